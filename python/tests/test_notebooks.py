"""The notebooks run, and print what they show in the documentation."""

from __future__ import annotations

import nbformat
import pytest

nbclient = pytest.importorskip("nbclient")

from notebooks import FOLDER, differ, executed, texts  # noqa: E402


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook(path):
    kept = nbformat.read(path, as_version=4)
    for cell, before in zip(executed(path).cells, kept.cells, strict=True):
        if "varies" in cell.metadata.get("tags", []):
            assert texts(before) or before.outputs, "run python/tests/notebooks.py --write"
        else:
            assert not differ(texts(cell), texts(before)), f"{texts(before)}\nnow:\n{texts(cell)}"
