#!/usr/bin/env python3
"""The Cosserat rod that the units are measured against (reference/cosserat.py), itself against closed forms, a finer
mesh and another formulation. Knows nothing of the program."""
import itertools
import math
import pathlib
import sys
import unittest

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing (Debian: python3-numpy)")
    sys.exit(77)
try:
    from scipy.integrate import solve_bvp
except ImportError:
    solve_bvp = None

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "reference"))
import cosserat
import make_rod_goldens
from cosserat import Load, Problem, Rod, Section, round_rod, spans_of

LENGTH = 0.09
NITI = round_rod(2.3e10, 5e-4, 0.3, 6450)
HOLES = tuple((2 * math.pi * k / 3, 4e-3) for k in range(3))


def plain(rod, spans=1, **numbers):
    """A rod without tendons or disks."""
    return Problem(spans_of([Section(spans, LENGTH / spans, rod, ())]), **numbers)


def tip(problem, load):
    """Position and rotation matrix."""
    p, q = problem.disks(problem.equilibrium(load), load)[-1]
    return p, cosserat.rotation(q[:, None])


def arc(turn):
    """exp of the rotation vector `turn`, by Rodrigues."""
    angle = np.linalg.norm(turn)
    x, y, z = turn / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def elliptic(kind, phi, modulus):
    """Incomplete integrals of the first (-1) and the second kind (+1)."""
    x, w = np.polynomial.legendre.leggauss(80)
    return phi / 2 * np.sum(w * (1 - (modulus * np.sin(phi / 2 * (1 + x))) ** 2) ** (kind / 2))


class ClosedForms(unittest.TestCase):
    def test_elastica_under_a_tip_force(self):
        slope = 1.2  # of the tip; Bisshopp and Drucker, 1945
        p = math.sqrt((1 + math.sin(slope)) / 2)
        phi = math.asin(1 / (p * math.sqrt(2)))
        root = elliptic(-1, math.pi / 2, p) - elliptic(-1, phi, p)
        force = (root / LENGTH) ** 2 * NITI.bending_Nm2
        along = math.sqrt(2 * NITI.bending_Nm2 * math.sin(slope) / force)
        across = LENGTH * (1 - 2 / root * (elliptic(1, math.pi / 2, p) - elliptic(1, phi, p)))
        x, r = tip(plain(NITI.only(), steps=64), Load((), (force, 0, 0)))
        np.testing.assert_allclose(x, (across, 0, along), rtol=0, atol=1e-8 * LENGTH)
        self.assertAlmostEqual(math.asin(r[0, 2]), slope, delta=1e-8)

    def test_tip_moment_bends_to_a_full_circle(self):
        moment = 2 * math.pi * NITI.bending_Nm2 / LENGTH
        x, r = tip(plain(NITI.only("torsion"), steps=64), Load((), moment_Nm=(0, moment, 0)))
        np.testing.assert_allclose(x, 0, atol=1e-6 * LENGTH)
        np.testing.assert_allclose(r, np.eye(3), atol=1e-6)

    def test_skew_tip_moment_makes_a_helix_and_twists(self):
        """t' = M/EI x t whatever GJ is; beside that turn the rod twists by (1/GJ - 1/EI) M . e_z."""
        rod = Rod(1.1e-3, 0.7e-3, math.inf)
        moment = np.array([0.01, -0.02, 0.015])
        x, r = tip(plain(rod, steps=64), Load((), moment_Nm=tuple(moment)))
        twist = (1 / rod.torsion_Nm2 - 1 / rod.bending_Nm2) * moment[2] * LENGTH
        np.testing.assert_allclose(r, arc(moment * LENGTH / rod.bending_Nm2) @ arc(np.array([0, 0, twist])), atol=1e-8)
        at, w = np.polynomial.legendre.leggauss(30)
        ends = [arc(moment * s / rod.bending_Nm2)[:, 2] for s in LENGTH * (1 + at) / 2]
        np.testing.assert_allclose(x, LENGTH / 2 * (w @ ends), atol=1e-8 * LENGTH)

    def test_twist_and_stretch(self):
        x, r = tip(plain(NITI), Load((), (0, 0, 30), (0, 0, 2e-3)))
        self.assertAlmostEqual(x[2], LENGTH * (1 + 30 / NITI.axial_N), delta=1e-14)
        self.assertAlmostEqual(math.atan2(r[1, 0], r[0, 0]), 2e-3 * LENGTH / NITI.torsion_Nm2, delta=1e-11)

    def test_small_force_bends_and_shears(self):
        thick = round_rod(2.3e10, 1e-2, 0.3)
        x, _ = tip(plain(thick), Load((), (1e-2, 0, 0)))
        per_force = LENGTH**3 / 3 / thick.bending_Nm2 + LENGTH / thick.shear_N
        self.assertAlmostEqual(x[0] / (1e-2 * per_force), 1, delta=1e-7)

    def test_buckles_at_eulers_load(self):
        problem = plain(NITI.only("torsion"), 3, steps=32)
        euler = math.pi**2 * NITI.bending_Nm2 / (2 * LENGTH) ** 2
        self.assertGreater(self.softest(problem, 0.99999 * euler), 0)
        self.assertLess(self.softest(problem, 1.00001 * euler), 0)

    @staticmethod
    def softest(problem, force):
        """1 / the largest deflection per force of the straight rod, in either sense."""
        load = Load((), (0, 0, -force))
        straight = np.tile([0, 0, -force, 0, 0, 0], 3)
        at_tip = problem.flexibility(straight, load)[-6:-3, -6:-3]
        return 1 / at_tip[0, 0]


class Vibrations(unittest.TestCase):
    def test_of_a_uniform_cantilever(self):
        """Bending in two planes, torsion and stretching, as the nodes become a continuous rod: their error is of second
        order and extrapolated."""
        rod = NITI.only()._replace(torsion_Nm2=NITI.torsion_Nm2 / 100, axial_N=NITI.axial_N / 100)
        coarse, fine = (self.frequencies(plain(rod, pieces=n, steps=2), Load(()))[:6] for n in (8, 16))
        found = fine + (fine - coarse) / 3
        bending = [b**2 / (2 * math.pi * LENGTH**2) * math.sqrt(rod.bending_Nm2 / rod.mass_kgpm)
                   for b in (1.8751040687, 4.6940911330)]
        polar = rod.mass_kgpm * rod.radius_m**2 / 2
        lowest = [math.sqrt(stiffness / inertia) / (4 * LENGTH)
                  for stiffness, inertia in ((rod.torsion_Nm2, polar), (rod.axial_N, rod.mass_kgpm))]
        np.testing.assert_allclose(found, [*np.repeat(bending, 2), *lowest], rtol=5e-4)

    def test_of_a_mass_on_a_massless_rod(self):
        """The mass swings in two planes; compression by its weight softens it as the beam-column's tangent."""
        rod, mass, weight = NITI.only("torsion")._replace(mass_kgpm=0), 3e-3, 0.2
        problem = Problem(spans_of([Section(1, LENGTH, rod, (), mass)]), steps=64)
        a = math.sqrt(weight / rod.bending_Nm2) * LENGTH
        stiffness = weight / LENGTH / (math.tan(a) / a - 1)
        load = Load((), gravity_mps2=(0, 0, -weight / mass))
        found = problem.frequencies(problem.equilibrium(load), load)
        np.testing.assert_allclose(found[:2], math.sqrt(stiffness / mass) / 2 / math.pi, rtol=1e-8)

    @staticmethod
    def frequencies(problem, load):
        return problem.frequencies(problem.equilibrium(load), load)


class Tendons(unittest.TestCase):
    load = Load((2, 3, 0.5), (0.05, -0.08, 0.03), (2e-3, 1e-3, -1.5e-3))

    @staticmethod
    def robot(rod=NITI, **numbers):
        softer = rod._replace(bending_Nm2=8e-4)
        sections = [Section(2, 0.018, rod, HOLES[:2], 2e-3, 1.2e-8, 2.4e-8),
                    Section(1, 0.025, softer, ((math.pi / 3, 3e-3),), 1e-3, 1e-8, 2e-8)]
        return Problem(spans_of(sections), **numbers)

    def test_halving_the_mesh_changes_the_tip_by_the_fourth_power(self):
        x = [tip(self.robot(steps=s), self.load)[0] for s in (2, 4, 8, 16)]
        change = [np.linalg.norm(b - a) for a, b in itertools.pairwise(x)]
        self.assertLess(change[-1], 1e-6 * LENGTH)
        for coarse, fine in itertools.pairwise(change):
            self.assertAlmostEqual(math.log2(coarse / fine), 4, delta=0.4)

    def test_further_nodes_change_nothing_at_rest(self):
        x = [tip(self.robot(pieces=p, steps=16 // p), self.load)[0] for p in (1, 2)]
        np.testing.assert_allclose(x[0], x[1], atol=1e-12)

    def test_motion_here_per_force_there_is_motion_there_per_force_here(self):
        """Maxwell and Betti, with all tendons pulling and forces at the tip."""
        problem, load = self.robot(steps=32), self.load._replace(moment_Nm=(0, 0, 0))
        f = problem.flexibility(problem.equilibrium(load), load)
        size = np.sqrt(np.diag(f))
        np.testing.assert_allclose(f / np.outer(size, size), f.T / np.outer(size, size), rtol=0, atol=1e-7)

    def test_turning_robot_and_loads_about_the_axis_turns_the_shape(self):
        def at(angle):
            c, s = math.cos(angle), math.sin(angle)
            r = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            holes = tuple((a + angle, radius) for a, radius in HOLES)
            problem = Problem(spans_of([Section(3, 0.018, NITI, holes)]))
            force, moment = r @ self.load.force_N, r @ self.load.moment_Nm
            x, turn = tip(problem, Load(self.load.tension_N, tuple(force), tuple(moment)))
            return r.T @ x, r.T @ turn @ r
        for a, b in zip(at(0), at(0.7)):
            np.testing.assert_allclose(a, b, atol=1e-12)

    @unittest.skipIf(solve_bvp is None, "scipy is missing")
    def test_collocation_with_forces_at_each_disk_finds_the_same(self):
        problem = self.robot()
        x, _ = tip(problem, self.load)
        np.testing.assert_allclose(x, collocated_tip(problem, self.load), atol=1e-7 * LENGTH)


class Goldens(unittest.TestCase):
    """What the program is compared with is what this rod says now; a load in nine, to be quick."""

    def test_stored_disks(self):
        for which, (robot, cases) in make_rod_goldens.ROBOTS.items():
            problem = Problem(robot("torsion", "extension"))
            stored = np.genfromtxt(make_rod_goldens.GOLDEN / f"rod_{which}.csv", delimiter=",", skip_header=1)
            self.assertEqual(len(stored), len(cases))
            for (_, tension, force, milli), row in list(zip(cases, stored))[4::9]:
                load = Load(tension, force, tuple(1e-3 * m for m in milli))
                found = [x for p, q in problem.disks(problem.equilibrium(load), load) for x in (*p, *q)]
                np.testing.assert_allclose(row[1:], [*tension, *force, *load.moment_Nm, *found], rtol=0, atol=1e-6)


def collocated_tip(problem, load):
    """SciPy's collocation over all spans at once. Each disk's own balance, tendon by tendon, gives the jumps there,
    instead of one cut through rod and tendons. From the straight rod, in three increments."""
    spans = problem.spans
    grid = np.linspace(0, 1, 9)
    rest = np.zeros((13 * len(spans), len(grid)))
    start = 0.0
    for i, span in enumerate(spans):
        rest[13 * i + 2] = start + grid * span.length_m
        rest[13 * i + 3] = 1
        start += span.length_m

    def slope(_, y):
        out = []
        for span, (p, q, n, m) in zip(spans, split(y)):
            there = cosserat.rates(p, q, np.concatenate((n, m)), p, span.rod)
            out += [span.length_m * d for d in (*there, 0 * n, -cosserat.cross(there[0], n))]
        return np.concatenate(out)

    for share in (1 / 3, 2 / 3, 1):
        now = load.scaled(share)
        missing = lambda a, b, now=now: ends(spans, split(a[:, None]), split(b[:, None]), now)
        found = solve_bvp(slope, missing, grid, rest, tol=1e-9, max_nodes=2000)
        if not found.success:
            raise AssertionError(found.message)
        grid, rest = found.x, found.y
    return found.y[-13:-10, -1]


def split(y):
    return [(y[i : i + 3], y[i + 3 : i + 7], y[i + 7 : i + 10], y[i + 10 : i + 13]) for i in range(0, len(y), 13)]


def ends(spans, first, last, load):
    """What is missing at the base, at each disk (place, orientation, forces, moments) and so at the tip."""
    p, q, _, _ = first[0]
    out = [p, q - cosserat.column((1, 0, 0, 0))]
    for i, span in enumerate(spans):
        p, q, n, m = last[i]
        force, moment = -n, -m
        for j, before, beyond in zip(span.tendons, span.before, span.beyond):
            arm = cosserat.turned(q, cosserat.column((*beyond, 0)))
            at = first[i][0] + cosserat.turned(first[i][1], cosserat.column((*before, 0)))
            pulls = [cosserat.unit(at - p - arm)]
            if i + 1 < len(spans) and j in spans[i + 1].tendons:
                k = spans[i + 1].tendons.index(j)
                pulls.append(cosserat.unit(last[i + 1][0] + cosserat.turned(last[i + 1][1], cosserat.column(
                    (*spans[i + 1].beyond[k], 0))) - p - arm))
            for pull in pulls:
                force = force + load.tension_N[j] * pull
                moment = moment + load.tension_N[j] * cosserat.cross(arm, pull)
        if i + 1 < len(spans):
            out += [first[i + 1][0] - p, first[i + 1][1] - q]
            force, moment = force + first[i + 1][2], moment + first[i + 1][3]
        else:
            force, moment = force + cosserat.column(load.force_N), moment + cosserat.column(load.moment_Nm)
        out += [force, 1e2 * moment]
    return np.concatenate(out)[:, 0]


if __name__ == "__main__":
    unittest.main()
