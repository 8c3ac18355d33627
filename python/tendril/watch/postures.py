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
_MOTOR, _PULL = re.compile(r"motor_position_rad_(\d+)"), re.compile("torque_|tension_")
# What is read of a point: of its place and of its turn.
_READ = {"": ("x_m", "y_m", "z_m"), "turn of ": ("qw", "qx", "qy", "qz")}
_CHANNEL = re.compile(r"(turn of )?disk (\d+) (?:about )?([xyz])")
# Lines of every calibration and diagnosis of such a robot: of what it cannot show at all, of the floor and of files.
_ALWAYS = (
    "neither torques nor tensions",
    "the robot as learned from the runs before misses",
    "its numbers furthest from the file",
    "the file draws no pulleys",
)


def columns(runs: DataSet) -> list[Columns]:
    """The readings of each run by column; columns without any are left out."""
    found = []
    for run in runs:
        names, values = _core.table_of(run)
        read = np.asarray(np.isfinite(values).any(axis=0))
        found.append({name: values[:, i] for i, name in enumerate(names) if read[i]})
    return found


def points(table: Columns, disks: int) -> dict[str, list[str]]:
    """Columns by what they show, 'disk 3' or 'turn of disk 3'. As in the diagnosis, the tip stands for the last disk
    where that has no readings of its own."""
    found = {}
    for kind, read in _READ.items():
        for disk in range(1, disks + 1):
            own, tip = [f"disk_{part}_{disk}" for part in read], [f"tip_{part}" for part in read]
            for names in (own, tip) if disk == disks else (own,):
                if any(name in table for name in names):
                    found[f"{kind}disk {disk}"] = names
                    break
    return found


def _motors(table: Columns) -> set[int]:
    return {int(named[1]) for named in map(_MOTOR.fullmatch, table) if named}


def _disks(robot: _core.Robot) -> int:
    return _core.Model(robot).disk_count


def shown(tables: Sequence[Columns], robot: _core.Robot) -> bool:
    """Every run has positions of the robot's motors and of disks, by place or orientation, and neither torques nor
    tensions."""
    disks = _disks(robot)
    return (
        bool(tables)
        and robot.has_actuation
        and all(
            len(table["t_s"]) > 1
            and 0 < max(_motors(table), default=0) <= robot.tendons
            and points(table, disks)
            and not any(map(_PULL.match, table))
            for table in tables
        )
    )


def states(tables: Sequence[Columns], robot: _core.Robot) -> int:
    """Times in which every motor of the robot was read, and every disk that all runs show. 0 where a run has none: the
    diagnosis then does not go state by state."""
    disks = _disks(robot)
    of_runs = [points(table, disks) for table in tables]
    common = set.intersection(*map(set, of_runs)) if of_runs else set()
    count = 0
    for table, its in zip(tables, of_runs, strict=True):
        used = [f"motor_position_rad_{j}" for j in range(1, robot.tendons + 1)]
        used += [name for point in common for name in its[point]]
        if not common or any(name not in table for name in used):
            return 0
        read = np.isfinite(np.stack([table[name] for name in used], axis=1))
        time = table["t_s"]
        number = np.floor((time - time[0]) / STATE_s + ROUNDING)
        first = np.flatnonzero(np.diff(number, prepend=-1.0))
        here = int(np.logical_or.reduceat(read, first, axis=0).all(axis=1).sum())
        if here == 0:
            return 0
        count += here
    return count


def require_states(tables: Sequence[Columns], robot: _core.Robot, name: str) -> None:
    """Raises where the robot cannot be learned from so little, nor a day be weighed."""
    unread = [j for j in range(1, robot.tendons + 1) if any(j not in _motors(table) for table in tables)]
    if unread:
        raise Error(
            f"{name}: no position of motor {', '.join(map(str, unread))} in a run, where a position-controlled robot "
            f"needs those of all {robot.tendons} motors in each; record them, or check the names of columns in the map"
        )
    if (there := states(tables, robot)) < LEAST_STATES:
        raise Error(
            f"{name}: {there} states of motors and markers, where a position-controlled robot needs {LEAST_STATES} "
            f"(a state is a mean over {STATE_s} s, or a row where these are further apart), some in each run; "
            "record more"
        )


def learned(entry: Entry, runs: DataSet, progress: Progress) -> Entry:
    """The accepted state: by how much the robot that these runs teach misses its disks where it was not fitted to."""
    tables = columns(runs)
    require_states(tables, runs.robot, entry.sources[0])
    found = calibrate(runs.robot, runs, progress=progress)
    notes = [*require_learned(found.channels, tables, _disks(runs.robot), entry.sources[0]), *runs.notes]
    notes += [line for line in found.notes if not line.startswith(_ALWAYS)]
    if not found.converged:
        notes.append("the numbers of the robot had not settled after the allowed steps")
    kept = [
        {"name": c.name, "unit": c.unit, "rms": c.held_out, "floor": c.floor, "discrepancy": c.discrepancy}
        for c in found.channels
    ]
    numbers = {Key(HELD_OUT, c.name, "rms"): Number(c.unit, c.held_out, 0, 0) for c in found.channels}
    return replace(entry, numbers=numbers, channels=kept, notes=list(dict.fromkeys(notes)), diagnosed=True)


def require_learned(
    channels: Sequence[CalibratedChannel], tables: Sequence[Columns], disks: int, name: str
) -> list[str]:
    """How well, as a note. Raises where the robot is not the one of the file: no day could be weighed against it."""
    squares: dict[str, float] = {}
    for channel in channels:
        turn, number, _ = _place(channel.name, name)
        if turn:
            return []  # what orientations miss has no such yardstick here; the diagnosis of a day has it
        disk = f"disk {number}"
        squares[disk] = squares.get(disk, 0.0) + channel.held_out**2
    moved = [_motion(tables, disk, disks) for disk in squares]
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


def _place(channel: str, source: str) -> tuple[bool, int, str]:
    """Turn or place, number of the disk, and axis; in the order in which the diagnosis lists its findings."""
    named = _CHANNEL.fullmatch(channel)
    if named is None:
        raise Error(
            f"{source}: compared by '{channel}', where a position-controlled robot is compared disk by disk; record "
            "positions of all motors, and the same markers in all runs"
        )
    return named[1] is not None, int(named[2]), named[3]


def _motion(tables: Sequence[Columns], disk: str, disks: int) -> float:
    """Rms distance of 'disk 3' from its mean."""
    seen = [[table[name] for name in points(table, disks)[disk]] for table in tables]
    return math.sqrt(sum(float(np.nanvar(np.concatenate(axis))) for axis in zip(*seen, strict=True)))


def diagnosed(
    entry: Entry, runs: DataSet, accepted: Entry, false_alarms_per_year: float, progress: Progress
) -> tuple[Entry, Report]:
    """A day: what the accepted robot misses of it, what may have changed, and how sure that is."""
    tables = columns(runs)
    if not shown(tables, runs.robot):
        raise Error(
            f"{entry.sources[0]}: with torques or tensions, or without motors or markers, where robot "
            f"'{accepted.robot}' was accepted by motors and markers alone; accept it with runs like these"
        )
    require_states(tables, runs.robot, entry.sources[0])
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
