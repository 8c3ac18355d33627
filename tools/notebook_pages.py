#!/usr/bin/env python3
"""Writes the notebooks with their outputs as pages of the documentation: notebook_pages.py NOTEBOOKS OUT

Knows nothing of what they say. Outputs are those kept in the notebooks (python/tests/notebooks.py --write).
"""

import base64
import json
import pathlib
import sys


def fenced(text, language=""):
    mark = "```" if "```" not in text else "````"
    return f"{mark}{language}\n{text.rstrip()}\n{mark}\n"


def shown(output, picture):
    """A cell's output as Markdown; a picture goes into the file `picture`."""
    if output["output_type"] == "stream":
        return fenced("".join(output["text"]), "text")
    data = output.get("data", {})
    if "image/png" in data:
        picture.write_bytes(base64.b64decode(data["image/png"]))
        return f"![output of the cell above]({picture.name})\n"
    return fenced("".join(data.get("text/plain", "")), "text")


def page(notebook, out):
    parts = []
    for number, cell in enumerate(json.loads(notebook.read_text())["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source + "\n")
            continue
        parts.append(fenced(source, "python"))
        parts += [
            shown(output, out / f"{notebook.stem}-{number}-{k}.png") for k, output in enumerate(cell["outputs"])
        ]
    parts.append(f"The notebook: `python/notebooks/{notebook.name}`.\n")
    (out / f"{notebook.stem.replace('_', '-')}.md").write_text("\n".join(parts))


def main():
    if len(sys.argv) != 3:
        sys.exit("usage: notebook_pages.py NOTEBOOKS OUT")
    source, out = map(pathlib.Path, sys.argv[1:])
    out.mkdir(parents=True, exist_ok=True)
    for notebook in sorted(source.glob("*.ipynb")):
        page(notebook, out)


if __name__ == "__main__":
    main()
