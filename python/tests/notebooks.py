#!/usr/bin/env python3
"""Runs the notebooks. `notebooks.py --write` keeps their outputs in them, which the documentation shows."""

from __future__ import annotations

import argparse
import math
import os
import pathlib
import re
from typing import Any

import nbclient
import nbformat

FOLDER = pathlib.Path(os.environ.get("TENDRIL_SOURCE", pathlib.Path(__file__).parents[2])) / "python" / "notebooks"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def executed(path: pathlib.Path) -> Any:
    """The notebook after every cell has run, in its own folder."""
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(path.parent)}})
    return client.execute()


def texts(cell: Any) -> str:
    """What a cell printed and showed as text; None of its pictures."""
    parts = []
    for output in cell.get("outputs", []):
        if output.output_type == "stream":
            parts.append(output.text)
        elif not any(kind.startswith("image/") for kind in output.get("data", {})):
            parts.append(output.get("data", {}).get("text/plain", ""))
    return "".join(parts)


def differ(a: str, b: str) -> bool:
    """Whether two outputs say something else. Another processor may round the last digit otherwise."""
    if NUMBER.split(a) != NUMBER.split(b):
        return True
    pairs = zip(map(float, NUMBER.findall(a)), map(float, NUMBER.findall(b)))
    return not all(math.isclose(x, y, rel_tol=0.02, abs_tol=2e-3) for x, y in pairs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("notebooks", nargs="*", type=pathlib.Path)
    options = parser.parse_args()
    for path in options.notebooks or sorted(FOLDER.glob("*.ipynb")):
        notebook = executed(path.resolve())
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)  # when each cell ran
            print(texts(cell), end="")
        notebook.metadata.language_info = {"name": "python"}
        if options.write:
            nbformat.write(notebook, path)


if __name__ == "__main__":
    main()
