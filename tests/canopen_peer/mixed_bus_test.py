"""A drive of another maker beside an EPOS4, both played by Python's canopen, under our master on a real vcan0.

The servo is a canopen.LocalNode made from its maker's EDS file, the one that the master reads its profile from. Usage:
mixed_bus_test.py MASTER_PROGRAM EPOS4_EDS SERVO_EDS. Ends with 77, which ctest shows as skipped, where canopen or vcan0
is missing.
"""

import sys
import unittest

import slaves_test
from slaves_test import ENABLED, FAULT, Bench, Slave

SERVO_EDS = None
RATED = 7.056 / 7  # the robot's rated torque over the servo's, which is in whole mN·m


class Servo(Slave):
    """A CiA 402 servo, set up for its motor, whose rotor turns as far each cycle as its torque says."""

    def prepare(self):
        for index, subindex in ((0x6041, 0), (0x6061, 0), (0x6064, 0), (0x6077, 0), (0x6401, 1)):
            self.set(index, subindex, 0)
        self.set(0x1018, 4, 4711)
        self.position = 0

    def follow(self, index, subindex, value):
        pass

    def act(self, received):
        super().act(received)
        if self.state == ENABLED:
            self.position += self.get(0x6071)
            self.set(0x6064, 0, self.position)


class MixedBus(Bench):
    def make_slave(self, node_id, refuse):
        if node_id == 1:
            return Slave(self.network, node_id, refuse)
        return Servo(self.network, node_id, refuse, SERVO_EDS)

    def feedback(self):
        """Of the servo: position, torque, load cell."""
        self.take_lines()
        before = sum(line.startswith("feedback ") for line in self.seen)
        self.tell("feedback 1")
        lines = []

        def came():
            lines[:] = [line for line in self.seen if line.startswith("feedback ")]
            return len(lines) > before

        self.wait_for(came, "feedback")
        return [int(word) for word in lines[-1].split()[1:]]

    def arm(self):
        self.tell("disable")
        self.tell("clear")
        self.wait_for_all("ready")
        self.tell("enable")
        self.wait_for_all("enabled")

    def test_arming_motion_fault_and_recovery(self):
        self.start(master=[SERVO_EDS])
        servo = self.slaves[1]
        self.wait_for_all("ready")
        with self.subTest("what was set up"):
            self.assertEqual(servo.broken_rules, [])
            makers = [w for w in servo.writes if 0x2000 <= w[0] < 0x6000]
            self.assertEqual(makers, [], "no object of another maker")
            self.assertEqual(servo.get(0x6060), 10)
            self.assertEqual(servo.get(0x1016, 1), 127 << 16 | 1000, "it watches the master")
            self.assertEqual(servo.get(0x6072), 2000, "twice its rated torque")
            self.assertEqual([servo.get(0x1A00, i) for i in (1, 2, 3)], [0x60640020, 0x60770010, 0x64010110])
            for unused in (0x1401, 0x1402, 0x1403, 0x1802, 0x1803):
                self.assertTrue(servo.get(unused, 1) & 0x80000000, f"{unused:04X}")
            self.assertNotEqual(servo.state, ENABLED, "nothing is enabled untold")

        with self.subTest("arming and motion"):
            servo.set(0x6401, 1, 602)
            self.tell("torque 150")
            self.tell("enable")
            self.wait_for_all("enabled")
            self.wait_for(lambda: len(servo.torques) > 50, "torques")
            self.assertEqual(servo.torques[-1], round(300 * RATED))
            self.assertEqual(self.slaves[0].torques[-1], 150)
            first, second = self.feedback(), self.feedback()
            self.assertGreater(second[0], 0)
            self.assertGreaterEqual(second[0], first[0])
            self.assertEqual(second[1:], [300, 1505])

        with self.subTest("fault"):
            servo.fail(0x7120, 0x01)
            self.wait_for(lambda: self.states[2] == "fault", "fault")
            self.wait_for(lambda: self.events(2, 402), "an event")
            self.assertTrue(any("EMCY 0x7120" in e and "motor error" in e for e in self.events(2, 402)))
            self.assertEqual(self.states[1], "enabled", "what the other does is the controller's choice")
            self.assertEqual(servo.state, FAULT, "no reset untold")
            self.arm()

        with self.subTest("lost and back"):
            servo.die()
            self.wait_for(lambda: self.states[2] == "offline", "lost")
            servo.revive()
            self.arm()
            count = len(servo.torques)
            self.wait_for(lambda: len(servo.torques) > count + 20, "torques again")
            self.tell("disable")
            self.wait_for_all("ready")
            self.assertNotEqual(servo.state, ENABLED)


if __name__ == "__main__":
    slaves_test.MASTER, slaves_test.EDS, SERVO_EDS = sys.argv[1:4]
    del sys.argv[1:4]
    unittest.main(verbosity=2, warnings="ignore")  # the library leaves the EDS file open
