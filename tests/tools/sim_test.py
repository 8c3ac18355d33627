#!/usr/bin/env python3
"""`tendril sim` as its operator has it: armed, moved, disturbed, logged and stopped by the same programs as a robot. Run by
own_network.sh."""
import contextlib
import json
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
RIG = ROOT / "config/robots/rig_60mm.yaml"
TENDRIL = sys.argv[1]


def tendril(*arguments, succeeds=True):
    """What a command prints."""
    done = subprocess.run([TENDRIL, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False)
    if succeeds and done.returncode:
        raise AssertionError(f"tendril {arguments}: {done.stderr or done.stdout}")
    return done.stdout + done.stderr


def state():
    return json.loads(tendril("status", "--json").splitlines()[0])


def until(what, holds, within_s=30):
    end = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > end:
            raise AssertionError(f"{what}: not within {within_s} s; {state()}")
        time.sleep(0.2)


class Sim(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    @contextlib.contextmanager
    def running(self, *options, ended_by=signal.SIGTERM):
        """A simulation, stopped at the end, and the file with what it printed."""
        said = self.folder / "sim.txt"
        with open(said, "w", encoding="utf-8") as out:
            sim = subprocess.Popen([TENDRIL, "sim", *map(str, options)], stdout=out, stderr=subprocess.STDOUT)
            try:
                until("configured", lambda: sim.poll() is not None or '"mode":"configured"' in
                      tendril("status", "--json", succeeds=False).replace(" ", ""))
                yield said
                sim.send_signal(ended_by)
                self.assertEqual(sim.wait(timeout=30), 0, said.read_text())
            finally:
                sim.kill()
                sim.wait()

    def refused(self, *options):
        done = subprocess.run([TENDRIL, "sim", "--duration", "1", *map(str, options)], capture_output=True, text=True,
                              timeout=30, check=False)
        self.assertIn(done.returncode, (1, 2), done.stdout)
        return done.stderr

    def test_it_is_armed_follows_and_its_log_replays_to_the_last_bit(self):
        log = self.folder / "run.lcmlog"
        with self.running("--log", log, "--headless") as said:
            tendril("send", "arm")
            self.assertEqual(state()["mode"], "running")
            tendril("send", "tip", "0.015", "0", "0.0575")
            until("the tip arrives", lambda: abs(1e3 * state()["tip_estimate_W_m"][0] - 15) < 2)
            followed = tendril("follow", "planar", "--robot", RIG)
            error = re.search(r"error of the estimated tip against the motion: rms ([\d.]+) mm", followed)
            self.assertLess(float(error[1]), 4, followed)
        self.assertNotIn("info", said.read_text())
        self.assertIn("no bit differs", tendril("replay", log))
        self.assertRegex(said.read_text(), r"tendril sim: [\d.]+ s simulated")

    def test_what_is_planted_is_in_the_log(self):
        log = self.folder / "run.lcmlog"
        with self.running("--log", log, "--headless", "--effect", "tip_payload mass_kg=0.004", ended_by=signal.SIGHUP):
            tendril("send", "arm")
            tendril("follow", "planar", "--robot", RIG)
            tendril("send", "disarm")
            until("disarmed", lambda: state()["mode"] == "configured")
        out = self.folder / "report"
        tendril("gap", "diagnose", "--robot", RIG, log, "--out", out, "--no-next")
        report = json.loads((out / "report.json").read_text())
        self.assertIn(report["verdict"], ("attributed", "ambiguous_group"), report["sentence"])
        group = report["causes"][0]["group"]
        self.assertIn("tip_payload", [c["effect"] for c in report["causes"] if c["group"] == group], report["sentence"])

    def test_a_fault_on_demand_and_what_follows(self):
        with self.running() as said:
            tendril("send", "arm")
            tendril("fault", "emcy", "node=2", "code=0x7320")
            until("a fault", lambda: state()["mode"] == "fault")
            tendril("send", "clear")
            until("cleared", lambda: state()["mode"] == "configured")
            tendril("send", "arm")  # armed when it is stopped
        self.assertIn("safe stop -> configured", said.read_text())
        self.assertNotIn("no heartbeat", said.read_text())

    def test_with_commissioning_it_needs_the_record_beside_its_robot(self):
        robot = self.folder / "rig.yaml"
        robot.write_text(RIG.read_text())
        with self.running("--robot", robot, "--commissioning"):
            self.assertIn(f"{robot}.commissioned is not there", tendril("send", "arm", succeeds=False))
            self.assertEqual(state()["mode"], "configured")

    def test_its_drives_are_wired_as_the_daemons_file_says(self):
        text = (ROOT / "config/tendrild.yaml").read_text()
        nodes = ("{node_id: 1, tendon: 1}", "{node_id: 2, tendon: 2}", "{node_id: 3, tendon: 3}")
        wired = ("{node_id: 3, tendon: 1, motor: reversed}", "{node_id: 2, tendon: 2, encoder: reversed}",
                 "{node_id: 1, tendon: 3}")
        for before, after in zip(nodes, wired):
            self.assertIn(before, text)
            text = text.replace(before, after)
        daemon = self.folder / "tendrild.yaml"
        daemon.write_text(text.replace("robot: robots/", f"robot: {ROOT}/config/robots/"))
        with self.running("--daemon", daemon, "--headless"):
            tendril("send", "arm")
            tendril("send", "tip", "0.015", "0", "0.0575")
            until("the tip arrives", lambda: abs(1e3 * state()["tip_estimate_W_m"][0] - 15) < 2)
            self.assertEqual(state()["mode"], "running")

    def test_faster_than_time(self):
        start_s = time.monotonic()
        said = tendril("sim", "--speed", "4", "--duration", "12")
        took_s = time.monotonic() - start_s
        ended = re.search(r"tendril sim: ([\d.]+) s simulated, ([\d.]+) s behind", said)
        self.assertGreaterEqual(float(ended[1]), 12, said)
        # Without what this machine was too slow for: a quarter of the time, after the start.
        own_s = took_s - float(ended[2])
        self.assertGreater(own_s, 12 / 4 - 0.2, said)
        self.assertLess(own_s, 12, said)

    def test_two_on_the_same_channels(self):
        with self.running():
            self.assertIn("another daemon", self.refused())
            self.assertIn("s simulated", tendril("sim", "--duration", "1", "--prefix", "OTHER"))

    def test_wrong_use(self):
        self.assertIn("--effect: there is no effect 'no_such'; did you mean", self.refused("--effect", "no_such"))
        self.assertIn("3 tendons, the plant's 4", self.refused("--plant", ROOT / "config/robots/four_tendon_90mm.yaml"))
        self.assertIn("has no 'actuation' section", self.refused("--robot", ROOT / "config/robots/qi2021_60mm.yaml"))
        self.assertIn("0.01", self.refused("--speed", "0"))
        self.assertIn("no_such.yaml", self.refused("--daemon", "no_such.yaml"))
        self.assertIn("no/where/run.lcmlog", self.refused("--log", "no/where/run.lcmlog"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[2:])
