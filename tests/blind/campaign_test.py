"""A small sealed campaign from the draw to the score: six short sets of the foreign plant, what is planted drawn from the
system's randomness, each diagnosed by the program itself where it cannot read the answers. Prints the score's table.

A sixth of the library is drawn from and looked for. Six sets show that the way from draw to score works, not how often the
diagnosis is right: that is what campaigns of hundreds are for. Where one set in fifty is confidently wrong, one campaign in
two hundred has two such of six."""
import tests.blind.packages  # noqa: F401  (first)
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SETS, FAMILIES = 6, 2
EFFECTS = "torque_constant motor_coulomb capstan_alpha backlash bending_stiffness tip_payload cell_gain".split()
FREE = "presliding motor_presliding gear_presliding".split()  # what nobody knows, and is not drawn
ROOT = Path(__file__).resolve().parents[2]
TENDRIL = sys.argv.pop()


def campaign(*words, after=()):
    """The command on two workers; its error is the test's."""
    done = subprocess.run([sys.executable, "-B", "-m", "tests.blind.campaign", *map(str, words), "--jobs", "2", *after], cwd=ROOT,
                          capture_output=True, text=True)
    if done.returncode:
        raise AssertionError(done.stderr)


class SmallCampaign(unittest.TestCase):
    def test_answers_every_set_and_is_seldom_confidently_wrong(self):
        with tempfile.TemporaryDirectory() as scratch:
            Path(scratch).chmod(0o755)
            folder = Path(scratch) / "c"
            campaign("make", "--campaign", folder, "--sets", SETS, "--families", FAMILIES, "--effects", ",".join(EFFECTS),
                     "--mujoco", "0.05")
            campaign("diagnose", "--campaign", folder, "--sets", SETS, after=[
                "--", TENDRIL, "gap", "diagnose", "--robot", "{robot}", "--out", "{out}", "--no-next", "--threads", "1",
                "--refits", "3", "--only", ",".join(EFFECTS + FREE), "{set}"])
            scored = subprocess.run([sys.executable, "-B", "-m", "tests.blind.campaign", "score", str(folder), "--json",
                                     str(folder / "score.json")], cwd=ROOT, capture_output=True, text=True)
            print(scored.stdout)
            self.assertEqual(scored.returncode, 0, scored.stderr)
            numbers = json.loads((folder / "score.json").read_text())
        self.assertEqual(numbers["refused"], [])
        self.assertEqual(numbers["sets"], SETS)
        self.assertEqual(numbers["diagnosis failed to answer"]["k"], 0)
        self.assertLessEqual(numbers["false alarms on exact nulls"]["k"], 1)
        self.assertLessEqual(numbers["confidently wrong (p >= 0.9)"]["k"], 1)
        strong = numbers["top-1 cause at > 3 sigma, group-exact"]
        self.assertGreaterEqual(strong["k"], (strong["n"] - 1) / 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
