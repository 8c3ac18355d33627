"""What the dashboard shows: pure functions from the client's state to lines. Knows no terminal; words of statuses and
drives come from the tables of the daemon."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence

from .. import _core
from .._arrays import Array
from ..messages import state_t
from ..state import FIRST_FAULT, Event, State, Statistics
from .jog import Jog, Limits

Span = tuple[str, str]
"""Text and style: '', 'bold', 'dim', 'good', 'warn' or 'bad'."""
Line = list[Span]

LEAST_WIDTH, LEAST_HEIGHT = 80, 24
_BAR = 16


def clean(text: str) -> str:
    """Without control characters, which texts from the network must not send to a terminal."""
    return "".join(character if character.isprintable() else " " for character in text)


def text_of(lines: Iterable[Line]) -> str:
    """The lines without their styles."""
    return "\n".join("".join(text for text, _ in line) for line in lines)


def too_small(width: int, height: int) -> str:
    """One line that fits; empty where the dashboard does."""
    if width >= LEAST_WIDTH and height >= LEAST_HEIGHT:
        return ""
    return f"{width}x{height} is too small: 80x24 needed"


def heading(state: State, robot: _core.Robot | None, daemon: _core.Daemon | None, silent_s: float) -> list[Line]:
    """Who it is, its mode, and each reported status with its remedy."""
    who = f"{robot.name} on {daemon.interface}" if robot is not None and daemon is not None else "robot not described yet"
    lines: list[Line] = [
        [("mode ", ""), (f" {clean(state.mode_text)} ", _mode_style(state)), (f"  {clean(who)}, cycle {state.cycle}", "")]
    ]
    if silent_s > 1:
        lines.append([(f"no state for {silent_s:.0f} s: has the daemon stopped? What was armed here is disarmed", "bad")])
    elif len(state.reported) == 0:
        lines.append([(f"status {state.status} {clean(state.status_text)}", "good")])
    for number in map(int, state.reported):
        own = number == state.status and state.status_text
        text = clean(state.status_text) if own else _core.status_text(number)
        style = "bad" if number >= FIRST_FAULT else "warn"
        lines.append([(f"status {number} {text}", style), *_remedy(_core.status_remedy(number))])
    return lines


def _mode_style(state: State) -> str:
    if state.faulted:
        return "bad reverse"
    return "good reverse" if state.disarmed else "warn reverse"


def _remedy(text: str) -> Line:
    return [(f"; {text}", "")] if text else []


def _number(value: float, scale: float, decimals: int, width: int) -> str:
    return f"{'-':>{width}}" if math.isnan(value) else f"{scale * value:>{width}.{decimals}f}"


def motion(state: State) -> list[Line]:
    """Tip [mm] and bends [deg], reference beside estimate."""
    lines: list[Line] = [[(f"{'':<11}{'reference':<30}estimate", "dim")]]

    def row(name: str, left: Array, right: Array, scale: float) -> None:
        both = ["".join(_number(v, scale, 2, 9) for v in values) for values in (left, right)]
        lines.append([(f"{name:<11}{both[0]:<30}{both[1]}", "")])

    row("tip [mm]", state.tip_desired_W_m, state.tip_estimate_W_m, 1e3)
    for k in range(len(state.bending_desired_rad) // 2):
        pair = slice(2 * k, 2 * k + 2)
        row(f"bend {k + 1} [°]", state.bending_desired_rad[pair], state.bending_estimate_rad[pair], 180 / math.pi)
    return lines


def bar(value: float, most: float, width: int = _BAR) -> str:
    """A value from 0 to its limit; full at the limit and beyond."""
    share = 0.0 if math.isnan(value) or not most > 0 else min(max(value / most, 0.0), 1.0)
    full = round(share * width)
    return "█" * full + "░" * (width - full)


def tension_style(value: float, least: float, most: float) -> str:
    """Over nine tenths of the limit: warn; over it, or slack by half of the least: bad."""
    if math.isnan(value):
        return "dim"
    if value > most or value < 0.5 * least:
        return "bad"
    return "warn" if value > 0.9 * most else "good"


def tendons(
    state: State, statistics: Statistics | None, robot: _core.Robot | None, daemon: _core.Daemon | None
) -> list[Line]:
    """Each tendon: tension at the base against its limit, motor side, and its drive."""
    most = robot.max_tension_base if robot is not None else math.nan
    side = robot.max_tension_motor if robot is not None else math.nan
    limits = (_number(most, 1, 1, 4).strip(), _number(side, 1, 1, 4).strip())
    head = f"{'tendon':<8}{f'base, limit {limits[0]} N':<{_BAR + 1}}{'est.':>6}{'ref.':>7}{f'motor ≤{limits[1]}':>12}"
    lines: list[Line] = [[(f"{head}  drive, error", "dim")]]
    off = state.mode in (state_t.MODE_DISCONNECTED, state_t.MODE_CONFIGURED)
    for j in range(len(state.tension_desired_base_N)):
        estimate = float(state.tension_base_estimate_N[j])
        wanted = float(state.tension_desired_base_N[j])
        shown = wanted if math.isnan(estimate) else estimate
        least = robot.min_tension if robot is not None and not off else 0.0
        style = tension_style(shown, least, most)
        numbers = f" {_number(estimate, 1, 2, 6)}{_number(wanted, 1, 2, 7)}"
        motor = float(state.tension_measured_N[j])
        lines.append(
            [
                (f"{j + 1:>4}    ", ""),
                (bar(shown, most), style),
                (numbers, ""),
                (_number(motor, 1, 2, 12), "bad" if motor > side else ""),
                *_drive(j, statistics, daemon),
            ]
        )
    return lines


def _drive(j: int, statistics: Statistics | None, daemon: _core.Daemon | None) -> Line:
    if statistics is None or j >= len(statistics.drive_node_id):
        return [("  -", "dim")]
    node, code = int(statistics.drive_node_id[j]), int(statistics.drive_error_code[j])
    words = _core.drive_state_text(int(statistics.drive_state[j]))
    style = "" if words in ("ready", "enabled") else "bad" if words == "fault" else "warn"
    spans: Line = [(f"  {node} {words}", style)]
    if code:
        meaning = _core.drive_error_text(daemon, node, code) if daemon is not None else None
        spans.append((f" 0x{code:04X} {meaning or ''}".rstrip(), "bad"))
    return spans


def timing(statistics: Statistics | None) -> list[Line]:
    """Cycles missed, latencies, bus, and the last fault."""
    if statistics is None:
        return [[("timing: published once a second", "dim")]]
    s = statistics
    late = f"cycles {s.cycles}, missed {s.deadline_misses}"
    if len(s.miss_cycle):
        late += f" (last: {s.miss_skipped[-1]} before cycle {s.miss_cycle[-1]}, {clean(s.miss_cause[-1])})"
    lines: list[Line] = [[(late, "warn" if s.deadline_misses else ""), (f"; bus load {100 * s.bus_load:.0f} %", "")]]
    names = (("wake-up", s.wake_latency_ns), ("bus", s.round_trip_ns), ("step", s.compute_ns))
    parts = [f"{name} {at[2] / 1e3:.0f} / {at[3] / 1e3:.0f}" for name, at in names]
    lines.append([("µs, 99.9 % / most: " + ", ".join(parts), "")])
    counts = (
        ("sends refused", s.can_send_refused),
        ("frames lost", s.can_receive_dropped),
        ("error frames", s.can_error_frames),
        ("bus-off", s.can_bus_off),
        ("malformed", s.can_malformed),
        ("foreign", s.can_foreign),
        ("LCM messages ignored", s.messages_ignored),
    )
    if wrong := [f"{name} {count}" for name, count in counts if count]:
        lines.append([("CAN and LCM: " + ", ".join(wrong), "warn")])
    if s.last_fault_utime:
        lines.append([(f"last fault {_clock(s.last_fault_utime)} {s.last_fault_status} {clean(s.last_fault_text)}", "warn")])
    return lines


def _clock(utime: int) -> str:
    return time.strftime("%H:%M:%S", time.localtime(utime / 1e6))


def events(happened: Sequence[Event], most: int) -> list[Line]:
    """The newest first, each with its remedy, repeats counted."""
    lines: list[Line] = [[("events, newest first", "dim")]]
    runs: list[tuple[Event, int]] = []
    for event in reversed(happened):
        if runs and (runs[-1][0].text, runs[-1][0].source) == (event.text, event.source):
            runs[-1] = (runs[-1][0], runs[-1][1] + 1)
        elif len(runs) < most:
            runs.append((event, 1))
        else:
            break
    for event, count in runs:
        style = "bad" if event.status >= FIRST_FAULT else "warn" if event.status else ""
        again = f" ({count} times)" if count > 1 else ""
        line: Line = [(f"{_clock(event.utime)} {clean(event.source)}: {clean(event.text)}{again}", style)]
        remedy = _core.status_remedy(event.status)
        if remedy and remedy not in event.text:
            line += _remedy(remedy)
        lines.append(line)
    return lines if runs else [[("no events yet", "dim")]]


def jog_line(jog: Jog, on: bool, limits: Limits | None, permitted: bool) -> Line:
    """What the arrows move, and how fast."""
    if not on or limits is None:
        return [("jog off: j switches it on", "dim")]
    if jog.kind == "tip":
        what, speed = "tip", f"{1e3 * jog.share * limits.tip_speed:.1f} mm/s"
        keys = "←→ x, ↓↑ y, PgDn PgUp z"
    else:
        what, speed = f"bend of section {jog.section + 1}", f"{jog.share * limits.bend_speed:.2f} rad/s"
        keys = "←→ u, ↓↑ v"
    line: Line = [(f"jog {what} ", "bold"), (f"at {speed} ({100 * jog.share:.0f} % of its limit): hold {keys}", "")]
    if permitted:
        line.append(("  at a limit" if jog.held_back else "  MOVES", "warn reverse"))
    return line
