"""Readings of sensors that are slower than the rows or frames beside them."""

from __future__ import annotations

import numpy as np

from .._arrays import Array
from .frames import unknown

LONGEST_GAP_S = 0.1  # that is bridged between two readings


def between(at_s: Array, time_s: Array, values: Array) -> Array:
    """n x c at these times, on the line between the two readings (k x c, in the order of their times) around each; the
    first or last one beside the ends. NaN where they are too far apart or one of them is."""
    if len(time_s) == 0:
        return unknown(len(at_s), values.shape[1])
    after = np.clip(np.searchsorted(time_s, at_s), 0, len(time_s) - 1)
    before = np.clip(np.searchsorted(time_s, at_s, side="right") - 1, 0, len(time_s) - 1)
    span = np.maximum(time_s[after], at_s) - np.minimum(time_s[before], at_s)
    share = np.where(after > before, (at_s - time_s[before]) / np.where(span > 0, span, 1), 0)[:, None]
    result = (1 - share) * values[before] + share * values[after]
    result[span > LONGEST_GAP_S] = np.nan
    return np.where(np.isfinite(result), result, np.nan)


def filled(time_s: Array, values: Array) -> Array:
    """Every column in every row, from the rows in which it has a reading."""
    result = unknown(*values.shape)
    for column, given in zip(result.T, values.T):
        known = np.isfinite(given)
        column[:] = between(time_s, time_s[known], given[known][:, None])[:, 0]
    return result


def same_side(quaternions: Array) -> Array:
    """Each on the side of the one before: q and -q are one rotation, and lines between them another."""
    known = np.isfinite(quaternions).all(axis=1)
    q = quaternions.copy()
    steps = np.sum(q[known][1:] * q[known][:-1], axis=1)
    signs = np.concatenate([np.ones(min(int(known.sum()), 1)), np.where(steps < 0, -1.0, 1.0)])
    q[known] *= np.cumprod(signs)[:, None]
    return q
