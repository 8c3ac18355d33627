"""The notebooks run, and print what they show in the documentation."""

from __future__ import annotations

import concurrent.futures

import nbformat
import pytest

nbclient = pytest.importorskip("nbclient")

from notebooks import FOLDER, differ, executed, texts  # noqa: E402


@pytest.fixture(scope="module")
def running(request):
    """Of each notebook that is to be tested, its run. Two at a time: one of them waits for its robot."""
    paths = [item.callspec.params["path"] for item in request.session.items if item.path == request.path]
    with concurrent.futures.ThreadPoolExecutor(2) as threads:
        yield {path: threads.submit(executed, path) for path in paths}
        threads.shutdown(cancel_futures=True)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook(running, path):
    kept = nbformat.read(path, as_version=4)
    for cell, before in zip(running[path].result().cells, kept.cells, strict=True):
        if "varies" in cell.metadata.get("tags", []):
            assert texts(before) or before.outputs, "run python/tests/notebooks.py --write"
        else:
            assert not differ(texts(cell), texts(before)), f"{texts(before)}\nnow:\n{texts(cell)}"
