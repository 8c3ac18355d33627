# Open-loop excitations of the rig: reference tensions at the base, turned into motor torques with the nominal numbers.
# Knows the nominal robot only, never what was planted.
import numpy as np

from tests.blind import lagrange_plant as lp

PERIOD_S = 1e-3
STILL_S = 0.5


class Controller:
    """Reference tensions at the base -> torque; the friction's direction is that of the reference motion of the spools."""

    def __init__(self, robot):
        self.p = lp.nominal(robot)
        robot = lp.numbers(robot)
        P = lp.build(self.p)
        self.val, self.axis = P.cap_val[0], P.cap_axis[0]
        t = self.p["t"][0]
        self.radius, self.ratio, self.eff = t[lp.T["r_spool"]], t[lp.T["ratio"]], t[lp.T["eff"]]
        self.coulomb, self.k, self.y = t[lp.T["coulomb"]], t[lp.T["k"]], t[lp.T["presliding"]]
        self.limit = t[lp.T["limit"]]
        self.permille = robot["actuation"]["drive"]["rated_torque_Nm"] / 1000
        self.angles = self.p["hole_a"][0]
        self.hole = self.p["hole_r"][0, 0]
        self.units = len(self.p["u"])
        self.kb, self.l = self.p["u"][0, lp.U["kb"]], self.p["u"][0, lp.U["l"]]
        self.rest = 0.3

    def tensions(self, bend_N, plane_rad, least_N):
        """Base tensions (S x M) whose pull adds up to bend_N in the plane, the least of them least_N."""
        c = np.cos(self.angles[None, :] - np.asarray(plane_rad)[:, None])
        w = np.asarray(bend_N)[:, None] * c * 2 / len(self.angles)
        return np.asarray(least_N)[:, None] + w - w.min(1, keepdims=True)

    def torque(self, base_N):
        """Torque targets (S x M), still for the first half second, quantised as the drive does."""
        S, m = base_N.shape
        cs = np.stack([np.cos(self.angles), np.sin(self.angles)])
        pull = base_N @ cs.T * self.hole
        stiff = self.kb - base_N.sum(1) * self.l / 12      # straight tendons soften the unit
        us = self.units * pull / np.maximum(stiff, 0.3 * self.kb)[:, None]
        F = cap(self.val, self.axis, 0, base_N)
        G = cap(self.val, self.axis, 1, base_N)
        x = self.hole * us @ cs + 0.5 * (base_N - base_N[:1]) / self.k
        z = np.zeros((S, m))
        w = np.zeros((4, m))
        yields = self.y * np.array([0.25, 0.5, 0.75, 1.0])[:, None]
        for k in range(1, S):
            w = np.clip(w + (x[k] - x[k - 1]), -yields, yields)
            z[k] = (w / yields).mean(0)
        Tm = 0.5 * (1 + z) * F + 0.5 * (1 - z) * G
        torque = Tm * self.radius / self.ratio * self.eff ** (-z) + self.coulomb * z
        rest = self.rest * self.radius / self.ratio
        time = np.arange(S) * PERIOD_S
        blend = smooth((time - STILL_S) / 0.4)[:, None]
        torque = rest + blend * (torque - rest)
        return self.quantise(torque)

    def quantise(self, torque):
        limit = np.floor(self.limit / self.permille + 1e-9)
        return np.clip(np.round(torque / self.permille), -limit, limit) * self.permille


def cap(val, axis, which, tension):
    return np.vectorize(lambda t: lp.cap(val, axis, which, t))(tension)


def smooth(a):
    a = np.clip(a, 0, 1)
    return a * a * (3 - 2 * a)


def zigzag(time, knots):
    t, v = zip(*knots)
    return np.interp(time, t, v)


def _triangle_knots(start, amplitudes, rate):
    """Up, through zero down and back for each amplitude, at `rate` N/s."""
    knots, t, v = [(0, 0), (start, 0)], start, 0.0
    for a in amplitudes:
        for goal in (a, -a, 0.5 * a, 0.0):
            t += max(abs(goal - v) / rate, 1e-3)
            knots.append((t, goal))
            v = goal
    return knots, t


T0 = 0.45  # N, of rest


def _times(end_s):
    return np.arange(int(end_s / PERIOD_S)) * PERIOD_S


# Each family: bend b, its plane and the least tension at every period. rng draws planes, levels and phases.

def _triangle(rng, plane, grow):
    rate = 2.0 * grow
    knots, end = _triangle_knots(1.0, grow * np.array([0.8, 1.8, 3.2]) * rng.uniform(0.9, 1.1), rate)
    time = _times(end + 0.5)
    return zigzag(time, knots), plane, np.full(len(time), T0)


def _cocontraction(rng, plane, grow):
    pieces, t = [(0, T0), (1.0, T0)], 1.0
    bend = [(0, 0), (1.0, 0)]
    for level in (T0, 1.2 * rng.uniform(0.9, 1.1), 2.2 * rng.uniform(0.9, 1.1)):
        t += 0.6
        pieces.append((t, level))
        bend.append((t, 0))
        for goal, dur in ((1.2, 0.6), (-1.2, 1.2), (1.2, 1.2), (0, 0.6)):
            t += dur
            bend.append((t, goal * grow))
            pieces.append((t, level))
    time = _times(t + 0.3)
    return zigzag(time, bend), plane, zigzag(time, pieces)


def _circle(rng, plane, grow):
    time = _times(9.0)
    b = rng.uniform(1.8, 2.4) * grow * smooth((time - 0.8) / 1.0)
    plane = plane + rng.choice([-1, 1]) * 2 * np.pi * np.clip(time - 1.8, 0, None) / 3.6
    return b, plane, np.full(len(time), T0)


def _steps(rng, plane, grow):
    time = _times(10.0)
    n = 7
    at = 1.0 + 1.2 * np.arange(n)
    levels = grow * rng.uniform(-1.9, 1.9, n)
    planes = plane + rng.uniform(-0.8, 0.8, n)
    lows = T0 + rng.uniform(0, 1.0, n)
    b, least = np.zeros(len(time)), np.full(len(time), T0)
    ang = np.full(len(time), planes[0])
    before = (0.0, planes[0], T0)
    for k in range(n):
        s = smooth((time - at[k]) / 0.45)
        on = time >= at[k]
        b[on] = (before[0] + s * (levels[k] - before[0]))[on]
        ang[on] = (before[1] + s * (planes[k] - before[1]))[on]
        least[on] = (before[2] + s * (lows[k] - before[2]))[on]
        before = (levels[k], planes[k], lows[k])
    return b, ang, least


def _multisine(rng, plane, grow):
    time = _times(9.0)
    f = np.geomspace(0.1, 10, 14)
    fade = smooth((time - 1.5) / 0.5)
    comp = []
    for _ in range(2):
        ph = rng.uniform(0, 2 * np.pi, len(f))
        comp.append((np.sin(2 * np.pi * f * (time[:, None] - 1.5) + ph) * (f ** -0.3)).sum(1))
    comp = np.array(comp) / np.std(comp) * 0.55 * grow * fade
    comp[0] += 1.2 * grow * np.cos(plane) * smooth((time - 0.8) / 0.7)
    comp[1] += 1.2 * grow * np.sin(plane) * smooth((time - 0.8) / 0.7)
    return np.hypot(*comp), np.arctan2(comp[1], comp[0]), np.full(len(time), 0.8)


def _ladder(rng, plane, grow):
    knots, t, v = [(0, 0), (1.0, 0)], 1.0, 0.0
    for rate in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0):
        for goal in (1.6 * grow, -1.6 * grow) if rate > 1.5 else (1.6 * grow, 0.0, -1.6 * grow):
            t += abs(goal - v) / (rate * grow)
            v = goal
            knots.append((t, v))
    time = _times(t + 0.6)
    return zigzag(time, knots), plane, np.full(len(time), 0.6)


def _hold(rng, plane, grow):
    time = _times(24.0)
    b = zigzag(time, [(0, 0), (1, 0), (2, 2.6 * grow), (14, 2.6 * grow), (15, 1.0 * grow), (24, 1.0 * grow)])
    return b, plane, zigzag(time, [(0, T0), (1, T0), (2, 1.0), (14, 1.0), (15, T0), (24, T0)])


def _sway(rng, plane, grow):
    time = _times(6.0)
    b = zigzag(time, [(0, 0), (0.8, 0), (1.6, 2.0 * grow), (2.0, 2.0 * grow), (2.02, 0), (6, 0)])
    return b, plane, zigzag(time, [(0, T0), (2.0, T0), (2.02, 0.02), (6, 0.02)])


def _weak(rng, plane, grow):  # too little motion to tell anything
    time = _times(8.0)
    return 0.12 * grow * np.sin(2 * np.pi * 0.4 * (time - 1)) * smooth((time - 1) / 0.5), plane, np.full(len(time), T0)


_SHAPES = dict(triangle=_triangle, cocontraction=_cocontraction, circle=_circle, steps=_steps, multisine=_multisine,
               ladder=_ladder, hold=_hold, sway=_sway, weak=_weak)
FAMILIES = list(_SHAPES)


def program(family, controller, rng, strength=1.0):
    """Torque targets (S x M) of one run: another seed, another run."""
    c = controller
    plane = rng.uniform(0, 2 * np.pi)
    grow = strength * c.kb * c.units / (4 * 0.05017)
    if family not in _SHAPES:
        raise ValueError(f"family {family}: accepted are {', '.join(FAMILIES)}")
    b, plane, least = _SHAPES[family](rng, plane, grow)
    b = np.asarray(b, float)
    plane = np.where(b < 0, plane + np.pi, plane)
    return c.torque(c.tensions(np.abs(b), plane, least))
USUAL = ["triangle", "cocontraction", "circle", "steps", "multisine", "ladder", "hold"]
