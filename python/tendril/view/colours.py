"""Colours of the view, in one place. Tendons: from blue at the least tension to red at the limit; purple below the
least (it goes slack) and magenta beyond the limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array

BACKBONE = (31, 42, 51)
DISK = (196, 206, 215)
BASE = (90, 102, 112)
REFERENCE = (0, 137, 123)
MEASURED = (245, 124, 0)
LIMIT = (150, 158, 165)
GRAVITY = (94, 53, 177)
NOT_KNOWN = (150, 150, 150)
BELOW, ABOVE = (126, 87, 194), (233, 30, 140)
STOPS = np.array([[38, 84, 194], [38, 166, 190], [76, 175, 80], [253, 196, 40], [211, 35, 35]], dtype=float)


def of_tensions(tension_N: Array, least_N: float, most_N: float) -> NDArray[np.uint8]:
    """n x 3: the colour of each tension. 2 % beyond a limit still count as on it: a controller holds its least
    tension, and cells have noise."""
    share = (np.asarray(tension_N, dtype=float) - least_N) / max(most_N - least_N, 1e-9)
    at = np.linspace(0, 1, len(STOPS))
    filled = np.where(np.isfinite(share), share, 0)
    colours = np.stack([np.interp(filled, at, STOPS[:, c]) for c in range(3)], axis=-1)
    colours[share < -0.02] = BELOW
    colours[share > 1.02] = ABOVE
    colours[~np.isfinite(share)] = NOT_KNOWN
    return colours.astype(np.uint8)


def css(colour: tuple[int, int, int] | Array) -> str:
    return "rgb({},{},{})".format(*(int(c) for c in colour))


def gradient_css() -> str:
    return "linear-gradient(90deg," + ",".join(css(stop) for stop in STOPS) + ")"
