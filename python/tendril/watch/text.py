"""A watched robot for readers and programs: lines, tables, JSON, CSV. Knows no database."""

from __future__ import annotations

import csv
import datetime
import io
import json
import math
from collections.abc import Sequence
from typing import Any

from .change import Change
from .day import headline
from .store import Entry

SHOWN = 5  # changes on the terminal
LEAST_SHOWN = 1e-9  # probability
_MILLI = {"m": ("mm", 1e3), "kg": ("g", 1e3), "rad": ("mrad", 1e3), "s": ("ms", 1e3), "N": ("mN", 1e3)}


def date(at: float) -> str:
    return datetime.datetime.fromtimestamp(at, datetime.timezone.utc).strftime("%Y-%m-%d")


def moment(at: float) -> str:
    return datetime.datetime.fromtimestamp(at, datetime.timezone.utc).strftime("%Y-%m-%d %H:%M")


def shown_unit(unit: str, largest: float) -> tuple[str, float]:
    """A unit in which numbers of this size read well, and the factor to it."""
    return _MILLI[unit] if unit in _MILLI and largest < 0.1 else (unit, 1.0)


def change_words(change: Change) -> str:
    """'cell_offset tendon:1 N +10.5 mN [9.9, 11.1], drifting by +5 mN a day since 2026-11-30'."""
    unit, factor = shown_unit(change.unit, abs(change.amount))
    low, high = (factor * end for end in change.ci)
    words = f"{change.key} {factor * change.amount:+.3g} {unit}".rstrip() + f" [{low:.3g}, {high:.3g}]"
    if change.per_day is not None:
        rate = f"{factor * change.per_day:+.2g} {unit}".rstrip()
        words += f", drifting by {rate} a day"
        if not change.alarm:
            left = (change.material - abs(change.amount)) / abs(change.per_day)
            words += f" (matters in {max(left, 0):.0f} days)"
    return words + f" since {date(change.since)}"


def cause_words(cause: dict[str, Any]) -> str:
    """'cell_offset tendon:1 (p 0.97)', 'wrap_angle (p 0.49) or capstan_alpha (p 0.48)', or that no cause is established."""
    names = [
        f"{c['effect']}{'' if c['where'] == 'all' else ' ' + c['where']} (p {c['p']:.2g})"
        for c in cause["causes"]
    ]
    # An alarm may take several days together; this is the last one's diagnosis.
    unknown = (
        "none by this day's runs alone"
        if cause["verdict"] == "no_gap"
        else cause["verdict"].replace("_", " ")
    )
    return (" or " if cause.get("one_of_them") else " and ").join(names) or unknown


def state(entry: Entry) -> str:
    """Of a day, in a word or two."""
    if entry.finding.get("alarm"):
        return "alarm"
    if entry.finding.get("cause"):
        return "unsure"
    return "drift" if entry.finding.get("changes") else "as accepted"


def sentence(entry: Entry, changes: Sequence[Change]) -> str:
    """The outcome of a day in one line."""
    robot = f"robot '{entry.robot}' on {date(entry.at)}"
    cause, drifting = entry.finding.get("cause"), [change for change in changes if not change.alarm]
    if not entry.finding.get("alarm"):
        if cause:
            return f"{robot}: not sure that anything changed; the diagnosis says: {cause_words(cause)}"
        if drifting:
            return f"{robot}: nothing that matters changed; seen to change: {change_words(drifting[0])}"
        return f"{robot}: as accepted"
    head = headline(changes, cause)
    if head:
        what = f": {change_words(head)}"
    elif entry.diagnosed:
        what = f": {missed_words(entry.channels, 1)[0]}"
    else:
        # Days that were entered later may explain what an alarm was entered with.
        what = " when it was entered; the days entered since explain it"
    because = f"; cause: {cause_words(cause)}" if cause else ""
    return f"{robot}: changed beyond materiality{what}{because}"


def missed_words(channels: Sequence[dict[str, Any]], count: int) -> list[str]:
    """'disk 3 x is missed by 5.1 mm (0.31 mm when accepted)', where it is the most times as much."""

    def shown(channel: dict[str, Any], value: float) -> str:
        unit, factor = shown_unit(channel["unit"], value)
        return f"{factor * value:.3g} {unit}"

    worst = sorted(channels, key=lambda c: c["floor"] / c["rms"] if c["rms"] > 0 else math.inf)
    return [
        f"{c['name']} is missed by {shown(c, c['rms'])} ({shown(c, c['floor'])} when accepted)"
        for c in worst[:count]
    ]


def _evidence(entry: Entry, changes: Sequence[Change]) -> list[str]:
    """What an alarm, or a suspicion, rests on."""
    if entry.diagnosed:
        if not entry.finding.get("cause"):
            return []
        p = entry.finding["unchanged"]
        lines = [f"  probability that nothing changed: {f'{p:.2g}' if p > LEAST_SHOWN else f'below {LEAST_SHOWN}'}"]
        listed = [*map(change_words, changes[:SHOWN]), *missed_words(entry.channels, SHOWN)]
        more = len(entry.channels) + len(changes) - len(listed)
    else:
        listed = [f"{change_words(change)}, z {change.z:+.1f}" for change in changes[:SHOWN]]
        more = len(changes) - len(listed)
        head = "  beyond chance (|z| > {:.1f}), each as if it alone had changed:"
        lines = [head.format(change.threshold) for change in changes[:1]]
    lines += [f"    {words}" for words in listed]
    return [*lines, f"    and {more} more; tendril gap history --json has all"] if more > 0 else lines


def day_text(entry: Entry, accepted: Entry, changes: Sequence[Change]) -> str:
    """What `tendril gap watch` prints of a day."""
    lines = [("ALARM: " if entry.finding.get("alarm") else "") + sentence(entry, changes)]
    lines += _evidence(entry, changes)
    if cause := entry.finding.get("cause"):
        lines.append(f"  diagnosis: {cause['sentence']}")
        if cause["remark"]:
            lines.append(f"  {cause['remark']}")
    if entry.families != accepted.families and not entry.diagnosed:
        lines.append(
            f"  other kinds of motion than accepted ({', '.join(accepted.families)}): errors of the model do not cancel"
        )
    return "\n".join([*lines, *(f"  {note}" for note in entry.notes)])


def history_text(accepted: Entry, days: Sequence[Entry], changes: Sequence[Change]) -> str:
    """A line an entry, and what its last day shows."""
    note = f": {accepted.note}" if accepted.note else ""
    lines = [
        f"robot '{accepted.robot}', accepted as of {moment(accepted.at)} UTC, {len(accepted.numbers)} numbers{note}"
    ]
    for day in days:
        words = state(day).replace("alarm", "ALARM")
        cause = day.finding.get("cause")
        lines.append(f"  {moment(day.at)}  {words:<12}{cause_words(cause) if cause else ''}".rstrip())
    if not days:
        lines.append("  no day yet: tendril gap watch enters one")
    lines += [f"  {change_words(change)}, z {change.z:+.1f}" for change in changes[:SHOWN]]
    return "\n".join(lines)


def entry_json(entry: Entry) -> dict[str, Any]:
    values = {key: value for key, value in vars(entry).items() if key != "numbers"}
    values["numbers"] = [{**vars(key), **vars(number)} for key, number in entry.numbers.items()]
    return values


def day_json(entry: Entry, changes: Sequence[Change]) -> str:
    """One line for programs."""
    return json.dumps({"format": 1, "sentence": sentence(entry, changes), **entry_json(entry)})


def history_json(states: Sequence[tuple[Entry, Sequence[Entry]]]) -> str:
    """All states with their days."""
    return json.dumps(
        {
            "format": 1,
            "states": [
                {"accepted": entry_json(a), "days": [entry_json(d) for d in days]} for a, days in states
            ],
        },
        indent=1,
    )


def history_csv(states: Sequence[tuple[Entry, Sequence[Entry]]]) -> str:
    """A row a number and entry."""
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(
        [
            "robot",
            "entry",
            "kind",
            "time_utc",
            "effect",
            "where",
            "name",
            "unit",
            "value",
            "deviation",
            "material",
        ]
    )
    for accepted, days in states:
        for entry in (accepted, *days):
            head = [entry.robot, entry.id, "accepted" if entry is accepted else "day", moment(entry.at)]
            for key, n in entry.numbers.items():
                rows.writerow(
                    [*head, key.effect, key.where, key.name, n.unit, n.value, n.deviation, n.material]
                )
    return out.getvalue()
