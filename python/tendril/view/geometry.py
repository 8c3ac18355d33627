"""From bends to points to draw, by tendril.Model. Knows nothing of viser."""

from __future__ import annotations

import dataclasses

import numpy as np

from .._arrays import Array
from .frames import DrawnRobot

POINTS_PER_UNIT = 6  # of the backbone


@dataclasses.dataclass(frozen=True)
class Points:
    """A robot's body in F_0 [m]."""

    backbone_m: Array  # P x 3, base first
    disks: Array  # D x 4 x 4, their poses
    tendons_m: list[Array]  # of each tendon its holes, base first: k x 3


def points_of(robot: DrawnRobot, q: Array) -> Points:
    """The body at one q."""
    model = robot.model
    lines = model.tendon_points(q)  # M x (D + 1) x 3, NaN beyond a tendon's end
    return Points(
        backbone_m=model.backbone(q, points=POINTS_PER_UNIT * sum(robot.units) + 1),
        disks=model.disks(q)[1:],  # without the base's
        tendons_m=[line[np.isfinite(line[:, 0])] for line in lines],
    )


def rotations_to(directions: Array) -> Array:
    """Unit quaternions w, x, y, z (n x 4) that turn +z to each direction (n x 3, any length)."""
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    d = directions / np.where(length > 0, length, 1)
    q = np.stack([1 + d[:, 2], -d[:, 1], d[:, 0], np.zeros(len(d))], axis=1)
    norm = np.linalg.norm(q, axis=1, keepdims=True)
    return np.where(norm > 1e-9, q / np.where(norm > 1e-9, norm, 1), [0.0, 1.0, 0.0, 0.0])


def quaternions_of(poses: Array) -> Array:
    """n x 4: w, x, y, z of poses n x 4 x 4."""
    r = poses[:, :3, :3]
    trace = np.trace(r, axis1=1, axis2=2)
    # The largest of the four squares decides the form, so that none divides by a small number.
    squares = np.stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]], axis=1)
    result = np.empty((len(r), 4))
    for n, case in enumerate(np.argmax(squares, axis=1)):
        m = r[n]
        if case == 0:
            q = [1 + trace[n], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
        else:
            i = case - 1
            j, k = (i + 1) % 3, (i + 2) % 3
            q = [0.0] * 4
            q[0] = m[k, j] - m[j, k]
            q[1 + i] = 1 + m[i, i] - m[j, j] - m[k, k]
            q[1 + j] = m[j, i] + m[i, j]
            q[1 + k] = m[k, i] + m[i, k]
        result[n] = np.asarray(q) / np.linalg.norm(q)
    return result


def bending_of_tips(
    robot: DrawnRobot, tip_m: Array, rotation: Array | None = None, rounds: int = 12
) -> Array:
    """2K for each row: the bend of each section whose tip comes nearest to the measured one, n x 3, and to its
    rotation, n x 3 x 3, where that is known. Constant curvature, levenberg-damped Gauss-Newton; where the tip
    does not determine the bend, the smallest one. NaN where the tip is."""
    sections, n = len(robot.units), len(tip_m)
    radius, height = np.hypot(tip_m[:, 0], tip_m[:, 1]), tip_m[:, 2]
    bend = np.zeros((n, 2 * sections))
    known = np.isfinite(tip_m).all(axis=1)
    # Exact for one section: an arc's chord leans by half of its bend.
    angle = 2 * np.arctan2(radius, height) / np.where(radius > 0, radius, 1)
    for k in range(sections):
        bend[:, 2 * k : 2 * k + 2] = angle[:, None] * tip_m[:, :2] / sections
    bend[~known] = np.nan
    if sections == 1:
        return bend

    def left(x: Array) -> Array:
        pose = robot.model.disks(robot.spread(x))[:, -1]
        error = [(pose[:, :3, 3] - tip_m[known]) / robot.length_m]
        if rotation is not None:
            error.append((pose[:, :3, :3] - rotation[known])[:, :, :2].reshape(len(x), 6))
        return np.concatenate(error, axis=1)

    x, step = bend[known], 1e-6
    for _ in range(rounds if known.any() else 0):
        here = left(x)
        slopes = np.stack([(left(x + step * row) - here) / step for row in np.eye(2 * sections)], axis=2)
        square = slopes.transpose(0, 2, 1) @ slopes + 1e-6 * np.eye(2 * sections)
        x = x - np.linalg.solve(square, np.einsum("nij,ni->nj", slopes, here)[:, :, None])[:, :, 0]
    bend[known] = x
    return bend
