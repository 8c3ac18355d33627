#!/usr/bin/env python3
"""Types of the messages: message_stubs.py FOLDER FILE.lcm...

lcm-gen's Python has none. __init__.pyi is for editors and type checkers; the comment of each field, with its unit and
meaning, becomes its description. fields.py is for programs: each message's fields with LCM's types and lengths.
"""

import pathlib
import re
import sys

CONSTANT = re.compile(r"\s*const\s+\w+\s+(\w+)\s*=")
FIELD = re.compile(r"\s*(\w+)\s+(\w+)\s*((?:\[\w+\])*)\s*;\s*(?://\s*(.*))?$")
PLAIN = {"double": "float", "float": "float", "boolean": "bool", "string": "str"}
METHODS = """    def __init__(self) -> None: ...
    def encode(self) -> bytes: ...
    @staticmethod
    def decode(data: bytes) -> {name}: ...
    def get_hash(self) -> int: ...
"""


def kind(base, dimensions):
    if base == "byte" and dimensions:
        return "bytes"
    text = PLAIN.get(base, "int")
    for _ in range(dimensions.count("[")):
        text = f"Sequence[{text}]"
    return text


def fields(path):
    """Name, type and length of each field: the name of the field with it, a number, or None for one value."""
    found = []
    for match in filter(None, map(FIELD.match, path.read_text().splitlines())):
        base, name, dimensions, _ = match.groups()
        if base == "package":
            continue
        length = dimensions.strip("[]")
        if "[" in length:
            raise SystemExit(f"{path.name}: {name}: arrays of arrays have no place in fields.py")
        found.append((name, base, int(length) if length.isdigit() else length or None))
    return found


def table(files):
    lines = ['"""Fields of the messages of lcm_types, in their order. Written by message_stubs.py."""', ""]
    lines += ["FIELDS: dict[str, list[tuple[str, str, str | int | None]]] = {"]
    for path in files:
        lines += [f'    "{path.stem}": [', *(f"        {field!r}," for field in fields(path)), "    ],"]
    return "\n".join([*lines, "}"]) + "\n"


def stub(path):
    lines = [f"class {path.stem}:"]
    for line in path.read_text().splitlines():
        if line.startswith("package "):
            continue
        if constant := CONSTANT.match(line):
            lines.append(f"    {constant[1]}: int")
        elif field := FIELD.match(line):
            base, name, dimensions, meaning = field.groups()
            lines.append(f"    {name}: {kind(base, dimensions)}")
            if meaning:
                quotes = "'''" if '"' in meaning else '"""'
                lines.append(f"    {quotes}{meaning.strip()}{quotes}")
    return "\n".join(lines) + "\n" + METHODS.format(name=path.stem)


def main():
    folder, *files = map(pathlib.Path, sys.argv[1:])
    files.sort()
    head = '"""The messages of lcm_types, as lcm-gen -p writes them. Written by message_stubs.py."""\n\n'
    imports = "from collections.abc import Sequence\n\n"
    (folder / "__init__.pyi").write_text(head + imports + "\n".join(map(stub, files)))
    (folder / "fields.py").write_text(table(files))


if __name__ == "__main__":
    main()
