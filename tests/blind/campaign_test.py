"""A small sealed campaign from the draw to the score: short sets of the foreign plant, what is planted drawn from the system's
randomness, each diagnosed by the program itself where it cannot read the answers. Prints the score's table.

A sixth of the library is drawn from and looked for. Six sets in which all is as it should be are enough; six more are made
where anything is not, and all twelve judged. Twelve say little of any share; where one set in twenty-five is confidently wrong,
one campaign in a hundred has three such."""
import tests.blind.packages  # noqa: F401  (first)
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SETS, FAMILIES = 12, 2
EFFECTS = "torque_constant motor_coulomb capstan_alpha backlash bending_stiffness tip_payload cell_gain".split()
FREE = "presliding motor_presliding gear_presliding".split()  # what nobody knows, and is not drawn
ROOT = Path(__file__).resolve().parents[2]
TENDRIL = sys.argv.pop()


def gap_blind(*words):
    done = subprocess.run([sys.executable, "-B", "-m", "tests.blind.campaign", *map(str, words)], cwd=ROOT, capture_output=True,
                          text=True)
    if done.returncode:
        raise AssertionError(done.stderr)
    return done.stdout


def answered(folder, shard):
    """A half of the sets, made and diagnosed in a folder of its own."""
    part = ["--campaign", folder, "--sets", SETS, "--shard", shard]
    gap_blind("make", *part, "--families", FAMILIES, "--effects", ",".join(EFFECTS), "--mujoco", "0.05")
    gap_blind("diagnose", *part, "--", TENDRIL, "gap", "diagnose", "--robot", "{robot}", "--out", "{out}", "--no-next",
              "--threads", "1", "--refits", "3", "--only", ",".join(EFFECTS + FREE), "{set}")
    return folder


class SmallCampaign(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)
        self.folder.chmod(0o755)

    def scored(self, *campaigns):
        """False alarms, the confidently wrong and the strong ones found, of sets that were all answered."""
        out = self.folder / "score.json"
        print(gap_blind("score", *campaigns, "--json", out))
        numbers = json.loads(out.read_text())
        self.assertEqual(numbers["refused"], [])
        self.assertEqual(numbers["sets"], SETS * len(campaigns) // 2)
        self.assertEqual(numbers["diagnosis failed to answer"]["k"], 0)
        return (numbers["false alarms on exact nulls"]["k"], numbers["confidently wrong (p >= 0.9)"]["k"],
                numbers["top-1 cause at > 3 sigma, group-exact"])

    def test_answers_every_set_and_is_seldom_confidently_wrong(self):
        half = answered(self.folder / "a", "1/2")
        alarms, wrong, strong = self.scored(half)
        if alarms or wrong or strong["k"] < (strong["n"] - 1) / 2:
            alarms, wrong, strong = self.scored(half, answered(self.folder / "b", "2/2"))
        self.assertLessEqual(alarms, 1)
        self.assertLessEqual(wrong, 2)
        self.assertGreaterEqual(strong["k"], (strong["n"] - 1) / 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
