"""Equilibria and small vibrations of a tendon-driven rod with disks: a Cosserat rod between disks, solved by shooting.

Written from the textbook equations (Antman, Nonlinear Problems of Elasticity, ch. 8), as the yardstick of the model of
units; shares nothing with it. In the base frame, with s the length along the unstrained rod:

    p' = R v     R' = R k^     n' = 0     m' = -p' x n
    v = e_z + diag(1/GA, 1/GA, 1/EA) R^T n      k = diag(1/EI, 1/EI, 1/GJ) R^T m

n and m are force and moment that the part beyond s exerts on the part before it; loads act at nodes alone. An infinite
stiffness switches its strain off. A tendon is straight between its holes in neighbouring disks, without friction, and
ends at the last disk of its section: a cut between two disks carries rod and tendons, so that with d the direction of a
tendon from its hole h in the disk before to that in the disk beyond, for all loads F, M at points x beyond the cut

    n + sum T d = sum F      m + sum (h - p) x T d = sum (M + (x - p) x F)      at each span's first point p.

These are six equations a span for the six numbers n, m there. Derivatives are complex steps, exact to the last digits.
Arrays hold a vector in each column: shape (3, columns). SI units.
"""

import math
from typing import NamedTuple

import numpy as np

STEP = 1e-30  # of the complex derivative
SCALE = np.array([1.0, 1.0, 1.0, 1e-2, 1e-2, 1e-2])  # size of force [N] and moment [N m]
SETTLED = 1e-11


class Rod(NamedTuple):
    """Stiffness of a rod; math.inf where it has no such strain."""

    bending_Nm2: float
    torsion_Nm2: float
    axial_N: float
    shear_N: float = math.inf
    mass_kgpm: float = 0.0
    radius_m: float = 0.0  # for the rotary inertia alone

    def only(self, *strains):
        """The same rod with bending and these strains alone: torsion, extension, shear."""
        kept = lambda name, value: value if name in strains else math.inf
        return self._replace(torsion_Nm2=kept("torsion", self.torsion_Nm2), axial_N=kept("extension", self.axial_N),
                             shear_N=kept("shear", self.shear_N))


def round_rod(youngs_Pa, radius_m, poisson, density_kgpm3=0.0):
    """Of solid circular section; its shear coefficient is Cowper's."""
    area, second = math.pi * radius_m**2, math.pi * radius_m**4 / 4
    shear = youngs_Pa / (2 * (1 + poisson))
    carried = 6 * (1 + poisson) / (7 + 6 * poisson)
    return Rod(youngs_Pa * second, shear * 2 * second, youngs_Pa * area, carried * shear * area, density_kgpm3 * area,
               radius_m)


class Span(NamedTuple):
    """The rod from one disk to the next, and the disk at its end."""

    length_m: float
    rod: Rod
    tendons: tuple  # numbers of those that pass it
    before: tuple  # their holes (x, y) in the disk before
    beyond: tuple  # and in the disk at the end
    disk_kg: float = 0.0
    disk_xx_kgm2: float = 0.0
    disk_zz_kgm2: float = 0.0


class Section(NamedTuple):
    """Equal spans with a disk at each one's end; the tendons, at (angle, radius), end at its last disk."""

    spans: int
    span_m: float
    rod: Rod
    tendons: tuple
    disk_kg: float = 0.0
    disk_xx_kgm2: float = 0.0
    disk_zz_kgm2: float = 0.0


def spans_of(sections):
    holes = [(r * math.cos(a), r * math.sin(a)) for s in sections for a, r in s.tendons]
    out, first = [], 0
    for s in sections:
        passing = tuple(range(first, len(holes)))
        at = tuple(holes[j] for j in passing)
        out += [Span(s.span_m, s.rod, passing, at, at, s.disk_kg, s.disk_xx_kgm2, s.disk_zz_kgm2)] * s.spans
        first += len(s.tendons)
    return out


class Load(NamedTuple):
    """Tensions of all tendons, a force and a moment at the tip, and gravity, in the base frame."""

    tension_N: tuple
    force_N: tuple = (0.0, 0.0, 0.0)
    moment_Nm: tuple = (0.0, 0.0, 0.0)
    gravity_mps2: tuple = (0.0, 0.0, 0.0)

    def scaled(self, share):
        return Load(*(tuple(share * x for x in part) for part in self))


# ---- vectors and quaternions (w, x, y, z), which need not have length one ----


def cross(a, b):
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))


def column(vector):
    return np.array(vector, dtype=float)[:, None]


def turned(q, v, back=False):
    """R(q) v, or R(q)^T v."""
    axis = -q[1:] if back else q[1:]
    across = cross(axis, v)
    return v + 2 / (q * q).sum(0) * (q[0] * across + cross(axis, across))


def rotation(q):
    """The matrix of a single quaternion, (4, 1)."""
    return turned(np.repeat(q, 3, 1), np.eye(3))


def unit(v):
    return v / np.sqrt((v * v).sum(0))


# ---- one piece of rod ----


def rates(p, q, wrench, start, rod):
    """p' and q' where the piece began at `start` with `wrench`, (n, m)."""
    n = wrench[:3]
    m = wrench[3:] - cross(p - start, n)
    force, moment = turned(q, n, True), turned(q, m, True)
    v = np.stack((force[0] / rod.shear_N, force[1] / rod.shear_N, 1 + force[2] / rod.axial_N))
    k = np.stack((moment[0] / rod.bending_Nm2, moment[1] / rod.bending_Nm2, moment[2] / rod.torsion_Nm2))
    dq = np.concatenate((-(q[1:] * k).sum(0)[None], q[0] * k + cross(q[1:], k)))
    return turned(q, v), 0.5 * dq


def along(p, q, wrench, length, rod, steps):
    """Pose and wrench at the end of a piece: Runge-Kutta of order four."""
    h, start = length / steps, p
    for _ in range(steps):
        a = rates(p, q, wrench, start, rod)
        b = rates(p + h / 2 * a[0], q + h / 2 * a[1], wrench, start, rod)
        c = rates(p + h / 2 * b[0], q + h / 2 * b[1], wrench, start, rod)
        d = rates(p + h * c[0], q + h * c[1], wrench, start, rod)
        p = p + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        q = q + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
    return p, q, np.concatenate((wrench[:3], wrench[3:] - cross(p - start, wrench[:3])))


# ---- the whole rod ----


class Problem:
    """A robot with `pieces` of rod a span, each with `steps` of integration. A node ends each piece: the last of a span
    is its disk, each carries the mass of half the rod on both of its sides."""

    def __init__(self, spans, pieces=1, steps=16):
        self.spans, self.pieces, self.steps = spans, pieces, steps
        self.nodes = pieces * len(spans)
        self.mass, self.inertia = self._masses()

    def _masses(self):
        mass, inertia = np.zeros(self.nodes), np.zeros((self.nodes, 3))
        for k in range(self.nodes):
            here = self.spans[k // self.pieces]
            after = self.spans[(k + 1) // self.pieces] if k + 1 < self.nodes else None
            for s in (here, after):
                if s is not None:
                    half = s.rod.mass_kgpm * s.length_m / self.pieces / 2
                    mass[k] += half
                    inertia[k] += half * s.rod.radius_m**2 * np.array([0.25, 0.25, 0.5])
            if (k + 1) % self.pieces == 0:
                mass[k] += here.disk_kg
                inertia[k] += (here.disk_xx_kgm2, here.disk_xx_kgm2, here.disk_zz_kgm2)
        return mass, inertia

    def forces(self, load):
        """Forces and moments at the nodes, (nodes, 3, 1) each."""
        force = self.mass[:, None, None] * column(load.gravity_mps2)
        moment = np.zeros((self.nodes, 3, 1))
        force[-1] += column(load.force_N)
        moment[-1] += column(load.moment_Nm)
        return force, moment

    def poses(self, wrenches, force, moment):
        """Of base and nodes, [(p, q), ...], with the wrenches (6 per span, columns) at the spans' first points."""
        columns = wrenches.shape[1]
        p, q = np.zeros((3, columns)), np.repeat(column((1, 0, 0, 0)), columns, 1)
        out = [(p, q)]
        for i, span in enumerate(self.spans):
            wrench = wrenches[6 * i : 6 * i + 6]
            for k in range(i * self.pieces, (i + 1) * self.pieces):
                p, q, wrench = along(p, q, wrench, span.length_m / self.pieces, span.rod, self.steps)
                wrench = wrench - np.concatenate((force[k], moment[k]))
                out.append((p, q))
        return out

    def residual(self, poses, wrenches, force, moment, tension):
        """What is missing of each span's equilibrium, in units of SCALE."""
        out = []
        for i, span in enumerate(self.spans):
            (p, q), (end, turn) = poses[i * self.pieces], poses[(i + 1) * self.pieces]
            n, m = wrenches[6 * i : 6 * i + 3], wrenches[6 * i + 3 : 6 * i + 6]
            for j, before, beyond in zip(span.tendons, span.before, span.beyond):
                arm = turned(q, column((*before, 0)))
                pull = tension[j] * unit(end + turned(turn, column((*beyond, 0))) - p - arm)
                n, m = n + pull, m + cross(arm, pull)
            for k in range(i * self.pieces, self.nodes):
                n, m = n - force[k], m - moment[k] - cross(poses[k + 1][0] - p, force[k])
            out += [n / SCALE[0], m / SCALE[3]]
        return np.concatenate(out)

    def linearised(self, wrenches, load):
        """Residual and its derivatives by the wrenches, in units of SCALE."""
        scale = np.tile(SCALE, len(self.spans))
        moved = wrenches[:, None] + 1j * STEP * np.diag(scale)
        force, moment = self.forces(load)
        r = self.residual(self.poses(moved, force, moment), moved, force, moment, load.tension_N)
        return r[:, 0].real, r.imag / STEP, scale

    def newton(self, wrenches, load):
        """The equilibrium near a guess, or None."""
        last = math.inf
        for _ in range(12):
            r, slope, scale = self.linearised(wrenches, load)
            size = np.abs(r).max()
            if size < SETTLED:
                return wrenches
            if not size < 1e3 * max(1.0, last):
                return None
            last = size
            wrenches = wrenches - scale * np.linalg.solve(slope, r)
        return None

    def equilibrium(self, load, increments=4):
        """Wrenches at the spans' first points, on the branch continued from no load with all loads in proportion: with
        few steps of integration, and from there with all of them."""
        coarse = Problem(self.spans, self.pieces, min(self.steps, max(1, 4 // self.pieces)))
        share, step, found, before = 0.0, 1 / increments, np.zeros(6 * len(self.spans)), None
        while share < 1:
            step = min(step, 1 - share)
            guess = found if before is None else found + step / before[1] * (found - before[0])
            there = coarse.newton(guess, load.scaled(share + step))
            if there is None:
                step /= 2
                if step < 1e-4:
                    raise ArithmeticError(f"no equilibrium beyond {share:.3g} of the load")
                continue
            found, before, share = there, (found, step), share + step
        found = self.newton(found, load)
        if found is None:
            raise ArithmeticError(f"{coarse.steps} steps of integration are too few for {load}")
        return found

    def disks(self, wrenches, load):
        """Position (3) and quaternion (4) of each disk."""
        poses = self.poses(wrenches[:, None], *self.forces(load))
        return [(p[:, 0], (unit(q) * np.sign(q[0]))[:, 0]) for p, q in poses[self.pieces :: self.pieces]]

    # ---- small vibrations ----

    def flexibility(self, wrenches, load):
        """Displacements and rotations of all nodes (in the base frame) per force and moment at them, 6 nodes square."""
        size = 6 * self.nodes
        force, moment = self.forces(load)
        at = wrenches[:, None]
        # by the wrenches
        moved = at + 1j * STEP * np.eye(len(wrenches))
        poses = self.poses(moved, force, moment)
        slope = self.residual(poses, moved, force, moment, load.tension_N).imag / STEP
        by_wrench = small_motions(poses[1:])
        # by the loads
        extra = 1j * STEP * np.eye(size).reshape(self.nodes, 6, size)
        force, moment = force + extra[:, :3], moment + extra[:, 3:]
        at = np.repeat(at, size, 1)
        poses = self.poses(at, force, moment)
        missing = self.residual(poses, at, force, moment, load.tension_N).imag / STEP
        return small_motions(poses[1:]) - by_wrench @ np.linalg.solve(slope, missing)

    def frequencies(self, wrenches, load):
        """Natural frequencies [Hz] about an equilibrium, ascending, without damping: F M x = x / omega^2."""
        flexibility = self.flexibility(wrenches, load)
        mass = np.zeros((6 * self.nodes,) * 2)
        for k, (_, q) in enumerate(self.poses(wrenches[:, None], *self.forces(load))[1:]):
            r = rotation(q)
            mass[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = self.mass[k] * np.eye(3)
            mass[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = r * self.inertia[k] @ r.T
        values, vectors = np.linalg.eigh(mass)
        root = vectors * np.sqrt(np.maximum(values, 0)) @ vectors.T
        inverse_squares = np.linalg.eigvalsh(root @ (flexibility + flexibility.T) / 2 @ root)[::-1]
        return 1 / (2 * math.pi * np.sqrt(inverse_squares[inverse_squares > 1e-9 * inverse_squares[0]]))


def small_motions(poses):
    """Displacement and rotation vector of each pose per imaginary STEP, stacked."""
    out = []
    for p, q in poses:
        dq = q.imag / STEP
        q = q.real
        out += [p.imag / STEP, 2 / (q * q).sum(0) * (q[0] * dq[1:] - dq[0] * q[1:] + cross(q[1:], dq[1:]))]
    return np.concatenate(out)
