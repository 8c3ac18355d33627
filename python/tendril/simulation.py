"""Data sets from the simulator, with effects planted to be found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from ._arrays import Array, file_name, flag, number, numbers, text, whole
from .data_set import DataSet, Path, as_robot
from .effects import effect_texts

Progress = Callable[[str, float], object]
"""Called as `progress(stage, share)` with the completed share of the stage, 0 to 1, on the caller's thread."""


def simulate(
    robot: _core.Robot | Path,
    effects: Sequence[str] = (),
    *,
    set: str = "standard",
    plan: Path | None = None,
    seed: int = 1,
    repeats: int | None = None,
    noise: bool = True,
    load_cell: str | None = None,
    tracker: bool = True,
    daemon: Path | None = None,
    jobs: int = 2,
    progress: Progress | None = None,
) -> DataSet:
    """Runs of a simulated robot with given effects, controlled with the nominal robot: as `tendril gap simulate`.

    Args:
        robot: nominal robot, or its file (a rig: with actuation).
        effects: of the simulated robot, each as a text such as 'backlash where=tendon:2 rad=0.05', or with its size in
            noise floors: 'backlash sigma=3'. `tendril.effects()` lists all.
        set: experiments, 'standard' (about 150 s of data) or 'quick' (about 60 s).
        plan: experiments from a plan file instead.
        seed: of the sensors' noise.
        repeats: identical repetitions of every run, instead of those in the plan.
        noise: of the sensors.
        load_cell: its place if not the file's: 'motor_side', 'robot_side' or 'none'.
        tracker: whether the tip is tracked.
        daemon: daemon file whose controller runs the experiments; None: the one built in.
        jobs: runs at a time; the result does not depend on it.
        progress: called with each run's name and completed share.

    Returns:
        The runs, with `robot` as their nominal robot. Equal arguments give equal numbers.
    """
    runs, _sizes = _core.simulate(
        as_robot(robot),
        effect_texts("effects", effects, "texts"),
        text("set", set),
        None if plan is None else file_name("plan", plan),
        "" if daemon is None else file_name("daemon", daemon),
        whole("seed", seed, 0, 2**64 - 1),
        None if repeats is None else whole("repeats", repeats, 0, 20),
        flag("noise", noise),
        None if load_cell is None else text("load_cell", load_cell),
        flag("tracker", tracker),
        whole("jobs", jobs, 1, 64),
        progress,
    )
    return DataSet(runs)


class Motions(NamedTuple):
    """What R simulated robots did in S steps: true values at the ends of the steps, NaN where a solver gave up."""

    time: Array
    """Ends of the steps [s], (S,)."""
    tip: Array
    """Position of the last disk [m], (R, S, 3)."""
    bending: Array
    """(us, vs) of each section [rad], (R, S, 2K)."""
    tension_base: Array
    """Tensions at the robot's base [N], (R, S, M)."""
    tension_motor: Array
    """Tensions on the motors' side of the pulleys [N], (R, S, M)."""
    motor_angle: Array
    """[rad], (R, S, M)."""
    failed: list[str]
    """Why a robot's solver gave up; empty where it did not, (R)."""


def simulate_torques(
    robot: _core.Robot | Path,
    torque: ArrayLike,
    step: float,
    variants: Sequence[Sequence[str]] = ((),),
    *,
    tolerance: float = 1e-7,
    jobs: int = 2,
    progress: Progress | None = None,
) -> Motions:
    """Many robots at once under the same motor torques, without a controller.

        masses = np.linspace(0, 0.005, 50)
        found = tendril.simulate_torques(robot, torque, 0.001, [[f"tip_payload mass_kg={m}"] for m in masses])
        found.tip[:, -1]                                            # where each ends

    Each starts straight and at rest, every tendon at the minimum tension.

    Args:
        robot: nominal robot, or its file (a rig: with actuation).
        torque: of the motors [N·m], (S, M), at each tendon; a row holds for one step. Of an
            antagonistic pair the first tendon's counts.
        step: length of a step [s].
        variants: for each robot the effects that it has beyond the nominal one, as in `simulate`; [[]] is the nominal
            robot alone.
        tolerance: relative, of the integration; tighter than the default it shows how far that is off.
        jobs: robots at a time; the result does not depend on it.
        progress: called with the completed share.
    """
    nominal = as_robot(robot)
    table = numbers("torque", torque, "(S, M) torques [N·m]")
    if table.ndim != 2 or table.shape[0] == 0 or table.shape[1] != nominal.tendons:
        raise ValueError(
            f"torque has shape {table.shape}; give (S, {nominal.tendons}): a row a step, S at least 1"
        )
    length = number("step", step, "seconds")
    if not 1e-5 <= length <= 1:
        raise ValueError(f"step is {length:g} s; give 1e-5 to 1 s")
    relative = number("tolerance", tolerance, "a relative tolerance")
    if not 1e-12 <= relative <= 1e-3:
        raise ValueError(f"tolerance is {relative:g}; give 1e-12 to 1e-3")
    if isinstance(variants, str):
        raise ValueError(
            f"variants is the text {variants!r}; give a list of lists of effects: [[{variants!r}]]"
        )
    if not len(variants):
        raise ValueError(
            "variants is empty; give a list of effects for each robot, [[]] for the nominal one alone"
        )
    effects = [effect_texts(f"variants[{i}]", variant, "texts") for i, variant in enumerate(variants)]
    *tables, failed = _core.simulate_torques(
        nominal, effects, table, length, relative, whole("jobs", jobs, 1, 64), progress
    )
    tip, bending, base, motor, angle = (rows.reshape(len(effects), table.shape[0], -1) for rows in tables)
    return Motions(length * np.arange(1, table.shape[0] + 1), tip, bending, base, motor, angle, failed)
