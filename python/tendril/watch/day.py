"""From runs to an entry, and from an alarm to its cause. Knows no database."""

from __future__ import annotations

import datetime
import os
import pathlib
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from .. import _core
from ..data_set import DataSet
from ..diagnosis import diagnose
from ..errors import Error
from ..report import Report
from ..simulation import Progress
from ..tracking import track
from .change import Change
from .store import Entry, Key, Number

_REMEDY = "put the runs back as they were, or accept the robot anew: tendril gap accept"
_DATED = re.compile(r"\d{4}-\d{2}-\d{2}")


def read_runs(paths: Sequence[str], robot_file: str, same_robot: bool) -> DataSet:
    """The runs of one entry. A robot file that differs from the runs' own is refused as by `tendril gap diagnose`."""
    return DataSet.from_folder(*paths, robot=robot_file, same_robot=same_robot)


def recorded_at(paths: Sequence[str]) -> float:
    """The last date that names begin with (its noon, UTC); without such, when the newest file was written."""
    dates = [_DATED.match(pathlib.Path(path).absolute().name) for path in paths]
    if all(dates):
        last = max(date.group() for date in dates if date)
        try:
            return datetime.datetime.fromisoformat(f"{last}T12:00:00+00:00").timestamp()
        except ValueError:
            pass  # looks like a date only
    return max(map(written_at, paths), default=0.0)


def written_at(path: str) -> float:
    """When the newest file of a folder, or the file, was written."""
    return max((file.stat().st_mtime for file in _files(pathlib.Path(path))), default=0.0)


def _files(path: pathlib.Path) -> list[pathlib.Path]:
    return [file for file in (path.rglob("*") if path.is_dir() else [path]) if file.is_file()]


def in_folders(folders: Sequence[str]) -> list[str]:
    """The folders, logs and tables in these, as absolute paths in order of time."""
    found = []
    for folder in folders:
        if not os.path.isdir(folder):
            raise Error(
                f"{folder}: no folder; with --each give folders that have an entry's runs in each item"
            )
        for name in os.listdir(folder):
            path = os.path.join(os.path.abspath(folder), name)
            if not name.startswith(".") and (os.path.isdir(path) or name.endswith((".lcmlog", ".csv"))):
                found.append(path)
    return sorted(found, key=lambda path: (recorded_at([path]), path))


def unmeasured(runs: DataSet, paths: Sequence[str], at: float) -> Entry:
    """What the entry is of, without its numbers."""
    sources = [os.path.abspath(path) for path in paths]
    hashes = {run.name: run.sha256 for run in runs}
    families = sorted({run.family for run in runs})
    build = f"{_core.version()} ({_core.revision()})"
    return Entry(runs.robot.name, at, {}, hashes, families, sources, build=build)


def measured(entry: Entry, runs: DataSet, accepted: Entry | None, progress: Progress) -> Entry:
    """With its numbers, weighed as those of the accepted state; `accepted` None: as such a state."""
    reference = accepted or entry
    found = track(
        runs.robot,
        runs,
        delta_N=reference.delta_N,
        delta_m=reference.delta_m,
        discrepancy={channel["name"]: channel["discrepancy"] for channel in accepted.channels}
        if accepted
        else None,
        progress=progress,
    )
    numbers = {
        Key(p.effect, p.where, p.name): Number(p.unit, p.value, p.deviation, p.material)
        for p in found.parameters
    }
    return replace(
        entry, numbers=numbers, channels=[vars(c) for c in found.channels], notes=list(found.notes)
    )


def accepted_runs(accepted: Entry) -> DataSet:
    """The runs of an accepted state; Error, with what to do, where they are not what they were."""
    robot = _core.parse_robot(accepted.robot_yaml, f"robot '{accepted.robot}' as accepted")
    if gone := [source for source in accepted.sources if not os.path.exists(source)]:
        raise Error(f"{gone[0]}: no longer there; {_REMEDY}")
    try:
        runs = DataSet.from_folder(*accepted.sources, robot=robot, same_robot=True)
    except (Error, ValueError) as error:
        raise Error(f"{str(error).splitlines()[0]}; these are accepted runs: {_REMEDY}") from None
    if {run.name: run.sha256 for run in runs} != accepted.runs:
        raise Error(f"{accepted.sources[0]}: changed since it was accepted; {_REMEDY}")
    return runs


def name_cause(runs: DataSet, accepted: Entry, progress: Progress) -> tuple[Report, str]:
    """The diagnosis of the change since the accepted runs, or, where they are gone or of other motions, of the
    gap to the accepted robot; and a remark on that."""

    def diagnosed(before: DataSet | None) -> Report:
        return diagnose(
            runs.robot,
            runs,
            before,
            delta_N=accepted.delta_N,
            delta_m=accepted.delta_m,
            next=False,
            progress=progress,
        )

    try:
        return diagnosed(accepted_runs(accepted)), ""
    except Error as error:
        return diagnosed(None), f"diagnosed without the accepted runs: {str(error).splitlines()[0]}"


def finding(changes: Sequence[Change], false_alarms_per_year: float) -> dict[str, Any]:
    """What is kept of a day beside its numbers."""
    return {
        "alarm": any(change.alarm for change in changes),
        "false_alarms_per_year": false_alarms_per_year,
        "changes": [change.as_json() for change in changes],
        "cause": None,
    }


def cause_json(report: Report, remark: str) -> dict[str, Any]:
    """What an alarm keeps of its diagnosis: the causes established, with all that the runs cannot tell from them."""
    groups = {cause.group for cause in report.accepted} - {0}
    named = [c for c in report.causes if c.group in groups] if groups else report.accepted
    return {
        "verdict": report.verdict,
        "sentence": report.sentence,
        "remark": remark,
        "established": bool(named),
        "one_of_them": bool(groups),
        "causes": [{"effect": c.effect, "where": c.where, "p": c.p} for c in named],
    }


def headline(changes: Sequence[Change], cause: dict[str, Any] | None) -> Change | None:
    """The change to be named: that of the established cause where it is among them, else the surest that matters."""
    if cause and cause["established"]:
        for named in cause["causes"]:
            for change in changes:
                if (change.effect, change.where) == (named["effect"], named["where"]):
                    return change
    return next((change for change in changes if change.alarm), None)
