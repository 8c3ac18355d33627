#!/usr/bin/python3
"""The rig once more, nominal or with effects of its body, from its laws, in numpy: golden values of the plant's tests.

Shares no code and no numerics with the simulator: Kane's sums over the disks with accelerations propagated along the
chain and a dense mass matrix, the Capstan boundary values by fixed-step Runge-Kutta, and classic Runge-Kutta in time
with steps far below the fastest mode (twice the step changes a tension by 7e-6 N); stop operators move after each
step, the torque loop is a state.
With --effects the body is not as drawn (see Built): tendons then act hole by hole, each span with its own tension.
Writes plant_rig_90mm.csv, or plant_rig_90mm_effects.csv, beside itself (takes a few minutes); --step to see that it has
converged.
"""
import argparse
import math
import os

import numpy as np

# ---- the 90 mm rig -------------------------------------------------------------------------------------------------
UNITS, UNIT_M, UNIT_KG = 4, 0.0225, 0.0025
IXX, IZZ = UNIT_KG * 0.010**2 / 16, UNIT_KG * 0.010**2 / 8
STIFFNESS = 2.3e10 * math.pi * 0.0005**4 / 4 / UNIT_M
BEND_DAMPING = 2.0e-4
GRAVITY = np.array([0.0, 0.0, -9.81])
HOLE_ANGLES, HOLE_M = np.arange(3) * 2 * math.pi / 3, 0.004
PRETENSION = 0.3
ROTOR, COULOMB, DAHL_RAD, DAHL_DAMPING, VISCOUS, LAG = 4.1e-7, 2.0e-4, 0.004, 1.6e-8, 1.0e-7, 0.0005
RATED = 0.007056
EFFICIENCY, GEAR_YIELDS = 0.84, np.array([0.002, 0.004])
TRAVEL = 0.008 / 19.0
K, C = 30000.0, 20.0
WRAP, RHO, ALPHA, EXPONENT, T_LOW = math.pi, 10.0, 0.466, 0.67, 0.05
SLIDE_YIELDS = np.array([0.25, 0.5, 0.75, 1.0]) * 0.05e-3

# ---- pulley: T'' + (rho/n) ((1+rho)/(alpha rho))^(1/n) T^((1-n)/n) T' - rho T = 0, T(0) = T1, T'(0) = 0 --------------


def capstan_high(low):
    """F of many tensions at once."""
    factor = RHO / EXPONENT * ((1 + RHO) / (ALPHA * RHO)) ** (1 / EXPONENT)
    power = (1 - EXPONENT) / EXPONENT

    def derivative(t, s):
        return s, RHO * t - factor * t**power * s

    t, s = low.copy(), np.zeros_like(low)
    steps = 40000
    h = WRAP / steps
    for _ in range(steps):
        a1, b1 = derivative(t, s)
        a2, b2 = derivative(t + h / 2 * a1, s + h / 2 * b1)
        a3, b3 = derivative(t + h / 2 * a2, s + h / 2 * b2)
        a4, b4 = derivative(t + h * a3, s + h * b3)
        t = t + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        s = s + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    return t


LOG_LOW = np.linspace(math.log(T_LOW), math.log(40.0), 6000)
LOG_RATIO = np.log(capstan_high(np.exp(LOG_LOW))) - LOG_LOW
LOG_HIGH = LOG_LOW + LOG_RATIO


def pull(t):
    return 0.0 if t <= 0 else t * math.exp(np.interp(math.log(t), LOG_LOW, LOG_RATIO))


def release(t):
    return 0.0 if t <= 0 else t * math.exp(-np.interp(math.log(t), LOG_HIGH, LOG_RATIO))


# ---- body ----------------------------------------------------------------------------------------------------------


class Built:
    """What the body has beyond its drawing; none of it by default."""
    mass = np.full(UNITS, UNIT_KG)
    stiffness = np.full(UNITS, STIFFNESS)
    rest = np.zeros((UNITS, 2))
    gravity = GRAVITY
    tip_force = np.zeros(3)
    twist = 0.0  # [rad/m]
    routing = 0.0
    hysteresis, hysteresis_yields = 0.0, np.array([0.25, 0.5, 0.75, 1.0]) * 0.05
    softening, onset = 0.0, 0.3
    wall, wall_gap, wall_angle, wall_edge = 0.0, 0.0, 0.0, 2e-4


def with_effects():
    b = Built()
    b.mass = np.array([1.0, 1.0, 1.0, 1.0]) * UNIT_KG + np.array([0.0, 0.0, 0.0, 0.002])
    b.stiffness = STIFFNESS * np.array([1.0, 0.8, 1.0, 1.0])
    b.rest = np.array([[0.0, 0.0], [0.0, 0.0], [0.02, 0.05], [0.0, 0.0]])
    tilt = 0.1  # of the base about its y: gravity turns the other way
    b.gravity = 9.81 * np.array([math.sin(tilt), 0.0, -math.cos(tilt)])
    b.tip_force = np.array([0.0, 0.02, 0.01])
    b.twist = 4.0
    b.routing = 0.2
    b.hysteresis = 0.002
    b.softening, b.onset = 0.4, 0.2
    b.wall, b.wall_gap, b.wall_angle = 100.0, 0.008, 0.3
    return b


BUILT = Built()
ROUTING_YIELDS = np.array([0.25, 0.5, 0.75, 1.0]) * 2e-5


class BodyMemory:
    """Of friction along the disks (tendon, disk, element) and of the units' hysteresis (unit, element, uv)."""

    def __init__(self):
        self.rub_w, self.rub_x = np.zeros((3, UNITS - 1, 4)), np.zeros((3, UNITS - 1))
        self.bend_w, self.bend_q = np.zeros((UNITS, 4, 2)), np.zeros((UNITS, 2))

    def rub(self, x):
        return np.clip(self.rub_w + (x - self.rub_x)[:, :, None], -ROUTING_YIELDS, ROUTING_YIELDS)

    def bend(self, q):
        w = self.bend_w + (q - self.bend_q)[:, None, :]
        size = np.maximum(np.linalg.norm(w, axis=2), 1e-300)
        return w * np.minimum(1.0, BUILT.hysteresis_yields / size)[:, :, None]

    def move(self, x, q):
        self.rub_w, self.rub_x = self.rub(x), x.copy()
        self.bend_w, self.bend_q = self.bend(q), q.copy()


def hole_at(disk, tendon):
    angle = HOLE_ANGLES[tendon] + BUILT.twist * disk * UNIT_M
    return HOLE_M * np.array([math.cos(angle), math.sin(angle), 0.0])


# One unit: p = l (A u, A v, S), R = exp(hat(-v, u, 0)), with functions of w = theta^2 and their derivatives by w.




FACT = {kind: np.array([(-1.0) ** k / math.factorial(2 * k + kind) for k in range(15)]) for kind in (1, 2, 3)}
POWER = np.arange(15)


def series(w):
    wk = w**POWER
    wk1 = np.concatenate(([0.0], POWER[1:] * wk[:-1]))
    wk2 = np.concatenate(([0.0, 0.0], POWER[2:] * POWER[1:-1] * wk[:-2]))
    return {kind: (FACT[kind] @ wk, FACT[kind] @ wk1, FACT[kind] @ wk2) for kind in (1, 2, 3)}


def hat(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def unit(u, v, du, dv):
    """p, R, dp = Jp (du, dv), w = Jw (du, dv), and the parts of ddp and dw that remain without second derivatives."""
    w = u * u + v * v
    f = series(w)
    s, s1, s2 = f[1]
    a, a1, a2 = f[2]
    b, b1, _ = f[3]
    q, dq = np.array([u, v]), np.array([du, dv])
    dw = 2 * q
    w_dot = dw @ dq
    w_bias = 2 * (du * du + dv * dv)
    p = UNIT_M * np.array([a * u, a * v, s])
    jp = UNIT_M * np.array([a1 * u * dw, a1 * v * dw, s1 * dw])
    jp[0, 0] += UNIT_M * a
    jp[1, 1] += UNIT_M * a
    a_dot, a_bias = a1 * w_dot, a2 * w_dot**2 + a1 * w_bias
    s_bias = s2 * w_dot**2 + s1 * w_bias
    p_bias = UNIT_M * np.array([2 * a_dot * du + a_bias * u, 2 * a_dot * dv + a_bias * v, s_bias])
    phi, dphi = np.array([-v, u, 0.0]), np.array([-dv, du, 0.0])
    h, dh = hat(phi), hat(dphi)
    r = np.eye(3) + s * h + a * h @ h
    left = np.eye(3) + a * h + b * h @ h
    left_dot = a_dot * h + a * dh + b1 * w_dot * h @ h + b * (dh @ h + h @ dh)
    to_phi = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    return p, r, jp, left @ to_phi, p_bias, left_dot @ dphi


def body(q, dq, tension_of, memory, out):
    """Accelerations; tension_of(shortening, rate) gives the base tensions. Returns ddq; `out` gets what slid."""
    n2 = 2 * UNITS
    rot, pos = np.eye(3), np.zeros(3)
    omega, alpha0, acc0 = np.zeros(3), np.zeros(3), np.zeros(3)  # alpha0, acc0: with ddq = 0
    jv, jw = np.zeros((3, n2)), np.zeros((3, n2))
    mass = np.zeros((n2, n2))
    bias = np.zeros(n2)
    disks = [(rot, pos, jv, jw)]
    for i in range(UNITS):
        u, v = q[2 * i : 2 * i + 2]
        du, dv = dq[2 * i : 2 * i + 2]
        p, r, jp, jom, p_bias, w_bias = unit(u, v, du, dv)
        cols = slice(2 * i, 2 * i + 2)
        arm = rot @ p
        dp, w_rel = jp @ dq[cols], jom @ dq[cols]
        acc0 = (acc0 + np.cross(alpha0, arm) + np.cross(omega, np.cross(omega, arm))
                + 2 * np.cross(omega, rot @ dp) + rot @ p_bias)
        jv = jv - hat(arm) @ jw
        jv[:, cols] += rot @ jp
        w_world = rot @ w_rel
        alpha0 = alpha0 + np.cross(omega, w_world) + rot @ w_bias
        jw = jw.copy()
        jw[:, cols] += rot @ jom
        omega = omega + w_world
        pos = pos + arm
        rot = rot @ r
        inertia = rot @ np.diag([IXX, IXX, IZZ]) @ rot.T
        mass += BUILT.mass[i] * jv.T @ jv + jw.T @ inertia @ jw
        bias += (jv.T @ (BUILT.mass[i] * (acc0 - BUILT.gravity))
                 + jw.T @ (inertia @ alpha0 + np.cross(omega, inertia @ omega)))
        disks.append((rot, pos, jv, jw))

    # Holes and spans in the base frame; how a hole moves with q.
    spans, jacobians, lengths = np.zeros((3, UNITS, 3)), [], np.zeros((3, UNITS))
    for j in range(3):
        arms = [disks[i][0] @ hole_at(i, j) for i in range(UNITS + 1)]
        holes = [disks[i][1] + arms[i] for i in range(UNITS + 1)]
        jacobians.append([disks[i][2] - hat(arms[i]) @ disks[i][3] for i in range(UNITS + 1)])
        for i in range(UNITS):
            x = holes[i + 1] - holes[i]
            lengths[j, i] = math.sqrt(x @ x)
            spans[j, i] = x / lengths[j, i]
    straight = np.array([[np.linalg.norm(hole_at(i + 1, j) - hole_at(i, j) + np.array([0.0, 0.0, UNIT_M]))
                          for i in range(UNITS)] for j in range(3)])
    shortening = (straight - lengths).sum(axis=1)
    rate = np.array([-sum(spans[j, i] @ (jacobians[j][i + 1] - jacobians[j][i]) @ dq for i in range(UNITS))
                     for j in range(3)])
    base = tension_of(shortening, rate)

    beyond = np.array([[(straight - lengths)[j, i + 1 :].sum() for i in range(UNITS - 1)] for j in range(3)])
    z = (memory.rub(beyond) / ROUTING_YIELDS).mean(axis=2)
    applied = np.zeros(n2)
    for j in range(3):
        tension = base[j]
        for i in range(UNITS):  # a span pulls the hole at its end back and the one at its start on
            applied += tension * (jacobians[j][i] - jacobians[j][i + 1]).T @ spans[j, i]
            if i + 1 < UNITS:
                e, f = spans[j, i], spans[j, i + 1]
                turn = math.atan2(np.linalg.norm(np.cross(e, f)), e @ f)
                tension *= math.exp(-BUILT.routing * turn * z[j, i])

    bend = q.reshape(UNITS, 2)
    from_rest = bend - BUILT.rest
    theta = np.linalg.norm(from_rest, axis=1)
    direction = from_rest / np.maximum(theta, 1e-300)[:, None]
    moment = BUILT.stiffness * ((1 - BUILT.softening) * theta
                                + BUILT.softening * BUILT.onset * np.tanh(theta / BUILT.onset))
    slip = (memory.bend(bend) / BUILT.hysteresis_yields[:, None]).mean(axis=1)
    applied -= (moment[:, None] * direction + BUILT.hysteresis * slip).ravel() + BEND_DAMPING * dq
    applied += disks[-1][2].T @ BUILT.tip_force
    normal = np.array([math.cos(BUILT.wall_angle), math.sin(BUILT.wall_angle), 0.0])
    for i in range(1, UNITS + 1):
        depth = normal @ disks[i][1] - BUILT.wall_gap
        edge = min(max(depth, 0.0), BUILT.wall_edge)
        push = BUILT.wall * (0.5 * edge * edge / BUILT.wall_edge + max(depth - BUILT.wall_edge, 0.0))
        applied -= disks[i][2].T @ (push * normal)
    out.update(d=shortening, beyond=beyond)
    return np.linalg.solve(mass, applied - bias)


# ---- drivetrains ---------------------------------------------------------------------------------------------------


class Hysteresis:
    def __init__(self):
        self.slide_w, self.slide_x = np.zeros((3, 4)), np.zeros(3)
        self.gear_w, self.gear_x = np.zeros((3, 2)), np.zeros(3)
        self.body = BodyMemory()

    def slide(self, x):
        return np.clip(self.slide_w + (x - self.slide_x)[:, None], -SLIDE_YIELDS, SLIDE_YIELDS)

    def gear(self, x):
        return np.clip(self.gear_w + (x - self.gear_x)[:, None], -GEAR_YIELDS, GEAR_YIELDS)

    def move(self, slide_x, gear_x):
        self.slide_w, self.slide_x = self.slide(slide_x), slide_x.copy()
        self.gear_w, self.gear_x = self.gear(gear_x), gear_x.copy()


N2 = 2 * UNITS


def derivative(y, wanted, memory, out=None):
    q, angle, dq, speed, zeta, torque = (y[:N2], y[N2 : N2 + 3], y[N2 + 3 : 2 * N2 + 3], y[2 * N2 + 3 : 2 * N2 + 6],
                                         y[2 * N2 + 6 : 2 * N2 + 9], y[2 * N2 + 9 :])
    s = TRAVEL * angle
    found = {}

    def tensions(d, d_rate):
        motor = np.maximum(0.0, K * (s - d + PRETENSION / K) + C * (TRAVEL * speed - d_rate))
        z = (memory.slide(0.5 * (s + d)) / SLIDE_YIELDS).mean(axis=1)
        base = np.array([0.5 * (1 + z[j]) * release(motor[j]) + 0.5 * (1 - z[j]) * pull(motor[j]) for j in range(3)])
        found.update(motor=motor, base=base, z=z)
        return base

    ddq = body(q, dq, tensions, memory.body, found)
    z_gear = (memory.gear(angle) / GEAR_YIELDS).mean(axis=1)
    zeta_rate = (speed - np.abs(speed) * zeta) / DAHL_RAD
    load = found["motor"] * TRAVEL * EFFICIENCY ** (-z_gear)
    accel = (torque - COULOMB * zeta - DAHL_DAMPING * zeta_rate - VISCOUS * speed - load) / ROTOR
    if out is not None:
        out.update(found)
    return np.concatenate([dq, speed, ddq, accel, zeta_rate, (wanted - torque) / LAG])


def wanted_torque(cycle):
    """A pull of tendon 1 with the others paid out, a reversal, and a stop: in per mille of the rated torque."""
    hold = PRETENSION * TRAVEL / RATED * 1000
    t = cycle * 1e-3
    first = 330 * math.sin(math.pi * t / 0.16) if t < 0.16 else -60 * math.sin(math.pi * (t - 0.16) / 0.08)
    second = 150 * math.sin(2 * math.pi * t / 0.12) ** 2
    third = -25 * math.sin(math.pi * t / 0.24)
    return np.round(np.array([hold + first, hold + second, hold + third])) * 1e-3 * RATED


def simulate(step, duration_ms):
    y = np.zeros(2 * (N2 + 3) + 6)
    y[2 * N2 + 9 :] = PRETENSION * TRAVEL
    memory = Hysteresis()
    rows = []
    per_ms = round(1e-3 / step)
    h = 1e-3 / per_ms
    for cycle in range(duration_ms):
        wanted = wanted_torque(cycle)
        for _ in range(per_ms):
            k1 = derivative(y, wanted, memory)
            k2 = derivative(y + h / 2 * k1, wanted, memory)
            k3 = derivative(y + h / 2 * k2, wanted, memory)
            k4 = derivative(y + h * k3, wanted, memory)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            out = {}
            derivative(y, wanted, memory, out)
            memory.move(0.5 * (TRAVEL * y[N2 : N2 + 3] + out["d"]), y[N2 : N2 + 3])
            memory.body.move(out["beyond"], y[:N2].reshape(UNITS, 2))
        rows.append(np.concatenate([[(cycle + 1) * 1e-3], wanted, y[:N2], y[N2 : N2 + 3], y[2 * N2 + 3 : 2 * N2 + 6],
                                    y[2 * N2 + 9 :], out["motor"], out["base"], out["z"]]))
    return np.array(rows)


def main():
    here = os.path.dirname(os.path.abspath(__file__))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--step", type=float, default=1e-5, help="time step [s]")
    parser.add_argument("--duration", type=int, default=240, help="[ms]")
    parser.add_argument("--effects", action="store_true", help="with the effects of with_effects()")
    parser.add_argument("--out")
    args = parser.parse_args()
    if args.effects:
        global BUILT
        BUILT = with_effects()
    if not args.out:
        args.out = os.path.join(here, "plant_rig_90mm_effects.csv" if args.effects else "plant_rig_90mm.csv")
    rows = simulate(args.step, args.duration)
    names = (["t_s"] + [f"wanted{j}_Nm" for j in (1, 2, 3)]
             + [f"{c}{i}_rad" for i in range(1, UNITS + 1) for c in "uv"]
             + [f"{what}{j}_{unit_}" for what, unit_ in (("angle", "rad"), ("velocity", "radps"), ("torque", "Nm"),
                                                          ("motor", "N"), ("base", "N"), ("sliding", "1"))
                for j in (1, 2, 3)])
    np.savetxt(args.out, rows, delimiter=",", header=",".join(names), comments="", fmt="%.12g")


if __name__ == "__main__":
    main()
