"""The command line of `tendril log export`, which hands over to `python -m tendril.export`."""

from __future__ import annotations

import argparse
import os
import pathlib
import signal
import sys
from collections.abc import Iterator
from typing import Any

from .. import _core
from .._command_line import Parser, stop_signals
from .._progress import Line
from ..errors import Error, install
from ..logs.batch import Part, Sorter
from .files import ExportError, NewFiles, new_files

DESCRIPTION = """A log as MCAP for Foxglove and PlotJuggler, with the robot drawn and a layout for each beside it, as
CSV or as Parquet. Every message of every channel is exported, damaged ones are left out and named. Files appear when
they are complete. The time of a message is its own utime; where it has none, when it was recorded."""
BATCH = 4096  # messages


def make_parser() -> argparse.ArgumentParser:
    parser = Parser(prog="tendril log export", description=DESCRIPTION)
    parser.add_argument("log", metavar="LOG", help="LCM log")
    parser.add_argument("--mcap", metavar="FILE", help="the MCAP file; layouts get its name")
    parser.add_argument("--csv", metavar="FOLDER", help="folder for CSV, one file a channel")
    parser.add_argument("--parquet", metavar="FOLDER", help="folder for Parquet, one file a channel")
    parser.add_argument(
        "--robot", metavar="FILE", help="robot file that is drawn, instead of the one in the log"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist")
    return parser


def open_log(path: str) -> _core.LogMessages:
    try:
        return _core.LogMessages(path)
    except Error as e:
        raise ExportError(str(e)) from None


def targets(options: argparse.Namespace, files: NewFiles) -> list[Any]:
    """What is written, each with write(parts), finish(about), and abandon() whether it is finished or not."""
    found: list[Any] = []
    try:
        if options.mcap:
            from .mcap_file import McapFile

            robot = _core.load_robot(options.robot) if options.robot else None
            found.append(McapFile(pathlib.Path(options.mcap), files, robot))
        if options.csv or options.parquet:
            from .tables import CsvFile, ParquetFile, Tables

            if options.csv:
                found.append(Tables(pathlib.Path(options.csv), files, CsvFile))
            if options.parquet:
                found.append(Tables(pathlib.Path(options.parquet), files, ParquetFile))
    except ImportError as e:
        raise ExportError(f"{e.name} is not installed; install it: {install('export')}") from None
    return found


def batches(log: _core.LogMessages, sorter: Sorter) -> Iterator[list[Part]]:
    while messages := log.next(BATCH):
        if parts := sorter.sort(messages):
            yield parts


def about(path: str, log: _core.LogMessages) -> dict[str, str]:
    return {
        "log": pathlib.Path(path).name.encode(errors="replace").decode(),
        "damage": log.damage(),
        "exported_by": f"Tendril {_core.version()} ({_core.revision()})",
    }


def export(options: argparse.Namespace) -> None:
    log = open_log(options.log)
    sorter, remarks, exported = Sorter(), [], 0
    with new_files(options.overwrite, [options.log, options.robot]) as files:
        found = targets(options, files)
        try:
            with Line() as line:
                for parts in batches(log, sorter):
                    for target in found:
                        target.write(parts)
                    exported += sum(len(part.places) for part in parts)
                    line("exporting", log.position / max(log.size, 1))
            if not exported:
                raise ExportError(no_message(options.log, log, sorter))
            for target in found:
                remarks += target.finish(about(options.log, log))
        finally:
            for target in found:
                target.abandon()
        written = files.paths
    for path in written:
        print(f"{path}: {path.stat().st_size / 1e6:.3f} MB")
    print(f"{exported} messages")
    if log.damage():
        remarks.append(f"damaged: {log.damage()}")
    for remark in remarks + sorter.remarks():
        print(f"tendril: log: {options.log}: {remark}", file=sys.stderr)


def no_message(path: str, log: _core.LogMessages, sorter: Sorter) -> str:
    why = "; ".join(sorter.remarks()) or log.damage() or "the file is empty"
    return f"{path}: no message that can be exported ({why}); accepted: LCM logs of a daemon, tendril sim or tendril demo"


def end_by_signal(number: int, _: Any) -> None:
    raise KeyboardInterrupt(number)


def main(arguments: list[str] | None = None) -> int:
    options = make_parser().parse_args(arguments)
    if not (options.mcap or options.csv or options.parquet):
        make_parser().error("no destination; give --mcap FILE, --csv FOLDER, --parquet FOLDER or several")
    if options.robot and not options.mcap:
        make_parser().error("--robot is drawn in an MCAP file; give --mcap, or leave it out")
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # names of files are any bytes
    for one in stop_signals():
        signal.signal(one, end_by_signal)
    try:
        export(options)
    except (ExportError, Error, ValueError) as e:
        print(f"tendril: log: {e}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as e:
        what = e.args[1] if len(e.args) > 1 else "nothing is written"
        print(f"tendril: log: ended; {what}", file=sys.stderr)
        return 128 + int(e.args[0])
    except OSError as e:
        if isinstance(e, BrokenPipeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            return 1
        print(f"tendril: log: {e.filename or options.log}: {e.strerror}; nothing is written", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
