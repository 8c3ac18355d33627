"""A position-controlled robot: learned from its accepted runs, then each day weighed against these by a diagnosis. Its
commands need not be the same every day. Knows no database."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

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
# As the diagnosis counts (src/gap/postures): it learns a robot from so many states, each a mean over such a time.
LEAST_STATES, STATE_s, ROUNDING = 40, 0.25, 1e-6
# And does not take for learned what is missed, everywhere, by more than this share of its motion.
MOST_MISSED = 0.5

Columns = dict[str, npt.NDArray[np.float64]]
_MOTOR, _PULL = re.compile("motor_position_"), re.compile("torque_|tension_")
_PLACE, _TURN = re.compile("(tip|disk)_[xyz]_m"), re.compile("(tip|disk)_q[wxyz]")


def columns(runs: DataSet) -> list[Columns]:
    """The readings of each run by column; columns without any are left out."""
    found = []
    for run in runs:
        names, values = _core.table_of(run)
        read = np.asarray(np.isfinite(values).any(axis=0))
        found.append({name: values[:, i] for i, name in enumerate(names) if read[i]})
    return found


def shown(tables: Sequence[Columns]) -> bool:
    """Every run has positions of motors and of disks, by place or orientation, and neither torques nor tensions."""
    return bool(tables) and all(
        any(map(_MOTOR.match, table))
        and any(_PLACE.match(name) or _TURN.match(name) for name in table)
        and not any(map(_PULL.match, table))
        for table in tables
    )


def states(tables: Sequence[Columns]) -> int:
    """Times in which every motor was read, and every disk that all runs show."""
    common = set.intersection(*({n for n in table if _PLACE.match(n) or _TURN.match(n)} for table in tables))
    count = 0
    for table in tables if common else ():
        used = [name for name in table if _MOTOR.match(name) or name in common]
        read = np.isfinite(np.stack([table[name] for name in used], axis=1))
        time = table["t_s"]
        number = np.floor((time - time[0]) / STATE_s + ROUNDING)
        first = np.flatnonzero(np.diff(number, prepend=-1.0))
        count += int(np.logical_or.reduceat(read, first, axis=0).all(axis=1).sum())
    return count


def require_states(tables: Sequence[Columns], name: str) -> None:
    """Raises where the robot cannot be learned from so little, nor a day be weighed."""
    if (there := states(tables)) < LEAST_STATES:
        raise Error(
            f"{name}: {there} states of motors and markers, where a position-controlled robot needs {LEAST_STATES} "
            f"(a state is a mean over {STATE_s} s, or a row where these are further apart); record more"
        )


def learned(entry: Entry, runs: DataSet, progress: Progress) -> Entry:
    """The accepted state: by how much the robot that these runs teach misses its disks where it was not fitted to."""
    tables = columns(runs)
    require_states(tables, entry.sources[0])
    found = calibrate(runs.robot, runs, progress=progress)
    note = require_learned(found.channels, tables, entry.sources[0])
    kept = [
        {"name": c.name, "unit": c.unit, "rms": c.held_out, "floor": c.floor, "discrepancy": c.discrepancy}
        for c in found.channels
    ]
    numbers = {Key(HELD_OUT, c.name, "rms"): Number(c.unit, c.held_out, 0, 0) for c in found.channels}
    return replace(entry, numbers=numbers, channels=kept, notes=[*note, *runs.notes], diagnosed=True)


def require_learned(channels: Sequence[CalibratedChannel], tables: Sequence[Columns], name: str) -> list[str]:
    """How well, as a note. Raises where the robot is not the one of the file: no day could be weighed against it."""
    squares: dict[str, float] = {}
    for channel in channels:
        if channel.unit != "m":
            return []  # what orientations miss has no such yardstick here; the diagnosis of a day has it
        disk = channel.name.rsplit(" ", 1)[0]
        squares[disk] = squares.get(disk, 0.0) + channel.held_out**2
    moved = [_motion(tables, disk) for disk in squares]
    missed = [math.sqrt(square) for square in squares.values()]
    missed_mm, moved_mm = (" / ".join(f"{1e3 * m:.1f}" for m in all_of) for all_of in (missed, moved))
    words = (
        f"it misses {', '.join(squares)} by {missed_mm} mm in states that it was not fitted to, where they move by "
        f"{moved_mm} mm"
    )
    if all(m >= MOST_MISSED * way for m, way in zip(missed, moved, strict=True)):
        raise Error(
            f"{name}: the robot cannot be learned from these runs: {words}; check lengths, holes, directions of motors "
            "and the frame in robot file and map"
        )
    return [f"learned: {words}"]


def _motion(tables: Sequence[Columns], disk: str) -> float:
    """Rms distance of 'disk 3' from its mean; the tip stands for a disk without columns of its own."""
    number = disk.split()[1]
    square = 0.0
    for axis in "xyz":
        names = (f"disk_{axis}_m_{number}", f"tip_{axis}_m")
        values = np.concatenate([t.get(names[0], t.get(names[1], np.empty(0))) for t in tables])
        square += float(np.nanvar(values)) if len(values) else 0.0
    return math.sqrt(square)


def diagnosed(
    entry: Entry, runs: DataSet, accepted: Entry, false_alarms_per_year: float, progress: Progress
) -> tuple[Entry, Report]:
    """A day: what the accepted robot misses of it, what may have changed, and how sure that is."""
    tables = columns(runs)
    if not shown(tables):
        raise Error(
            f"{entry.sources[0]}: with torques or tensions, or without motors or markers, where robot "
            f"'{accepted.robot}' was accepted by motors and markers alone; accept it with runs like these"
        )
    require_states(tables, entry.sources[0])
    report = diagnose(
        runs.robot, runs, accepted_runs(accepted), delta_m=accepted.delta_m, next=False, progress=progress
    )
    if report.verdict == "insufficient_data":
        raise Error(f"{entry.sources[0]}: {report.sentence}")
    channels = _channels(report)
    numbers = {Key(HELD_OUT, c["name"], "rms"): Number(c["unit"], c["rms"], 0, c["delta"]) for c in channels}
    for cause in report.causes:
        if "screened" not in cause.note:
            numbers |= _sizes(cause)
    day = replace(entry, numbers=numbers, channels=channels, notes=list(runs.notes), diagnosed=True)
    return replace(day, finding=finding(report, false_alarms_per_year)), report


def _channels(report: Report) -> list[dict[str, Any]]:
    """What is compared, disk by disk: missed by the robot as accepted, and what this missed of its own runs."""

    def place(name: str) -> tuple[bool, int, str]:  # as the findings are listed: places first, then turns
        turn, disk, axis = re.fullmatch(r"(turn of )?disk (\d+) (?:about )?([xyz])", name).groups()  # type: ignore[union-attr]
        return turn is not None, int(disk), axis

    of_disks = [f for f in report.location if f.cut == "C4" and f.measured]
    names = sorted((c.channel for c in report.closed.channels.values()), key=place)
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
    amount, spread = number.value - unchanged(key), TWO_SIDED_95 * number.deviation
    return Change(
        effect=key.effect,
        where=key.where,
        name=key.name,
        unit=number.unit,
        amount=amount,
        ci=(amount - spread, amount + spread),
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
