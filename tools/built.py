"""Finds the project's own programs. Knows where builds put them."""
import os
import pathlib
import shutil

from workers import Wrong

BUILD = pathlib.Path(__file__).resolve().parent.parent / "build"


def find_program(name, given=None, option=None):
    """The program given; else by TENDRIL_BINARY (tendril alone), in a build of this checkout, in PATH."""
    environment = os.environ.get("TENDRIL_BINARY") if name == "tendril" else None
    places = [given] if given else [environment, BUILD / "bin" / name, BUILD / "release" / "bin" / name, shutil.which(name)]
    for place in places:
        if place and os.access(place, os.X_OK) and not os.path.isdir(place):
            return os.path.abspath(place)
    raise Wrong(f"no {name} program found{f' at {given}' if given else ''}; build it (tools/setup) or name it with {option or f'--{name}'} FILE")
