"""What the words of the command line are: logs, a data set, or a diagnosis with its runs."""

from __future__ import annotations

import pathlib

from . import diagnosis, logs, robots, sets
from .frames import Recording, ViewError

ACCEPTED = (
    "LCM logs (.lcmlog) or folders with one, data-set folders (runs.yaml), CSV files with --robot, or the report.json "
    "of tendril gap diagnose, or its folder, and the runs that it was made from"
)


def is_log(path: pathlib.Path) -> bool:
    if path.suffix == ".lcmlog":
        return True
    try:
        with path.open("rb") as file:
            return file.read(4) == logs.LCM_SYNC
    except OSError:
        return False


def report_of(path: pathlib.Path) -> pathlib.Path | None:
    """The report.json that this is or holds."""
    if path.is_dir() and (path / "report.json").is_file():
        return path / "report.json"
    return path if path.is_file() and path.suffix == ".json" else None


def logs_of(path: pathlib.Path) -> list[pathlib.Path]:
    """The logs that this is or holds, unless it is a data set."""
    if path.is_file():
        return [path] if is_log(path) else []
    return [] if (path / "runs.yaml").is_file() else sorted(path.glob("*.lcmlog"))


def name_of(log: pathlib.Path) -> str:
    """A log is always called run.lcmlog, so it is named by its folder."""
    return log.resolve().parent.name if log.stem == "run" else log.stem


def open_sources(words: list[str], robot: str | None) -> list[Recording]:
    """At least one recording; ViewError says what is wrong with a word and what is accepted."""
    paths = [pathlib.Path(word) for word in words]
    for path in paths:
        if not path.exists():
            raise ViewError(f"'{path}': no such file or folder; accepted: {ACCEPTED}")
    report = report_of(paths[0])
    if report is not None:
        if robot is not None:
            raise ViewError(f"{report} holds the robot that it is about; leave out --robot")
        return diagnosis.read_diagnosis(report, words[1:])
    given = robots.load_robot(robot) if robot is not None else None
    found = [logs_of(path) for path in paths]
    if all(found):
        recordings = []
        for log in (log for of_path in found for log in of_path):
            recording = logs.read_log(log, given)
            recording.title = name_of(log)
            recordings.append(recording)
        return recordings
    for path in paths:
        if path.is_dir() and not any(path.iterdir()):
            raise ViewError(f"'{path}': the folder is empty; accepted: {ACCEPTED}")
        if path.is_file() and path.suffix not in (".csv", ".txt", ".tsv") and not is_log(path):
            raise ViewError(f"'{path}': neither a log, a table nor a report; accepted: {ACCEPTED}")
    return sets.read_set(words, given)
