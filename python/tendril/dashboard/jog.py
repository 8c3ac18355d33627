"""The jog: keys become moving targets that end by themselves. Knows neither terminal nor LCM; time is passed in.

A terminal reports that a key went down and, while it is held, repeats of it; it never reports the release. So the dead
man is the repeat: each event of a jog key permits motion for `release_after`, and nothing else does.

* A held key pauses once, between its first event and the first repeat (the keyboard's delay, 250 to 660 ms by default),
  and then moves on steadily. Moving on through that pause would need a permission longer than the delay, and every
  release would be noticed that much later: 0.66 s instead of 0.15 s.
* `release_after` is longer than the slowest usual repeat (92 ms on a Linux console, 90 ms on macOS, 30 to 40 ms under
  X11 and Wayland) and shorter than the shortest usual delay.
* The permission counts from the time at which the event was read, not from when it is handled: events that queued up
  behind a slow screen have expired and move nothing.
* Each target is valid in the daemon only until the permission ends, plus one interval of sending. A dashboard that is
  killed, stopped or cut off leaves a target that the daemon itself ends; its guard then holds.
"""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np

from .._arrays import Array

SEND_EVERY_S = 0.05
"""Interval between targets."""
RELEASE_AFTER_S = 0.15
"""How long one event of a key permits motion."""
SHARES = (0.1, 0.25, 0.5, 1.0)
"""Speeds to choose from, as shares of the speed limit."""

# How far a target may run ahead of the robot's reference: this, and what the reference covers in _LEAD_S. A reference
# that limits hold back then stops the target too. Within a tenth of the length the gate takes any tip.
_LEAD_RAD, _LEAD_LENGTHS, _MOST_LENGTHS, _LEAD_S = 0.15, 0.03, 0.08, 0.2
_IN_REACH_LENGTHS = 1e-3


class Reference(Protocol):
    """What the jog reads of a `tendril.State`."""

    @property
    def tip_desired_W_m(self) -> Array: ...
    @property
    def bending_desired_rad(self) -> Array: ...
    @property
    def target_distance_m(self) -> float: ...


@dataclasses.dataclass(frozen=True)
class Limits:
    """What bounds the jog: of the robot and of the operator."""

    sections: int
    length: float
    """Of the backbone [m]."""
    max_bending: float
    """Of a section [rad]."""
    tip_speed: float
    """Fastest jog of the tip [m/s]."""
    bend_speed: float
    """Fastest jog of a section's bend [rad/s]."""


@dataclasses.dataclass(frozen=True)
class Target:
    """A target to be sent; at rest with rates of zero."""

    kind: str
    """'tip' or 'bend'"""
    value: Array
    """Tip in the base frame [m], (3,); or bends us, vs of each section [rad], (2K,)."""
    rate: Array
    """Its rate per second, the same shape."""
    valid_for: float
    """[s]"""


class Jog:
    """Which motion the keys permit, and the targets that it takes."""

    def __init__(self, release_after: float = RELEASE_AFTER_S) -> None:
        self.release_after = release_after
        self.kind = "tip"
        self.section = 0
        self._speed = 1
        self._direction: tuple[float, ...] | None = None
        self._permitted_until = float("-inf")
        self._blocked_until: float | None = None  # after a refusal, until the key was released
        self._target: Array | None = None  # where the motion is; None at rest
        self._start = np.zeros(0)
        self._stepped_at = 0.0
        self._held_back = False

    # ---- the keys ----

    @property
    def share(self) -> float:
        """Chosen speed, of the limit."""
        return SHARES[self._speed]

    def faster(self, steps: int) -> None:
        """Chooses another speed; ends a motion."""
        self.release()
        self._speed = min(max(self._speed + steps, 0), len(SHARES) - 1)

    def choose(self, kind: str, section: int = 0) -> None:
        """Jogs the tip, or the bend of a section (from 0); ends a motion."""
        self.release()
        self.kind, self.section = kind, section

    def press(self, direction: tuple[float, ...], at: float) -> None:
        """An event of a jog key, read at time `at` [s]: (x, y, z) or (u, v) of unit length."""
        if self._blocked_until is not None:
            if at <= self._blocked_until:
                self._blocked_until = at + self.release_after
                return
            self._blocked_until = None
        if direction != self._direction:
            self._direction, self._start = direction, np.zeros(0)
        self._permitted_until = max(self._permitted_until, at + self.release_after)

    def release(self) -> None:
        """Ends the permission at once."""
        self._permitted_until = float("-inf")

    def block(self, at: float) -> None:
        """As release, and until the key was let go: the daemon refused."""
        self.release()
        self._blocked_until = at + self.release_after

    def permitted(self, at: float) -> bool:
        """Whether the robot may move."""
        return at < self._permitted_until

    @property
    def moving(self) -> bool:
        """Whether the last target moves."""
        return self._target is not None

    @property
    def held_back(self) -> bool:
        """Whether a limit of the robot keeps the motion from going on."""
        return self._held_back

    # ---- the motion ----

    def step(self, at: float, reference: Reference, limits: Limits) -> Target | None:
        """The target to be sent now, every SEND_EVERY_S; None: nothing is to be sent."""
        if not self.permitted(at):
            return self._stop(at, limits)
        now = self._now(reference)
        if not np.isfinite(now).all():
            self.release()
            return self._stop(at, limits)
        if self._target is None:
            self._target, self._start, self._stepped_at = now.copy(), now.copy(), at
        elif self._start.size == 0:
            self._start = self._target.copy()
        rate = self._rate(limits)
        wish = self._target + rate * min(at - self._stepped_at, 2 * SEND_EVERY_S)
        self._target = self._within(wish, now, reference, limits)
        self._stepped_at = at
        along = float(rate @ (wish - self._target))
        self._held_back = along > 1e-6 * float(rate @ rate)
        if self._held_back:
            rate = np.zeros_like(rate)
        return Target(self.kind, self._target.copy(), rate, self._permitted_until - at + SEND_EVERY_S)

    def _stop(self, at: float, limits: Limits) -> Target | None:
        """At rest where the permission ended; the daemon came there meanwhile."""
        if self._target is None:
            return None
        value = self._target
        if not self._held_back:
            end = min(max(self._permitted_until, self._stepped_at), at)
            value = _bounded(value + self._rate(limits) * (end - self._stepped_at), limits, self.kind)
        self._target, self._held_back = None, False
        return Target(self.kind, value, np.zeros_like(value), 1.0)

    def _now(self, reference: Reference) -> Array:
        return reference.tip_desired_W_m if self.kind == "tip" else reference.bending_desired_rad

    def _rate(self, limits: Limits) -> Array:
        assert self._direction is not None
        if self.kind == "tip":
            return self.share * limits.tip_speed * np.array(self._direction)
        rate = np.zeros(2 * limits.sections)
        rate[2 * self.section : 2 * self.section + 2] = np.array(self._direction[:2])
        return self.share * limits.bend_speed * rate

    def _within(self, wish: Array, now: Array, reference: Reference, limits: Limits) -> Array:
        """The wish, not far ahead of the reference, and within what the gate accepts."""
        rate = self._rate(limits)
        if self.kind == "tip":
            along = rate / np.linalg.norm(rate)
            beside = self._start
            if not reference.target_distance_m <= _IN_REACH_LENGTHS * limits.length:
                beside = self._start = now.copy()  # slides along the surface that the robot reaches
            wish = beside + along * float(along @ (wish - beside))
            lead = _LEAD_LENGTHS * limits.length + _LEAD_S * float(np.linalg.norm(rate))
            return now + _shortened(wish - now, min(lead, _MOST_LENGTHS * limits.length))
        lead = _LEAD_RAD + _LEAD_S * float(np.linalg.norm(rate))
        own = slice(2 * self.section, 2 * self.section + 2)
        wish[own] = now[own] + _shortened(wish[own] - now[own], lead)
        return _bounded(wish, limits, self.kind)


def _bounded(value: Array, limits: Limits, kind: str) -> Array:
    """Each section's bend within the robot's limit."""
    if kind == "tip":
        return value
    pairs = [_shortened(pair, (1 - 1e-9) * limits.max_bending) for pair in value.reshape(-1, 2)]
    return np.concatenate(pairs)


def _shortened(vector: Array, most: float) -> Array:
    length = float(np.linalg.norm(vector))
    return vector * (most / length) if length > most else vector
