"""From the package's robots to what the view draws: the only place of the view that knows tendril's robots."""

from __future__ import annotations

import numpy as np

from .. import _core
from ..model import Model
from .frames import DrawnRobot, ViewError

DISK_PER_HOLE = 1.25  # a disk's radius to that of its outermost hole; the model has no use for the disk's own


def load_robot(path: str) -> _core.Robot:
    """tendril.load_robot; its errors, which name file, line and key, become ViewError."""
    try:
        return _core.load_robot(path)
    except (OSError, RuntimeError, ValueError) as e:
        raise ViewError(str(e)) from None


def parse_robot(yaml: str, of: str) -> _core.Robot:
    """A robot from the text of its file; `of` names it in errors."""
    try:
        return _core.parse_robot(yaml, of)
    except (RuntimeError, ValueError) as e:
        raise ViewError(str(e)) from None


def drawn(robot: _core.Robot, title: str = "", *, coloured_by: str = "base", **names: str) -> DrawnRobot:
    """`coloured_by`: the tension at the base, or the reading of the load cells ("cell")."""
    model = Model(robot)
    bends = 2 * robot.sections
    at_rest = model.spread(np.zeros(bends))
    at_base = coloured_by == "base" or robot.load_cell == "robot_side"
    return DrawnRobot(
        title=title,
        name=robot.name,
        model=model,
        units=tuple(robot.section_units),
        disks=len(model.disks(at_rest)) - 1,
        q_at_rest=at_rest,
        q_per_bending=model.spread(np.eye(bends)) - at_rest,
        length_m=float(robot.length),
        disk_radius_m=DISK_PER_HOLE * float(np.max(robot.tendon_radii)),
        tendons=int(robot.tendons),
        least_tension_N=float(robot.min_tension),
        most_tension_N=float(robot.max_tension_base if at_base else robot.max_tension_motor),
        most_cell_N=float(
            robot.max_tension_base if robot.load_cell == "robot_side" else robot.max_tension_motor
        ),
        gravity_W_mps2=np.asarray(robot.gravity, dtype=float),
        **names,
    )
