"""The diagnosis of the sim-to-real gap."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from . import _core
from ._arrays import file_name, flag, number, whole
from .data_set import DataSet, Path, checked_set
from .effects import effect_texts
from .report import Report
from .simulation import Progress


def diagnose(
    robot: _core.Robot | Path,
    data: DataSet | Path | Sequence[Path] | Any,
    before: DataSet | Path | Sequence[Path] | Any = None,
    *,
    delta_N: float | None = None,
    delta_m: float | None = None,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    seed: int = 1,
    refits: int = 8,
    threads: int = 0,
    next: bool = True,
    daemon: Path | None = None,
    same_robot: bool = False,
    progress: Progress | None = None,
) -> Report:
    """Finds where the gap lies, which effect causes it, and how far it shrinks with the effect in the model.

    Runs without the GIL; Ctrl-C ends it within a second. What makes the data doubtful is warned of before it begins. The
    report depends only on the arguments, and equals that of `tendril gap diagnose` bit for bit.

    Args:
        robot: nominal robot, the one the controller used, or its file.
        data: runs: a DataSet, folders, CSV files or LCM logs, or pandas tables.
        before: runs of the same commands from before the robot changed: the change is diagnosed, and model errors common
            to both cancel.
        delta_N: tension difference that does not matter in practice [N]; None: from noise floor and signal.
        delta_m: tip distance that does not matter in practice [m]; None: from noise floor and signal.
        only: search for these effects only, by name.
        without: effects to leave out of the library.
        seed: of bootstraps and of alternative readings of the sensors.
        refits: candidates refitted in full after the screening, 1 to 200.
        threads: 0: all cores. The result does not depend on it.
        next: look for the next experiment.
        daemon: daemon file whose controller would run the next experiment; None: the one built in.
        same_robot: the runs are of `robot` although their own robot file differs.
        progress: called with each stage and its completed share.

    Raises:
        tendril.Error: the set cannot be diagnosed at all; lesser shortcomings are in `report.degradations`.
    """
    only, without = effect_texts("only", only, "names"), effect_texts("without", without, "names")
    seed = whole("seed", seed, 0, 2**64 - 1)
    refits, threads = whole("refits", refits, 1, 200), whole("threads", threads, 0, 256)
    next = flag("next", next)
    runs = checked_set(robot, data, same_robot, before)
    diagnosis = _core.diagnose(
        runs._core,
        materiality("delta_N", delta_N),
        materiality("delta_m", delta_m),
        seed,
        only,
        without,
        refits,
        threads,
        next,
        "" if daemon is None else file_name("daemon", daemon),
        progress,
    )
    return Report._of(diagnosis)


def materiality(name: str, value: float | None) -> float:
    """A materiality as the rooms take it: 0 stands for None."""
    if value is None:
        return 0.0
    if not number(name, value, "above 0") > 0:
        raise ValueError(f"{name} is {value}; give a number above 0, or None")
    return float(value)
