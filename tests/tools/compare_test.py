#!/usr/bin/env python3
"""`tendril compare` over control laws as a user runs it: the goals that the nominal plant meets, limits, and wrong
use. Knows the JSON's keys only."""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

TENDRIL = sys.argv.pop(1)


def run(*args):
    return subprocess.run([TENDRIL, "compare", *args], capture_output=True, text=True, timeout=300)


class Laws(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with tempfile.TemporaryDirectory() as folder:
            done = run("--trajectory", "circle", "--on", "nominal", "--no-plots", "--json", "--out", folder)
            assert done.returncode == 0, done.stderr
            cls.found = json.loads(done.stdout)
            cls.columns = (pathlib.Path(folder) / "circle.csv").read_text().split("\n")[0].split(",")
        cls.runs = {r["law"]: r for r in cls.found["trajectories"][0]["runs"]}

    def test_feedback_of_tension_keeps_the_tip_within_a_fifth_of_a_millimetre(self):
        self.assertLess(self.runs["tension"]["tip_rms_error_m"], 0.2e-3)
        self.assertLess(self.runs["tension"]["tip_max_error_m"], 0.2e-3)

    def test_it_is_eight_times_better_than_the_paper(self):
        # The circle lies 0.07 mm beside every tip that three tendons reach on this robot; the tenth part of the
        # paper's error would be less than that.
        self.assertLess(self.runs["tension"]["tip_rms_error_m"], self.runs["paper"]["tip_rms_error_m"] / 8)
        self.assertLess(self.runs["equilibrium"]["tip_rms_error_m"], self.runs["paper"]["tip_rms_error_m"] / 5)

    def test_no_limit_is_exceeded(self):
        for law, r in self.runs.items():
            self.assertIsNone(r["fault"], law)
            self.assertEqual(max(r["limit_excess"].values()), 0, law)

    def test_no_limit_is_exceeded_where_laws_and_plants_are_at_odds_and_after_a_fault(self):
        with tempfile.TemporaryDirectory() as folder:
            done = run("--trajectory", "fast_circle", "--on", "stiffness", "--on", "friction", "--no-plots", "--json",
                       "--out", folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        runs = json.loads(done.stdout)["trajectories"][0]["runs"]
        self.assertEqual(len(runs), 10)
        self.assertIsNotNone(next(r for r in runs if r["law"] == "equilibrium" and r["plant"] == "friction")["fault"])
        for r in runs:
            self.assertEqual(max(r["limit_excess"].values()), 0, (r["law"], r["limit_excess"]))

    def test_samples_have_a_tip_for_every_law(self):
        self.assertEqual(len(self.columns), 4 + 3 * len(self.runs))

    def test_a_law_that_ended_in_a_fault_stays_visible_with_it(self):
        with tempfile.TemporaryDirectory() as folder:
            done = run("--trajectory", "fast_circle", "--on", "nominal", "--law", "paper", "--law", "tension", "--out",
                       folder)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            rows = (pathlib.Path(folder) / "fast_circle.csv").read_text().split("\n")
            self.assertEqual(len(rows[0].split(",")), 4 + 3 * 2)
            self.assertNotEqual(rows[1].split(",")[4], "")
            self.assertEqual(rows[-2].split(",")[4:7], ["", "", ""])
            drawn = (pathlib.Path(folder) / "compare.svg").read_text()
            self.assertIn("paper: FAULT at", drawn)
            self.assertIn("off its reference", drawn)
            for kind in ("png", "pdf"):
                self.assertGreater((pathlib.Path(folder) / f"compare.{kind}").stat().st_size, 10000)

    def test_the_plants_own_file_closes_all(self):
        rig = pathlib.Path(__file__).parents[2] / "config" / "robots" / "rig_60mm.yaml"
        with tempfile.TemporaryDirectory() as folder:
            heavy = pathlib.Path(folder) / "heavy.yaml"
            heavy.write_text(rig.read_text().replace("unit_mass_kg: 0.0025", "unit_mass_kg: 0.0045"))
            done = run("--robot", str(rig), "--robot", str(heavy), "--plant", str(heavy), "--trajectory", "circle",
                       "--no-plots", "--json", "--out", folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertAlmostEqual(json.loads(done.stdout)["trajectories"][0]["closed_fraction"][0], 1, 6)

    def test_a_robot_that_cannot_go_there_is_told(self):
        rig = pathlib.Path(__file__).parents[2] / "config" / "robots" / "rig_60mm.yaml"
        with tempfile.TemporaryDirectory() as folder:
            weak = pathlib.Path(folder) / "weak.yaml"
            weak.write_text(rig.read_text().replace("max_tension_base_N: 8.0", "max_tension_base_N: 4.0"))
            done = run("--robot", str(weak), "--plant", str(weak), "--trajectory", "circle", "--no-plots", "--out",
                       folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("limited or refused in 100 % of its cycles: command refused", done.stdout)

    def test_wrong_use_is_told(self):
        for args in (("--robot", "a.yaml"), ("--plant", "b.yaml"), ("--law", "best"), ("--on", "moon"),
                     ("--robot", "a.yaml", "--plant", "b.yaml", "--law", "paper"), ("--seed", "-1")):
            done = run(*args)
            self.assertEqual(done.returncode, 2, args)
            self.assertNotEqual(done.stderr, "")


if __name__ == "__main__":
    unittest.main()
