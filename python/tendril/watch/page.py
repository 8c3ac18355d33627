"""The courses of a watched robot as one page that needs no network, in the looks of the diagnosis' report."""

from __future__ import annotations

import contextlib
import os
import pathlib
import tempfile
from collections.abc import Sequence
from html import escape

from .. import _core
from ..errors import Error
from .change import TWO_SIDED_95, Change, DAY_s
from .postures import HELD_OUT, with_unchanged
from .store import Entry, Key, Number
from .text import cause_words, change_words, date, moment, sentence, shown_unit, state

MARK = "<!-- tendril gap history -->"
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 330.0, 150.0, 62.0, 8.0, 8.0, 22.0
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"


def require_page(path: str) -> None:
    """Raises where the file is something else than such a page, which is written anew each time."""
    file = pathlib.Path(path)
    try:
        if not file.exists():
            if not file.absolute().parent.is_dir():
                raise Error(f"{path}: there is no such folder; make it, or give another --page")
            return
        with open(file, encoding="utf-8", errors="replace") as text:
            if MARK in text.read(200):
                return
    except OSError as error:
        raise Error(f"{path}: {error.strerror}; give another --page") from None
    raise Error(f"{path} is there and no page of gap watch: nothing was written; give another --page")


def write(path: str, text: str) -> None:
    """As a whole or not at all."""
    file = pathlib.Path(path)
    try:
        with tempfile.NamedTemporaryFile(
            "w", dir=file.absolute().parent, delete=False, encoding="utf-8"
        ) as part:
            try:
                part.write(text)
                part.flush()
                os.fchmod(part.fileno(), 0o644)
                os.fsync(part.fileno())
                os.replace(part.name, file)
            except BaseException:
                with contextlib.suppress(OSError):
                    os.unlink(part.name)
                raise
    except OSError as error:
        raise Error(f"{path}: {error.strerror}; give another --page, or make room") from None


def page(accepted: Entry, days: Sequence[Entry], changes: Sequence[Change]) -> str:
    """A page of one accepted state and the days beside it; `changes`: of the last of them."""
    last = days[-1] if days else None
    alarm = bool(last and last.finding.get("alarm"))
    words = sentence(last, changes) if last else f"robot '{accepted.robot}': accepted, no day yet"
    if accepted.diagnosed:
        accepted = with_unchanged(accepted, days)
    badge, colour = ("changed", "insufficient_data") if alarm else ("as accepted", "no_gap")
    if not alarm and (changes or (last and state(last) == "unsure")):
        badge, colour = "drifting" if changes else "unsure", "ambiguous_group"
    changed = {change.key: change for change in changes}
    parts = [
        f"<!DOCTYPE html>\n{MARK}\n<html lang='en'><head><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width, initial-scale=1'>",
        f"<meta http-equiv='Content-Security-Policy' content=\"{POLICY}\"><link rel='icon' href='data:,'>",
        f"<title>Robot {escape(accepted.robot)}, watched</title><style>{_core.report_style()}</style></head><body>",
        f"<header class='hero'><div class='wrap'><p class='kicker'><span class='verdict {colour}'>{badge}</span>",
        f"<span>{escape(accepted.robot)}</span></p><h1>{escape(words)}</h1>{_facts(accepted, days)}</div></header>",
        "<main class='wrap'>",
        _changes(accepted, days, changes),
        _entries(days),
        _all(accepted, days, changed),
        "</main></body></html>\n",
    ]
    return "\n".join(parts)


def _facts(accepted: Entry, days: Sequence[Entry]) -> str:
    note = accepted.note or "no note"
    facts = [
        ("accepted as of", moment(accepted.at) + " UTC", note),
        ("days since", str(len(days)), f"last {moment(days[-1].at)} UTC" if days else "none yet"),
        ("numbers followed", str(len(accepted.numbers)), ", ".join(accepted.families)),
        ("accepted with", accepted.build, f"{len(accepted.runs)} runs"),
    ]
    cells = "".join(
        "<div class='fact'>"
        + "".join(
            f"<div class='{style}'>{escape(words)}</div>" for style, words in zip("kvs", fact, strict=True)
        )
        + "</div>"
        for fact in facts
    )
    return f"<div class='facts'>{cells}</div>"


def _changes(accepted: Entry, days: Sequence[Entry], changes: Sequence[Change]) -> str:
    if accepted.diagnosed:
        return _named(accepted, days, changes) + _missed(accepted, days)
    if not changes:
        return "<section><h2>What changed</h2><p class='caption'>Nothing beyond chance.</p></section>"
    cards = "".join(_card(accepted, days, change.key, change) for change in changes[:12])
    caption = (
        "Each number is what it would be if it alone had changed, so one cause shows in several. Points: a day with "
        "its 95 % interval, less the accepted value. Grey: what does not matter. Line: the step or drift that fits best."
    )
    return f"<section><h2>What changed</h2><p class='caption'>{caption}</p><div class='grid'>{cards}</div></section>"


def _named(accepted: Entry, days: Sequence[Entry], changes: Sequence[Change]) -> str:
    if not changes:
        words = "No cause is named."
        return f"<section><h2>What changed</h2><p class='caption'>{words}</p></section>"
    cards = "".join(_card(accepted, days, change.key, change) for change in changes)
    caption = (
        "What the diagnosis of the last day names. Points: a day with its 95 % interval, as if this alone had changed, "
        "less its value where nothing has; days on which it is not among the likeliest have none."
    )
    return f"<section><h2>What changed</h2><p class='caption'>{caption}</p><div class='grid'>{cards}</div></section>"


def _missed(accepted: Entry, days: Sequence[Entry]) -> str:
    """The courses of a robot that was learned, disk by disk."""
    cards = "".join(_card(accepted, days, key, None) for key in accepted.numbers if key.effect == HELD_OUT)
    caption = (
        "By how much (rms) the robot as accepted misses its disks on each day, less what it missed of the accepted "
        "runs in states that it was not fitted to. Grey: what does not matter on one axis alone."
    )
    head = "<h2>Held-out error</h2>"
    return f"<section>{head}<p class='caption'>{caption}</p><div class='grid'>{cards}</div></section>"


def _entries(days: Sequence[Entry]) -> str:
    rows = ""
    for day in reversed(days):
        cause = day.finding.get("cause")
        count = len(day.finding.get("changes", []))
        diagnosis = escape(cause_words(cause)) if cause else ""
        cells = f"<td>{moment(day.at)}</td><td>{state(day)}</td><td class='n'>{count}</td><td>{diagnosis}</td>"
        rows += f"<tr>{cells}</tr>"
    head = (
        "<tr><th>day (UTC)</th><th>state</th><th class='n'>numbers beyond chance</th><th>diagnosis</th></tr>"
    )
    return f"<section><h2>Days</h2><div class='card scroll'><table>{head}{rows}</table></div></section>"


def _all(accepted: Entry, days: Sequence[Entry], changed: dict[Key, Change]) -> str:
    effects: dict[str, list[Key]] = {}
    for key in accepted.numbers:
        effects.setdefault(key.effect, []).append(key)
    blocks = ""
    for effect, keys in effects.items():
        cards = "".join(_card(accepted, days, key, changed.get(key)) for key in keys)
        blocks += f"<details><summary>{escape(effect)}</summary><div class='grid'>{cards}</div></details>"
    return f"<section><h2>Every number</h2>{blocks}</section>"


def _card(accepted: Entry, days: Sequence[Entry], key: Key, change: Change | None) -> str:
    words = f"<p class='note'>{escape(change_words(change))}</p>" if change else ""
    return f"<div class='card'><h3>{escape(str(key))}</h3>{_plot(accepted, days, key, change)}{words}</div>"


class _Axes:
    """From days and differences to the picture."""

    def __init__(self, times: Sequence[float], largest: float) -> None:
        self._from, self._span = times[0], max(times[-1] - times[0], DAY_s)
        self._largest = largest or 1.0

    def x(self, at: float) -> float:
        return LEFT + (at - self._from) / self._span * (WIDTH - LEFT - RIGHT)

    def y(self, difference: float) -> float:
        return TOP + (1 - difference / self._largest) / 2 * (HEIGHT - TOP - BOTTOM)


def _plot(accepted: Entry, days: Sequence[Entry], key: Key, change: Change | None) -> str:
    base = accepted.numbers[key]
    points = [(accepted.at, base), *((day.at, day.numbers[key]) for day in days if key in day.numbers)]
    reach = max(abs(n.value - base.value) + TWO_SIDED_95 * n.deviation for _, n in points)
    material = max(n.material for _, n in points)
    axes = _Axes([at for at, _ in points], 1.05 * max(reach, material))
    unit, factor = shown_unit(base.unit, reach)
    parts = [_band(axes, material), _ticks(axes, points, max(reach, material), factor, unit)]
    if change is not None:
        parts.append(_fit(axes, change, points))
    parts += [_point(axes, at, number, base) for at, number in points]
    return (
        f"<svg viewBox='0 0 {WIDTH:.0f} {HEIGHT:.0f}' role='img' aria-label='Course of {escape(str(key), quote=True)}'>"
        f"{''.join(parts)}</svg>"
    )


def _band(axes: _Axes, material: float) -> str:
    top, bottom = axes.y(material), axes.y(-material)
    width = WIDTH - LEFT - RIGHT
    return (
        f"<rect class='floor-band' x='{LEFT}' y='{top:.1f}' width='{width}' height='{bottom - top:.1f}'/>"
        f"<line class='zero' x1='{LEFT}' x2='{WIDTH - RIGHT}' y1='{axes.y(0):.1f}' y2='{axes.y(0):.1f}'/>"
    )


def _ticks(
    axes: _Axes, points: Sequence[tuple[float, Number]], reach: float, factor: float, unit: str
) -> str:
    shown = ""
    for value in (reach, 0.0, -reach):
        words = f"{factor * value:+.2g} {unit}".rstrip() if value else "0"
        place = f"x='{LEFT - 6}' y='{axes.y(value) + 4:.1f}'"
        shown += f"<text class='soft tiny' text-anchor='end' {place}>{escape(words)}</text>"
    first, last = points[0][0], points[-1][0]
    shown += f"<text class='soft tiny' x='{LEFT}' y='{HEIGHT - 6}'>{date(first)}</text>"
    if last - first >= DAY_s:
        shown += f"<text class='soft tiny' text-anchor='end' x='{WIDTH - RIGHT}' y='{HEIGHT - 6}'>{date(last)}</text>"
    return shown


def _fit(axes: _Axes, change: Change, points: Sequence[tuple[float, Number]]) -> str:
    last = points[-1][0]
    start = change.since if change.per_day is None else last - change.amount / change.per_day * DAY_s
    begun = change.amount if change.per_day is None else 0.0
    corners = [(points[0][0], 0.0), (start, 0.0), (start, begun), (last, change.amount)]
    path = " ".join(f"{axes.x(at):.1f},{axes.y(value):.1f}" for at, value in corners)
    return f"<polyline class='line after' points='{path}'/>"


def _point(axes: _Axes, at: float, number: Number, base: Number) -> str:
    difference, spread = number.value - base.value, TWO_SIDED_95 * number.deviation
    x, low, high = axes.x(at), axes.y(difference - spread), axes.y(difference + spread)
    return (
        f"<line class='whisker' x1='{x:.1f}' x2='{x:.1f}' y1='{low:.1f}' y2='{high:.1f}'/>"
        f"<circle class='fill-ink' cx='{x:.1f}' cy='{axes.y(difference):.1f}' r='2.5'/>"
    )
