"""What a robot's runs say of every effect, to be followed from day to day."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from . import _core
from ._arrays import whole
from .data_set import DataSet, Path, checked_set
from .diagnosis import materiality
from .report import _made
from .simulation import Progress


@dataclass(frozen=True)
class TrackedParameter:
    """A parameter of an effect, as if this effect alone were in the robot, to first order about the robot. It has no
    bounds, so that its error is Gaussian: a friction may be negative within it."""

    effect: str
    where: str
    name: str
    """As in the registry of effects: 'scale', 'N', ..."""
    unit: str
    value: float
    deviation: float
    """One standard deviation."""
    material: float
    """Change of the value that moves the channel where it shows most by its materiality (rms)."""


@dataclass(frozen=True)
class TrackedChannel:
    """A measured quantity that is compared with the model."""

    name: str
    unit: str
    rms: float
    floor: float
    delta: float
    """Materiality."""
    discrepancy: float
    """What the best single effect leaves beyond the noise."""


@dataclass(frozen=True)
class Tracking:
    """Every effect that the runs can show, each alone."""

    parameters: list[TrackedParameter]
    channels: list[TrackedChannel]
    notes: list[str]
    """What was left out of the runs, and why."""

    @property
    def discrepancy(self) -> dict[str, float]:
        """Of each channel: for `track` of later days."""
        return {channel.name: channel.discrepancy for channel in self.channels}


def track(
    robot: _core.Robot | Path,
    data: DataSet | Path | Sequence[Path] | Any,
    *,
    delta_N: float | None = None,
    delta_m: float | None = None,
    discrepancy: Mapping[str, float] | None = None,
    seed: int = 1,
    threads: int = 0,
    same_robot: bool = False,
    progress: Progress | None = None,
) -> Tracking:
    """Estimates every effect alone, with its deviation: the screening of a diagnosis, at a fraction of its cost.

    Args:
        robot: the robot about which effects are tried, or its file.
        data: runs: a DataSet, folders, CSV files or LCM logs, or pandas tables.
        delta_N: tension difference that does not matter in practice [N]; None: from noise floor and signal.
        delta_m: tip distance that does not matter in practice [m]; None: from noise floor and signal.
        discrepancy: by channel; days are weighed alike with that of the first. None: from these runs.
        seed: of alternative readings of the sensors.
        threads: 0: all cores. The result does not depend on it.
        same_robot: the runs are of `robot` although their own robot file differs.
        progress: called with each stage and its completed share.

    Raises:
        tendril.Error: nothing can be compared.
    """
    seed, threads = whole("seed", seed, 0, 2**64 - 1), whole("threads", threads, 0, 256)
    runs = checked_set(robot, data, same_robot)
    text = _core.track(
        runs._core,
        materiality("delta_N", delta_N),
        materiality("delta_m", delta_m),
        seed,
        threads,
        dict(discrepancy or {}),
        progress,
    )
    return _made(Tracking, json.loads(text), "tracking")
