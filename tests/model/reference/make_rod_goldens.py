"""Writes ../golden/rod_*.csv: disks and frequencies of two robots by the Cosserat rod of cosserat.py. Needs numpy;
takes two minutes. `make_rod_goldens.py FILE...` writes these alone.

The robots are config/robots/rod_5disks.yaml and tests/support/robots/rod_two_sections.yaml, whose numbers are repeated
here: nothing of the program is read. Files that end in _bends have neither torsion, extension nor shear, those that end
in _shears or _frequencies have all of them, the others torsion and extension.
"""

import math
import sys
from pathlib import Path

import numpy as np
from cosserat import Load, Problem, Section, round_rod, spans_of

GOLDEN = Path(__file__).resolve().parent.parent / "golden"
TINY = 1e-13  # what symmetry makes zero
STEPS = 24  # of integration, a span
NODES = 6  # a span, for the frequencies: they carry the rod's mass
NITI_KGPM3 = 6450.0
FREQUENCIES = ("f1", "f2", "f3", "f4", "f5")


def around(count, radius, offset=0.0):
    return tuple((offset + 2 * math.pi * k / count, radius) for k in range(count))


def thin_disk(mass, diameter):
    return mass, mass * diameter**2 / 16, mass * diameter**2 / 8


def one_section(*strains):
    rod = round_rod(2.3e10, 0.0005, 0.3, NITI_KGPM3).only(*strains)
    return spans_of([Section(5, 0.018, rod, around(3, 0.004), *thin_disk(0.002, 0.010))])


def two_sections(*strains):
    lower, upper = (round_rod(2.3e10, r, 0.3, NITI_KGPM3).only(*strains) for r in (0.0006, 0.0004))
    return spans_of([Section(3, 0.018, lower, around(3, 0.004), *thin_disk(0.0025, 0.010)),
                     Section(3, 0.015, upper, around(3, 0.0035, math.pi / 3), *thin_disk(0.0015, 0.008))])


# What loads the robot: kind, tensions [N], force [N] and moment [mN m] at the tip.
ONE = (
    *(("tension", (t, 0, 0), (0, 0, 0), (0, 0, 0)) for t in (0, 1, 2, 3, 4, 5)),
    ("tension", (0, 5, 0), (0, 0, 0), (0, 0, 0)),
    ("tension", (3, 3, 0), (0, 0, 0), (0, 0, 0)),
    ("tension", (4, 2, 1), (0, 0, 0), (0, 0, 0)),
    ("tension", (5, 5, 5), (0, 0, 0), (0, 0, 0)),
    ("side force", (0, 0, 0), (0.1, 0, 0), (0, 0, 0)),
    ("side force", (2, 2, 2), (0, 0.1, 0), (0, 0, 0)),
    ("side force", (2, 0, 0), (0, 0.1, 0), (0, 0, 0)),
    ("side force", (5, 0, 0), (0.05, 0, 0), (0, 0, 0)),
    ("side force", (5, 0, 0), (0, 0.05, 0), (0, 0, 0)),
    ("side force", (5, 0, 0), (0, -0.1, 0), (0, 0, 0)),
    ("side force", (0, 5, 0), (-0.1, 0, 0), (0, 0, 0)),
    ("side force", (3, 3, 0), (-0.1, 0, 0), (0, 0, 0)),
    ("side force", (3, 3, 0), (0, -0.1, 0), (0, 0, 0)),
    ("side force", (4, 2, 1), (-0.06, 0.08, 0), (0, 0, 0)),
    ("force along z", (0, 0, 0), (0, 0, 1), (0, 0, 0)),
    ("force along z", (3, 0, 0), (0, 0, 0.2), (0, 0, 0)),
    ("force along z", (3, 0, 0), (0, 0, -0.1), (0, 0, 0)),
    ("force along z", (5, 1, 0), (0, 0, -0.1), (0, 0, 0)),
    ("moment", (0, 0, 0), (0, 0, 0), (0, 0, 3)),
    ("moment", (0, 0, 0), (0, 0, 0), (5, 0, 0)),
    ("moment", (3, 0, 0), (0, 0, 0), (0, 0, 3)),
    ("moment", (5, 0, 0), (0, 0, 0), (0, 0, -2)),
    ("moment", (3, 3, 0), (0, 0, 0), (2, -3, 1)),
    ("moment", (0, 4, 1), (0, 0, 0), (-3, 0, 2)),
    ("force and moment", (5, 0, 0), (0, 0.05, 0), (0, 0, 1)),
    ("force and moment", (3, 3, 0), (0.05, 0, 0.1), (2, 0, -2)),
    ("force and moment", (1, 4, 0), (-0.05, 0.05, -0.05), (1, 1, 1)),
)
TWO = (
    ("tension", (5, 0, 0, 0, 0, 0), (0, 0, 0), (0, 0, 0)),
    ("tension", (0, 0, 0, 2, 0, 0), (0, 0, 0), (0, 0, 0)),
    ("tension", (5, 0, 0, 0, 0, 2), (0, 0, 0), (0, 0, 0)),
    ("tension", (3, 2, 0, 0, 1.5, 1), (0, 0, 0), (0, 0, 0)),
    ("side force", (0, 0, 0, 0, 0, 0), (0, 0.05, 0), (0, 0, 0)),
    ("side force", (5, 0, 0, 0, 2, 0), (0, 0.03, 0), (0, 0, 0)),
    ("side force", (2, 4, 0, 1, 0, 1), (-0.04, 0, 0), (0, 0, 0)),
    ("force along z", (3, 0, 0, 0, 1, 1), (0, 0, -0.05), (0, 0, 0)),
    ("moment", (0, 4, 0, 0, 0, 2), (0, 0, 0), (0, 0, 1)),
    ("moment", (3, 0, 2, 1, 0, 0), (0, 0, 0), (1, -0.5, 0)),
    ("force and moment", (4, 0, 0, 0, 2, 0), (0.02, 0.02, 0), (0, 0.5, -0.5)),
)
PULLS = {"one": ((0, 0, 0), (1, 0, 0), (2, 2, 2), (3, 0, 0), (3, 3, 0), (5, 0, 0), (5, 2, 0)),
         "two": ((0, 0, 0, 0, 0, 0), (5, 0, 0, 0, 0, 0), (3, 2, 0, 0, 1.5, 1), (2, 4, 0, 1, 0, 1))}
ROBOTS = {"one": (one_section, ONE), "two": (two_sections, TWO)}
STRAINS = {"": ("torsion", "extension"), "_bends": (), "_shears": ("torsion", "extension", "shear")}


def write(name, header, rows):
    with open(GOLDEN / name, "w", encoding="ascii") as out:
        out.write(",".join(header) + "\n")
        for row in rows:
            out.write(",".join(x if isinstance(x, str) else f"{x if abs(x) > TINY else 0.0:.12g}" for x in row) + "\n")
    print(name, file=sys.stderr)


def columns(spans, *more):
    return [f"T{j + 1}" for j in range(max(max(s.tendons) for s in spans) + 1)] + list(more)


def pose_columns(spans):
    return [f"{c}{k + 1}" for k in range(len(spans)) for c in ("x", "y", "z", "qw", "qx", "qy", "qz")]


def statics(name, robot, cases):
    problem = Problem(robot, steps=STEPS)
    rows = []
    for kind, tension, force, milli in cases:
        load = Load(tension, force, tuple(1e-3 * m for m in milli))
        found = problem.equilibrium(load)
        stiffness = np.linalg.eigvals(problem.flexibility(found, load))
        if not stiffness.real.min() > -1e-9:
            raise ArithmeticError(f"{name}: {kind} {load} is not stable")
        poses = [x for p, q in problem.disks(found, load) for x in (*p, *q)]
        rows.append((kind, *load.tension_N, *load.force_N, *load.moment_Nm, *poses))
    header = columns(robot, "fx", "fy", "fz", "mx", "my", "mz")
    write(name, ["load", *header, *pose_columns(robot)], rows)


def frequencies(name, robot, pulls):
    problem = Problem(robot, pieces=NODES, steps=STEPS // NODES)
    rows = []
    for tension in pulls:
        load = Load(tension)
        rows.append((*tension, *problem.frequencies(problem.equilibrium(load), load)[:5]))
    write(name, columns(robot, *FREQUENCIES), rows)


def main(wanted):
    files = {}
    for which, (robot, cases) in ROBOTS.items():
        for end, strains in STRAINS.items():
            files[f"rod_{which}{end}.csv"] = (statics, robot(*strains), cases)
        files[f"rod_{which}_frequencies.csv"] = (frequencies, robot(*STRAINS["_shears"]), PULLS[which])
    for name in wanted or files:
        if name not in files:
            sys.exit(f"no file '{name}'; there are {', '.join(files)}")
        files[name][0](name, *files[name][1:])


if __name__ == "__main__":
    main(sys.argv[1:])
