#!/usr/bin/python3 -B
"""tools/fault_campaign, shared among workers, beside the program's own table: fault_campaign_test.py PROGRAM.
A made-up program shows what becomes of broken rules and of a program that fails."""
import pathlib
import stat
import subprocess
import sys
import tempfile
import unittest

CAMPAIGN = pathlib.Path(__file__).resolve().parents[2] / "tools" / "fault_campaign"

# Breaks a rule at seed 40, and ends at seed 100 as it should not.
FAKE = r'''#!/usr/bin/python3 -B
import sys
option = lambda name: int(sys.argv[sys.argv.index(name) + 1])
first, count = option("--first"), option("--scenarios")
seeds = range(first, first + count)
if 100 in seeds:
    sys.exit("fault_campaign: out of memory")
if 40 in seeds:
    print("seed 40: drive dies\n  tension above its limit")
print("%-22s%7s%8s%7s%7s%9s%9s%9s%10s%7s  %s" % ("fault", "runs", "went on", "held", "faults", "slowest", "motor N", "base N", "recovered", "broken", "faults by number"))
for name in ("drive dies", "all"):
    print("%-22s%7d%8d%7d%7d%9d%9.2f%9.2f%10d%7d  %s" % (name, count, 1, 0, count - 1, max(seeds), 9.5, 7, count, 40 in seeds, f"406x{count - 1} "))
sys.exit(1 if 40 in seeds else 0)
'''


class FaultCampaign(unittest.TestCase):
    def campaign(self, program, *words):
        return subprocess.run([CAMPAIGN, "--program", program, "--jobs", "2", *words], capture_output=True, text=True, timeout=200)

    def test_shared_it_makes_the_table_of_the_program_alone(self):
        alone = subprocess.run([PROGRAM, "--scenarios", "35", "--first", "8", "--jobs", "1"], capture_output=True, text=True)
        shared = self.campaign(PROGRAM, "--scenarios", "35", "--first", "8", "--size", "31")
        self.assertEqual((shared.returncode, shared.stdout), (alone.returncode, alone.stdout), shared.stderr)
        self.assertEqual(len(alone.stdout.splitlines()), 1 + 31 + 1)

    def test_broken_rules_and_scenarios_that_were_not_played_are_told(self):
        with tempfile.TemporaryDirectory() as folder:
            program = pathlib.Path(folder) / "fault_campaign"
            program.write_text(FAKE)
            program.chmod(program.stat().st_mode | stat.S_IXUSR)
            done = self.campaign(program, "--scenarios", "62", "--size", "31")
            self.assertEqual(done.returncode, 1)
            self.assertIn("seed 40: drive dies\n  tension above its limit", done.stdout)
            self.assertEqual(done.stdout.splitlines()[-2].split(), "all 62 2 0 60 62 9.50 7.00 62 1 406x60".split())
            self.assertIn("again: ", done.stdout)
            done = self.campaign(program, "--first", "50", "--scenarios", "62", "--size", "31")
            self.assertEqual(done.returncode, 1)
            self.assertIn("seeds 81 to 111: fault_campaign: out of memory", done.stderr)
            self.assertEqual(done.stdout.splitlines()[-1].split()[:2], ["all", "31"])  # the others count

    def test_wrong_use_is_told(self):
        for words, says in ((("--size", "30"), "from 31"), (("--scenarios", "0"), "from 1 to"), (("--config", "gone"), "no such folder"),
                            (("--program", "gone"), "--program FILE")):
            done = self.campaign(PROGRAM, *words)
            self.assertEqual(done.returncode, 2)
            self.assertIn(says, done.stderr)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop()
    unittest.main()
