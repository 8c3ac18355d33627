"""The numbers of a robot file, inferred from runs of the robot as it is."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _core
from ._arrays import Array, whole
from .data_set import DataSet, Path, checked_set
from .report import _made
from .simulation import Progress


@dataclass(frozen=True)
class CalibratedNumber:
    """A number of the file, before and after the runs; of a position-controlled robot also what no file holds, such as the zero
    of a tendon."""

    key: str
    unit: str
    deviations_are: str
    """'share' of the value, or the number's unit."""
    of_file: bool
    """False for what no file holds."""
    in_file: float
    value: float
    low: float
    """Lower end of the 95 % interval of the value."""
    high: float
    prior_deviation: float
    """One standard deviation before the runs."""
    deviation: float
    """And after them."""
    learned: float
    """Share of the prior variance that the runs took away."""
    moved: float
    """From the file, in prior standard deviations."""


@dataclass(frozen=True)
class CalibratedChannel:
    """What is compared in the runs, before and after, rms over all of them."""

    name: str
    unit: str
    in_file: float
    """With the file's numbers."""
    held_out: float
    """Each kind of motion predicted with the numbers found from the others."""
    floor: float
    """The sensors' noise."""
    discrepancy: float
    """Left beyond the noise with the numbers of all runs: what the model itself gets wrong."""


@dataclass(frozen=True)
class Calibration:
    """All uncertain numbers of a robot file, inferred from runs. `print(calibration)` shows the table that the command line
    prints."""

    numbers: list[CalibratedNumber]
    channels: list[CalibratedChannel]
    known: list[str]
    """Numbers that the file takes as exact."""
    notes: list[str]
    """What was left out of the runs, and why."""
    held_out_by: str
    """What was held out in turn: 'kinds of motion', 'runs' or 'quarters of the runs'."""
    iterations: int
    converged: bool
    not_learned: str
    """Of a position-controlled robot: why these are not runs of the robot of the file; empty: they are."""
    format: int
    version: str
    correlation: Array = dataclasses.field(repr=False)
    """Of `numbers`, after the runs, (N, N)."""
    robot: _core.Robot = dataclasses.field(repr=False)
    """The file's robot with the numbers found."""
    _text: str = dataclasses.field(repr=False)

    def __str__(self) -> str:
        return self._text


def calibrate(
    robot: _core.Robot | Path,
    data: DataSet | Path | Sequence[Path] | Any,
    *,
    seed: int = 1,
    threads: int = 0,
    same_robot: bool = False,
    progress: Progress | None = None,
) -> Calibration:
    """Infers all uncertain numbers of a robot file together, each within what is known of it.

    Runs without the GIL; Ctrl-C ends it within a second. The numbers equal those of `tendril gap calibrate` bit for bit.

    Args:
        robot: the robot with what is known of its numbers, or its file.
        data: runs of the robot as it is: a DataSet, folders, CSV files or LCM logs, or pandas tables.
        seed: of alternative readings of the sensors.
        threads: 0: all cores. The result does not depend on it.
        same_robot: the runs are of `robot` although their own robot file differs.
        progress: called with each stage and its completed share.

    Raises:
        tendril.Error: nothing can be compared, or the file takes every number as exact.
    """
    seed, threads = whole("seed", seed, 0, 2**64 - 1), whole("threads", threads, 0, 256)
    runs = checked_set(robot, data, same_robot)
    found = _core.calibrate(runs._core, seed, threads, progress)
    values = json.loads(found.json())
    del values["robot"]  # its name, where this has the robot itself
    correlation = np.array(values.pop("correlation"))
    return _made(Calibration, values, "calibration", correlation=correlation, robot=found.robot, _text=found.text())
