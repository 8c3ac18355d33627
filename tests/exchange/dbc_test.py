"""The bus as `tendril config dbc` describes it, in cantools: every frame that master and emulated drives send is
decoded, to the values that were put in.

Usage: dbc_test TENDRIL BUS_FRAMES SOURCE.
"""

import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

try:
    import cantools
    import yaml
except ImportError as error:
    print(f"skipped: {error}; install tests/requirements.txt and tests/blind/requirements.txt into the Python that the tests use")
    sys.exit(77)

TENDRIL, FRAMES, SOURCE = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])


def dbc(daemon):
    return subprocess.run([TENDRIL, "config", "dbc", str(daemon)], capture_output=True, text=True, check=True).stdout


class Dbc(unittest.TestCase):
    def check(self, daemon, robot):
        """All frames decode; the PDOs of the last cycle have the values of the robot file's units."""
        database = cantools.database.load_string(dbc(daemon), "dbc")
        lines = subprocess.run([FRAMES, str(daemon)], capture_output=True, text=True, check=True).stdout.splitlines()
        nodes = {n["node_id"]: n for n in yaml.safe_load(daemon.read_text())["bus"]["nodes"]}
        parts = robot["actuation"]
        last, names, checked = {}, set(), 0
        for line in lines:
            kind, *words = line.split()
            if kind != "drive":
                frame = bytes.fromhex(words[0]) if words else b""
                message = database.get_message_by_frame_id(int(kind))  # KeyError: a frame that the file does not know
                self.assertEqual(message.length, len(frame), message.name)
                last[message.name] = message.decode(frame)
                self.assertEqual(message.encode(last[message.name]), frame, message.name)
                names.add(message.name)
                continue
            node, target, counts, torque, analog_mV = map(int, words)
            turned = -1 if nodes[node].get("motor") == "reversed" else 1
            encoder = -1 if nodes[node].get("encoder") == "reversed" else 1
            rated_Nm = parts["drive"]["rated_torque_Nm"]
            feedback, sent = last[f"drive{node}_Feedback"], last[f"drive{node}_Torque"]
            self.assertAlmostEqual(sent["TargetTorque"], turned * target / 1000 * rated_Nm, places=12)
            self.assertAlmostEqual(feedback["ActualTorque"], turned * torque / 1000 * rated_Nm, places=12)
            self.assertAlmostEqual(
                feedback["Position"],
                encoder * counts * 2 * math.pi / parts["drive"]["encoder_counts_per_turn"],
                places=8,
            )
            tension = analog_mV / 1000 / parts["load_cell"]["gain_VpN"] - parts["load_cell"].get("offset_N", 0)
            self.assertAlmostEqual(feedback["Tension"], tension, places=8)
            self.assertEqual(last[f"drive{node}_Status"]["Statusword"] & 0x6F, 0x27, "operation enabled")
            self.assertEqual(last[f"drive{node}_Heartbeat"]["NmtState"], "operational")
            checked += 1
        self.assertEqual(checked, len(nodes))
        self.assertEqual(last[f"drive{min(nodes)}_Emergency"]["ErrorCode"], "over-current")
        self.assertLessEqual({"Nmt", "Sync", "tendrild_Heartbeat", f"drive{max(nodes)}_SdoRequest"}, names)
        self.assertEqual(
            database.get_message_by_name("Sync").cycle_time,
            yaml.safe_load(daemon.read_text())["bus"]["cycle_ns"] // 1_000_000,
        )

    def robot(self, name):
        return yaml.safe_load((SOURCE / "config" / "robots" / name).read_text())

    def test_shipped_buses(self):
        self.check(SOURCE / "config" / "tendrild.yaml", self.robot("rig_60mm.yaml"))
        self.check(SOURCE / "config" / "tendrild_two_section.yaml", self.robot("two_section.yaml"))

    def test_turned_motor_other_maker_and_offset(self):
        text = (SOURCE / "config" / "tendrild.yaml").read_text()
        text = (
            text.replace("robot: robots/rig_60mm.yaml", "robot: robot.yaml")
            .replace("{node_id: 1, tendon: 1}", "{node_id: 1, tendon: 1, motor: reversed, encoder: reversed}")
            .replace(
                "{node_id: 2, tendon: 2}",
                "{node_id: 2, tendon: 2, profile: cia402, eds: servo.eds, analog_input: 0x6401:01, "
                "analog_mV_per_count: 2.5}",
            )
        )
        robot = (SOURCE / "config" / "robots" / "rig_60mm.yaml").read_text()
        robot = robot.replace("gain_VpN: 0.2", "gain_VpN: 0.25\n    offset_N: 0.1")
        with tempfile.TemporaryDirectory() as folder:
            daemon = pathlib.Path(folder) / "daemon.yaml"
            daemon.write_text(text)
            daemon.with_name("robot.yaml").write_text(robot)
            daemon.with_name("servo.eds").write_text((SOURCE / "config" / "drives" / "cia402_servo.eds").read_text())
            self.assertIn("offset_N", robot)
            self.check(daemon, yaml.safe_load(robot))

    def test_shipped_file_is_what_the_command_writes(self):
        self.assertEqual(
            (SOURCE / "config" / "tendrild.dbc").read_text(),
            dbc(SOURCE / "config" / "tendrild.yaml"),
            "write it anew: tendril config dbc config/tendrild.yaml > config/tendrild.dbc",
        )

    def test_wrong_use(self):
        for file in (SOURCE / "config" / "robots" / "rig_60mm.yaml", "/nowhere.yaml"):
            done = subprocess.run([TENDRIL, "config", "dbc", str(file)], capture_output=True, text=True)
            self.assertEqual((done.returncode, done.stdout, done.stderr.count("\n")), (1, "", 1), done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
