"""The same torques give the same tensions, angles and tip in Tendril's plant and in the foreign one, open loop and within
the noise floor of the sensors; MuJoCo's motors are held to somewhat more (its chain has joints).

Usage: agreement_test PLANT_ROWS_PROGRAM. The golden is the other implementation: neither has seen the other's code.
"""
import tests.blind.packages  # noqa: F401  (first)
import sys
import unittest

import numpy as np
import yaml

from tests.blind import agreement, lagrange_plant as lp, make, programs, sensors

PROGRAM = None


def compare(robot_name, family, seconds, simulate):
    file = make.ROOT / "config" / "robots" / f"{robot_name}.yaml"
    robot = yaml.safe_load(file.read_text())
    targets = programs.program(family, programs.Controller(robot), np.random.default_rng(3))[:int(seconds * 1000)]
    theirs = agreement.tendril(PROGRAM, file, targets)
    ours = sensors.ideal(simulate(lp.nominal(robot), targets), targets, {})
    return make.difference(ours, theirs)


class Agreement(unittest.TestCase):
    def check(self, got, limits):
        for channel, limit in limits.items():
            self.assertLess(got[channel], limit, f"{channel}: rms difference over the sensor's noise; all: {got}")

    # One encoder count is 1.3 um of tendon: the motor angle is where open-loop dry friction shows first.
    def test_slow_reversals(self):
        got = compare("rig_90mm", "triangle", 5.0, lambda p, t: lp.simulate(p, t, sub=20))
        self.check(got, dict(tension=0.3, motor=1.5, tip=0.2, turn=0.4, actual=0.1))

    def test_fast_motion_of_the_short_robot(self):
        got = compare("rig_60mm", "multisine", 4.0, lambda p, t: lp.simulate(p, t, sub=20))
        self.check(got, dict(tension=0.3, motor=1.5, tip=0.2, turn=0.4, actual=0.1))

    def test_mujoco(self):
        try:
            import mujoco  # noqa: F401
        except ImportError:
            self.skipTest("mujoco is not installed")
        from tests.blind import mujoco_plant
        for family in ("triangle", "sway"):
            got = compare("rig_90mm", family, 2.5, mujoco_plant.simulate)
            self.check(got, dict(tension=0.3, motor=3.0, tip=0.2, turn=0.4, actual=0.1))


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main()
