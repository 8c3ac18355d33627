"""What a person at the dashboard commands, and what is undone when they leave. Knows no screen; time is passed in.

Commands are sent without waiting, in the order of the keys, and their answers are read from the states: no command waits
behind another one, and no arm can follow a disarm. What the gate would not accept in the robot's mode is not sent.
"""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from .._arrays import Array
from ..errors import DaemonError
from ..messages import state_t
from ..state import DRIVES_OFF, Event, State, Statistics
from .jog import SEND_EVERY_S, Jog, Limits

LOST_S = 1.0
"""Without a state for so long the daemon counts as lost."""
_LOOK_EVERY_S = 1.0
_DISARM_EVERY_S, _DISARM_FOR_S = 0.2, 5.0
_SETTLED_S = 1.0
_EVENTS_KEPT = 100
_REFUSED_IN_MODE = 204  # status number


class DaemonClient(Protocol):
    """What the operator uses of `tendril.Client`."""

    def state(self, timeout: float = ...) -> State: ...
    def events(self) -> list[Event]: ...
    def statistics(self) -> Statistics | None: ...
    def robot(self, timeout: float = ...) -> _core.Robot: ...
    def daemon(self, timeout: float = ...) -> _core.Daemon: ...
    def arm(self, timeout: float = ...) -> str: ...
    def disarm(self, timeout: float = ...) -> str: ...
    def hold(self, timeout: float = ...) -> str: ...
    def clear(self, timeout: float = ...) -> str: ...
    def send_tip(
        self, tip: ArrayLike, velocity: ArrayLike | None = ..., *, valid_for: float = ..., timeout: float = ...
    ) -> str: ...
    def send_bending(
        self, bending: ArrayLike, rate: ArrayLike | None = ..., *, valid_for: float = ..., timeout: float = ...
    ) -> str: ...


class Watcher(Protocol):
    """What the operator uses of `guard.Guard`."""

    def ready(self) -> bool: ...
    def tell(self, ours: bool, now: float) -> bool: ...
    def leave(self, in_order: bool) -> None: ...


@dataclasses.dataclass(frozen=True)
class Message:
    """The last answer to the operator."""

    text: str = ""
    refused: bool = False


class Operator:
    """One person's commands to one daemon.

    Args:
        client, guard: see the protocols.
        tip_speed: limit of the jog of the tip [m/s]; None: a fifth of the robot's length per second.
        bend_speed: limit of the jog of a bend [rad/s]; None: the daemon's default speed.
        sender: this process's sender number.
    """

    def __init__(
        self,
        client: DaemonClient,
        guard: Watcher,
        jog: Jog,
        tip_speed: float | None = None,
        bend_speed: float | None = None,
        sender: int | None = None,
    ) -> None:
        self._client, self._guard, self.jog = client, guard, jog
        self._tip_speed, self._bend_speed = tip_speed, bend_speed
        self._sender = _core.sender() if sender is None else sender
        self.state: State | None = None
        self.statistics: Statistics | None = None
        self.robot: _core.Robot | None = None
        self.daemon: _core.Daemon | None = None
        self.limits: Limits | None = None
        self.events: collections.deque[Event] = collections.deque(maxlen=_EVENTS_KEPT)
        self.message = Message()
        self.jog_on = False
        self.ours = False  # armed or moved from here
        self._heard_at = self._looked_at = self._sent_at = self._jogged_at = float("-inf")
        self._disarm_until = self._disarmed_at = float("-inf")
        self._answered = 0

    # ---- every tick ----

    def tick(self, now: float) -> None:
        """Reads what came, and sends what is due. To be called every SEND_EVERY_S."""
        self._read(now)
        self._look(now)
        if self.silent_s(now) > LOST_S:
            self._lose(now)
        if now < self._disarm_until and now >= self._disarmed_at + _DISARM_EVERY_S:
            self._send_disarm(now)
        self._step(now)
        if not self._guard.tell(self.ours, now) and self.ours and not self._guard.ready():
            self.refuse("the process that disarms when this one ends is gone and does not start: disarmed")
            self.disarm(now)

    def silent_s(self, now: float) -> float:
        """Time since the last state [s]; infinite before the first."""
        return now - self._heard_at

    def _read(self, now: float) -> None:
        try:
            state = self._client.state(timeout=0.0)
        except DaemonError:
            return
        if self.state is None or (state.cycle, state.utime) != (self.state.cycle, self.state.utime):
            self._heard_at, self.state = now, state
            self._answer(state, now)
            if state.disarmed and now < self._disarm_until:
                self._disarm_until = float("-inf")
            if state.mode in DRIVES_OFF and now > self._sent_at + _SETTLED_S:
                self.ours = False
        self.events.extend(self._client.events())

    def _answer(self, state: State, now: float) -> None:
        """The daemon's answer to the last command, where that was one of ours."""
        if state.command_sequence >> 32 != self._sender or state.command_sequence == self._answered:
            return
        self._answered = state.command_sequence
        if state.command_status:
            self.jog.block(now)
            self.jog.forget()
            self.refuse(f"{state.command_status_text} ({state.command_status})")

    def _look(self, now: float) -> None:
        """Robot and daemon as they describe themselves once a second; a daemon may have been started anew."""
        if now < self._looked_at + _LOOK_EVERY_S:
            return
        self._looked_at = now
        self.statistics = self._client.statistics()
        try:
            self.robot, self.daemon = self._client.robot(timeout=0.0), self._client.daemon(timeout=0.0)
        except (DaemonError, ValueError):
            return  # not heard yet, or of another version
        tip = 0.2 * self.robot.length if self._tip_speed is None else self._tip_speed
        bend = self.daemon.default_speed if self._bend_speed is None else self._bend_speed
        self.limits = Limits(
            sections=self.robot.sections,
            length=self.robot.length,
            max_bending=self.robot.max_bending,
            tip_speed=tip,
            bend_speed=min(bend, self.daemon.max_rate),
        )

    def _lose(self, now: float) -> None:
        """What was armed here is disarmed as soon as anybody hears it."""
        self.jog.release()
        if self.ours:
            self._disarm_until = now + _DISARM_FOR_S

    def _step(self, now: float) -> None:
        if self.state is None or self.limits is None or now < self._jogged_at + 0.8 * SEND_EVERY_S:
            return
        if self.state.mode != state_t.MODE_RUNNING:
            self.jog.forget()
        target = self.jog.step(now, self.state, self.limits)
        if target is None or not self._accepts("target"):
            return
        self._jogged_at = now
        moves = bool(np.any(target.rate))
        rate: Array | None = target.rate if moves else None
        send = self._client.send_tip if target.kind == "tip" else self._client.send_bending
        self._command(now, lambda: send(target.value, rate, valid_for=target.valid_for, timeout=0.0))

    # ---- the keys ----

    def press(self, direction: tuple[float, ...], at: float, now: float) -> None:
        """An event of a jog key."""
        if not self.jog_on:
            return
        if reason := self._why_not("target", now) or self._why_unguarded():
            self.jog.release()
            self.refuse(reason)
            return
        if not self.jog.permitted(now):
            self.message = Message()
        self.jog.press(direction, at)

    def request(self, name: str, now: float) -> None:
        """'arm', 'hold' or 'clear'."""
        self.jog.forget()
        if reason := self._why_not(name, now) or (self._why_unguarded() if name == "arm" else ""):
            self.refuse(reason)
            return
        self._disarm_until = float("-inf")
        self.message = Message(f"{name} sent")
        send = getattr(self._client, name)
        self._command(now, lambda: send(timeout=0.0), ours=name == "arm")

    def disarm(self, now: float) -> None:
        """At once, in every mode, and again until the daemon shows it."""
        self.jog.forget()
        self.message = self.message if self.message.refused else Message("disarm sent")
        self._disarm_until = now + _DISARM_FOR_S
        self._send_disarm(now)

    def refuse(self, text: str) -> None:
        """Shows why a key did nothing."""
        self.message = Message(text, refused=True)

    def leave(self, timeout: float = 2.0) -> str:
        """Undoes what was done here. Returns what could not be; empty: all."""
        self.jog.release()
        trouble = ""
        if self.ours:
            try:
                self._client.disarm(timeout=timeout)
                self.ours = False
            except DaemonError as error:
                trouble = f"disarm was sent and not answered: {error}"
        self._guard.leave(in_order=not self.ours)
        return trouble

    # ---- helpers ----

    def _accepts(self, name: str) -> bool:
        return self.state is not None and _core.accepted_in(self.state.mode, name)

    def _why_not(self, name: str, now: float) -> str:
        """Why the daemon would not take the command now; empty: it would."""
        if self.state is None or self.silent_s(now) > LOST_S:
            return "not sent: no state from the daemon"
        if name == "target" and self.limits is None:
            return "not sent: the daemon has not described its robot yet; a moment"
        if self._accepts(name):
            return ""
        words = f"{_core.status_text(_REFUSED_IN_MODE)} ({_REFUSED_IN_MODE}, mode {self.state.mode_text})"
        return f"{words}; {_hint(name, self.state)}"

    def _why_unguarded(self) -> str:
        """Why nothing is armed or moved: nobody would disarm after this process; empty: the guard would."""
        return "" if self._guard.ready() else "not sent: the process that disarms when this one ends does not start"

    def _command(self, now: float, send: Callable[[], object], ours: bool = True) -> None:
        """Sends; what makes the robot ours is known to the guard before."""
        self.ours = self.ours or ours
        self._sent_at = now
        self._guard.tell(self.ours, now)
        try:
            send()
        except (DaemonError, ValueError) as error:
            self.jog.block(now)
            self.refuse(str(error))

    def _send_disarm(self, now: float) -> None:
        self._disarmed_at = now
        try:
            self._client.disarm(timeout=0.0)
        except DaemonError as error:
            self.refuse(str(error))


def _hint(name: str, state: State) -> str:
    """What to do first."""
    if state.mode == state_t.MODE_FAULT:
        return "remove its cause, then press c to clear"
    if state.mode == state_t.MODE_HOLD or (state.mode == state_t.MODE_CONFIGURED and name != "clear"):
        return "press a to arm"
    return _core.status_remedy(_REFUSED_IN_MODE)
