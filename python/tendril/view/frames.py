"""What is drawn: one dataclass for a frame, whatever it comes from. Knows nothing of sources or of viser."""

from __future__ import annotations

import bisect
import dataclasses
from collections.abc import Sequence

import numpy as np

from .._arrays import Array
from ..model import Model


class ViewError(Exception):
    """One line for the user: what is wrong, where, what is accepted, the remedy."""


def unknown(*shape: int) -> Array:
    """Values that nobody measured: NaN."""
    return np.full(shape, np.nan)


@dataclasses.dataclass(frozen=True)
class Pose:
    """One robot at one time: M tendons. NaN: not known. Frames and signs as in the LCM messages."""

    q: Array  # strains of the units, as model.coordinates of its robot names them
    tension_N: Array  # M: pull of each tendon, which colours it
    cell_N: Array  # M: readings of the load cells; all NaN: none
    reference_tip_m: Array  # 3, in F_0: where the tip should be
    measured_tip_m: Array  # 3, in F_0: where it is


@dataclasses.dataclass(frozen=True)
class Frame:
    """All robots of the picture at one time."""

    time_s: float  # since the start of the recording
    poses: tuple[Pose, ...]  # one a robot
    note: str = ""  # of this moment: the mode, a fault and its remedy


@dataclasses.dataclass(frozen=True, eq=False)
class DrawnRobot:
    """A robot of the picture."""

    title: str
    name: str
    model: Model
    units: tuple[int, ...]  # of each section
    disks: int
    q_at_rest: Array  # without bending
    q_per_bending: Array  # 2K x n: what an arc of each section adds
    length_m: float
    disk_radius_m: float
    tendons: int
    least_tension_N: float  # limits of what colours the tendons
    most_tension_N: float
    most_cell_N: float  # limit of what the load cells read
    gravity_W_mps2: Array  # 3, in F_0
    reference_is: str = "reference"  # names of the two tips for the legend
    measured_is: str = "measured"

    def spread(self, bending_rad: Array) -> Array:
        """q of arcs, from (us, vs) of each section, 2K or rows of them; NaN where one is not known."""
        return np.asarray(self.q_at_rest + bending_rad @ self.q_per_bending)


@dataclasses.dataclass
class Recording:
    """Frames in the order of their time, complete or still growing."""

    title: str
    robots: tuple[DrawnRobot, ...]
    frames: Sequence[Frame]
    remarks: tuple[str, ...] = ()

    @property
    def duration_s(self) -> float:
        return self.frames[-1].time_s if self.frames else 0.0

    def at(self, time_s: float) -> int:
        """Index of the last frame that is not later than this; the first where there is none."""
        return max(bisect.bisect_right(self.frames, time_s, key=lambda frame: frame.time_s) - 1, 0)
