#!/usr/bin/python3 -B
"""tools/gap_fleet with a made-up program in tendril's place: which logs it takes with which robot file, what it tells of them, and
what it does not do again. Knows the forms of the program's answers, not how they come about."""
import json
import os
import pathlib
import stat
import subprocess
import tempfile
import unittest

from cluster import cluster

FLEET = pathlib.Path(__file__).resolve().parents[2] / "tools" / "gap_fleet"

# Finds what the robot file says that it has; refuses a log with the word "broken" in it.
FAKE = r'''#!/usr/bin/python3 -B
import json, pathlib, sys
option = lambda name: sys.argv[sys.argv.index(name) + 1]
log, out = pathlib.Path(sys.argv[sys.argv.index("--out") - 1]), pathlib.Path(option("--out"))
with open(pathlib.Path(sys.argv[0]).parent / "calls", "a") as calls:
    calls.write(" ".join([log.name, *sys.argv[3:sys.argv.index("--threads")]]) + "\n")
text = (log / "run.csv" if log.is_dir() else log).read_text()
if "broken" in text:
    sys.exit("tendril: reading\ntendril: run.csv:3: not a number")
effect = open(option("--robot")).read().strip()
cause = dict(effect=effect, where="tendon:2", p=0.97)
report = dict(verdict="attributed", sentence="", causes=[cause], accepted=[cause], closed=dict(pooled=dict(value=0.93)))
if not effect:
    report = dict(verdict="no_gap", sentence="", causes=[dict(effect="no_gap", where="", p=0.7)], accepted=[], closed=None)
out.mkdir(parents=True, exist_ok=True)
(out / "report.json").write_text(json.dumps(report))
'''


class GapFleet(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scheduler = cls.enterClassContext(cluster())

    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.tendril = self.folder / "tendril"
        self.tendril.write_text(FAKE)
        self.tendril.chmod(self.tendril.stat().st_mode | stat.S_IXUSR)
        self.logs, self.robots, self.out = (self.folder / name for name in ("logs", "robots", "out"))
        self.robots.mkdir()
        for name, robot in (("arm1", "backlash"), ("arm2", ""), ("arm3", "slack")):
            (self.logs / name).mkdir(parents=True)
            (self.logs / name / "run.csv").write_text("1\n")
            (self.logs / name / "robot.yaml").write_text(robot)
            (self.robots / f"{name}.yaml").write_text(robot)

    def fleet(self, *words, where=None):
        return subprocess.run([FLEET, "--tendril", self.tendril, "--out", self.out, *(where or ("--scheduler", self.scheduler)), *words],
                              capture_output=True, text=True, timeout=100)

    def calls(self):
        path = self.folder / "calls"
        lines = sorted(path.read_text().splitlines()) if path.exists() else []
        path.unlink(missing_ok=True)
        return lines

    def summary(self):
        return json.loads((self.out / "summary.json").read_text())

    def test_each_log_has_a_line_and_is_not_done_again(self):
        (self.logs / "arm4.log").write_text("broken")
        (self.robots / "arm4.yaml").write_text("creep")
        done = self.fleet("--each", self.logs, "--robot", self.robots, where=("--jobs", "2"))
        self.assertEqual(done.returncode, 1, done.stderr)
        lines = {line.split()[0]: " ".join(line.split()[1:]) for line in done.stdout.splitlines()}
        self.assertEqual(lines["arm1"], "attributed backlash tendon:2 0.97; closes 93 %")
        self.assertEqual(lines["arm2"], "no_gap no_gap 0.70")
        self.assertEqual(lines["arm4"], "not diagnosed: tendril: run.csv:3: not a number")
        summary = self.summary()
        self.assertEqual(summary["counts"], {"attributed": 2, "no_gap": 1, "not_diagnosed": 1})
        self.assertEqual([r["name"] for r in summary["results"]], ["arm1", "arm2", "arm3", "arm4"])
        self.assertEqual(len(self.calls()), 4)
        # Again: only what failed, and what changed.
        (self.logs / "arm4.log").write_text("mended")
        (self.logs / "arm2" / "run.csv").write_text("1\n2\n")
        (self.robots / "arm3.yaml").write_text("presliding")
        done = self.fleet("--each", self.logs, "--robot", self.robots)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.calls(), ["arm2", "arm3", "arm4.log"])
        self.assertEqual(self.summary()["counts"], {"attributed": 3, "no_gap": 1})
        self.assertEqual(self.fleet("--each", self.logs, "--robot", self.robots).returncode, 0)
        self.assertEqual(self.calls(), [])
        # Other options are another diagnosis.
        self.assertEqual(self.fleet(self.logs / "arm1", "--robot", self.robots, "--", "--refits", "3").returncode, 0)
        self.assertEqual(self.calls(), ["arm1 --refits 3"])

    def test_robot_files_are_the_data_sets_own_or_one_for_all(self):
        self.assertEqual(self.fleet(self.logs / "arm3", self.logs / "arm1").returncode, 0)
        named = lambda: [r["causes"][0]["effect"] for r in self.summary()["results"]]
        self.assertEqual(named(), ["backlash", "slack"])
        self.assertEqual(self.fleet("--each", self.logs, "--robot", self.robots / "arm1.yaml").returncode, 0)
        self.assertEqual(named(), ["backlash"] * 3)

    def test_wrong_use_is_told(self):
        (self.logs / "arm1.csv").write_text("")
        (self.folder / "empty").mkdir()
        for words, says in (((), "no log: name some"), (("gone",), "gone: no such log"), (("--each", "gone"), "gone: no such folder"),
                            (("--each", self.folder / "empty"), "no log in it"),
                            (("--each", self.logs), "both would be kept as arm1"),
                            ((self.logs / "arm1.csv",), "no robot file"),
                            ((self.logs / "arm1", "--robot", self.folder / "empty"), "no robot file"),
                            ((self.logs / "arm1", "--timeout", "nan"), "expected seconds"),
                            ((self.logs / "arm1", "--", "--out", "x"), "give it before"),
                            ((self.logs / "arm1", "--out", self.tendril), "is a file")):
            done = self.fleet(*words)
            self.assertEqual(done.returncode, 2, words)
            self.assertIn(says, done.stderr)
            self.assertNotIn("Traceback", done.stderr)
            self.assertFalse(os.path.exists(self.out))


if __name__ == "__main__":
    unittest.main()
