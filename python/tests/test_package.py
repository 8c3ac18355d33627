"""The package itself: its types are checked, its type declarations are the module's, everything public says what it is."""

from __future__ import annotations

import inspect
import os
import pathlib
import re
import subprocess
import sys

import pytest

import tendril
from tendril import messages

from conftest import SOURCE

PACKAGE = pathlib.Path(tendril.__file__).parent


def test_version_is_the_projects():
    text = (SOURCE / "CMakeLists.txt").read_text()
    assert tendril.__version__ == re.search(r"project\(tendril VERSION ([0-9.]+)", text)[1]


def test_type_declarations_are_the_modules(tmp_path):
    pytest.importorskip("nanobind")
    words = [sys.executable, "-P", "-m", "nanobind.stubgen", "-q", "-m", "tendril._core", "-o", str(tmp_path / "_core.pyi")]
    subprocess.run(words, check=True)
    kept = (SOURCE / "python" / "tendril" / "_core.pyi").read_text()
    assert (tmp_path / "_core.pyi").read_text() == kept, "write it anew: docs/howto/contribute.md"


def test_types_are_sound(tmp_path):
    pytest.importorskip("mypy")
    config = SOURCE / "python" / "pyproject.toml"
    words = [sys.executable, "-P", "-m", "mypy", "--config-file", str(config), "-p", "tendril"]
    environment = {"MYPY_CACHE_DIR": str(tmp_path), **os.environ}
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


def test_everything_public_is_described():
    for name in tendril.__all__:
        thing = getattr(tendril, name)
        assert thing.__doc__, name
        for part, method in inspect.getmembers(thing, callable):
            inherited = getattr(Exception, part, None) or getattr(tuple, part, None)
            if inspect.isclass(thing) and not part.startswith("_") and inherited is None:
                assert method.__doc__, f"{name}.{part}"


def test_messages_have_types_for_every_field():
    stub = (PACKAGE / "messages" / "__init__.pyi").read_text()
    for name in ("state_t", "cycle_t", "command_tip_t", "run_t"):
        block = stub.split(f"class {name}:")[1].split("\nclass ")[0]
        for field in getattr(messages, name).__slots__:
            assert f"    {field}: " in block, f"{name}.{field}"
