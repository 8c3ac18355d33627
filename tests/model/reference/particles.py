"""The robot as particles: an independent statement of its mechanics, differentiated numerically in extended precision.

Knows nothing of the C++ code: no Stumpff functions, no angular velocities, no joint recursion, no closed tendon length.

Each disk is four weighted points: its centre and the tips of its three axes, so that T = 1/2 sum w |dx/dt|^2 over
coordinates x(q) alone, and d'Alembert's principle gives X^T W (X ddq + x'') = Q with X = dx/dq and x'' the second
derivative of x along dq. Q is the gradient of the potential, in which a tendon is the sum of distances between holes.
Derivatives are central differences with step 1e-20 at 120 digits: exact to some 40 digits.
"""

import math
from dataclasses import dataclass, field

import mpmath

mpmath.mp.dps = 120
STEP = mpmath.mpf(10) ** -20


@dataclass
class Section:
    units: int
    length: float  # of a unit
    mass: float
    ixx: float
    izz: float
    youngs: float
    core_radius: float
    tendons: list  # (angle, radius)
    damping: float = 0.0


@dataclass
class Robot:
    sections: list
    gravity: tuple = (0.0, 0.0, -9.81)
    units: list = field(init=False)  # (section, index in sections) per unit

    def __post_init__(self):
        self.units = [(s, k) for k, s in enumerate(self.sections) for _ in range(s.units)]

    @property
    def dof(self):
        return 2 * len(self.units)

    @property
    def tendons(self):
        return [(a, r, k) for k, s in enumerate(self.sections) for a, r in s.tendons]


class Exact:
    """Numbers of 120 digits."""

    num = staticmethod(mpmath.mpf)
    sin, cos, sqrt, pi = staticmethod(mpmath.sin), staticmethod(mpmath.cos), staticmethod(mpmath.sqrt), mpmath.pi


class Quick:
    """Ordinary floats, to walk along a branch before the last digits are found."""

    num = float
    sin, cos, sqrt, pi = math.sin, math.cos, math.sqrt, math.pi


def arc(m, length, u, v):
    """Eqs. 2 and 3 of the paper as printed (R21 mended), with cos(beta) = u/theta, sin(beta) = v/theta."""
    theta = m.sqrt(u * u + v * v)
    if theta == 0:
        one, zero = m.num(1), m.num(0)
        return (zero, zero, length), ((one, zero, zero), (zero, one, zero), (zero, zero, one))
    cb, sb, ct, st = u / theta, v / theta, m.cos(theta), m.sin(theta)
    p = (length * (1 - ct) / theta * cb, length * (1 - ct) / theta * sb, length * st / theta)
    r = (
        (cb * cb * (ct - 1) + 1, cb * sb * (ct - 1), cb * st),
        (cb * sb * (ct - 1), sb * sb * (ct - 1) + 1, sb * st),
        (-cb * st, -sb * st, ct),
    )
    return p, r


def times(a, b):
    return tuple(tuple(sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)) for i in range(3))


def apply(a, x):
    return tuple(a[i][0] * x[0] + a[i][1] * x[1] + a[i][2] * x[2] for i in range(3))


def poses(m, robot, q):
    """(P, R) of frames 0..N."""
    one, zero = m.num(1), m.num(0)
    p, r = (zero, zero, zero), ((one, zero, zero), (zero, one, zero), (zero, zero, one))
    out = [(p, r)]
    for i, (s, _) in enumerate(robot.units):
        dp, dr = arc(m, m.num(s.length), q[2 * i], q[2 * i + 1])
        step = apply(r, dp)
        p, r = tuple(a + b for a, b in zip(p, step)), times(r, dr)
        out.append((p, r))
    return out


def points(m, robot, q):
    """All coordinates x(q), with their weights: disk centres, and the axes weighted by the disk's second moments."""
    x, w = [], []
    for (p, r), (s, _) in zip(poses(m, robot, q)[1:], robot.units):
        side, along = m.num(s.izz) / 2, m.num(s.ixx) - m.num(s.izz) / 2
        x += p
        w += [m.num(s.mass)] * 3
        for axis, weight in ((0, side), (1, side), (2, along)):
            x += [r[k][axis] for k in range(3)]
            w += [weight] * 3
    return x, w


def tendon_lengths(m, robot, q):
    frames = poses(m, robot, q)
    lengths = []
    for angle, radius, section in robot.tendons:
        hole = (m.num(radius) * m.cos(m.num(angle)), m.num(radius) * m.sin(m.num(angle)), m.num(0))
        total = m.num(0)
        for i, (_, k) in enumerate(robot.units):
            if k > section:
                continue
            a = [x + y for x, y in zip(frames[i][0], apply(frames[i][1], hole))]
            b = [x + y for x, y in zip(frames[i + 1][0], apply(frames[i + 1][1], hole))]
            total += m.sqrt(sum((x - y) ** 2 for x, y in zip(a, b)))
        lengths.append(total)
    return lengths


def elastic_energy(m, robot, q):
    total = m.num(0)
    for i, (s, _) in enumerate(robot.units):
        stiffness = m.num(s.youngs) * m.pi * m.num(s.core_radius) ** 4 / 4 / m.num(s.length)
        total += stiffness * (q[2 * i] ** 2 + q[2 * i + 1] ** 2) / 2
    return total


def gravity_energy(m, robot, q):
    g = [m.num(x) for x in robot.gravity]
    return -sum(
        m.num(s.mass) * sum(a * b for a, b in zip(g, p)) for (p, _), (s, _) in zip(poses(m, robot, q)[1:], robot.units)
    )


def potential(m, robot, q, tension, tip_force=(0, 0, 0), gravity=1):
    tip = poses(m, robot, q)[-1][0]
    return (
        elastic_energy(m, robot, q)
        + gravity * gravity_energy(m, robot, q)
        + sum(m.num(t) * length for t, length in zip(tension, tendon_lengths(m, robot, q)))
        - sum(m.num(f) * x for f, x in zip(tip_force, tip))
    )


def shifted(q, direction, step):
    return [a + step * d for a, d in zip(q, direction)]


def unit_vector(n, i):
    return [1 if k == i else 0 for k in range(n)]


def gradient(f, q, step):
    n = len(q)
    return [(f(shifted(q, unit_vector(n, i), step)) - f(shifted(q, unit_vector(n, i), -step))) / (2 * step) for i in range(n)]


def point_jacobian(m, robot, q):
    n = len(q)
    columns = []
    for i in range(n):
        ahead, _ = points(m, robot, shifted(q, unit_vector(n, i), STEP))
        behind, _ = points(m, robot, shifted(q, unit_vector(n, i), -STEP))
        columns.append([(a - b) / (2 * STEP) for a, b in zip(ahead, behind)])
    return columns


def mass_matrix(robot, q):
    m = Exact
    columns = point_jacobian(m, robot, q)
    _, w = points(m, robot, q)
    n = len(q)
    h = mpmath.matrix(n, n)
    for i in range(n):
        for j in range(i, n):
            h[i, j] = h[j, i] = mpmath.fsum(a * b * c for a, b, c in zip(columns[i], columns[j], w))
    return h, columns, w


def kinetic_energy(robot, q, dq):
    x0, w = points(Exact, robot, shifted(q, dq, -STEP))
    x1, _ = points(Exact, robot, shifted(q, dq, STEP))
    return mpmath.fsum(c * ((b - a) / (2 * STEP)) ** 2 for a, b, c in zip(x0, x1, w)) / 2


def accelerations(robot, q, dq, tension):
    m = Exact
    q, dq = [m.num(x) for x in q], [m.num(x) for x in dq]
    h, columns, w = mass_matrix(robot, q)
    ahead, _ = points(m, robot, shifted(q, dq, STEP))
    here, _ = points(m, robot, q)
    behind, _ = points(m, robot, shifted(q, dq, -STEP))
    curve = [(a - 2 * b + c) / STEP**2 for a, b, c in zip(ahead, here, behind)]
    slope = gradient(lambda x: potential(m, robot, x, tension), q, STEP)
    right = mpmath.matrix(len(q), 1)
    for i in range(len(q)):
        damping = m.num(robot.units[i // 2][0].damping)
        right[i] = -slope[i] - damping * dq[i] - mpmath.fsum(a * b * c for a, b, c in zip(columns[i], curve, w))
    return list(mpmath.lu_solve(h, right))


def hessian(m, f, q, step):
    """Central second differences."""
    n = len(q)
    k = [[m.num(0)] * n for _ in range(n)]
    for i in range(n):
        for j in range(i, n):
            ei, ej = unit_vector(n, i), unit_vector(n, j)
            pp = f(shifted(shifted(q, ei, step), ej, step))
            pm = f(shifted(shifted(q, ei, step), ej, -step))
            mp = f(shifted(shifted(q, ei, -step), ej, step))
            mm = f(shifted(shifted(q, ei, -step), ej, -step))
            k[i][j] = k[j][i] = (pp - pm - mp + mm) / (4 * step * step)
    return k


def equilibrium(robot, tension, tip_force):
    """The equilibrium on the branch from the unloaded straight robot: gravity first, then the load, in small steps."""
    q = [0.0] * robot.dof
    schedule = [(k / 8, 0.0) for k in range(1, 9)] + [(1.0, k / 40) for k in range(1, 41)]
    for gravity, load in schedule:
        t, f = [load * x for x in tension], [load * x for x in tip_force]

        def energy(x, t=t, f=f, gravity=gravity):
            return potential(Quick, robot, x, t, f, gravity)

        for _ in range(4):
            g = mpmath.matrix(gradient(energy, q, 1e-5))
            k = mpmath.matrix(hessian(Quick, energy, q, 1e-4))
            with mpmath.workdps(20):
                step = mpmath.lu_solve(k, g)
            q = [a - float(b) for a, b in zip(q, step)]
            if max(abs(float(b)) for b in step) < 1e-7:
                break

    def exact(x):
        return potential(Exact, robot, x, tension, tip_force)

    q = [mpmath.mpf(x) for x in q]
    k = mpmath.matrix(hessian(Exact, exact, q, STEP))
    for _ in range(12):  # linear convergence by some five digits a step with the tangent of the start
        step = mpmath.lu_solve(k, mpmath.matrix(gradient(exact, q, STEP)))
        q = [a - b for a, b in zip(q, step)]
        if max(abs(b) for b in step) < mpmath.mpf(10) ** -25:
            break
    else:
        raise RuntimeError("no convergence")
    return q


def frequencies(robot, q, tension, tip_force=(0, 0, 0)):
    def exact(x):
        return potential(Exact, robot, x, tension, tip_force)

    k = mpmath.matrix(hessian(Exact, exact, q, STEP))
    h, _, _ = mass_matrix(robot, q)
    with mpmath.workdps(60):
        lower = mpmath.cholesky(h)
        inverse = mpmath.inverse(lower)
        squares = mpmath.eigsy(inverse * k * inverse.T, eigvals_only=True)
        return sorted(mpmath.sqrt(x) / (2 * mpmath.pi) for x in squares)
