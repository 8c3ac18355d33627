"""tendril gap explain and tendril gap report as a user runs them: complete, readable by programs, clear about misuse.

usage: gap_report_test.py TENDRIL REPORT_EXAMPLE
REPORT_EXAMPLE FOLDER writes a report of an invented diagnosis. Knows nothing of how diagnoses are made."""
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

TENDRIL, EXAMPLE = sys.argv[1:3]


def run(*arguments):
    return subprocess.run([TENDRIL, "gap", *arguments], capture_output=True, text=True, timeout=60)


class Explain(unittest.TestCase):
    def test_every_effect_is_complete(self):
        effects = json.loads(run("explain", "--json").stdout)
        self.assertGreater(len(effects), 40)
        names = {e["effect"] for e in effects}
        self.assertEqual(len(names), len(effects))
        table = run("explain").stdout
        for e in effects:
            with self.subTest(e["effect"]):
                self.assertRegex(table, rf"(?m)^  {e['effect']} +C[0-6]  {re.escape(e['summary'])}$")
                self.assertRegex(e["cut"], r"^C[0-6]$")
                for key in ("summary", "physics", "signature", "experiment"):
                    self.assertGreater(len(e[key]), 20, key)
                self.assertTrue(e["parameters"])
                for p in e["parameters"]:
                    self.assertLessEqual(p["lower"], p["nominal"])
                    self.assertLessEqual(p["nominal"], p["upper"])
                self.assertLessEqual(set(e["confusable"]) - {e["effect"]}, names, "looks like an effect that is none")
                self.assertNotIn(e["effect"], e["confusable"])

    def test_one_effect_in_words_fits_the_terminal_and_can_be_tried(self):
        effects = json.loads(run("explain", "--json").stdout)
        for e in effects[:: max(1, len(effects) // 8)]:
            with self.subTest(e["effect"]):
                text = run("explain", e["effect"]).stdout
                self.assertTrue(text.startswith(f"{e['effect']}: {e['summary']}"))
                for title in ("What happens", "How it looks in the data", "What shows it", "Try it"):
                    self.assertIn(f"\n{title}\n", text)
                for p in e["parameters"]:
                    self.assertRegex(text, rf"(?m)^  {p['name']} ")
                self.assertLessEqual(max(len(line) for line in text.splitlines()[1:]), 100)
                self.assertEqual(json.loads(run("explain", e["effect"], "--json").stdout), e)

    def test_a_misspelt_effect_is_named_with_the_nearest(self):
        done = run("explain", "back-lahs")
        self.assertEqual(done.returncode, 2)
        self.assertIn("no effect 'back-lahs'; did you mean backlash?", done.stderr)
        self.assertEqual(run("explain", "tendon-stiffness").returncode, 0)


class Report(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = pathlib.Path(self.folder.name)
        subprocess.run([EXAMPLE, self.path / "first"], check=True, timeout=60)

    def test_page_and_numbers_come_back_bit_for_bit(self):
        done = run("report", self.path / "first/report.json", "--out", self.path / "second")
        self.assertEqual(done.returncode, 0, done.stderr)
        for name in ("report.json", "report.html"):
            self.assertEqual((self.path / "first" / name).read_bytes(), (self.path / "second" / name).read_bytes())
        self.assertIn("Report: " + str(self.path / "second/report.html"), done.stdout)
        self.assertNotIn("\x1b", done.stdout)

    def test_bad_files_get_one_line(self):
        text = (self.path / "first/report.json").read_text()
        (self.path / "broken.json").write_text(text[: len(text) // 2])
        (self.path / "other.json").write_text('{"a": 1}')
        for name, word in (("broken.json", "is not JSON"), ("other.json", "'format' is missing"), ("none.json", "cannot read")):
            done = run("report", self.path / name, "--out", self.path / "second")
            self.assertEqual(done.returncode, 1)
            self.assertIn(word, done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1)
            self.assertFalse((self.path / "second").exists(), "a folder was made for nothing")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
