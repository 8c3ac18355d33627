"""Friction of a tendon over a guide pulley."""

from __future__ import annotations

from typing import NamedTuple

from . import _core
from ._arrays import numbers


class Capstan(NamedTuple):
    """Tensions on both sides of a guide pulley (`tendril.capstan`)."""

    ratio: float
    """Motor side over robot side."""
    tension_motor: float
    """[N]"""
    tension_base: float
    """[N], the robot's side."""


def capstan(
    alpha: float,
    wrap: float,
    tension: float,
    *,
    n: float | None = None,
    rho: float | None = None,
    phi1: float = 0.0,
    direction: str = "pull",
    law: str = "cumulative",
    low_tension: float = 0.0,
) -> Capstan:
    """The tension on the motor's side of a guide pulley, as `tendril capstan` computes it.

    Args:
        alpha: friction coefficient [N^(1-n)], 0 to 100.
        wrap: wrap angle [rad], 0 to 100.
        tension: on the robot's side [N], 0 to 1e6; at 0 the ratio is the limit.
        n: friction exponent, 0.05 to 1; the classic law needs none.
        rho: pulley radius over tendon radius; the classic law needs none.
        phi1: entry angle [rad], 0 to 1.5.
        direction: the motor's motion, 'pull' or 'release'.
        law: 'cumulative', 'local' or 'classic'.
        low_tension: below this tension of the low side the ratio found there is kept [N]; 0: nowhere.
    """
    given = {"alpha": alpha, "wrap": wrap, "tension": tension, "phi1": phi1, "low_tension": low_tension}
    for name, value in given.items():
        if numbers(name, value, "a number").ndim != 0:
            raise ValueError(f"{name} has more than one value; give one")
    if direction not in ("pull", "release"):
        raise ValueError(f"direction is {direction!r}; accepted: pull, release")
    if law not in ("cumulative", "local", "classic"):
        raise ValueError(f"law is {law!r}; accepted: cumulative, local, classic")
    if law != "classic" and (n is None or rho is None):
        raise ValueError("n and rho are required (only law='classic' needs neither)")
    release = direction == "release"
    ratio = _core.capstan_ratio(alpha, wrap, tension, n, rho, phi1, release, law, low_tension)
    return Capstan(ratio, ratio * tension, tension)
