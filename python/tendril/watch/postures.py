"""A position-controlled robot: learned from its accepted runs, then each day weighed against these by a diagnosis. Its
commands need not be the same every day. Knows no database."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from .. import _core
from ..calibration import CalibratedChannel, calibrate
from ..data_set import DataSet
from ..diagnosis import diagnose
from ..errors import Error
from ..report import Cause, Report
from ..simulation import Progress
from .change import TWO_SIDED_95, Change, YEAR_days
from .day import accepted_runs, cause_json
from .store import Entry, Key, Number

HELD_OUT = "held_out_error"
_CHANNEL = re.compile(r"(turn of )?disk (\d+) (?:about )?([xyz])")
# Lines of every calibration and diagnosis of such a robot: of what it cannot show at all, of the floor and of files.
_ALWAYS = (
    "neither torques nor tensions",
    "the robot as learned from the runs before misses",
    "its numbers furthest from the file",
    "the file draws no pulleys",
)


def states(runs: DataSet) -> int | None:
    """None where these are not runs of a position-controlled robot.

    Raises:
        tendril.Error: motors and the same markers are not read together.
    """
    return _core.posture_states(runs._core)


def require_states(there: int, name: str) -> None:
    """Raises where the robot cannot be learned from so little, nor a day be weighed."""
    if there < (least := _core.least_posture_states):
        raise Error(
            f"{name}: {there} states of motors and markers, where a position-controlled robot needs {least} "
            "(a state is a mean over 0.25 s, or a row where these are further apart); record more"
        )


def learned(entry: Entry, runs: DataSet, progress: Progress) -> Entry:
    """The accepted state: by how much the robot that these runs teach misses its disks where it was not fitted to."""
    require_states(states(runs) or 0, entry.sources[0])
    found = calibrate(runs.robot, runs, progress=progress)
    if found.not_learned:
        raise Error(f"{entry.sources[0]}: {found.not_learned.strip()}")
    notes = [f"learned: {missed(found.channels, entry.sources[0])}", *runs.notes]
    notes += [line for line in found.notes if not line.startswith(_ALWAYS)]
    if not found.converged:
        notes.append("the numbers of the robot had not settled after the allowed steps")
    kept = [
        {"name": c.name, "unit": c.unit, "rms": c.held_out, "floor": c.floor, "discrepancy": c.discrepancy}
        for c in found.channels
    ]
    numbers = {Key(HELD_OUT, c.name, "rms"): Number(c.unit, c.held_out, 0, 0) for c in found.channels}
    return replace(entry, numbers=numbers, channels=kept, notes=list(dict.fromkeys(notes)), diagnosed=True)


def missed(channels: Sequence[CalibratedChannel], name: str) -> str:
    """By how much the learned robot misses each disk's place, in words."""
    squares: dict[str, float] = {}
    for channel in channels:
        turn, number, _ = _place(channel.name, name)
        if not turn:
            squares[f"disk {number}"] = squares.get(f"disk {number}", 0.0) + channel.held_out**2
    by = " / ".join(f"{1e3 * math.sqrt(square):.1f}" for square in squares.values())
    if not squares:
        return "from orientations alone"
    return f"it misses {', '.join(squares)} by {by} mm in states that it was not fitted to"


def _place(channel: str, source: str) -> tuple[bool, int, str]:
    """Turn or place, number of the disk, and axis; in the order in which the diagnosis lists its findings."""
    named = _CHANNEL.fullmatch(channel)
    if named is None:
        raise Error(
            f"{source}: compared by '{channel}', where a position-controlled robot is compared disk by disk; record "
            "positions of all motors, and the same markers in all runs"
        )
    return named[1] is not None, int(named[2]), named[3]


def diagnosed(
    entry: Entry, runs: DataSet, accepted: Entry, false_alarms_per_year: float, progress: Progress
) -> tuple[Entry, Report]:
    """A day: what the accepted robot misses of it, what may have changed, and how sure that is."""
    there = states(runs)
    if there is None:
        raise Error(
            f"{entry.sources[0]}: with torques or tensions, or without motors or markers, where robot "
            f"'{accepted.robot}' was accepted by motors and markers alone; accept it with runs like these"
        )
    require_states(there, entry.sources[0])
    report = diagnose(
        runs.robot, runs, accepted_runs(accepted), delta_m=accepted.delta_m, next=False, progress=progress
    )
    if report.verdict == "insufficient_data":
        raise Error(f"{entry.sources[0]}: {report.sentence}")
    channels = _channels(report, entry.sources[0])
    numbers = {Key(HELD_OUT, c["name"], "rms"): Number(c["unit"], c["rms"], 0, material(c)) for c in channels}
    for cause in report.causes:
        if "screened" not in cause.note:
            numbers |= _sizes(cause)
    notes = day_notes(runs.notes, report.degradations, accepted.notes, [run.name for run in runs])
    day = replace(entry, numbers=numbers, channels=channels, notes=notes, diagnosed=True)
    return replace(day, finding=finding(report, false_alarms_per_year)), report


def material(channel: dict[str, Any]) -> float:
    """Above the floor, where all of a disk's excess is on this axis: the diagnosis takes the floor off in squares, and
    the day's course shows the difference of the two."""
    return math.hypot(channel["floor"], channel["delta"]) - float(channel["floor"])


def day_notes(of_set: Sequence[str], told: Sequence[str], accepted: Sequence[str], runs: Sequence[str]) -> list[str]:
    """What was left out of a day, masked, or is doubtful, by the remarks on the set and those that the diagnosis told.
    Without what acceptance has said of the accepted runs, which every day is diagnosed with; there they are called
    'NAME@before'."""

    def is_known(line: str) -> bool:
        then = line.removeprefix("before: ").replace("@before", "")
        begin = tuple(f"{word}{name}: " for word in ("", "run ", "left out: ") for name in runs)
        own = then == line and line.startswith(begin)  # the day's run may be called as an accepted one
        return not own and any(then.startswith(note) for note in accepted)

    lines = [line for line in told if not line.startswith(_ALWAYS) and not is_known(line)]
    return list(dict.fromkeys([*of_set, *lines]))


def _channels(report: Report, source: str) -> list[dict[str, Any]]:
    """What is compared, disk by disk: missed by the robot as accepted, and what this missed of its own runs."""
    of_disks = [f for f in report.location if f.cut == "C4" and f.measured]
    names = sorted((c.channel for c in report.closed.channels.values()), key=lambda name: _place(name, source))
    return [
        {
            "name": name,
            "unit": report.closed.channels[name].unit,
            "rms": report.closed.channels[name].before,
            "floor": report.closed.channels[name].floor,
            "delta": of_disks[i // 3].delta,
        }
        for i, name in enumerate(names)
    ]


def _sizes(cause: Cause) -> dict[Key, Number]:
    """The parameters of a cause, as if it alone had changed."""
    sizes = {}
    for name, p in cause.parameters.items():
        if p.value is not None and p.ci[0] is not None and p.ci[1] is not None:
            deviation = (p.ci[1] - p.ci[0]) / 2 / TWO_SIDED_95
            sizes[Key(cause.effect, cause.where, name)] = Number(p.unit, p.value, deviation, 0)
    return sizes


def finding(report: Report, false_alarms_per_year: float) -> dict[str, Any]:
    """Of a day that differs: an alarm only where so many days without a change would hardly show it."""
    none = max(0.0, next((cause.p for cause in report.causes if cause.effect == "no_gap"), 0.0))
    differs = report.verdict != "no_gap"
    return {
        "alarm": differs and none <= false_alarms_per_year / YEAR_days,
        "false_alarms_per_year": false_alarms_per_year,
        "unchanged": none,
        "changes": [],  # follow from the days before, too
        "cause": cause_json(report, "") if differs else None,
    }


def changes(days: Sequence[Entry]) -> list[Change]:
    """The sizes of what the last day's diagnosis names, the surest first; none without an alarm. `days`: by time."""
    if not days or not days[-1].finding.get("alarm"):
        return []
    last = days[-1]
    found = []
    for key, number in last.numbers.items():
        if not _names(last, key):
            continue
        since = last.at
        for day in reversed(days[:-1]):
            if not _names(day, key):
                break
            since = day.at
        found.append(_change(key, number, since))
    return sorted(found, key=lambda change: -abs(change.z))


def _names(day: Entry, key: Key) -> bool:
    cause = day.finding.get("cause")
    return cause is not None and any((c["effect"], c["where"]) == (key.effect, key.where) for c in cause["causes"])


def _change(key: Key, number: Number, since: float) -> Change:
    amount = number.value - unchanged(key)
    return Change.of(
        key,
        number.unit,
        amount,
        number.deviation,
        shape="step",
        since=since,
        per_day=None,
        z=amount / number.deviation if number.deviation > 0 else 0.0,
        # The diagnosis has decided on both.
        threshold=0.0,
        material=0.0,
    )


def unchanged(key: Key) -> float:
    """An effect's parameter where there is none of it."""
    return 1.0 if key.name.endswith("scale") else 0.0


def with_unchanged(accepted: Entry, days: Sequence[Entry]) -> Entry:
    """The accepted state with every number that only days have, as it is where nothing changed."""
    new = {
        key: Number(number.unit, unchanged(key), 0, 0)
        for day in days
        for key, number in day.numbers.items()
        if key not in accepted.numbers
    }
    return replace(accepted, numbers={**accepted.numbers, **new})
