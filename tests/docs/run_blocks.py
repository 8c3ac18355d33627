#!/usr/bin/python3 -B
"""Runs the shell blocks of a documentation page and compares what they print with what the page shows.

A block to run is fenced ```{.sh .run}, ```{.sh .live} where it needs LCM (--kind live, under tests/tools/own_network.sh),
or ```{.sh .vcan} where it needs a virtual CAN bus (--kind vcan, under tools/vcan-run); the block of class `output` that
follows it shows its standard output. Blocks of one kind run in order in one fresh folder, with the programs of --bin
first on PATH and the source tree in $TENDRIL. In an output block "..." matches anything: on a line of its own any
number of lines, within a line any text. Spaces count as one. Numbers must be equal unless the block says tolerance="5%".
A page on data that are no part of the project is skipped (exit status 77) where --data names no folder.
"""
import argparse
import contextlib
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile

FENCE = re.compile(r"^( *)(`{3,})\s*(.*?)\s*$")
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w])")
KINDS = {"run", "live", "vcan"}
# Of one block, on a machine that does other things as well.
TIME_LIMIT_S = 600


class PageError(Exception):
    """A page that cannot be read as one that runs."""


class Block:
    def __init__(self, line, attributes, text):
        self.line = line
        self.text = text
        self.classes = set(re.findall(r"\.([\w-]+)", re.sub(r'"[^"]*"', "", attributes)))
        self.values = dict(re.findall(r'([\w-]+)="([^"]*)"', attributes))


def blocks_of(page):
    """All fenced blocks of a page, with the line of their fence."""
    blocks, fence, indent, start, attributes, lines = [], None, 0, 0, "", []
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        match = FENCE.match(line)
        if fence is None:
            if match:
                indent, fence, start, attributes, lines = len(match[1]), match[2], number, match[3], []
        elif match and match[2] == fence and not match[3]:
            blocks.append(Block(start, attributes, "\n".join(lines)))
            fence = None
        else:
            lines.append(line[indent:] if not line[:indent].strip() else line)
    if fence is not None:
        raise PageError(f"line {start}: the block is not closed")
    return blocks


def tolerance_of(block):
    text = block.values.get("tolerance", "0%")
    match = re.fullmatch(r"(\d+(?:\.\d+)?)%", text)
    if not match:
        raise PageError(f'line {block.line}: tolerance="{text}" is no percentage')
    return float(match[1]) / 100


def steps_of(page, kind):
    """Pairs of a block of this kind and the output that the page shows for it, or None."""
    steps = []
    for block in blocks_of(page):
        if block.classes & KINDS:
            steps.append([block, None])
        elif "output" in block.classes:
            if not steps or steps[-1][1]:
                raise PageError(f"line {block.line}: an output block that follows no block to run")
            tolerance_of(block)
            steps[-1][1] = block
    return [step for step in steps if kind in step[0].classes]


def line_matches(expected, actual, tolerance):
    """Whether a line is as the page shows it; numbers within the tolerance, "..." any text."""
    expected, actual = " ".join(expected.split()), " ".join(actual.split())
    pieces, position, wanted = [], 0, []
    for match in re.finditer(r"\.\.\.|" + NUMBER.pattern, expected):
        pieces.append(re.escape(expected[position:match.start()]))
        if match[0] == "...":
            pieces.append(".*")
        else:
            pieces.append("(" + NUMBER.pattern.replace("(?<![\\w.])", "") + ")")
            wanted.append(match[0])
        position = match.end()
    pieces.append(re.escape(expected[position:]))
    found = re.fullmatch("".join(pieces), actual)
    return bool(found) and all(number_matches(a, b, tolerance) for a, b in zip(wanted, found.groups()))


def number_matches(expected, actual, tolerance):
    return expected == actual or (tolerance > 0 and
                                  abs(float(actual) - float(expected)) <= tolerance * abs(float(expected)))


def output_matches(expected, actual, tolerance):
    """Whether all lines match in order; a line "..." stands for any number of lines."""
    if not expected:
        return not actual
    if expected[0].strip() == "...":
        return any(output_matches(expected[1:], actual[skipped:], tolerance) for skipped in range(len(actual) + 1))
    return bool(actual) and line_matches(expected[0], actual[0], tolerance) and \
        output_matches(expected[1:], actual[1:], tolerance)


def run_block(text, folder, environment):
    """Exit status, standard output, standard error; what the block started ends with it."""
    # "-e" and "pipefail": a failing command in the middle of a block fails it.
    process = subprocess.Popen(["bash", "-e", "-o", "pipefail", "-c", text], cwd=folder, env=environment, text=True,
                               stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               start_new_session=True)
    try:
        out, err = process.communicate(timeout=TIME_LIMIT_S)
        return process.returncode, out, err
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        out, err = process.communicate()
        return f"none after {TIME_LIMIT_S} s", out, err
    finally:
        # A block that fails half way leaves the programs that it started in the background.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def indented(text):
    return "\n".join("    " + line for line in text.splitlines()) or "    (nothing)"


def run_page(page, binaries, source, kind="run", keep=None):
    """None when every block did as the page says, else what the first that did not did. `keep`: a folder to run in."""
    steps = steps_of(page, kind)
    if not steps:
        return f"{page}: no block to run"
    environment = dict(os.environ, TENDRIL=str(source), LC_ALL="C.UTF-8",
                       PATH=f"{binaries}{os.pathsep}{os.environ.get('PATH', '')}")
    with contextlib.nullcontext(keep) if keep else tempfile.TemporaryDirectory(prefix="tendril-page-") as folder:
        for block, shown in steps:
            status, out, err = run_block(block.text, folder, environment)
            expected_status = int(block.values.get("exit", "0"))
            if status != expected_status:
                return (f"{page}:{block.line}: exit status {status}, expected {expected_status}\n{indented(block.text)}\n"
                        f"  standard output\n{indented(out)}\n  standard error\n{indented(err)}")
            if shown and not output_matches(lines_of(shown.text), lines_of(out), tolerance_of(shown)):
                return (f"{page}:{shown.line}: the output of the block at line {block.line} differs\n"
                        f"{indented(block.text)}\n  expected\n{indented(shown.text)}\n  actual\n{indented(out)}")
    return None


def named_folder(text):
    name, equals, folder = text.partition("=")
    if not (name.isidentifier() and equals and folder):
        raise argparse.ArgumentTypeError(f"'{text}': expected NAME=FOLDER")
    return name, pathlib.Path(folder)


@contextlib.contextmanager
def shortened(name, rows):
    """In this context $NAME is a folder of the same tables with their first rows only."""
    if not (name and rows):
        yield
        return
    with tempfile.TemporaryDirectory(prefix="tendril-tables-") as folder:
        for table in sorted(pathlib.Path(os.environ[name]).glob("*.csv")):
            lines = table.read_text(encoding="utf-8").splitlines(keepends=True)
            (pathlib.Path(folder) / table.name).write_text("".join(lines[:1 + rows]), encoding="utf-8")
        os.environ[name] = folder
        yield


def lines_of(text):
    """Lines without the empty ones: a blank line has no meaning in a page."""
    return [line for line in text.splitlines() if line.strip()]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", type=pathlib.Path, help="Markdown file")
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder with the built programs")
    parser.add_argument("--source", type=pathlib.Path, required=True, help="source tree, $TENDRIL in the blocks")
    parser.add_argument("--kind", choices=sorted(KINDS), default="run", help="which blocks")
    parser.add_argument("--data", metavar="NAME=FOLDER", type=named_folder, default=("", None),
                        help="tables of the page: $NAME in the blocks")
    parser.add_argument("--rows", type=int, default=0, help="of each of them, from the first (default: all)")
    parser.add_argument("--keep", type=pathlib.Path, help="an empty folder to run in, that stays")
    options = parser.parse_args()
    if not shutil.which("bash"):
        sys.exit("run_blocks: bash is not installed")
    name, folder = options.data
    if options.rows < 0 or (options.rows and not name):
        parser.error("--rows: accepted are 1 and more, beside --data")
    if name and not folder.is_dir():
        print(f"skipped: no {folder}")
        sys.exit(77)
    if name:
        os.environ[name] = str(folder.resolve())
    try:
        with shortened(name, options.rows):
            failure = run_page(options.page, options.bin.resolve(), options.source.resolve(), options.kind,
                               options.keep)
    except (OSError, PageError) as error:
        sys.exit(f"{options.page}: {error}")
    if failure:
        sys.exit(failure)
    print(f"{options.page}: {len(steps_of(options.page, options.kind))} block(s) as shown")


if __name__ == "__main__":
    main()
