"""The model of a robot's body: equilibria, motion, kinematics and their inverses, for one row or many."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from ._arrays import Array, Batch, number, whole

Reached: TypeAlias = "np.bool_ | NDArray[np.bool_]"
Numbers: TypeAlias = "np.float64 | Array"

_Q = "q = u1, v1, ..., the strains of each unit, as Model.coordinates names them"
_DQ = "dq = du1, dv1, ..., the rates of q"
_T = "tensions at the base, one a tendon [N]"


class Tip(NamedTuple):
    """Where the tip is (`Model.fk`); with N rows each array has N rows."""

    position: Array
    """Position of the last disk's centre in the base frame [m], (3,)."""
    orientation: Array
    """Its frame in the base frame as a unit quaternion w, x, y, z with w >= 0, (4,)."""
    tendon_lengths: Array
    """Straight length of each tendon within the robot [m], (M,)."""


class Inverse(NamedTuple):
    """Tensions for a bend (`Model.inverse`); with N rows each array has N rows."""

    tension: Array
    """At the base [N], (M,)."""
    reached: Reached
    """True where they hold the bend; else they are the admissible ones that come nearest."""
    missing: Numbers
    """What is missing: arcs: of the force [N m]; equilibrium: of the bend [rad]. 0 where it is reached."""


class InverseTip(NamedTuple):
    """Tensions for a tip position (`Model.inverse_tip`); with N rows each array has N rows."""

    tension: Array
    """At the base [N], (M,)."""
    q: Array
    """Shape of the equilibrium [rad], (n,)."""
    reached: Reached
    """True where the tip is there; else it is the nearest found within the tension bounds."""
    distance: Numbers
    """From the target to the tip [m]; 0 where it is reached."""
    from_rest: Reached
    """True where raising the tensions from zero ends in this shape; other equilibria exist, to which a robot does not come
    by itself. At rest only; True in motion."""


class Bending(NamedTuple):
    """Bends of the sections for a tip position (`Model.ik`); with N rows each array has N rows."""

    bending: Array
    """us, vs of each section [rad], (2K,)."""
    reached: Reached
    """True where the tip is there; else it is the nearest reachable."""
    distance: Numbers
    """From the target to the tip [m]; 0 where it is reached."""


class Model:
    """The model of one robot.

    Every method takes one row or a batch: arrays of shape `(n,)` give results of one row, arrays of shape `(N, n)` results
    with N rows, computed on all cores without the GIL; one row goes with N rows of another argument. Results do not
    depend on the number of cores, and equal those of `tendril model` bit for bit.

    A robot has K sections, N units, D disks and M tendons. `q` has `n` numbers, named by `coordinates`: of each unit the bend
    `(u, v) = angle (cos, sin)` [rad] and, where its section has them, torsion `w` [rad], extension `e` and shear `sx`, `sy`
    (of its length); `n` is `2 N` where units only bend. Bendings of sections have `2 K`. Positions are in the base frame W
    (F_0), the straight robot points along +z. `inverse`, `inverse_tip`, `ik` and `hinge_angles` are for robots whose units
    only bend; for another they raise `tendril.ConfigError`.

    Wrong shapes and values that are not finite raise ValueError; a row without a solution raises `tendril.ModelError`.
    """

    def __init__(self, robot: _core.Robot) -> None:
        if not isinstance(robot, _core.Robot):
            raise ValueError(f"robot is {type(robot).__name__}; give a Robot, from tendril.load_robot(path)")
        self._robot = robot
        self._core = _core.Model(robot)
        self._n = len(self._core.coordinates)
        self._m = robot.tendons

    @property
    def robot(self) -> _core.Robot:
        """The robot that this is the model of."""
        return self._robot

    @property
    def coordinates(self) -> list[str]:
        """Names of q's n numbers, as the columns of `tendril model`: u1, v1, ..., with w1, e1, sx1, sy1 where there are."""
        return self._core.coordinates

    def statics(self, T: ArrayLike, tip_force: ArrayLike | None = None) -> Array:
        """Shape at rest: the stable equilibrium on the branch from zero tension.

        Args:
            T: tensions at the base [N], (M,) or (N, M).
            tip_force: force on the tip in the base frame [N], (3,) or (N, 3); beside the robot file's own.

        Returns:
            q, (n,) a row. The tip is `fk(q).position`.
        """
        batch = Batch()
        self._add_tensions(batch, T)
        if tip_force is not None:
            batch.add("tip_force", tip_force, 3, "fx, fy, fz in the base frame [N]")
        tension, *force = batch.tables()
        return batch.shaped(self._core.statics(tension, force[0] if force else None))

    def inverse(
        self,
        bending: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        *,
        shape: str = "arc",
        min_tension: float | None = None,
    ) -> Inverse:
        """Tensions of least sum (T - Tmin)^2 that hold a bend, or drive a motion.

        Args:
            bending: us, vs of each section [rad], (2K,) or (N, 2K).
            rate: their rates [rad/s], and
            acceleration: their accelerations [rad/s^2], the same shape; both or neither.
            shape: 'arc': the units of a section share its bend equally, and the tensions balance Kane's equations
                projected on that motion; 'equilibrium': the units bend according to the forces, their sums are us, vs.
            min_tension: least tension of every tendon [N]; None: the robot file's. The upper bound is its
                max_tension_base.
        """
        if shape not in ("arc", "equilibrium"):
            raise ValueError(f"shape is {shape!r}; accepted: arc, equilibrium")
        k = 2 * self._robot.sections
        batch = Batch()
        batch.add("bending", bending, k, "us, vs of each section [rad]")
        _add_motion(batch, k, ("rate", rate), ("acceleration", acceleration))
        bend, *motion = batch.tables()
        dbend, ddbend = motion or (None, None)
        least = self._least(min_tension)
        rows = batch.shaped(self._core.inverse(bend, dbend, ddbend, least, shape == "equilibrium"))
        missing = rows[..., -1]
        return Inverse(rows[..., :-1], missing == 0, missing)

    def inverse_tip(
        self,
        tip: ArrayLike,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        *,
        min_tension: float | None = None,
    ) -> InverseTip:
        """Tensions and shape of the true equilibrium with its tip at a point, or on its way through it.

        Args:
            tip: position in the base frame [m], (3,) or (N, 3).
            velocity: [m/s], and
            acceleration: [m/s^2], the same shape; both or neither.
            min_tension: as in `inverse`.
        """
        batch = Batch()
        batch.add("tip", tip, 3, "x, y, z in the base frame [m]")
        _check_near(tip)
        _add_motion(batch, 3, ("velocity", velocity), ("acceleration", acceleration))
        point, *motion = batch.tables()
        dtip, ddtip = motion or (None, None)
        rows = batch.shaped(self._core.inverse_tip(point, dtip, ddtip, self._least(min_tension)))
        distance = rows[..., -2]
        m = self._m
        return InverseTip(rows[..., :m], rows[..., m:-2], distance == 0, distance, rows[..., -1] != 0)

    def ik(self, tip: ArrayLike) -> Bending:
        """Bends of the sections, as arcs of constant curvature, that bring the tip to a point.

        The search for a row begins at the row before, so that points along a path give bends along a path.

        Args:
            tip: position in the base frame [m], (3,) or (N, 3).
        """
        batch = Batch()
        batch.add("tip", tip, 3, "x, y, z in the base frame [m]")
        _check_near(tip)
        rows = batch.shaped(self._core.ik(*batch.tables()))
        distance = rows[..., -1]
        return Bending(rows[..., :-1], distance == 0, distance)

    def frequencies(self, T: ArrayLike) -> Array:
        """Natural frequencies about the equilibrium at constant tensions, without damping.

        Args:
            T: tensions at the base [N], (M,) or (N, M).

        Returns:
            Frequencies [Hz], ascending, (n,) a row.
        """
        batch = Batch()
        self._add_tensions(batch, T)
        return batch.shaped(self._core.frequencies(*batch.tables()))

    def forward_dynamics(self, q: ArrayLike, dq: ArrayLike, T: ArrayLike) -> Array:
        """Accelerations of a state under tensions.

        Args:
            q: strains of the units, (n,) or (N, n).
            dq: their rates, the same shape.
            T: tensions at the base [N], (M,) or (N, M).

        Returns:
            ddq, (n,) a row.
        """
        batch = Batch()
        batch.add("q", q, self._n, _Q)
        batch.add("dq", dq, self._n, _DQ)
        self._add_tensions(batch, T)
        return batch.shaped(self._core.forward_dynamics(*batch.tables()))

    def fk(self, q: ArrayLike) -> Tip:
        """Pose of the tip and lengths of the tendons.

        Args:
            q: strains of the units, (n,) or (N, n).
        """
        batch = self._shapes(q)
        rows = batch.shaped(self._core.fk(*batch.tables()))
        return Tip(rows[..., 0:3], rows[..., 3:7], rows[..., 7:])

    def jacobian(self, q: ArrayLike) -> Array:
        """Velocity of the tip per rate of q.

        Args:
            q: strains of the units, (n,) or (N, n).

        Returns:
            (6, n) a row: linear velocity [m/s] and angular velocity [rad/s] of the last disk, in the base frame, each
            per dq.
        """
        batch = self._shapes(q)
        return batch.shaped(self._core.jacobian(*batch.tables()), 6, self._n)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Mass matrix H(q), (n, n) a row [kg m^2 where q is in rad], symmetric and positive definite."""
        batch = self._shapes(q)
        return batch.shaped(self._core.mass_matrix(*batch.tables()), self._n, self._n)

    def energy(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Kinetic, elastic and gravity energy [J], (3,) a row; gravity's is zero at the base frame's origin."""
        batch = self._shapes(q)
        batch.add("dq", dq, self._n, _DQ)
        return batch.shaped(self._core.energy(*batch.tables()))

    def backbone(self, q: ArrayLike, points: int = 101) -> Array:
        """Positions along the backbone, equally spaced by arc length from base to tip.

        Args:
            q: strains of the units, (n,) or (N, n).
            points: how many, at least 2.

        Returns:
            Positions in the base frame [m], (points, 3) a row.
        """
        points = whole("points", points, 2, 100_000)
        batch = self._shapes(q)
        (rows,) = batch.tables()
        return batch.shaped(self._core.backbone(rows, points), points, 3)

    def disks(self, q: ArrayLike) -> Array:
        """Frames of the base disk and of every other disk, from the base on.

        Args:
            q: strains of the units, (n,) or (N, n).

        Returns:
            Homogeneous frames in the base frame [m], (D+1, 4, 4) a row. The disk's axis is the frame's z.
        """
        batch = self._shapes(q)
        return batch.shaped(self._core.disks(*batch.tables()), self._core.disk_count + 1, 4, 4)

    def hinge_angles(self, q: ArrayLike) -> Array:
        """Angles of the joints of `Robot.to_urdf` and `Robot.to_mjcf`: unit1_u, unit1_v, unit2_u, ...

        Args:
            q: bends of the units [rad], (2N,) or (N, 2N).

        Returns:
            Joint angles [rad], (2N,) a row: about half of the bends. The joints named ..._end equal them.
        """
        batch = self._shapes(q)
        return batch.shaped(self._core.hinge_angles(*batch.tables()))

    def tendon_points(self, q: ArrayLike) -> Array:
        """Each tendon's polyline: its hole in the base disk and in each disk up to the one where it ends.

        Args:
            q: strains of the units, (n,) or (N, n).

        Returns:
            Positions in the base frame [m], (M, D+1, 3) a row; NaN beyond a tendon's end.
        """
        batch = self._shapes(q)
        return batch.shaped(self._core.tendon_points(*batch.tables()), self._m, self._core.disk_count + 1, 3)

    def spread(self, bending: ArrayLike) -> Array:
        """q of arcs: each section's bend shared equally by its units, without other strains.

        Args:
            bending: us1, vs1, ..., usK, vsK of the sections [rad], (2K,) or (N, 2K).
        """
        batch = Batch()
        batch.add("bending", bending, 2 * self._robot.sections, "us, vs of each section [rad]")
        return batch.shaped(self._core.spread(*batch.tables()))

    def _least(self, min_tension: float | None) -> float:
        if min_tension is None:
            return self._robot.min_tension
        least, most = number("min_tension", min_tension, "newtons"), self._robot.max_tension_base
        if not 0 <= least <= most:
            raise ValueError(f"min_tension is {least} N; give 0 to {most} N (limits.max_tension_base_N of the robot)")
        return least

    def _shapes(self, q: ArrayLike) -> Batch:
        batch = Batch()
        batch.add("q", q, self._n, _Q)
        return batch

    def _add_tensions(self, batch: Batch, T: ArrayLike) -> None:
        batch.add("T", T, self._m, _T)
        if (np.asarray(T, dtype=np.float64) < 0).any():
            raise ValueError("T has a negative value: tendons only pull; give 0 or more [N]")

    def __repr__(self) -> str:
        return f"Model({self._robot!r})"


def _add_motion(batch: Batch, columns: int, *given: tuple[str, ArrayLike | None]) -> None:
    """Rates and accelerations, which come together or not at all."""
    named = {name: value for name, value in given if value is not None}
    if len(named) == 1:
        missing = next(name for name, value in given if value is None)
        raise ValueError(f"{next(iter(named))} is given without {missing}; give both, or neither for rest")
    for name, value in named.items():
        batch.add(name, value, columns, "as many as in the first argument")


def _check_near(tip: ArrayLike) -> None:
    if (np.abs(np.asarray(tip, dtype=np.float64)) > 1e6).any():
        raise ValueError("tip is more than 1e6 m from the base; give metres")
