"""Each planted effect at zero is the nominal rig bit for bit, and at its typical amount is seen; sizes asked for in sigma
are met; and a data set tells nothing of its truth."""
import tests.blind.packages  # noqa: F401  (first)
import json
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import yaml

from tests.blind import effects, make, programs

ROBOT = yaml.safe_load((make.ROOT / "config" / "robots" / "rig_90mm.yaml").read_text())


def short(family, seconds):
    return programs.program(family, programs.Controller(ROBOT), np.random.default_rng(8))[:int(seconds * 1000)]


class Effects(unittest.TestCase):
    def test_zero_is_nominal_and_typical_is_seen(self):
        targets = {f: short(f, s) for f, s in (("triangle", 3.0), ("ladder", 2.4), ("steps", 2.4))}
        reference = {f: make.outputs(ROBOT, make.planted(ROBOT, [], 1)[0], {}, t, "motor_side", 5)
                     for f, t in targets.items()}
        for name, e in effects.LIST.items():
            if name in ("free_chain", "contact"):  # the first is MuJoCo's; the second needs a wide bend its way
                continue
            where = "all" if e.on_all else f"{e.scope}:1"
            family = next((f for f in e.families if f in targets), "triangle")
            with self.subTest(name):
                for amount, seen in ((0.0, False), (e.typical, True)):
                    p, faults, truth = make.planted(ROBOT, [(name, where, amount)], 1)
                    got = make.outputs(ROBOT, p, faults, targets[family], "motor_side", 5)
                    d = max(make.difference(got, reference[family]).values())
                    self.assertTrue(np.isfinite(d))
                    if seen:
                        self.assertGreater(d, 1.0)
                    else:
                        self.assertLess(d, 1e-6)

    def test_sigma_is_met(self):
        amount, size, _ = make.amount_for(ROBOT, "tip_payload", "all", 3.0, 1, 1)
        self.assertGreater(amount, 0)
        self.assertAlmostEqual(np.log(size / 3.0), 0, delta=0.06)

    def test_a_delay_of_a_part_of_a_step_is_one(self):
        targets = short("multisine", 1.0)
        changes = []
        for s in (0.0, 2.5e-5, 5e-5, 1e-4):  # a step is 0.2 ms
            p, faults, _ = make.planted(ROBOT, [("command_delay", "all", s)], 1)
            changes.append(make.outputs(ROBOT, p, faults, targets, "motor_side", 5)["actual"])
        moved = [np.sqrt(np.mean((c - changes[0]) ** 2)) for c in changes[1:]]
        self.assertGreater(moved[0], 0)
        np.testing.assert_allclose(np.divide(moved, moved[0]), [1, 2, 4], rtol=0.05)

    def test_a_stiffer_tendon_is_no_tauter_at_pretension(self):
        for amount in (-0.5, 1.0):
            p, faults, _ = make.planted(ROBOT, [("tendon_stiffness", "all", amount)], 1)
            got = make.outputs(ROBOT, p, faults, short("hold", 0.3), "motor_side", 5)
            self.assertLess(np.abs(got["tension"][-1] - 0.3).max(), 1e-3)

    def test_micro_constants_of_a_nuisance_null_change_little(self):
        short_robot = yaml.safe_load((make.ROOT / "config" / "robots" / "rig_60mm.yaml").read_text())
        for robot in (ROBOT, short_robot):
            nuisance, size = make.small_nuisance(robot, 2, "motor_side")
            self.assertTrue(0 < nuisance <= 0.2)
            self.assertLessEqual(size, 0.1)
            self.assertAlmostEqual(size, make.nuisance_size(robot, 2, "motor_side", nuisance))

    def test_a_set_does_not_tell(self):
        with tempfile.TemporaryDirectory() as folder:
            out, truth = Path(folder) / "set", Path(folder) / "truth.json"
            make.make_set(out, truth, "rig_90mm", [("backlash", "tendon:2", 0.2)], 5, ["weak"])
            names = sorted(p.name for p in out.iterdir())
            self.assertEqual(names, ["robot.yaml", "runs.yaml", "weak_1.csv", "weak_1_again1.csv"])
            self.assertNotIn("backlash", "".join(p.read_text() for p in out.iterdir() if p.name != "robot.yaml"))
            self.assertEqual((out / "robot.yaml").read_text(),
                             (make.ROOT / "config" / "robots" / "rig_90mm.yaml").read_text())
            self.assertEqual(json.loads(truth.read_text())["truth"][0]["parameters"], {"rad": 0.2})


if __name__ == "__main__":
    sys.argv = sys.argv[:1]
    unittest.main()
