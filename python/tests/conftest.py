"""What the tests share: files of the checkout, and the program whose results they compare with."""

from __future__ import annotations

import os
import pathlib
import subprocess

import pytest

import tendril

SOURCE = pathlib.Path(os.environ.get("TENDRIL_SOURCE", pathlib.Path(__file__).parents[2]))
ROBOTS = SOURCE / "config" / "robots"


@pytest.fixture(scope="session")
def rig() -> tendril.Robot:
    return tendril.load_robot(ROBOTS / "rig_60mm.yaml")


def program(*words: object, text: str = "") -> str:
    """What `tendril WORDS` prints, with `text` as its input."""
    done = subprocess.run(
        ["tendril", *map(str, words)], input=text, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture()
def served():
    """A server of the view on any free port."""
    from tendril.view import server

    opened = server.start(0, "test")
    yield opened
    server.stop(opened)


@pytest.fixture(scope="session")
def circle(tmp_path_factory):
    """A log of a robot whose tip goes round."""
    import view_help

    return view_help.circle_log(tmp_path_factory.mktemp("logs") / "circle.lcmlog")
