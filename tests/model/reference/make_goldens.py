"""Writes ../golden/*.csv from particles.py; deterministic. Run in a venv with requirements.txt; takes some minutes.

The robots are those of ../bodies.h. Inputs are short decimals, read as the nearest double by both sides.
"""

import math
import random
import sys
from pathlib import Path

import mpmath

import particles
from particles import Robot, Section

GOLDEN = Path(__file__).resolve().parent.parent / "golden"


def around(count, radius, offset=0.0):
    return [(offset + 2 * math.pi * k / count, radius) for k in range(count)]


def thin_disk(mass, diameter):
    return mass * diameter**2 / 16, mass * diameter**2 / 8


def paper_robot():
    ixx, izz = thin_disk(0.0025, 0.010)
    return Robot([Section(4, 0.0225, 0.0025, ixx, izz, 2.3e10, 0.0005, around(3, 0.004))])


def two_sections():
    """Everything different between the sections, gravity askew, damping, disks that are no thin plates."""
    return Robot(
        [
            Section(3, 0.020, 0.0030, 2.5e-8, 3.5e-8, 2.3e10, 0.0006, around(3, 0.005), 3e-5),
            Section(2, 0.025, 0.0015, 1.4e-8, 1.1e-8, 3.1e10, 0.0004, around(4, 0.0035, 0.3), 1e-5),
        ],
        gravity=(2.0, -3.0, 8.5),
    )


def short(x):
    return float(f"{x:.6g}")


def write(name, header, rows):
    with open(GOLDEN / name, "w", encoding="ascii") as out:
        out.write(",".join(header) + "\n")
        for inputs, outputs in rows:
            cells = [f"{x:.6g}" for x in inputs] + [mpmath.nstr(x, 17, min_fixed=0, max_fixed=0) for x in outputs]
            out.write(",".join(cells) + "\n")
    print(name, file=sys.stderr)


def pairs(a, b, n):
    return [f"{c}{i}" for i in range(1, n + 1) for c in (a, b)]


def numbered(a, n):
    return [f"{a}{i}" for i in range(1, n + 1)]


def bend(rng, kind):
    beta = rng.uniform(-math.pi, math.pi)
    if kind == "straight":
        return 0.0, 0.0
    if kind == "tiny":
        theta = 10 ** rng.uniform(-9, -3)
    elif kind == "pi":
        theta = math.pi + rng.choice((-1, 1)) * 10 ** rng.uniform(-7, -1)
    else:
        theta = rng.uniform(0, 2.5)
    return short(theta * math.cos(beta)), short(theta * math.sin(beta))


def state(rng, robot, k):
    kind = ["any", "any", "pi", "tiny", "mixed"][k % 5] if k % 50 else "straight"
    units = len(robot.units)
    q = []
    for _ in range(units):
        q += bend(rng, rng.choice(("straight", "tiny", "any", "pi")) if kind == "mixed" else kind)
    speed = 0.0 if k % 100 == 50 else 10 ** rng.uniform(-1, 1.5)
    dq = [short(rng.gauss(0, speed)) for _ in range(2 * units)]
    tension = [short(rng.uniform(0, 8)) if rng.random() > 0.05 else 0.0 for _ in robot.tendons]
    return q, dq, tension


def accel(name, robot, count, seed):
    rng = random.Random(seed)
    rows = []
    for k in range(count):
        q, dq, tension = state(rng, robot, k)
        rows.append((q + dq + tension, particles.accelerations(robot, q, dq, tension)))
    n = len(robot.units)
    header = pairs("u", "v", n) + pairs("du", "dv", n) + numbered("T", len(robot.tendons)) + pairs("ddu", "ddv", n)
    write(name, header, rows)


def shapes(name, robot, count, seed):
    """Energies, tip and tendon lengths, and the mass matrix's upper triangle."""
    rng = random.Random(seed)
    m = particles.Exact
    rows = []
    n = len(robot.units)
    for k in range(count):
        q, dq, _ = state(rng, robot, k)
        exact, rate = [m.num(x) for x in q], [m.num(x) for x in dq]
        h, _, _ = particles.mass_matrix(robot, exact)
        p, r = particles.poses(m, robot, exact)[-1]
        outputs = [
            particles.kinetic_energy(robot, exact, rate),
            particles.elastic_energy(m, robot, exact),
            particles.gravity_energy(m, robot, exact),
            *p,
            *[r[i][j] for i in range(3) for j in range(3)],
            *particles.tendon_lengths(m, robot, exact),
            *[h[i, j] for i in range(2 * n) for j in range(i, 2 * n)],
        ]
        rows.append((q + dq, outputs))
    header = pairs("u", "v", n) + pairs("du", "dv", n) + ["kinetic", "elastic", "gravity", "x", "y", "z"]
    header += [f"R{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)] + numbered("L", len(robot.tendons))
    header += [f"H{i}_{j}" for i in range(1, 2 * n + 1) for j in range(i, 2 * n + 1)]
    write(name, header, rows)


def statics(name, robot, loads):
    """Equilibria on the branch from zero load and the natural frequencies about them."""
    rows = []
    for tension, force in loads:
        q = particles.equilibrium(robot, tension, force)
        f = particles.frequencies(robot, q, tension, force)
        rows.append((list(tension) + list(force), q + list(particles.poses(particles.Exact, robot, q)[-1][0]) + f))
    n = len(robot.units)
    header = numbered("T", len(robot.tendons)) + ["fx", "fy", "fz"] + pairs("u", "v", n) + ["x", "y", "z"]
    write(name, header + numbered("f", 2 * n), rows)


def main():
    GOLDEN.mkdir(exist_ok=True)
    paper, two = paper_robot(), two_sections()
    jobs = {
        "accel_paper.csv": lambda name: accel(name, paper, 1000, 1),
        "accel_two_sections.csv": lambda name: accel(name, two, 150, 2),
        "shapes_paper.csv": lambda name: shapes(name, paper, 20, 3),
        "shapes_two_sections.csv": lambda name: shapes(name, two, 20, 4),
        "statics_paper.csv": lambda name: statics(
            name,
            paper,
            [
                ((0, 0, 0), (0, 0, 0)),
                ((5, 0, 0), (0, 0, 0)),
                ((0.3, 0.3, 0.3), (0, 0, 0)),
                ((8, 0, 0), (0, 0, 0)),
                ((0, 8, 0), (0, 0, 0)),
                ((8, 8, 0), (0, 0, 0)),
                ((5.2, 3.1, 0.3), (0, 0, 0)),
                ((7, 6.5, 7), (0, 0, 0)),
                ((2, 1, 0.5), (0.05, -0.1, 0.08)),
                ((0.3, 0.3, 6), (0.02, 0.2, -0.1)),
            ],
        ),
        "statics_two_sections.csv": lambda name: statics(
            name,
            two,
            [
                ((0, 0, 0, 0, 0, 0, 0), (0, 0, 0)),
                ((3, 0.3, 0.3, 0.3, 0.3, 2, 0.3), (0, 0, 0)),
                ((0.5, 4, 1, 1.5, 0.3, 0.3, 0.7), (0.04, 0.02, -0.06)),
            ],
        ),
    }
    for name in sys.argv[1:] or jobs:
        jobs[name](name)


if __name__ == "__main__":
    main()
