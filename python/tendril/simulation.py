"""Data sets from the simulator, with effects planted to be found."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from . import _core
from ._arrays import file_name, flag, text, whole
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
