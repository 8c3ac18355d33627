"""The robots of tests/model/golden/rod_*.csv as chains in MuJoCo: rigid links, between them a slide that stretches,
two hinges that bend and one that twists; spatial tendons through the disks' holes. `python -m tests.blind.mujoco_rod`
writes rod_*_chain*.csv there, `... one` those of one robot.

A joint lies in the middle of the piece of rod that it stands for, and the order of its turns is reversed from joint to
joint, so that the chain's error falls with the square of the pieces. Equilibria by Newton on MuJoCo's own forces,
frequencies from their slope and its mass matrix. Needs mujoco; knows of the rod what reference/make_rod_goldens.py
says."""

import csv
import math
import sys
from pathlib import Path

import mujoco
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/model/reference"))
import make_rod_goldens as rods

PIECES = (2, 4, 8)  # of rod a disk spacing
JOINTS = (("slide", "0 0 1"), ("hinge", "0 1 0"), ("hinge", "-1 0 0"), ("hinge", "0 0 1"))
STEP = 1e-6  # rad or m, of the derivatives


def inertial(mass, xx, zz):
    zz *= 1 - 1e-9  # a thin disk's is xx + xx, which MuJoCo refuses where the last digit is rounded up
    return f'<inertial pos="0 0 0" mass="{mass:.12g}" diaginertia="{xx:.12g} {xx:.12g} {zz:.12g}"/>'


def sites(disk, holes):
    return "".join(f'<site name="s{disk}_{j}" pos="{x:.15g} {y:.15g} 0"/>' for j, (x, y) in holes)


def chain_xml(spans, pieces):
    """Bodies sit at the pieces' ends, with the mass of half the rod on both sides; a body's joint lies half a piece
    before its origin."""
    rows = ['<mujoco><compiler angle="radian" inertiafromgeom="false"/><option gravity="0 0 0"/><worldbody>',
            sites(0, zip(spans[0].tendons, spans[0].before))]
    total = pieces * len(spans)
    for k in range(total):
        span = spans[k // pieces]
        rod, h = span.rod, span.length_m / pieces
        after = spans[(k + 1) // pieces] if k + 1 < total else None
        mass = rod.mass_kgpm * h / 2 + (after.rod.mass_kgpm * after.length_m / pieces / 2 if after else 0)
        xx, zz = mass * rod.radius_m**2 / 4, mass * rod.radius_m**2 / 2
        disk = (k + 1) % pieces == 0
        if disk:
            mass, xx, zz = mass + span.disk_kg, xx + span.disk_xx_kgm2, zz + span.disk_zz_kgm2
        rows.append(f'<body name="b{k}" pos="0 0 {h:.15g}">' + inertial(mass, xx, zz))
        stiffness = (rod.axial_N, rod.bending_Nm2, rod.bending_Nm2, rod.torsion_Nm2)
        for (kind, axis), k_rod in list(zip(JOINTS, stiffness))[:: -1 if k % 2 else 1]:
            rows.append(f'<joint type="{kind}" pos="0 0 {-h / 2:.15g}" axis="{axis}" stiffness="{k_rod / h:.15g}"/>')
        if disk:
            rows.append(sites((k + 1) // pieces, zip(span.tendons, span.beyond)))
    rows.append("</body>" * total + "</worldbody><tendon>")
    tendons = spans[0].tendons
    for j in tendons:
        last = max(i for i, s in enumerate(spans) if j in s.tendons) + 1
        path = "".join(f'<site site="s{d}_{j}"/>' for d in range(last + 1))
        rows.append(f'<spatial name="t{j}">{path}</spatial>')
    rows.append("</tendon><actuator>")
    rows += [f'<general tendon="t{j}" gainprm="1" biastype="none"/>' for j in tendons]
    return "".join(rows) + "</actuator></mujoco>"


class Chain:
    def __init__(self, spans, pieces):
        self.model = mujoco.MjModel.from_xml_string(chain_xml(spans, pieces))
        self.data = mujoco.MjData(self.model)
        self.disks = [f"b{k}" for k in range(pieces - 1, pieces * len(spans), pieces)]

    def force(self, q, load):
        """Generalised force at rest at q: springs, tendons and the load at the tip."""
        self.data.qpos[:] = q
        self.data.ctrl[:] = -np.array(load.tension_N)
        self.data.xfrc_applied[-1] = (*load.force_N, *load.moment_Nm)
        mujoco.mj_forward(self.model, self.data)
        return self.data.qfrc_smooth.copy()

    def slope(self, q, load):
        moved = STEP * np.eye(len(q))
        return np.stack([(self.force(q + d, load) - self.force(q - d, load)) / (2 * STEP) for d in moved], 1)

    def equilibrium(self, load, increments=8):
        """On the branch from no load, all loads in proportion."""
        q = np.zeros(self.model.nq)
        for share in np.linspace(0, 1, increments + 1)[1:]:
            part = load.scaled(share)
            for _ in range(20):
                step = np.linalg.solve(self.slope(q, part), -self.force(q, part))
                q = q + step
                if np.abs(step).max() < 1e-10:
                    break
            else:
                raise ArithmeticError(f"no equilibrium at {part}")
        return q

    def poses(self, q, load):
        self.force(q, load)
        return [x for name in self.disks for x in (*self.data.body(name).xpos, *upright(self.data.body(name).xquat))]

    def frequencies(self, q, load):
        slope = self.slope(q, load)
        mass = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, mass)
        squares = np.linalg.eigvals(np.linalg.solve(mass, -slope)).real
        return np.sqrt(np.sort(squares)[:5]) / (2 * math.pi)


def upright(quaternion):
    return quaternion if quaternion[0] >= 0 else -quaternion


def loads(which):
    """The loads of a golden, as it says them."""
    with open(rods.GOLDEN / f"rod_{which}.csv", encoding="ascii") as file:
        for row in csv.DictReader(file):
            numbers = {k: float(v) for k, v in row.items() if k != "load"}
            tension = tuple(numbers[f"T{j}"] for j in range(1, len(row)) if f"T{j}" in numbers)
            yield row["load"], rods.Load(tension, *(tuple(numbers[f"{c}{a}"] for a in "xyz") for c in "fm"))


def main(wanted):
    if unknown := set(wanted) - set(rods.ROBOTS):
        sys.exit(f"no robot '{unknown.pop()}'; there are {', '.join(rods.ROBOTS)}")
    for which in wanted or rods.ROBOTS:
        robot, _ = rods.ROBOTS[which]
        spans = robot(*rods.STRAINS[""])
        statics, vibrations = [], []
        for pieces in PIECES:
            chain = Chain(spans, pieces)
            for kind, load in loads(which):
                poses = chain.poses(chain.equilibrium(load), load)
                statics.append((kind, str(pieces), *load.tension_N, *load.force_N, *load.moment_Nm, *poses))
            for tension in rods.PULLS[which]:
                load = rods.Load(tension)
                vibrations.append((str(pieces), *tension, *chain.frequencies(chain.equilibrium(load), load)))
        header = rods.columns(spans, "fx", "fy", "fz", "mx", "my", "mz")
        rods.write(f"rod_{which}_chain.csv", ["load", "pieces", *header, *rods.pose_columns(spans)], statics)
        header = rods.columns(spans, *rods.FREQUENCIES)
        rods.write(f"rod_{which}_chain_frequencies.csv", ["pieces", *header], vibrations)


if __name__ == "__main__":
    main(sys.argv[1:])
