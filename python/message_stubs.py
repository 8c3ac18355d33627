#!/usr/bin/env python3
"""Types of the messages for editors and type checkers: message_stubs.py OUT FILE.lcm...

lcm-gen's Python has none. The comment of each field, with its unit and meaning, becomes its description.
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
    out, *files = map(pathlib.Path, sys.argv[1:])
    head = '"""The messages of lcm_types, as lcm-gen -p writes them. Written by message_stubs.py."""\n\n'
    imports = "from collections.abc import Sequence\n\n"
    out.write_text(head + imports + "\n".join(stub(path) for path in sorted(files)))


if __name__ == "__main__":
    main()
