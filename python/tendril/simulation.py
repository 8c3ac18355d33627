"""Data sets from the simulator, with effects planted to be found."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

from . import _core
from .data_set import DataSet, Path
from .effects import check_effect

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
    nominal = robot if isinstance(robot, _core.Robot) else _core.load_robot(os.fspath(robot))
    if isinstance(effects, str):
        raise ValueError(f"effects is the text {effects!r}; give a list of texts: [{effects!r}]")
    for effect in effects:
        check_effect(effect)
    _check("seed", seed, 0, 2**64 - 1)
    _check("jobs", jobs, 1, 64)
    if repeats is not None:
        _check("repeats", repeats, 0, 20)
    runs, _sizes = _core.simulate(
        nominal,
        list(effects),
        set,
        None if plan is None else os.fspath(plan),
        "" if daemon is None else os.fspath(daemon),
        seed,
        repeats,
        noise,
        load_cell,
        tracker,
        jobs,
        progress,
    )
    return DataSet(runs)


def _check(name: str, value: int, least: int, most: int) -> None:
    if not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{name} is {value!r}; give a whole number from {least} to {most}")
