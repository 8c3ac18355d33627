#!/usr/bin/env python3
"""`tendril model statics` and `frequencies` against a Cosserat rod: the solutions in golden/rod_*.csv, which
reference/make_rod_goldens.py makes from the textbook's equations with nothing of the program."""
import importlib.machinery
import importlib.util
import pathlib
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
TENDRIL = pathlib.Path(sys.argv.pop(1))
GOAL_MM, GOAL_SHARE = 0.1, 0.01

sys.dont_write_bytecode = True
try:
    import yaml  # noqa: F401  what rod_accuracy needs
except ImportError:
    print("skipped: PyYAML is missing (Debian: python3-yaml)")
    sys.exit(77)
loader = importlib.machinery.SourceFileLoader("rod_accuracy", str(ROOT / "tools/rod_accuracy"))
rods = importlib.util.module_from_spec(importlib.util.spec_from_loader("rod_accuracy", loader))
loader.exec_module(rods)


class Rod(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)

    def finer(self, which, units, strains=rods.ALL):
        """The robot with so many units a disk spacing, as a file."""
        return rods.variant(rods.ROBOTS[which][1], strains, units, pathlib.Path(self.folder.name))

    def test_every_disk_is_within_the_goal_at_two_units_a_spacing(self):
        for which, (title, _) in rods.ROBOTS.items():
            rod = rods.golden(f"rod_{which}_shears.csv")
            for found, wanted in zip(rods.statics(TENDRIL, self.finer(which, 2), rod), rod, strict=True):
                with self.subTest(robot=title, load=rods.short(wanted)):
                    self.assertLess(rods.worst_mm(found, wanted), GOAL_MM)

    def test_first_five_frequencies_are_within_the_goal_at_two_units_a_spacing(self):
        for which, (title, _) in rods.ROBOTS.items():
            rod = rods.golden(f"rod_{which}_frequencies.csv")
            for found, wanted in zip(rods.frequencies(TENDRIL, self.finer(which, 2), rod), rod, strict=True):
                with self.subTest(robot=title, tensions=rods.text_of(wanted, rods.tensions([wanted]))):
                    self.assertLess(rods.worst_share(found, wanted), GOAL_SHARE)

    def worst_mm(self, which, file, strains, units):
        rod = rods.golden(file)
        return max(map(rods.worst_mm, rods.statics(TENDRIL, self.finer(which, units, strains), rod), rod))

    def test_twice_the_units_leave_a_quarter_of_the_error_without_shear(self):
        """Of the worst case; the first order would leave a half."""
        for which, (title, _) in rods.ROBOTS.items():
            coarse, fine = (self.worst_mm(which, f"rod_{which}.csv", rods.UNSHEARED, units) for units in (4, 8))
            with self.subTest(robot=title):
                self.assertAlmostEqual(coarse / fine, 4, delta=0.4)

    def test_two_units_with_shear_are_closer_than_four_without(self):
        """And four leave less than a tenth of the error of two."""
        for which, (title, _) in rods.ROBOTS.items():
            two, four = (self.worst_mm(which, f"rod_{which}_shears.csv", rods.ALL, units) for units in (2, 4))
            with self.subTest(robot=title):
                self.assertLess(two, self.worst_mm(which, f"rod_{which}.csv", rods.UNSHEARED, 4))
                self.assertGreater(two / four, 10)

    def test_a_chain_in_mujoco_converges_to_the_same_rod(self):
        """The yardstick against a solution of another kind, stored as well (tests/blind/mujoco_rod.py)."""
        for which, (title, _) in rods.ROBOTS.items():
            rod, chain = rods.golden(f"rod_{which}.csv"), rods.by_pieces(f"rod_{which}_chain.csv")
            worst = {n: max(map(rods.worst_mm, chain[n], rod)) for n in rods.PIECES}
            with self.subTest(robot=title):
                self.assertAlmostEqual(worst["4"] / worst["8"], 4, delta=0.2)
                fine = map(rods.extrapolated, chain["4"], chain["8"])
                self.assertLess(max(map(rods.worst_mm, fine, rod)), 0.02)

    def test_units_that_bend_alone_converge_to_a_rod_that_only_bends(self):
        rod = rods.golden("rod_one_bends.csv")
        worst = []
        for units in (4, 8):
            robot = rods.variant(rods.ROBOTS["one"][1], rods.BENDS, units, pathlib.Path(self.folder.name))
            worst.append(max(map(rods.worst_mm, rods.statics(TENDRIL, robot, rod), rod)))
        self.assertAlmostEqual(worst[0] / worst[1], 4, delta=0.4)


if __name__ == "__main__":
    unittest.main()
