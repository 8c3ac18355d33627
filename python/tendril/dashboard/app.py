"""The Textual application: screen and keys. What is shown is in state.py, what keys do in operator.py and jog.py."""

from __future__ import annotations

import asyncio
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Iterable

from rich.text import Text
from textual import events
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.widgets import Static

from . import state as view
from .jog import SEND_EVERY_S
from .operator import Operator

_DRAW_EVERY_S = 0.2
_LAST_RESORT_S = 5.0
_EVENTS_SHOWN = 20
_STYLES = {"good": "green", "warn": "yellow", "bad": "bold red", "dim": "dim", "reverse": "reverse", "bold": "bold"}
_DIRECTIONS: dict[str, tuple[float, ...]] = {
    "left": (-1, 0, 0),
    "right": (1, 0, 0),
    "down": (0, -1, 0),
    "up": (0, 1, 0),
    "pagedown": (0, 0, -1),
    "pageup": (0, 0, 1),
}
KEYS = [
    [("SPACE or d  disarm", "bold reverse"), ("   a arm   h hold   c clear fault   q quit (disarms)", "")],
    [("j jog on/off   t tip   1-4 bend of a section   + - speed   (off: arrows scroll)", "")],
]


def _text(lines: Iterable[view.Line]) -> Text:
    """Never as markup: texts come from the network."""
    text = Text()
    for number, line in enumerate(lines):
        if number:
            text.append("\n")
        for words, style in line:
            text.append(words, " ".join(_STYLES[name] for name in style.split()))
    return text


class Dashboard(App[int]):
    """Shows one daemon, and takes the keys."""

    TITLE = "tendril status --watch"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    Screen { layout: vertical; }
    #head, #foot { height: auto; }
    #head { max-height: 7; }
    #body { height: 1fr; scrollbar-size-vertical: 1; }
    #foot { dock: bottom; }
    #body Static { height: auto; }
    #events { margin-top: 0; }
    #small { display: none; }
    .small #head, .small #body, .small #foot { display: none; }
    .small #small { display: block; }
    """
    BINDINGS = [
        Binding("space,d", "disarm", priority=True),
        Binding("q,ctrl+q,ctrl+c,ctrl+d", "leave", priority=True),
        Binding("ctrl+z", "nothing", priority=True),
    ]

    def __init__(self, operator: Operator) -> None:
        super().__init__()
        self.operator = operator
        self.ended_by = 0
        """Number of the signal that ended it."""

    def compose(self) -> ComposeResult:
        yield Static(id="small", markup=False)
        yield Static(id="head", markup=False)
        with VerticalScroll(id="body", can_focus=False):
            for name in ("motion", "tendons", "timing", "events"):
                yield Static(id=name, markup=False)
        with Vertical(id="foot"):
            yield Static(id="jog", markup=False)
            yield Static(id="message", markup=False)
            yield Static(_text(KEYS), id="keys", markup=False)

    def on_mount(self) -> None:
        loop = asyncio.get_running_loop()
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGINT, signal.SIGQUIT):
                loop.add_signal_handler(number, self._end, number)
        self.set_interval(SEND_EVERY_S, self._tick)
        self.set_interval(_DRAW_EVERY_S, self._draw)
        self._tick()
        self._draw()

    # ---- leaving ----

    def _end(self, number: int) -> None:
        """A signal: disarm first, then the screen. What hangs at a dead terminal is ended; the guard disarms again."""
        self.ended_by = number
        now = time.monotonic()
        self.operator.jog_on = False
        self.operator.jog.release()
        if self.operator.ours:
            self.operator.disarm(now)
        last_resort = threading.Timer(_LAST_RESORT_S, os._exit, (128 + number,))
        last_resort.daemon = True
        last_resort.start()
        self.exit(128 + number)

    def action_leave(self) -> None:
        self.exit(0)

    def action_nothing(self) -> None:
        """Ctrl-Z would leave an armed robot behind."""

    def _terminal_gone(self) -> bool:
        """The terminal closed without a signal (nohup)."""
        if self.is_headless:
            return False
        poll = select.poll()
        poll.register(sys.__stdin__.fileno(), 0)  # type: ignore[union-attr]
        return any(what & (select.POLLHUP | select.POLLERR) for _, what in poll.poll(0))

    # ---- keys ----

    def action_disarm(self) -> None:
        self.operator.disarm(time.monotonic())
        self._draw()

    def on_key(self, event: events.Key) -> None:
        """Jog keys first: the time at which they were read counts."""
        operator, key = self.operator, event.key
        if self._small():
            return
        if key in _DIRECTIONS:
            self._arrow(key, event.time)
            return
        operator.jog.release()
        if key in ("a", "h", "c"):
            operator.request({"a": "arm", "h": "hold", "c": "clear"}[key], time.monotonic())
        elif key == "j":
            operator.jog_on = not operator.jog_on
        elif key == "t":
            operator.jog.choose("tip")
        elif key in ("1", "2", "3", "4"):
            self._choose_section(int(key))
        elif key in ("plus", "equals_sign", "minus"):
            operator.jog.faster(-1 if key == "minus" else 1)
        self._draw()

    def _arrow(self, key: str, read_at: float) -> None:
        operator, direction = self.operator, _DIRECTIONS[key]
        if not operator.jog_on:
            scroll = {"up": -1, "down": 1, "pageup": -8, "pagedown": 8}
            self.query_one("#body").scroll_relative(y=scroll.get(key, 0), animate=False)
            return
        if operator.jog.kind == "bend":
            if direction[2]:
                return
            direction = direction[:2]
        operator.press(direction, read_at, time.monotonic())

    def _choose_section(self, number: int) -> None:
        limits = self.operator.limits
        if limits is None or number > limits.sections:
            count = "?" if limits is None else str(limits.sections)
            self.operator.refuse(f"section {number}: this robot has {count}")
            return
        self.operator.jog.choose("bend", number - 1)

    def on_app_blur(self) -> None:
        """Another window has the keys."""
        self.operator.jog.release()

    # ---- drawing ----

    def _small(self) -> str:
        return view.too_small(self.size.width, self.size.height)

    def on_resize(self) -> None:
        self._draw()

    def _tick(self) -> None:
        self.operator.tick(time.monotonic())
        if self._terminal_gone():
            self._end(signal.SIGHUP)

    def _draw(self) -> None:
        if not self.is_running:
            return
        small = self._small()
        self.screen.set_class(bool(small), "small")
        if small:
            self.operator.jog.release()
            self.query_one("#small", Static).update(Text(f"{small}; d disarms, q quits"))
            return
        o, now = self.operator, time.monotonic()
        if o.state is None:
            self.query_one("#head", Static).update(Text("waiting for the daemon's first state"))
            return
        parts: dict[str, list[view.Line]] = {
            "head": view.heading(o.state, o.robot, o.daemon, o.silent_s(now)),
            "motion": view.motion(o.state),
            "tendons": view.tendons(o.state, o.statistics, o.robot, o.daemon),
            "timing": view.timing(o.statistics),
            "events": view.events(list(o.events), _EVENTS_SHOWN),
            "jog": [view.jog_line(o.jog, o.jog_on, o.limits, o.jog.permitted(now))],
            "message": [[(view.clean(o.message.text), "bad" if o.message.refused else "good")]],
        }
        for name, lines in parts.items():
            self.query_one(f"#{name}", Static).update(_text(lines))
