"""The seal: answers stay out of the diagnosis's reach, are written once, and count only when sealed before and unchanged.

The diagnosis is a stand-in that looks for answers and says "no gap"; the sets are nulls, so the score is known.
"""
import tests.blind.packages  # noqa: F401  (first)
import argparse
import contextlib
import io
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

from tests.blind import campaign

SPY = """
import json, pathlib, sys
found = []
for path in sys.argv[3:]:
    try:
        found += [str(p) for p in pathlib.Path(path).iterdir()]
    except OSError:
        pass
names = sorted(p.name for p in pathlib.Path(sys.argv[1]).iterdir())
report = dict(verdict="no_gap", sentence=" ".join(found), location=[], causes=[dict(effect="no_gap", where="", p=1.0)],
              degradations=names)
pathlib.Path(sys.argv[2], "report.json").write_text(json.dumps(report))
"""


def run(*words):
    out = io.StringIO()
    with mock.patch.object(sys, "argv", ["gap_blind", *map(str, words)]), contextlib.redirect_stdout(out):
        campaign.main()
    return out.getvalue()


class Seal(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.scratch.name) / "c"
        Path(cls.scratch.name).chmod(0o755)
        with mock.patch.object(campaign, "kinds_of", lambda n, rng: ["null"] * n):
            for shard in ("1/2", "2/2"):
                run("make", "--campaign", cls.folder, "--sets", 2, "--families", 2, "--shard", shard)
        cls.vault = Path(str(cls.folder) + ".vault")
        spy = [sys.executable if sys.executable.startswith("/usr") else "/usr/bin/python3", "-c", SPY, "{set}", "{out}",
               str(cls.vault), str(cls.folder)]
        cls.refusal = None
        try:
            run("diagnose", "--campaign", cls.folder, "--", *spy)
        except campaign.Wrong as refusal:  # a machine where nothing can be hidden: it must refuse, and did
            cls.refusal = refusal

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def setUp(self):
        if self.refusal:
            self.skipTest(str(self.refusal))

    def answer(self, name="0000"):
        return self.folder / "answers" / f"{name}.json"

    def test_answers_are_out_of_reach_and_data_say_nothing(self):
        report = json.loads(self.answer().read_text())["report"]
        self.assertNotIn(str(self.vault) + "/", report["sentence"])
        self.assertTrue({"robot.yaml", "runs.yaml"} < set(report["degradations"]))
        seal = json.loads((self.folder / "seals" / "0000.json").read_text())
        self.assertEqual(set(seal), {"id", "answer_sha256", "data_sha256", "sealed_ns"})

    def test_score_of_two_nulls(self):
        text = run("score", self.folder)
        self.assertIn("2 sealed sets, 0 refused", text)
        self.assertIn("| false alarms on exact nulls | 0 of 2 |", text)

    def test_the_record_scores_as_the_campaign_does(self):
        record = self.folder.parent / "c.jsonl"
        text = run("score", self.folder, "--record", record)
        self.assertEqual(len(record.read_text().splitlines()), 2)
        self.assertEqual(run("score", record), text)
        with self.assertRaisesRegex(campaign.Wrong, "set 0000 is in what was named before"):
            run("score", record, self.folder)
        with self.assertRaises(FileExistsError):
            run("score", self.folder, "--record", record)

    def test_damaged_and_missing_input_is_named(self):
        bad = self.folder.parent / "bad.jsonl"
        bad.write_text('{"refused": ["0001", "why"]}\n{"truth": 1}\n')
        with self.assertRaisesRegex(campaign.Wrong, "bad.jsonl:2: not a line of a record"):
            run("score", bad)
        for words in (["score", self.folder.parent / "nowhere"], ["diagnose", "--campaign", self.folder.parent, "--", "/bin/true"]):
            with self.assertRaisesRegex(campaign.Wrong, "sealed sets"):
                run(*words)
        text = run("score", self.folder, "--vault", self.folder.parent / "nowhere")
        self.assertIn("0 sealed sets, 2 refused", text)
        self.assertIn("does not hold its answer", text)
        for words in (["make", "--campaign", "x", "--sets", "0"], ["diagnose", "--campaign", "x", "--timeout", "nan"]):
            with self.assertRaises(SystemExit), contextlib.redirect_stderr(io.StringIO()) as said:
                run(*words)
            self.assertIn("and more", said.getvalue())

    def test_a_program_that_writes_no_report_fails_to_answer(self):
        for report in ("", "{}", "[1]", '{"verdict": "no_gap", "causes": [{}], "location": []}'):
            write = f"import sys; open(sys.argv[1] + '/report.json', 'w').write({report!r})"
            got, facts = campaign.diagnose_one(["/usr/bin/python3", "-c", write, "{out}"], self.folder / "sets" / "0000", [], 60)
            self.assertIsNone(got)
            self.assertIn("report.json", facts["error"])

    def test_score_draws_its_picture(self):
        picture = self.folder.parent / "score.png"
        record = campaign.ROOT / "tests" / "blind" / "records" / "c5.jsonl"
        done = subprocess.run(["/usr/bin/python3", "-B", "-m", "tests.blind.campaign", "score", record, "--picture", picture],
                              cwd=campaign.ROOT, capture_output=True, text=True)
        if "no Python package matplotlib" in done.stderr:
            self.skipTest(done.stderr)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(picture.read_bytes().startswith(b"\x89PNG"))

    def test_two_at_one_set_do_it_once(self):
        lock = self.folder / "seals" / ".0007.lock"
        with campaign.mine(lock) as first:
            self.assertTrue(first)
            text = io.StringIO()
            with contextlib.redirect_stdout(text), campaign.mine(lock) as second:
                self.assertFalse(second)
            self.assertIn("0007: another process", text.getvalue())
        with campaign.mine(lock) as again:
            self.assertTrue(again)
        self.assertFalse(lock.exists())

    def test_effects_that_there_are_not_are_refused(self):
        with self.assertRaisesRegex(campaign.Wrong, "no nothing; accepted: .*backlash"):
            run("make", "--campaign", self.folder.parent / "d", "--sets", 1, "--effects", "backlash,nothing")

    def test_written_once(self):
        before = self.answer().read_bytes()
        run("diagnose", "--campaign", self.folder, "--", "/bin/true")
        self.assertEqual(self.answer().read_bytes(), before)
        with self.assertRaises(FileExistsError):
            campaign.write_once(self.answer(), "{}")

    def tampered(self, change):
        seal = json.loads((self.folder / "seals" / "0001.json").read_text())
        text = (self.vault / "0001.json").read_text()
        record = json.loads(self.answer("0001").read_text())
        text = change(seal, record) or text
        return campaign.refused(seal, text, json.loads(text), record, self.folder / "sets" / "0001")

    def test_tampering_is_refused(self):
        self.assertIsNone(self.tampered(lambda seal, record: None))
        self.assertIn("older", self.tampered(lambda seal, record: record.update(started_ns=seal["sealed_ns"] - 1)))
        self.assertIn("data", self.tampered(lambda seal, record: record.update(data_sha256="0")))
        self.assertIn("sealed one", self.tampered(lambda seal, record: '{"truth": []}'))

    def test_wilson(self):
        # 8 of 10: the textbook's 0.490 to 0.943
        p, low, high = campaign.wilson(8, 10)
        self.assertAlmostEqual(low, 0.4902, places=3)
        self.assertAlmostEqual(high, 0.9433, places=3)


if __name__ == "__main__":
    sys.argv = sys.argv[:1]
    unittest.main()
