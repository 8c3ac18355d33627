"""Data sets, which `tendril gap` reads as well, as recordings: one a run."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._arrays import Array
from ..data_set import DataSet
from . import robots
from .frames import DrawnRobot, Frame, Pose, Recording, ViewError, unknown
from .geometry import bending_of_tips
from .logs import FRAMES_PER_S
from .readings import LONGEST_GAP_S, filled, same_side


@dataclasses.dataclass(frozen=True)
class Run:
    """A run's columns, S rows. NaN: no new value; no columns: not measured."""

    name: str
    time_s: Array  # S
    tension_N: Array  # S x M
    tip_m: Array  # S x 3
    tip_quaternion: Array  # S x 4: w, x, y, z
    bending_rad: Array  # S x 2K


def open_set(paths: list[str], robot: _core.Robot | None = None) -> DataSet:
    """The package's data set of any mixture of folders, CSV files and logs; `robot` instead of its own."""
    try:
        return DataSet.from_folder(*paths, robot=robot)
    except (OSError, RuntimeError, ValueError) as e:
        raise ViewError("; ".join(line.strip() for line in str(e).splitlines())) from None


def kept_rows(time_s: Array) -> NDArray[np.intp]:
    """Rows for 60 frames a second; all of a slower table."""
    if len(time_s) == 0 or not np.isfinite(time_s).all() or (np.diff(time_s) < 0).any():
        raise ViewError("its times are not finite or do not increase")
    grid = np.floor((time_s - time_s[0]) * FRAMES_PER_S + 1e-9)
    return np.flatnonzero(np.diff(grid, prepend=-1) > 0)


def rotations_of(quaternions: Array) -> Array:
    """n x 3 x 3 of unit quaternions w, x, y, z."""
    w, x, y, z = quaternions.T
    return np.moveaxis(
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        ),
        2,
        0,
    )


def measured_shape(robot: DrawnRobot, run: Run, rows: NDArray[np.intp]) -> tuple[Array, str]:
    """n rows of q, and how it was found: recorded bends, else the arc through the tracked tip, else the model's
    equilibrium under the measured tensions."""
    bends = filled(run.time_s, run.bending_rad)[rows] if run.bending_rad.size else unknown(len(rows), 0)
    if np.isfinite(bends).any():
        return robot.spread(bends), "bends as recorded"
    if np.isfinite(run.tip_m).any():
        tip = filled(run.time_s, run.tip_m)[rows]
        rotation = None
        if run.tip_quaternion.size and len(robot.units) > 1:
            quaternion = filled(run.time_s, same_side(run.tip_quaternion))[rows]
            tip[~np.isfinite(quaternion).all(axis=1)] = np.nan
            rotation = rotations_of(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))
        bends = bending_of_tips(robot, tip, rotation)
        return robot.spread(bends), "arcs through the tracked tip"
    if np.isfinite(run.tension_N).any():
        tension = filled(run.time_s, run.tension_N)[rows]
        known = np.isfinite(tension).all(axis=1)
        shape = unknown(len(rows), robot.q_at_rest.size)
        if known.any():
            shape[known] = robot.model.statics(np.maximum(tension[known], 0))
        return shape, "the model's equilibrium under the measured tensions"
    return unknown(len(rows), robot.q_at_rest.size), ""


def recording_of(robot: DrawnRobot, run: Run) -> Recording:
    """One run; ViewError names it where nothing of it can be drawn."""
    try:
        rows = kept_rows(run.time_s)
    except ViewError as e:
        raise ViewError(f"run {run.name}: {e}") from None
    shape, how = measured_shape(robot, run, rows)
    known = np.flatnonzero(np.isfinite(shape).all(axis=1))
    if len(known) and run.time_s[rows[known[0]]] - run.time_s[0] <= LONGEST_GAP_S:
        rows, shape = rows[known[0] :], shape[known[0] :]  # until a slower sensor's first reading
    if not how:
        raise ViewError(
            f"run {run.name}: neither bends, a tip nor tensions are recorded: nothing can be drawn of it"
        )
    n, tendons = len(rows), robot.tendons
    tension = filled(run.time_s, run.tension_N)[rows] if run.tension_N.size else unknown(n, tendons)
    tip = filled(run.time_s, run.tip_m)[rows] if run.tip_m.size else unknown(n, 3)
    times = run.time_s[rows] - run.time_s[0]
    frames = [
        Frame(float(times[i]), (Pose(shape[i], tension[i], tension[i], unknown(3), tip[i]),))
        for i in range(n)
    ]
    hidden = int((~np.isfinite(shape).all(axis=1)).sum())
    remarks = [f"shape: {how}"]
    if hidden:
        remarks.append(f"{hidden} of {n} frames have no finite values for it and show no robot")
    return Recording(run.name, (robot,), frames, tuple(remarks))


def columns(run: _core.Run) -> Run:
    """Of the package's run, where None is what was not measured."""
    none = unknown(0, 0)
    channels = (run.tension, run.tip, run.tip_orientation, run.bending)
    return Run(run.name, run.time, *(none if channel is None else channel for channel in channels))


def read_set(paths: list[str], given: _core.Robot | None = None) -> list[Recording]:
    data = open_set(paths, given)
    robot = robots.drawn(data.robot, coloured_by="cell", measured_is="tip, by the tracker")
    recordings, problems = [], []
    for run in data.runs:
        try:
            recordings.append(recording_of(robot, columns(run)))
        except ViewError as e:
            problems.append(str(e))
    if not recordings:
        raise ViewError(
            f"{', '.join(map(str, paths))}: no run to draw" + (f": {problems[0]}" if problems else "")
        )
    if problems:
        recordings[0].remarks += tuple(problems)
    return recordings
