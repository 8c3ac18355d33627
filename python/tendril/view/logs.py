"""LCM logs of the daemon, the simulation or the demo, as recordings."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

import numpy as np

from . import robots
from .frames import DrawnRobot, Frame, Recording, ViewError
from .messages import OtherVersion, Tracker, decode, frame_of, lcm_module, require_same_layout, types

FRAMES_PER_S = 60  # kept of a recording: enough at half speed


@dataclasses.dataclass
class Events:
    """A log's events that the view reads, by channel ending, in the order of the file."""

    states: list[bytes]
    cycles: list[bytes]
    trackers: list[bytes]
    run: bytes | None
    other: int  # events of other channels


def read_events(path: pathlib.Path) -> Events:
    lcm = lcm_module()
    events = Events([], [], [], None, 0)
    lists = {"STATE": events.states, "CYCLE": events.cycles, "TRACKER": events.trackers}
    try:
        log = lcm.EventLog(str(path), "r")
        for event in log:
            ending = event.channel.rpartition("_")[2]
            if ending in lists:
                lists[ending].append(event.data)
            elif ending == "RUN":
                events.run = event.data
            else:
                events.other += 1
        log.close()
    except (OSError, ValueError) as e:
        raise ViewError(f"{path}: cannot be read as an LCM log ({e})") from None
    return events


def other_version(path: pathlib.Path, message: str) -> ViewError:
    return ViewError(
        f"{path}: its {message} messages are of another version of Tendril; accepted: logs of this version; view it "
        "with the version that wrote it, or record it again"
    )


def robot_of_log(path: pathlib.Path, events: Events, given: Any) -> DrawnRobot:
    if given is not None:
        return robots.drawn(given)
    if events.run is None:
        raise ViewError(f"{path}: no RUN message says which robot this is; give its file with --robot")
    try:
        yaml = decode(types().run_t, events.run).robot_yaml
    except OtherVersion:
        raise other_version(path, "RUN") from None
    return robots.drawn(robots.parse_robot(yaml, f"{path}: the robot in this log"))


def _readings(events: Events, path: pathlib.Path) -> list[tuple[int, np.ndarray, bool]]:
    try:
        decoded = [decode(types().tracker_t, data) for data in events.trackers]
    except OtherVersion:
        raise other_version(path, "TRACKER") from None
    return sorted(((m.utime, m.tip_W_m, bool(m.valid)) for m in decoded), key=lambda reading: reading[0])


def _frames(path: pathlib.Path, robot: DrawnRobot, events: Events) -> tuple[list[Frame], bool, int]:
    """The frames, whether a tracker was read, and the number of messages whose time does not increase."""
    kind = types().state_t if events.states else types().cycle_t
    messages = events.states or events.cycles
    readings, used = _readings(events, path), 0
    tracker, backwards = Tracker(), 0
    frames: list[Frame] = []
    first = last = None
    for n, data in enumerate(messages):
        try:
            message = decode(kind, data)
        except OtherVersion:
            # A log may end in the middle of a message.
            if n == len(messages) - 1 and frames:
                break
            raise other_version(path, "STATE" if events.states else "CYCLE") from None
        if first is None:
            require_same_layout(robot, message, f"{path}: the log")
            first = message.utime
        while used < len(readings) and readings[used][0] <= message.utime:
            tracker.read(readings[used][1], readings[used][2], readings[used][0])
            used += 1
        if getattr(message, "tracker_valid", False):
            tracker.read(message.tracker_tip_W_m, True, message.utime)
        if last is not None and message.utime < last:
            backwards += 1
            continue
        if last is not None and message.utime - last < 1e6 / FRAMES_PER_S - 1:
            continue
        last = message.utime
        frames.append(frame_of(robot, message, 1e-6 * (message.utime - first), tracker))
    return frames, tracker.seen, backwards


def read_log(path: pathlib.Path, given: Any = None) -> Recording:
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
    frames, tracked, backwards = _frames(path, robot, events)
    measured = "tip, by the tracker" if tracked else "tip, estimated from the tendons"
    robot = dataclasses.replace(robot, measured_is=measured)
    remarks = []
    if backwards:
        remarks.append(f"{backwards} messages whose time does not increase left out")
    hidden = sum(not np.isfinite(frame.poses[0].q_rad).all() for frame in frames)
    if hidden:
        remarks.append(f"{hidden} of {len(frames)} frames hold no finite bending and show no robot")
    return Recording(path.name, (robot,), frames, tuple(remarks))
