"""The LCM messages that the view reads, as poses. Knows nothing of where they come from."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from .._arrays import Array
from ..errors import install
from ..messages import state_t
from .frames import DrawnRobot, Frame, Pose, ViewError, unknown
from .readings import LONGEST_GAP_S


def lcm_module() -> Any:
    """The Python bindings of LCM."""
    try:
        import lcm
    except ImportError:
        raise ViewError(
            f"running daemons need lcm, which is not installed; install it: {install('view')}"
        ) from None
    return lcm


class OtherVersion(Exception):
    """A message of another version of the program."""


def decode(kind: Any, data: bytes) -> Any:
    try:
        return kind.decode(data)
    except (ValueError, OverflowError, UnicodeDecodeError) as e:
        raise OtherVersion(kind.__name__) from e
    except Exception as e:  # struct.error: a message cut short
        raise OtherVersion(kind.__name__) from e


def finite(values: Any, size: int) -> Array:
    """As an array of this size: NaN for what is infinite or missing."""
    array = np.asarray(values, dtype=float).reshape(-1)
    if array.size != size:
        return unknown(size)
    return np.where(np.isfinite(array), array, np.nan)


@dataclasses.dataclass
class Tracker:
    """The last reading of an external tracker."""

    tip_m: Array = dataclasses.field(default_factory=lambda: unknown(3))
    utime: int = -(2**62)
    seen: bool = False

    def read(self, tip_m: Any, valid: bool, utime: int) -> None:
        if valid:
            self.tip_m, self.utime, self.seen = finite(tip_m, 3), utime, True

    def tip_at(self, utime: int, estimate_m: Array) -> Array:
        """Measured where there is a reading; estimated from the tendons on a robot without a tracker."""
        if not self.seen:
            return estimate_m
        return self.tip_m if utime - self.utime <= 1e6 * LONGEST_GAP_S else unknown(3)


def mode_words() -> dict[int, str]:
    names = [name for name in dir(state_t) if name.startswith("MODE_")]
    return {getattr(state_t, name): name[5:].replace("_", " ").lower() for name in names}


def note_of(message: Any) -> str:
    """The mode, and a fault or warning with its remedy."""
    if not hasattr(message, "mode_text"):
        return mode_words().get(message.mode, f"mode {message.mode}")
    if message.status == 0:
        return str(message.mode_text)
    remedy = f": {message.status_remedy}" if message.status_remedy else ""
    return f"{message.mode_text} · {message.status} {message.status_text}{remedy}"


def frame_of(robot: DrawnRobot, message: Any, time_s: float, measured_tip_m: Array) -> Frame:
    """A frame of a state_t or a cycle_t, which name the same values alike but for the reference's tip."""
    tendons = robot.tendons
    bending = finite(message.bending_estimate_rad, 2 * len(robot.units))
    reference = getattr(message, "tip_desired_W_m", None) or getattr(message, "reference_tip_W_m", ())
    pose = Pose(
        q=robot.spread(bending),
        tension_N=finite(message.tension_base_estimate_N, tendons),
        cell_N=finite(message.tension_measured_N, tendons),
        reference_tip_m=finite(reference, 3),
        measured_tip_m=measured_tip_m,
    )
    return Frame(time_s, (pose,), note_of(message))


def require_same_layout(robot: DrawnRobot, message: Any, of: str) -> None:
    sections = message.num_bending // 2
    if (message.num_tendons, sections) != (robot.tendons, len(robot.units)):
        raise ViewError(
            f"{of} is of a robot with {message.num_tendons} tendons and {sections} sections; '{robot.name}' has "
            f"{robot.tendons} and {len(robot.units)}: give the robot file that belongs to it with --robot"
        )
