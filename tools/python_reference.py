#!/usr/bin/env python3
"""Writes the reference of the Python package from its sources: python_reference.py PACKAGE REFERENCE

PACKAGE is python/tendril, REFERENCE the folder of the generated reference. Imports nothing: signatures and descriptions
are read as text, those of the compiled module from its type declarations (_core.pyi).
"""

import ast
import inspect
import pathlib
import re
import sys

INTRODUCTION = """# Python

The package `tendril`: what its functions and classes take and give. All quantities are in SI units, positions are in the
base frame F_0. K sections, N units, M tendons, S samples. How to install and use it: [Python](../guides/python.md).

"""


def definitions(package):
    """Every public class and function of the package by its name."""
    found = {}
    for path in [*sorted(package.glob("*.py")), package / "_core.pyi"]:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
                found.setdefault(node.name, node)
    return found


def exported(package):
    for node in ast.parse((package / "__init__.py").read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return ast.literal_eval(node.value)
    raise SystemExit("python_reference: no __all__ in __init__.py")


def signature(function):
    arguments = ast.unparse(function.args)
    arguments = re.sub(r"^(self|cls)(, )?", "", arguments)
    arguments = re.sub(r"Annotated\[NDArray\[numpy\.float64\], dict\([^)]*\)*\]", "Array", arguments)
    result = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    line = f"{function.name}({arguments}){result}".replace("_os.", "os.").replace("_core.", "")
    if len(line) < 90:
        return line
    # A comma that separates arguments is followed by a name or a star.
    each = re.split(r", (?=\*|\w+[:=])", arguments)
    rows = "".join(f"    {argument},\n" for argument in each)
    return f"{function.name}(\n{rows}){result}".replace("_os.", "os.").replace("_core.", "")


def text(documented):
    """A docstring as Markdown: its sections Args, Returns and Raises become lists."""
    lines = []
    section = False
    for line in inspect.cleandoc(documented).splitlines():
        section = section or re.fullmatch(r"(Args|Returns|Raises|Attributes):.*", line)
        if re.fullmatch(r"(Args|Returns|Raises|Attributes):.*", line):
            lines += ["", f"**{line}**" if line.endswith(":") else line, ""]
        elif match := re.fullmatch(r"    (\w[\w.]*(?:, \w+)*): (.*)", line):
            lines.append(f"- `{match[1]}`: {match[2]}")
        elif line.startswith("    ") and lines and lines[-1].startswith(("- ", "  ")):
            lines.append("  " + line.strip())
        else:
            lines.append(line.removeprefix("    ") if section else line)
    return "\n".join(lines).replace("<", "&lt;") + "\n"


def fields(node):
    """Attributes with the text below each, and properties."""
    rows = []
    for at, item in enumerate(node.body):
        follows = node.body[at + 1] if at + 1 < len(node.body) else None
        if isinstance(item, ast.AnnAssign) and not item.target.id.startswith("_"):
            is_text = isinstance(follows, ast.Expr) and isinstance(follows.value, ast.Constant)
            rows.append((item.target.id, ast.unparse(item.annotation), follows.value.value if is_text else ""))
        elif is_property(item):
            kind = ast.unparse(item.returns) if item.returns else ""
            rows.append((item.name, kind, ast.get_docstring(item) or ""))
    return rows


def is_property(node):
    return isinstance(node, ast.FunctionDef) and "property" in [ast.unparse(d) for d in node.decorator_list]


def table(rows):
    lines = ["| attribute | type | |", "|---|---|---|"]
    for name, kind, meaning in rows:
        kind = "array" if "NDArray" in kind or kind == "Array" else kind
        lines.append(f"| `{name}` | {kind} | {' '.join(meaning.split())} |".replace("<", "&lt;").replace(" | None", " or None"))
    return "\n".join(lines) + "\n"


def class_page(node):
    parts = [f"## {node.name}\n", text(ast.get_docstring(node) or "")]
    if rows := fields(node):
        parts.append(table(rows))
    for item in node.body:
        public = isinstance(item, ast.FunctionDef) and not item.name.startswith("_") and not is_property(item)
        if public and ast.get_docstring(item):
            parts.append(f"### {node.name}.{item.name}\n\n```python\n{signature(item)}\n```\n")
            parts.append(text(ast.get_docstring(item)))
    return parts


def main():
    if len(sys.argv) != 3:
        sys.exit("usage: python_reference.py PACKAGE REFERENCE")
    package, out = map(pathlib.Path, sys.argv[1:])
    found = definitions(package)
    names = exported(package)
    functions = [found[name] for name in names if isinstance(found[name], ast.FunctionDef)]
    classes = [found[name] for name in names if isinstance(found[name], ast.ClassDef)]
    parts = [INTRODUCTION]
    for node in functions:
        parts.append(f"## {node.name}\n\n```python\n{signature(node)}\n```\n")
        parts.append(text(ast.get_docstring(node) or ""))
    for node in classes:
        parts += class_page(node)
    (out / "python.md").write_text("\n".join(parts))
    with open(out / "index.md", "a") as index:
        index.write("| [Python](python.md) | The package `tendril`: what its functions and classes take and give. |\n")


if __name__ == "__main__":
    main()
