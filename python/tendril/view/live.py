"""A running daemon's states, as they come. Subscribes only: nothing here publishes."""

from __future__ import annotations

import collections
import dataclasses
import re
import socket
import time
from typing import Any

from ..messages import run_t, state_t, tracker_t
from . import robots
from .frames import Frame, Recording, ViewError
from .messages import OtherVersion, Tracker, decode, finite, frame_of, lcm_module

KEPT_S = 60.0  # that one can go back
SILENT_S = 1.0
URL_RULE = "udpm://ADDRESS:PORT?ttl=N with a multicast address, e.g. udpm://239.255.76.67:7667?ttl=0; or memq://, tcpq://"
MOST_AT_ONCE = 5000  # messages: a flood must not stop the picture


def require_route(url: str) -> None:
    """LCM itself waits seconds for its own packets where there is no route; the kernel answers at once."""
    match = re.match(r"udpm://([0-9.]+):[0-9]+(\?|$)", url)
    if not match:
        if url.startswith(("memq://", "tcpq://")):
            return
        raise ViewError(f"LCM address '{url}' cannot be opened; accepted: {URL_RULE}; correct it")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((match[1], 7667))
        except OSError:
            raise ViewError(
                f"LCM address '{url}': no multicast route to {match[1]}; add one: 'ip link set lo multicast on && "
                "ip route add 224.0.0.0/4 dev lo' as root"
            ) from None


def open_lcm(url: str) -> Any:
    """A connection; ViewError with the remedy where there is none."""
    lcm = lcm_module()
    require_route(url)
    try:
        return lcm.LCM(url)
    except (RuntimeError, ValueError, OSError):
        raise ViewError(f"LCM address '{url}' cannot be opened; accepted: {URL_RULE}; correct it") from None


class Live:
    """The last minute of a daemon. `recording` is None until its robot is known, and another one when the robot is."""

    def __init__(self, url: str, prefix: str):
        self.url, self.prefix = url, prefix
        self.lcm = open_lcm(url)
        self.recording: Recording | None = None
        self.problem = ""  # with what comes, a line
        self._heard_s: float | None = None
        self._robot_yaml, self._first_utime = "", 0
        self._tracker, self._frames = Tracker(), collections.deque[Frame]()
        self._state: bytes | None = None
        takes = {"STATE": self._take_state, "RUN": self._take_run, "TRACKER": self._take_tracker}
        self._subscriptions = [
            self.lcm.subscribe(f"{re.escape(prefix)}_{name}", takes[name]) for name in takes
        ]
        for subscription in self._subscriptions:
            subscription.set_queue_capacity(200)

    def close(self) -> None:
        while self._subscriptions:
            self.lcm.unsubscribe(self._subscriptions.pop())

    def _take_state(self, _channel: str, data: bytes) -> None:
        self._state, self._heard_s = data, time.monotonic()

    def _take_tracker(self, _channel: str, data: bytes) -> None:
        try:
            message = decode(tracker_t, data)
        except OtherVersion:
            return
        # Without a time of measurement that of arrival counts, on the clock of the states.
        latest = self.recording.frames[-1] if self.recording and self.recording.frames else None
        arrival = self._first_utime + int(1e6 * latest.time_s) if latest else 0
        self._tracker.read(message.tip_W_m, bool(message.valid), message.utime or arrival)

    def _take_run(self, _channel: str, data: bytes) -> None:
        try:
            run = decode(run_t, data)
            if run.robot_yaml == self._robot_yaml:
                return
            robot = robots.drawn(robots.parse_robot(run.robot_yaml, "the daemon's robot"))
        except OtherVersion:
            self.problem = (
                "the daemon's messages are of another version of Tendril: use the same version for both"
            )
            return
        except ViewError as e:
            self.problem = f"the daemon's robot cannot be drawn: {e}"
            return
        self._robot_yaml, self.problem = run.robot_yaml, ""
        self._tracker = Tracker()
        self._frames = collections.deque()
        self.recording = Recording("live", (robot,), self._frames)

    def poll(self) -> bool:
        """Takes what came; True when there is a new frame."""
        for _ in range(MOST_AT_ONCE):
            if self.lcm.handle_timeout(0) <= 0:
                break
        if self._state is None or self.recording is None:
            return False
        data, self._state = self._state, None
        try:
            message = decode(state_t, data)
        except OtherVersion:
            self.problem = (
                "the daemon's messages are of another version of Tendril: use the same version for both"
            )
            return False
        robot = self.recording.robots[0]
        if (message.num_tendons, message.num_bending) != (robot.tendons, 2 * len(robot.units)):
            return False  # of the next robot; its RUN message comes within a second
        return self._append(message)

    def _append(self, message: Any) -> bool:
        recording, frames = self.recording, self._frames
        assert recording is not None
        if not frames:
            self._first_utime = message.utime
        time_s = 1e-6 * (message.utime - self._first_utime)
        if frames and time_s <= frames[-1].time_s:
            if time_s > frames[-1].time_s - 1:
                return False  # seen already, or overtaken
            frames.clear()  # a daemon that was started anew
            self._first_utime, time_s = message.utime, 0.0
        if self._tracker.seen and recording.robots[0].measured_is != "tip, by the tracker":
            robot = dataclasses.replace(recording.robots[0], measured_is="tip, by the tracker")
            recording.robots = (robot,)
        tip = self._tracker.tip_at(message.utime, finite(message.tip_estimate_W_m, 3))
        frames.append(frame_of(recording.robots[0], message, time_s, tip))
        while frames[-1].time_s - frames[0].time_s > KEPT_S:
            frames.popleft()
        return True

    def silence(self) -> str:
        """What to say where nothing comes; empty while states come."""
        if self.problem:
            return self.problem
        if self._heard_s is None:
            return (
                f"waiting: no daemon answers on {self.url} ({self.prefix}_STATE); is tendrild or tendril sim running, "
                "with the same --lcm and --prefix?"
            )
        silent_s = time.monotonic() - self._heard_s
        if silent_s > SILENT_S:
            return f"no state for {silent_s:.0f} s: has the daemon stopped?"
        return (
            ""
            if self.recording
            else "waiting for the daemon's RUN message, which says what robot it controls"
        )
