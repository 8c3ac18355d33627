"""LCM logs of the daemon, the simulation or the demo, as recordings."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

import numpy as np

from .. import _core
from .._arrays import Array
from ..errors import Error
from ..messages import cycle_t, run_t, state_t, tracker_t
from . import robots
from .frames import DrawnRobot, Recording, ViewError, unknown
from .messages import OtherVersion, decode, finite, frame_of, require_same_layout
from .readings import between

FRAMES_PER_S = 60  # kept of a recording: enough at half speed
LCM_SYNC = b"\xed\xa1\xda\x01"
AT_ONCE = 4096  # events


@dataclasses.dataclass
class Events:
    """A log's events that the view reads, by channel ending, in the order of the file."""

    states: list[bytes]
    cycles: list[bytes]
    trackers: list[tuple[bytes, int]]  # and when they were recorded [us]
    run: bytes | None
    other: int  # events of other channels
    damage: str = ""  # a line


def read_events(path: pathlib.Path) -> Events:
    """Of one daemon: another one's on the same address have a prefix of their own and are left out."""
    by_prefix: dict[str, Events] = {}
    try:
        log = _core.LogMessages(str(path))
    except Error as e:
        raise ViewError(f"{path}: {e}") from None
    while messages := log.next(AT_ONCE):
        for channel, _, utime, data in messages:
            prefix, _, ending = channel.rpartition("_")
            events = by_prefix.setdefault(prefix, Events([], [], [], None, 0))
            lists = {"STATE": events.states, "CYCLE": events.cycles}
            if ending in lists:
                lists[ending].append(data)
            elif ending == "TRACKER":
                events.trackers.append((data, utime))
            elif ending == "RUN":
                events.run = data
            else:
                events.other += 1
    of_daemons = [events for events in by_prefix.values() if events.states or events.cycles]
    # Of several the first one that says which robot it is.
    of_daemons.sort(key=lambda events: events.run is None)
    found = of_daemons[0] if of_daemons else Events([], [], [], None, 0)
    if not of_daemons:
        found.other = sum(e.other + (e.run is not None) for e in by_prefix.values())
    found.damage = log.damage()
    return found


def other_version(path: pathlib.Path, message: str) -> ViewError:
    return ViewError(
        f"{path}: its {message} messages are of another version of Tendril; accepted: logs of this version; view it "
        "with the version that wrote it, or record it again"
    )


def robot_of_log(path: pathlib.Path, events: Events, given: _core.Robot | None) -> DrawnRobot:
    if given is not None:
        return robots.drawn(given)
    if events.run is None:
        raise ViewError(f"{path}: no RUN message says which robot this is; give its file with --robot")
    try:
        yaml = decode(run_t, events.run).robot_yaml
    except OtherVersion:
        raise other_version(path, "RUN") from None
    return robots.drawn(robots.parse_robot(yaml, f"{path}: the robot in this log"))


def _tracker(path: pathlib.Path, events: Events, messages: list[Any]) -> tuple[Array, Array]:
    """Times [us] and tips (k x 3, NaN where it lost the tip) of the tracker's readings, by its own messages or those of
    the cycles."""
    try:
        own = [(decode(tracker_t, data), utime) for data, utime in events.trackers]
    except OtherVersion:
        raise other_version(path, "TRACKER") from None
    found = [(m.utime or arrived, finite(m.tip_W_m, 3) if m.valid else unknown(3)) for m, arrived in own]
    for m in messages if not found else []:
        if getattr(m, "tracker_valid", False):
            found.append((m.utime - (m.time_ns - m.tracker_time_ns) // 1000, finite(m.tracker_tip_W_m, 3)))
    found.sort(key=lambda reading: reading[0])
    times = np.array([utime for utime, _ in found], dtype=float)
    return times, np.array([tip for _, tip in found]).reshape(-1, 3)


def _decoded(path: pathlib.Path, events: Events) -> list[Any]:
    """The states, or the cycles of a log that has no states."""
    kind = state_t if events.states else cycle_t
    messages: list[Any] = []
    for n, data in enumerate(data_of := events.states or events.cycles):
        try:
            messages.append(decode(kind, data))
        except OtherVersion:
            # A log may end in the middle of a message.
            if n == len(data_of) - 1 and messages:
                break
            raise other_version(path, "STATE" if events.states else "CYCLE") from None
    return messages


def _kept(messages: list[Any]) -> tuple[list[Any], int]:
    """Sixty a second, and how many were left out because their time does not increase."""
    kept: list[Any] = []
    latest, backwards = messages[0].utime, 0
    for message in messages:
        backwards += message.utime < latest
        if message.utime < latest or kept and message.utime - kept[-1].utime < 1e6 / FRAMES_PER_S - 1:
            continue
        kept.append(message)
        latest = message.utime
    return kept, backwards


def read_log(path: pathlib.Path, given: _core.Robot | None = None) -> Recording:
    """The whole log, 60 frames a second. `given`: the robot, instead of the log's own."""
    events = read_events(path)
    if not events.states and not events.cycles:
        what = (
            "no message at all" if events.other == 0 and events.run is None else "no STATE or CYCLE message"
        )
        raise ViewError(
            f"{path}: {what} in this log; accepted: LCM logs of a daemon, tendril sim or tendril demo"
        )
    robot = robot_of_log(path, events, given)
    messages = _decoded(path, events)
    require_same_layout(robot, messages[0], f"{path}: the log")
    kept, backwards = _kept(messages)
    read_us, tips = _tracker(path, events, messages)
    at_us = np.array([message.utime for message in kept], dtype=float)
    times_s = 1e-6 * (at_us - at_us[0])
    if len(read_us):
        robot = dataclasses.replace(robot, measured_is="tip, by the tracker")
        measured = between(times_s, 1e-6 * (read_us - at_us[0]), tips)
    else:
        robot = dataclasses.replace(robot, measured_is="tip, estimated from the tendons")
        measured = np.array([finite(message.tip_estimate_W_m, 3) for message in kept])
    frames = [frame_of(robot, m, float(t), tip) for m, t, tip in zip(kept, times_s, measured)]
    remarks = []
    if events.damage:
        remarks.append(f"the log is damaged: {events.damage}")
    if backwards:
        remarks.append(f"{backwards} messages whose time does not increase left out")
    hidden = sum(not np.isfinite(frame.poses[0].q).all() for frame in frames)
    if hidden:
        remarks.append(f"{hidden} of {len(frames)} frames hold no finite bending and show no robot")
    return Recording(path.name, (robot,), frames, tuple(remarks))
