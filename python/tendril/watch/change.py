"""Whether a robot changed since its accepted state: one test for steps and slow drifts. Knows numbers and dates only.

A number's days differ from its accepted value by

    d_t = a h_t + e_t + e_0,    e_t ~ N(0, s_t^2),  e_0 ~ N(0, s_0^2)

where h_t is 0 before an onset and then a step or a line in time. e_0, the error of the accepted value, is
common to all days. a is the generalised least-squares estimate and z = a / deviation(a). Onsets 1, 2, 4, ...
entries ago are tried, so a fast change is found at once and a slow one as soon as its days together show it.
|z| has to pass the quantile that leaves the false alarms asked for, shared by all numbers and onsets
(Bonferroni: no more than that, however they depend on each other)."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .store import Entry, Key, Number

DAY_s = 86400.0
YEAR_days = 365
TWO_SIDED_95 = 1.959964
ONE_SIDED_95 = 1.644854
# Relative deviation of the median of n squared differences of successive Gaussian days, which share a day (simulated),
# times sqrt(n).
MEDIAN_SPREAD = 2.55
SCATTER_DAYS = 10  # differences between days from which the scatter of days is known

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """A number that is no longer what was accepted."""

    effect: str
    where: str
    name: str
    unit: str
    amount: float
    """On the last day."""
    ci: tuple[float, float]
    """Of the amount, 95 %."""
    shape: str
    """'step' or 'drift'."""
    since: float
    """[s since the epoch] the first entry that has it; a drift began after the one before."""
    per_day: float | None
    """Rate of a drift."""
    z: float
    threshold: float
    material: float
    """The amount that matters."""

    @classmethod
    def of(cls, key: Key, unit: str, amount: float, deviation: float, **how: Any) -> Change:
        """Of a number: by `amount`, with its standard deviation."""
        spread = TWO_SIDED_95 * deviation
        ci = (amount - spread, amount + spread)
        return cls(effect=key.effect, where=key.where, name=key.name, unit=unit, amount=amount, ci=ci, **how)

    @property
    def alarm(self) -> bool:
        return abs(self.amount) >= self.material

    @property
    def key(self) -> Key:
        return Key(self.effect, self.where, self.name)

    def as_json(self) -> dict[str, Any]:
        return {**vars(self), "alarm": self.alarm}


@dataclass(frozen=True)
class _Course:
    """The differences of one number from its accepted value."""

    at: Vector
    before: float
    """Time of the accepted state."""
    difference: Vector
    variance: Vector
    common: float
    """Variance of the accepted value."""

    def shapes(self, onset: int) -> Iterator[tuple[str, Vector]]:
        n = len(self.at)
        began = np.arange(n) >= onset
        yield "step", began.astype(float)
        if onset < n - 1:
            start = self.at[onset - 1] if onset else self.before
            yield "drift", np.where(began, (self.at - start) / DAY_s, 0.0)

    def fit(self, shape: Vector) -> tuple[float, float]:
        """Amount of this shape and its deviation; (0, inf) where the days cannot show it."""
        weight = 1 / self.variance
        share = self.common / (1 + self.common * weight.sum())
        weighted = weight * shape
        # Inverse covariance times shape (Sherman and Morrison).
        solved = weighted - weight * share * weighted.sum()
        information = float(solved @ shape)
        if not information > 0:
            return 0.0, math.inf
        return float(solved @ self.difference) / information, 1 / math.sqrt(information)


def onsets(days: int) -> list[int]:
    """Indices of the entries at which a change may have begun: 1, 2, 4, ... entries ago, and the first."""
    return sorted({0, *(days - 2**k for k in range(days.bit_length()) if 2**k <= days)})


def threshold(numbers: int, days: int, false_alarms_per_year: float) -> float:
    """What |z| has to pass, with a test of every number at every entry."""
    tests = numbers * (2 * len(onsets(days)) - 1)  # a step and a drift; at the last entry they are the same
    return -statistics.NormalDist().inv_cdf(false_alarms_per_year / YEAR_days / tests / 2)


def changes(accepted: Entry, days: Sequence[Entry], false_alarms_per_year: float) -> list[Change]:
    """What the last of `days` (by time) shows with those before it, the surest first; also what does not matter yet."""
    if not days:
        return []
    tested = {key: number for key, number in accepted.numbers.items() if key in days[-1].numbers}
    limit = threshold(max(len(tested), 1), len(days), false_alarms_per_year)
    found = (_change(key, number, accepted.at, days, limit) for key, number in tested.items())
    return sorted((change for change in found if change is not None), key=lambda change: -abs(change.z))


def _change(key: Key, number: Number, before: float, days: Sequence[Entry], limit: float) -> Change | None:
    having = [day for day in days if key in day.numbers]
    course = _course(number, before, [day.at for day in having], [day.numbers[key] for day in having])
    if max(_significance(course, onset)[0] for onset in onsets(len(having))) <= limit:
        return None
    # Found; every entry may be where it began.
    z, shape, onset, amount, deviation = max(_significance(course, onset) for onset in range(len(having)))
    last = float(dict(course.shapes(onset))[shape][-1])
    return Change.of(
        key,
        number.unit,
        amount * last,
        deviation * last,
        shape=shape,
        since=float(course.at[onset]),
        per_day=amount if shape == "drift" else None,
        z=math.copysign(z, amount),
        threshold=limit,
        material=number.material,
    )


def _significance(course: _Course, onset: int) -> tuple[float, str, int, float, float]:
    """|z|, shape, onset, amount and deviation of the better shape."""
    fits = [(name, *course.fit(shape)) for name, shape in course.shapes(onset)]
    return max((abs(amount) / deviation, name, onset, amount, deviation) for name, amount, deviation in fits)


def _course(accepted: Number, before: float, at: Sequence[float], numbers: Sequence[Number]) -> _Course:
    values = np.array([number.value for number in numbers])
    variance = np.array([number.deviation for number in numbers]) ** 2
    scatter = _scatter(values, variance)  # the accepted state is of one day too
    return _Course(
        at=np.array(at),
        before=before,
        difference=values - accepted.value,
        variance=scatter * variance,
        common=scatter * accepted.deviation**2,
    )


def _scatter(values: Vector, variance: Vector) -> float:
    """How much more than their intervals days differ from the days before them (variances): temperature, setting
    up. By the median, which a step does not move; a slow drift hardly shows from day to day. 1 where few days are
    there or chance may be the reason, else the upper end of its interval."""
    if len(values) <= SCATTER_DAYS:
        return 1.0
    squares = np.diff(values) ** 2 / (variance[1:] + variance[:-1])
    of_chance = statistics.NormalDist().inv_cdf(0.75) ** 2  # median of chi-square with one degree of freedom
    ratio = float(np.median(squares)) / of_chance
    unsure = 1 + ONE_SIDED_95 * MEDIAN_SPREAD / math.sqrt(len(squares))
    return ratio * unsure if ratio > unsure else 1.0
