"""The seal: answers stay out of the diagnosis's reach, are written once, and count only when sealed before and unchanged.

The diagnosis is a stand-in that looks for answers and says "no gap"; the sets are nulls, so the score is known.
"""
import tests.blind.packages  # noqa: F401  (first)
import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

import psutil

from tests.blind import campaign, draw, figures, score, seal
from tests.tools.cluster import cluster
from tools import workers

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


TRUE = ["/bin/true", "{set}", "{out}"]


def ran(*words):
    """(exit code, what was printed); on workers that all tests of this file share."""
    out = io.StringIO()
    if words[0] in ("make", "diagnose"):
        words = words[0], "--scheduler", Seal.scheduler, *words[1:]
    with mock.patch.object(sys, "argv", ["gap_blind", *map(str, words)]), contextlib.redirect_stdout(out):
        code = campaign.main()
    return code, out.getvalue()


def run(*words):
    return ran(*words)[1]


class Seal(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scheduler = cls.enterClassContext(cluster())
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.scratch.name) / "c"
        Path(cls.scratch.name).chmod(0o755)
        with mock.patch.object(campaign, "kinds_of", lambda n, rng: ["null"] * n):
            run("make", "--campaign", cls.folder, "--sets", 2, "--families", 2, "--mujoco", 0)
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
        sealed = json.loads((self.folder / "seals" / "0000.json").read_text())
        self.assertEqual(set(sealed), {"id", "answer_sha256", "data_sha256", "sealed_ns"})

    def test_score_of_two_nulls(self):
        text = run("score", self.folder)
        self.assertIn("2 sealed sets, 0 refused", text)
        self.assertIn("| false alarms on exact nulls | 0 of 2 |", text)

    def test_the_record_scores_as_the_campaign_does(self):
        record = self.folder.parent / "c.jsonl"
        text = run("score", self.folder, "--record", record)
        self.assertEqual(len(record.read_text().splitlines()), 4)
        self.assertEqual(run("score", record), text.replace(f"{self.folder}:", f"{record}:"))
        with self.assertRaisesRegex(campaign.Wrong, "set 0000 is in it or in what was named before"):
            run("score", record, self.folder)
        with self.assertRaisesRegex(campaign.Wrong, "is there already"):
            run("score", self.folder, "--record", record)
        # The seals go with it: what is changed in it is refused.
        head, *texts = record.read_text().splitlines()
        lost = self.folder.parent / "lost.jsonl"
        for kept in (texts[:1], texts[::-1], [texts[0], texts[1].replace('"no_gap"', '"unexplained"', 1)]):
            lost.write_text("\n".join([head, *kept]) + "\n")
            with self.assertRaisesRegex(campaign.Wrong, "its first line is of other lines"):
                run("score", lost)
        lost.write_text("\n".join(texts[:1]) + "\n")  # without the first line nothing shows it, which is said
        self.assertIn("without the first line that tells how many follow", run("score", lost))
        lines = [json.loads(line) for line in texts]
        forged = lines[1]["opened"].replace('"null"', '"null" ')
        for change, why in ((dict(opened=forged), "not the sealed one"),
                            (dict(opened=forged, seal=dict(lines[1]["seal"], answer_sha256=seal.sha(forged.encode()))), "diagnosed under"),
                            (dict(record=dict(lines[1]["record"], started_ns=0)), "older than the seal")):
            changed = self.folder.parent / "changed.jsonl"
            changed.write_text(json.dumps(lines[0]) + "\n" + json.dumps({**lines[1], **change}) + "\n")
            text = run("score", changed)
            self.assertIn("1 sealed sets, 1 refused", text)
            self.assertIn(why, text)
        for report in (dict(verdict="banana"), dict(causes=[dict(effect="no_gap", where="", p=7)]), dict(location=None)):
            bad = json.loads(json.dumps(lines[1]))
            bad["record"]["report"].update(report)
            changed.write_text(json.dumps(bad) + "\n")
            with self.assertRaisesRegex(campaign.Wrong, "changed.jsonl:1: not a line of a record"):
                run("score", changed)

    def test_a_set_of_a_record_is_made_again_to_the_last_bit(self):
        record, out = self.folder.parent / "to_make.jsonl", self.folder.parent / "again"
        run("score", self.folder, "--record", record)
        self.assertIn("0001: nothing planted; the same data", run("again", record, "--set", "0001", "--out", out))
        self.assertEqual(seal.digest(out / "0001"), seal.digest(self.folder / "sets" / "0001"))
        for name, why in (("0001", "there is a 0001 in it already"), ("0007", "--set 0007: these records hold 2 sets, 0000 to 0001")):
            with self.assertRaisesRegex(campaign.Wrong, why):
                run("again", record, "--set", name, "--out", out)
        with self.assertRaisesRegex(campaign.Wrong, "--set 0001: two of these records hold another set"):
            run("again", record, campaign.ROOT / "tests/blind/records/c13.jsonl", "--set", "0001", "--out", out)
        with self.assertRaisesRegex(campaign.Wrong, "hold no seeds"):
            run("again", campaign.ROOT / "tests/blind/records/c2.jsonl", "--set", "0001", "--out", out)

    def test_damaged_and_missing_input_is_named(self):
        bad = self.folder.parent / "bad.jsonl"
        bad.write_text('{"refused": ["0001", "why"]}\n{"truth": 1}\n')
        with self.assertRaisesRegex(campaign.Wrong, "bad.jsonl:2: not a line of a record"):
            run("score", bad)
        with self.assertRaisesRegex(campaign.Wrong, "--effects cell_gain: too few for sets of kind parameter"):
            run("make", "--campaign", self.folder.parent / "d", "--sets", 1, "--effects", "cell_gain")
        self.assertFalse((self.folder.parent / "d").exists())
        for words in (["score", self.folder.parent / "nowhere"], ["diagnose", "--campaign", self.folder.parent, "--", *TRUE]):
            with self.assertRaisesRegex(campaign.Wrong, "sealed sets"):
                run(*words)
        elsewhere = self.folder.parent / "elsewhere"
        elsewhere.mkdir()
        for vault, why in (("nowhere", "no such folder; make put the answers into"), ("elsewhere", "answers are in .*c.vault")):
            for words in (["score", self.folder], ["diagnose", "--campaign", self.folder]):
                with self.assertRaisesRegex(campaign.Wrong, why):
                    run(*words, "--vault", self.folder.parent / vault)
        for words in (["make", "--campaign", "x", "--sets", "0"], ["diagnose", "--campaign", "x", "--timeout", "nan"]):
            with self.assertRaises(SystemExit), contextlib.redirect_stderr(io.StringIO()) as said:
                run(*words)
            self.assertIn("and more", said.getvalue())

    def test_a_program_that_writes_no_report_fails_to_answer(self):
        for report in ("", "{}", "[1]", '{"verdict": "no_gap", "causes": [{}], "location": []}', "[" * 100000):
            write = f"import sys; open(sys.argv[1] + '/report.json', 'w').write({report!r})"
            got, facts = seal.diagnose_one(["/usr/bin/python3", "-c", write, "{out}"], self.folder / "sets" / "0000", [], 60)
            self.assertIsNone(got)
            self.assertIn("report.json", facts["error"])

    def test_a_command_that_hangs_is_ended_with_all_it_started(self):
        data = self.folder / "sets" / "0000"
        mark = Path(self.scratch.name) / "mark"
        for words, why in (("sleep 60 & echo $! > $1; wait", "more than 1 s"), ('mkfifo "$0/report.json"', "no plain file"),
                           ('ln -s /etc/hostname "$0/report.json"; rm -f stderr; mkfifo stderr', "no plain file")):
            got, facts = seal.diagnose_one(["/bin/sh", "-c", words, "{out}", str(mark)], data, [], 1)
            self.assertIsNone(got)
            self.assertIn(why, facts["error"])
        with self.assertRaises(ProcessLookupError):
            for _ in range(50):  # it is gone once its parent's parent has seen it
                os.kill(int(mark.read_text()), 0)
                time.sleep(0.1)
                if "State:\tZ" in Path(f"/proc/{int(mark.read_text())}/status").read_text():
                    raise ProcessLookupError

    def test_what_the_machine_stops_is_not_answered(self):
        with self.assertRaisesRegex(seal.NotRun, "stopped from outside .SIGKILL"):
            seal.diagnose_one(["/bin/sh", "-c", "kill -9 $$"], self.folder / "sets" / "0000", [], 60)
        got, facts = seal.diagnose_one(["/bin/sh", "-c", "kill -SEGV $$"], self.folder / "sets" / "0000", [], 60)
        self.assertEqual((got, facts["exit_code"]), (None, -11))  # its own fault

    @contextlib.contextmanager
    def copied(self):
        with tempfile.TemporaryDirectory() as scratch:
            folder, vault = Path(scratch) / "c", Path(scratch) / "v"
            shutil.copytree(self.folder, folder)
            shutil.copytree(self.vault, vault)
            (folder / "vault").unlink()
            (folder / "vault").write_text(f"{vault}\n")
            yield folder, vault

    def test_answers_given_twice_rewritten_or_without_a_seal_do_not_count(self):
        for change, why in (
                (lambda folder, vault, answer: answer.write_text(answer.read_text().replace("no_gap", "unexplained", 1)), "not the answer that was given"),
                (lambda folder, vault, answer: run("diagnose", "--campaign", folder, "--", *TRUE) if answer.unlink() is None else 0, "answered 2 times"),
                (lambda folder, vault, answer: (folder / "seals" / "0000.json").unlink(), "its seal is gone")):
            with self.copied() as (folder, vault):
                answer = folder / "answers" / "0000.json"
                mode = answer.stat().st_mode
                answer.chmod(0o644)
                change(folder, vault, answer)
                if answer.exists():
                    answer.chmod(mode)
                text = run("score", folder)
                self.assertIn("1 sealed sets, 1 refused", text)
                self.assertIn(f"0000: {why}", text)
        with self.copied() as (folder, vault):
            ledger = vault / seal.LEDGER
            ledger.write_text(ledger.read_text().splitlines(True)[-1])
            with self.assertRaisesRegex(campaign.Wrong, "answers.ledger:1: the line of .* does not follow .*put the ledger back"):
                run("score", folder)
            ledger.write_text('{"name": "0000", ')
            with self.assertRaisesRegex(campaign.Wrong, "answers.ledger:1: not a line of a ledger.*put the ledger back"):
                run("score", folder)
            ledger.unlink()
            self.assertIn("nobody knows whether a set was answered twice", run("score", folder))

    def rewrite(self, path, text):
        path.unlink()
        seal.write_once(path, text)

    def test_a_truth_that_was_replaced_with_its_seal_does_not_count(self):
        for also_answer in (False, True):
            with self.copied() as (folder, vault):
                text = (vault / "0000.json").read_text().replace('"null"', '"null" ')
                self.rewrite(vault / "0000.json", text)
                forged = dict(json.loads((folder / "seals" / "0000.json").read_text()), answer_sha256=seal.sha(text.encode()))
                self.rewrite(folder / "seals" / "0000.json", json.dumps(forged) + "\n")
                if also_answer:
                    answer = folder / "answers" / "0000.json"
                    self.rewrite(answer, json.dumps(dict(json.loads(answer.read_text()), seal_sha256=seal.seal_sha(forged))) + "\n")
                text = run("score", folder)
                self.assertIn("1 sealed sets, 1 refused", text)
                self.assertIn("0000: not the answer that was given" if also_answer else
                              "0000: its seal is not the one it was diagnosed under", text)
        # A seal that was replaced after an attempt, before the answer.
        with self.copied() as (folder, vault):
            seal.enter(vault / seal.LEDGER, folder / seal.HEAD, "0001", begun_ns=1, seal_sha256="another")
            self.assertIn("0001: its seal is not the one it was diagnosed under", run("score", folder))

    def of_earlier_times(self, folder, vault):
        """The campaign as it was diagnosed up to c15: no begun lines, no hash of a seal, no head."""
        (vault / seal.LEDGER).unlink()
        for path in sorted((folder / "answers").iterdir()):
            answer = json.loads(path.read_text())
            answer.pop("seal_sha256")
            self.rewrite(path, json.dumps(answer) + "\n")
            (folder / seal.HEAD).unlink(missing_ok=True)
            seal.enter(vault / seal.LEDGER, folder / seal.HEAD, path.stem, sha256=seal.sha(path.read_bytes()))
        (folder / seal.HEAD).unlink()

    def test_answers_of_earlier_campaigns_count_and_are_said_not_to_be_bound(self):
        with self.copied() as (folder, vault):
            self.of_earlier_times(folder, vault)
            text = run("score", folder, "--record", folder / "r.jsonl")
            self.assertIn("2 sealed sets, 0 refused", text)
            self.assertIn("2 answers not bound to their seals", text)
            self.assertIn("2 answers not bound to their seals", run("score", folder / "r.jsonl"))
        self.assertNotIn("not bound", run("score", self.folder))

    def test_lines_taken_off_the_end_of_the_ledger_show(self):
        with self.copied() as (folder, vault):
            ledger, lines = vault / seal.LEDGER, (vault / seal.LEDGER).read_text().splitlines(True)
            kinds = [(json.loads(line)["name"], "answered" if "sha256" in json.loads(line) else "begun") for line in lines[:4]]
            self.assertEqual([name for name, kind in kinds if kind == "begun"], ["0000", "0001"])  # in order
            for name in ("0000", "0001"):
                self.assertEqual([kind for of, kind in kinds if of == name], ["begun", "answered"])
            self.assertTrue(all("opened_ns" in json.loads(line) for line in lines[4:]))  # by the tests before this one
            name = json.loads(lines[3])["name"]
            (folder / "answers" / f"{name}.json").unlink()
            for kept in (3, 2, 0):
                ledger.write_text("".join(lines[:kept]))
                for words in (["score", folder], ["diagnose", "--campaign", folder, "--", *TRUE]):
                    with self.assertRaisesRegex(campaign.Wrong, f"{kept} lines, not the {len(lines)} that .*ledger.head knows of; put it back"):
                        run(*words)
            ledger.write_text("".join(lines))
            (folder / seal.HEAD).unlink()
            with self.assertRaisesRegex(campaign.Wrong, "ledger.head is gone"):
                run("diagnose", "--campaign", folder, "--", *TRUE)
        with self.copied() as (folder, vault):  # one line more than the head knows of: stopped between the two
            before = (folder / seal.HEAD).read_text()
            seal.enter(vault / seal.LEDGER, folder / seal.HEAD, "0001", begun_ns=1)
            (folder / seal.HEAD).write_text(before)
            self.assertIn("2 sealed sets, 0 refused", run("score", folder))

    def test_a_ledger_that_is_being_written_to_is_not_taken_for_a_cut_one(self):
        with self.copied() as (folder, vault):
            write = ("import sys; from pathlib import Path; from tests.blind import seal\n"
                     "for k in range(300): seal.enter(Path(sys.argv[1]), Path(sys.argv[2]), str(k), begun_ns=k, seal_sha256='')")
            ledger, head = vault / seal.LEDGER, folder / seal.HEAD
            with subprocess.Popen([sys.executable, "-B", "-c", write, ledger, head], cwd=campaign.ROOT) as writer:
                while writer.poll() is None:
                    seal.entered(ledger, head)
            self.assertEqual((writer.returncode, len(seal.entered(ledger, head))), (0, 304))

    def test_a_ledger_that_is_gone_is_said_by_the_record_too(self):
        with self.copied() as (folder, vault):
            (vault / seal.LEDGER).unlink()
            with self.assertRaisesRegex(campaign.Wrong, "answers.ledger is gone"):
                run("diagnose", "--campaign", folder, "--", *TRUE)
            for text in (run("score", folder, "--record", folder / "r.jsonl"), run("score", folder / "r.jsonl")):
                self.assertIn("its ledger of answers is gone, so that nobody knows whether a set was answered twice", text)
            self.assertNotIn(str(folder), (folder / "r.jsonl").read_text())

    def test_what_was_begun_and_not_answered_is_written_down(self):
        with self.copied() as (folder, vault):
            (folder / "answers" / "0000.json").unlink()
            ledger = vault / seal.LEDGER
            ledger.unlink()
            (folder / seal.HEAD).unlink()
            killed = ["/bin/sh", "-c", "kill -9 $$", "{set}", "{out}"]
            for times in ("begun", "begun 2 times"):
                self.assertEqual(ran("diagnose", "--campaign", folder, "--", *killed)[0], 1)
                self.assertIn(f"0000: {times}, not answered", run("score", folder))
            self.assertIn("stopped from outside (SIGKILL)", json.loads(ledger.read_text().splitlines()[1])["not_answered"])
            run("diagnose", "--campaign", folder, "--", *TRUE)
            text = run("score", folder)
            self.assertIn("begun more than once, as what was stopped may be: 0000 (3 times)", text)
            self.assertIn("1 answered after seals had been opened: 0000", text)

    def test_a_command_that_is_wrong_spends_no_set(self):
        with self.copied() as (folder, vault):
            (folder / "answers" / "0000.json").unlink()
            (folder / "answers" / "0001.json").unlink()
            lines = (vault / seal.LEDGER).read_text().splitlines()
            for words, missing in ((["/bin/true", "{set}"], "{out}"), (["/bin/true", "--out={out}"], "{set}")):
                with self.assertRaisesRegex(campaign.Wrong, f"does not say {missing}"):
                    run("diagnose", "--campaign", folder, "--", *words)
            self.assertEqual((vault / seal.LEDGER).read_text().splitlines(), lines)
            for code in (2, 126, 127):
                with self.assertRaisesRegex(campaign.Wrong, f"set 0000: .* exit code {code}: no such flag; nothing was answered"):
                    run("diagnose", "--campaign", folder, "--sets", 1, "--", "/bin/sh", "-c",
                        f"echo beginning >&2; echo no such flag >&2; exit {code}", "{set}", "{out}")
            self.assertEqual(list((folder / "answers").iterdir()), [])
            lines = [json.loads(line) for line in (vault / seal.LEDGER).read_text().splitlines()[len(lines):]]
            self.assertEqual([line.get("not_answered") for line in lines],
                             [None, "exit code 2: no such flag", None, "exit code 126: no such flag", None, "exit code 127: no such flag"])
            text = run("score", folder)
            self.assertIn("0000: begun 4 times, not answered; 0001: begun, not answered", text)

    def test_a_folder_that_is_no_vault_is_left_alone(self):
        with tempfile.TemporaryDirectory() as scratch:
            base = Path(scratch)
            base.chmod(0o755)
            for name in ("full", "empty"):
                (base / name).mkdir(mode=0o755)
            (base / "full" / "letter").write_text("dear")
            for vault, why in ((base, "contains the campaign"), (base / "full", "is not empty"),
                               (base / "new" / "v", "outside the campaign"), (base / "full" / "letter", "is no folder"),
                               (self.vault, "not empty, and not this campaign's")):
                with self.assertRaisesRegex(campaign.Wrong, why):
                    run("make", "--campaign", base / "new", "--sets", 1, "--vault", vault)
            self.assertEqual({p.name for p in base.iterdir()}, {"full", "empty"})
            self.assertEqual([p.stat().st_mode & 0o777 for p in (base, base / "full")], [0o755] * 2)

    def test_failures_of_before_and_data_that_are_gone_are_said(self):
        with self.copied() as (folder, vault):
            code, text = ran("diagnose", "--campaign", folder, "--", *TRUE)
            self.assertEqual(code, 0)
            self.assertIn("nothing to diagnose: every sealed set is answered", text)
            shutil.rmtree(folder / "sets" / "0000")
            self.assertIn("the data of 1 are gone, and were not compared with the seals: 0000", run("score", folder))
            (folder / "answers" / "0000.json").unlink()
            code, text = ran("diagnose", "--campaign", folder, "--", *TRUE)
            self.assertEqual(code, 3)
            self.assertIn("the data of 1 are gone: 0000; put them back", text)
            (folder / "answers" / "0001.json").unlink()
            for wanted in (1, 3):
                code, text = ran("diagnose", "--campaign", folder, "--", *TRUE)
                self.assertEqual(code, wanted)
            self.assertIn("1 failed to answer before: 0001;", text)

    def test_two_vaults_in_one_are_told_apart(self):
        both = "score CAMPAIGN1 CAMPAIGN2"
        with self.copied() as (folder, vault):
            other = vault.parent / "other.ledger"
            seal.enter(other, vault.parent / "other.head", "0002", begun_ns=1)
            (vault / seal.LEDGER).write_text(other.read_text())
            with self.assertRaisesRegex(campaign.Wrong, both):
                run("score", folder)
        with self.copied() as (folder, vault):  # where no head tells
            self.of_earlier_times(folder, vault)
            (vault / seal.LEDGER).unlink()
            seal.enter(vault / seal.LEDGER, vault.parent / "other.head", "0002", sha256="0")
            text = run("score", folder)
            self.assertIn("0000: not in the ledger of answers", text)
            self.assertIn(both, text)
        with self.copied() as (folder, vault):
            shutil.copy(vault / "0000.json", vault / "0002.json")
            self.assertIn(both, run("score", folder))

    def test_a_picture_that_cannot_be_drawn_is_told_first(self):
        record, numbers = self.folder.parent / "unseen.jsonl", self.folder.parent / "unseen.json"
        with mock.patch.dict(sys.modules, {"matplotlib": None, "matplotlib.figure": None}), self.assertRaises(ModuleNotFoundError):
            run("score", self.folder, "--picture", self.folder.parent / "x.png", "--record", record, "--json", numbers)
        self.assertFalse(record.exists() or numbers.exists())

    def test_what_is_made_is_not_made_again(self):
        before = seal.digest(self.folder / "sets" / "0000")
        self.assertIn("nothing to make: all 2 sets are sealed", run("make", "--campaign", self.folder, "--sets", 2))
        how = dict(folder=str(self.folder), vault=str(self.vault), effects=None, families=2, mujoco=0)  # its worker died after sealing
        self.assertEqual(draw.make_one(how, "0000", "null"), json.loads((self.folder / "seals" / "0000.json").read_text())["answer_sha256"])
        self.assertEqual(seal.digest(self.folder / "sets" / "0000"), before)

    def test_who_stops_reading_has_the_record_all_the_same(self):
        record = self.folder.parent / "head.jsonl"
        reading, writing = os.pipe()
        os.close(reading)
        done = subprocess.run([sys.executable, "-B", "-m", "tests.blind.campaign", "score", self.folder, "--record", record],
                              cwd=campaign.ROOT, stdout=writing, stderr=subprocess.PIPE, text=True)
        os.close(writing)
        self.assertEqual((done.returncode, done.stderr), (141, ""))
        self.assertIn("2 sealed sets, 0 refused", run("score", record))

    def test_files_that_are_garbage_are_named_with_what_to_do(self):
        with self.copied() as (folder, vault):
            self.rewrite(folder / "seals" / "0000.json", "garbage")
            (folder / "answers" / "0000.json").unlink()
            code, text = ran("diagnose", "--campaign", folder, "--", *TRUE)
            self.assertEqual(code, 1)
            for text in (text, run("score", folder)):
                self.assertRegex(text, "seals/0000.json is no seal that make wrote .*put it back")
        with self.copied() as (folder, vault):
            self.rewrite(vault / "0000.json", "garbage")
            self.assertRegex(run("score", folder), "0000.json in the vault, or its data: .*; put them back")
        with self.copied() as (folder, vault):
            for garbage in ("[]", "{}", '{"lines": "x", "sha256": ""}', "[" * 100000):
                (folder / seal.HEAD).write_text(garbage)
                with self.assertRaisesRegex(campaign.Wrong, "ledger.head says no longer .*put it back"):
                    run("score", folder)
            for garbage in ("[1]", '{"name": [], "before": ""}', '{"name": "0000", "before": "", "seal_sha256": []}', "[" * 100000):
                (vault / seal.LEDGER).write_text(garbage + "\n")
                with self.assertRaisesRegex(campaign.Wrong, "answers.ledger:1: not a line of a ledger .*put the ledger back"):
                    run("score", folder)
            self.rewrite(vault / "1_of_1_of_2.kinds", '["nul')
            with self.assertRaisesRegex(campaign.Wrong, "1_of_1_of_2.kinds: not the kinds .*put it back"):
                run("make", "--campaign", folder, "--vault", vault, "--sets", 2)
        bad = self.folder.parent / "bad_head.jsonl"
        for head in ('{"lines": 1, "parts": []}', '{"lines": 1, "sha256": "", "parts": [[1]]}', '{"lines": 1, "sha256": "", "parts": 1}'):
            bad.write_text(head + '\n{"refused": ["0001", "why"]}\n')
            with self.assertRaisesRegex(campaign.Wrong, "bad_head.jsonl:1: not a line of a record.*take the record as score"):
                run("score", bad)

    def test_help_tells_units_and_exit_codes(self):
        for what, says in (("make", "Exit codes: 0 every set"), ("diagnose", "3 none did so now"), ("diagnose", "(default: 3600)"),
                           ("again", "1 not to the last bit"), ("score", "141")):
            with mock.patch.object(sys, "argv", ["gap_blind", what, "--help"]), contextlib.redirect_stdout(io.StringIO()) as said, \
                    self.assertRaises(SystemExit):
                campaign.main()
            self.assertIn(says, " ".join(said.getvalue().split()))

    def test_a_set_that_is_taken_out_whole_is_missed(self):
        for also in ((), ("1_of_1_of_2.kinds",), (seal.LEDGER,)):  # either tells that it was there
            with self.copied() as (folder, vault):
                for path in (folder / "seals" / "0000.json", folder / "answers" / "0000.json", vault / "0000.json"):
                    path.unlink()
                shutil.rmtree(folder / "sets" / "0000")
                for name in also:
                    (vault / name).unlink()
                text = run("score", folder)
                self.assertIn("1 sealed sets, 1 refused", text)
                self.assertRegex(text, "Refused: 0000: (its seal is gone|drawn, not made)")

    def test_damaged_numbers_are_refused_and_told(self):
        for path, change in (("seals/0000.json", lambda x: x.update(sealed_ns="x")), ("answers/0000.json", lambda x: x.update(vault={})),
                             ("answers/0000.json", lambda x: x["report"]["causes"][0].update(p=10 ** 400))):
            with self.copied() as (folder, vault):
                x = json.loads((folder / path).read_text())
                change(x)
                (folder / path).unlink()
                (folder / path).write_text(json.dumps(x))
                self.assertIn("1 sealed sets, 1 refused", run("score", folder))
        with self.assertRaisesRegex(ValueError, "closed"):
            score.check_closed(dict(pooled=dict(value="all")))

    def test_another_number_of_sets_is_refused(self):
        with self.assertRaisesRegex(campaign.Wrong, "begun with 2 sets; .* or --sets 2"):
            run("make", "--campaign", self.folder, "--sets", 4)

    def test_campaigns_that_were_made_in_parts_still_count(self):
        with self.copied() as (folder, vault):
            (vault / "1_of_1_of_2.kinds").rename(vault / "1_of_2_of_3.kinds")  # sets 0000 and 0002; 0001 is of the other part
            text = run("score", folder)
            self.assertIn("Parts of 3 sets: 1 of 2", text)
            self.assertIn("0002: drawn, not made", text)
            with self.assertRaisesRegex(campaign.Wrong, "begun with 3 sets in 2 parts"):
                run("make", "--campaign", folder, "--vault", vault, "--sets", 3)

    @contextlib.contextmanager
    def six_sets(self):
        """A sealed campaign of the same robot without a gap, six times, of which none is answered."""
        with tempfile.TemporaryDirectory() as scratch:
            Path(scratch).chmod(0o755)
            folder, vault = Path(scratch) / "c", Path(scratch) / "c.vault"
            for made in (folder / "seals", vault):
                made.mkdir(parents=True)
            vault.chmod(0o700)
            for name in (f"{k:04d}" for k in range(6)):
                shutil.copytree(self.folder / "sets" / "0000", folder / "sets" / name)
                text = (self.vault / "0000.json").read_text().replace('"id": "0000"', f'"id": "{name}"')
                seal.write_once(vault / f"{name}.json", text)
                sealed = json.loads((self.folder / "seals" / "0000.json").read_text())
                sealed = dict(sealed, id=name, answer_sha256=seal.sha(text.encode()), sealed_ns=seal.now())
                seal.write_once(folder / "seals" / f"{name}.json", json.dumps(sealed) + "\n")
            yield folder, vault

    def test_one_of_two_workers_is_killed_and_each_set_is_answered_once(self):
        report = json.dumps(dict(verdict="no_gap", location=[], causes=[dict(effect="no_gap", where="", p=0.7)]))
        command = ["/bin/sh", "-c", f"sleep 0.83; echo '{report}' > $0/report.json", "{out}", "{set}"]
        with self.six_sets() as (folder, vault):
            ledger = vault / seal.LEDGER
            planner = subprocess.Popen([sys.executable, "-B", "-m", "tests.blind.campaign", "diagnose", "--campaign", folder, "--jobs", "2",
                                        "--", *command], cwd=campaign.ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            victim = None
            while victim is None and planner.poll() is None:  # a worker that is at its second set or a later one
                time.sleep(0.02)
                if ledger.exists() and ledger.read_text().count('"begun_ns"') >= 4:
                    victim = next((p.parent() for p in psutil.Process(planner.pid).children(recursive=True)
                                   if self.is_command(p)), None)
            self.assertIsNotNone(victim, "no worker was seen at work")
            victim.kill()
            said = planner.communicate(timeout=120)[0]
            self.assertEqual(planner.returncode, 0, said)
            lines = [json.loads(line) for line in ledger.read_text().splitlines()]
            names = [f"{k:04d}" for k in range(6)]
            self.assertEqual(sorted(line["name"] for line in lines if "sha256" in line), names)  # each answered, and once
            dead = [line["name"] for line in lines if line.get("not_answered") == "its worker died"]
            self.assertEqual(len(dead), 1)
            begun = [line["name"] for line in lines if "begun_ns" in line]
            again = len(begun) - 1 - begun[::-1].index(dead[0])
            self.assertEqual(begun[:again] + begun[again + 1:], names)  # as planned, and that one once more
            self.assertEqual([p.name for p in (folder / "answers").iterdir() if p.name.startswith(".")], [])
            text = run("score", folder)
            self.assertIn("6 sealed sets, 0 refused", text)
            self.assertIn(f"begun more than once, as what was stopped may be: {dead[0]} (2 times)", text)
            for name in names:
                sealed, answer = (json.loads((folder / where / f"{name}.json").read_text()) for where in ("seals", "answers"))
                self.assertLess(sealed["sealed_ns"], answer["started_ns"])

    @staticmethod
    def is_command(process):
        with contextlib.suppress(psutil.Error):
            return process.name() == "sh" and any("sleep 0.83" in word for word in process.cmdline())

    def test_a_beginning_that_the_ledger_does_not_know_of_is_refused(self):
        """As where a cluster's scheduler does a task again by itself."""
        claim = self.folder.parent / "claim"
        words = (self.folder / "sets" / "0000", TRUE, seal.sha(Path(TRUE[0]).read_bytes()), self.vault, self.folder, claim, 60)
        self.assertIsNone(seal.run_sealed(*words)[0])
        with self.assertRaises(workers.WorkerDied):
            seal.run_sealed(*words)

    def test_what_is_terminated_ends_what_it_runs_and_answers_nothing(self):
        with self.copied() as (folder, vault):
            (folder / "answers" / "0000.json").unlink()
            program = subprocess.Popen([sys.executable, "-B", "-m", "tests.blind.campaign", "diagnose", "--campaign", folder, "--jobs", "1",
                                        "--", "/bin/sh", "-c", "exec /bin/sleep 61.7", "{set}", "{out}"], cwd=campaign.ROOT,
                                       stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            def working():
                found = []
                for line in Path("/proc").glob("[0-9]*/cmdline"):
                    with contextlib.suppress(OSError):
                        found += [line] * (line.read_bytes() == b"/bin/sleep\x0061.7\0")
                return found

            while not working():
                self.assertIsNone(program.poll(), "it ended by itself")
                time.sleep(0.1)
            program.terminate()
            self.assertIn("stopped; what is done stays", program.communicate()[0])
            self.assertEqual((program.returncode, working()), (130, []))
            self.assertFalse((folder / "answers" / "0000.json").exists())

    def test_an_oracle_that_fails_is_tried_again(self):
        case, data = self.case("single", ["slack"], "no_gap", [("no_gap", 0.7)]), self.folder / "sets" / "0000"
        for _ in range(2):
            with contextlib.redirect_stderr(io.StringIO()) as said:
                self.assertIsNone(score.told("/bin/false", case, data))
            self.assertIn("oracle, 0001", said.getvalue())

    def test_changed_data_and_reports_that_say_nothing_are_not_taken(self):
        with self.copied() as (folder, vault):
            (folder / "answers" / "0000.json").unlink()
            (folder / "sets" / "0000" / "runs.yaml").write_text("[]")
            self.assertIn("not answered: its data are not the sealed ones", run("diagnose", "--campaign", folder, "--", *TRUE))
            self.assertFalse((folder / "answers" / "0000.json").exists())
        with self.copied() as (folder, vault):
            (folder / "answers" / "0000.json").unlink()
            report = '{"verdict": "attributed", "causes": [], "location": []}'
            text = run("diagnose", "--campaign", folder, "--", "/bin/sh", "-c", f"echo '{report}' > $0/report.json", "{out}", "{set}")
            self.assertIn("0000: failed: report.json: causes", text)

    def test_an_oracle_that_is_not_there_is_refused_first(self):
        with self.assertRaisesRegex(campaign.Wrong, "no such program"):
            run("score", self.folder, "--oracle", "/nope")
        with self.assertRaisesRegex(campaign.Wrong, "needs the sets"):
            run("score", campaign.ROOT / "tests" / "blind" / "records" / "c5.jsonl", "--oracle", "/bin/true")

    def test_who_is_not_root_cannot_uncover_the_answers(self):
        if os.geteuid() == 0 or subprocess.run(["unshare", "--user", "--map-root-user", "true"]).returncode:
            self.skipTest("as root another user's rights do it; else user namespaces are needed")
        prefix, how = seal.confined(self.vault, self.folder)
        self.assertEqual(how, "covered")
        spy = f"umount {self.vault}; unshare --user --map-root-user --mount umount {self.vault}; cat {self.vault}/0000.json"
        self.assertNotEqual(subprocess.run([*prefix, "sh", "-c", spy], capture_output=True).returncode, 0)

    def test_who_is_not_root_may_name_a_campaign_from_where_he_is(self):
        other = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"] if os.geteuid() == 0 else []
        if subprocess.run([*other, "unshare", "--user", "--map-root-user", "--mount", "/usr/bin/python3", "-c", "import yaml"],
                          cwd=campaign.ROOT, capture_output=True).returncode:
            self.skipTest("needs user namespaces, and a project that everybody may read")
        with self.copied() as (folder, vault):
            (folder / "answers" / "0000.json").unlink()
            for path in (folder.parent, *folder.parent.rglob("*")):
                if other:
                    os.chown(path, 65534, 65534)
            report = json.dumps(dict(verdict="no_gap", location=[], causes=[dict(effect="no_gap", where="", p=0.7)]))
            done = subprocess.run([*other, "/usr/bin/python3", "-B", "-m", "tests.blind.campaign", "diagnose", "--campaign", "c", "--sets", "1",
                                   "--", "/bin/sh", "-c", f"test -d {{set}} && echo '{report}' > {{out}}/report.json"], cwd=folder.parent,
                                  env=dict(os.environ, PYTHONPATH=str(campaign.ROOT)), capture_output=True, text=True)
            self.assertEqual((done.returncode, done.stderr), (0, ""), done.stdout)
            self.assertEqual(json.loads((folder / "answers" / "0000.json").read_text())["vault"], "covered")

    def case(self, kind, wanted, verdict, causes, accepted=(), sigma=5.0, name="0001"):
        cause = lambda e, p, group=0: dict(effect=e, where="all", p=p, group=group)
        truth = dict(id=name.split("_")[0], robot="r", load_cell="motor_side", set_kind=kind,
                     truth=[dict(effect=e, where="all", cut="C3") for e in wanted], sizes=[dict(sigma=sigma, channel="tip")] * len(wanted))
        report = dict(verdict=verdict, causes=[cause(*c) for c in causes], location=[], accepted=[cause(e, 1) for e in accepted])
        return score.Case(truth, dict(id=name, data_sha256="d", program_sha256="p", started_ns=1, report=report))

    def test_what_counts_as_confidently_wrong(self):
        right = self.case("single", ["backlash"], "attributed", [("backlash", 0.95)], ["backlash"])
        wrong = self.case("single", ["slack"], "attributed", [("backlash", 0.95)], ["backlash"])
        beside = self.case("unlisted", ["gusts"], "ambiguous_group", [("backlash", 0.95), ("slack", 0.5, 2)], ["backlash", "slack"])
        group = self.case("single", ["slack"], "ambiguous_group", [("backlash", 0.91, 1), ("slack", 0.09, 1)], ["backlash"])
        second = self.case("single", ["slack"], "attributed", [("slack", 0.99), ("backlash", 0.98)], ["slack", "backlash"])
        unsure = self.case("single", ["slack"], "attributed", [("backlash", 0.8)], ["backlash"])
        refusal = self.case("single", ["slack"], "unexplained", [("unknown", 0.95), ("backlash", 0.05)])
        self.assertEqual([c.confident_wrong() for c in (right, wrong, beside, group, second, unsure, refusal)],
                         [False, True, True, False, False, False, False])
        self.assertEqual([c.confident_besides() for c in (right, wrong, second, unsure, refusal)], [False, True, True, False, False])

    def test_calibration_counts_every_kind(self):
        small = self.case("single", ["slack"], "attributed", [("slack", 0.9)], ["slack"], sigma=0.2)
        unlisted = self.case("unlisted", ["gusts"], "unexplained", [("unknown", 0.9)])
        pair = self.case("pair", ["slack", "backlash"], "attributed", [("backlash", 0.9)], ["backlash", "slack"])
        null = self.case("null", [], "no_gap", [("no_gap", 0.9)])
        _, numbers = figures.table([small, unlisted, pair, null], [], [])
        self.assertEqual(numbers["reliability, none below 0 sigma"], [[0.9, 4, 4]])
        self.assertEqual(numbers["reliability, none below 0.3 sigma"], [[0.9, 3, 4]])

    def test_a_followup_counts_where_the_first_had_not_shown_it(self):
        weak = lambda name, hit, follow: self.case("weak", ["slack"], "attributed", [("slack" if hit else "backlash", 0.8)],
                                                   name=name + "_followup" * follow)
        _, numbers = figures.table([weak("0001", True, False), weak("0002", False, False)],
                                 [weak("0001", True, True), weak("0002", True, True)], [])
        figure = numbers["follow-up finds the cause that weak excitation had not shown"]
        self.assertEqual((figure["k"], figure["n"]), (1, 1))

    def test_confusion_counts_what_is_right_too_and_every_miss_is_named(self):
        cases = [self.case("single", ["slack"], "attributed", [("slack", 0.9)], ["slack"], name="0001"),
                 self.case("single", ["slack"], "ambiguous_group", [("backlash", 0.6, 1), ("slack", 0.4, 1)], ["backlash"], name="0002"),
                 self.case("single", ["slack"], "attributed", [("backlash", 0.9)], ["backlash"], name="0003"),
                 self.case("single", ["slack"], "no_gap", [("no_gap", 0.7)], sigma=0.4, name="0004"),  # small: named, not in the matrix
                 self.case("single", ["slack"], "no_gap", [("no_gap", 0.7)], sigma=0.2, name="0005"),
                 self.case("unlisted", ["gusts"], "unexplained", [("unknown", 0.9)], name="0006"),
                 self.case("pair", ["slack", "backlash"], "attributed", [("slack", 0.9)], ["slack"], name="0007"),
                 self.case("null", [], "no_gap", [("no_gap", 0.7)], name="0008"),
                 self.case("null", [], "ambiguous_group", [("no_gap", 0.6, 1), ("slack", 0.4, 1)], name="0009")]
        lines, numbers = figures.table(cases, [], [])
        self.assertEqual(numbers["confusion matrix, > 1 sigma"], {"slack": {"slack": 2, "backlash": 1}, "nothing": {"no gap": 1, "no gap or a cause": 1},
                                                                  "none of the library's": {"unexplained": 1}})
        missed = lines[[k for k, line in enumerate(lines) if line.startswith("\nNot found")][0] + 1:]
        self.assertEqual([line.split()[0] for line in missed if line.startswith("  000")], ["0003", "0004", "0007"])

    def test_sizes_that_the_short_runs_do_not_show_bend_no_curve(self):
        cases = [self.case("single", ["slack"], "attributed" if s > 0.3 else "no_gap", [("slack", 0.8)], sigma=s)
                 for s in np.geomspace(0.05, 2, 40)]
        unseen = self.case("single", ["slack"], "attributed", [("slack", 0.8)], sigma=0.0)
        self.assertEqual(figures.half_point(cases + [unseen])[0], figures.half_point(cases)[0])

    def test_half_point_and_its_interval(self):
        cases = [self.case("single", ["slack"], "attributed" if k % 40 >= 20 - k // 40 else "no_gap", [("slack", 0.8)], sigma=s)
                 for k, s in enumerate(np.tile(np.geomspace(0.05, 2, 40), 4))]
        half, (low, high), _, _ = figures.half_point(cases)
        self.assertTrue(low < half < high and 0.2 < half < 0.4 and high / low < 1.6, (low, half, high))

    def test_score_draws_its_picture(self):
        picture = self.folder.parent / "score.png"
        record = campaign.ROOT / "tests" / "blind" / "records" / "c5.jsonl"
        done = subprocess.run(["/usr/bin/python3", "-B", "-m", "tests.blind.campaign", "score", record, "--picture", picture],
                              cwd=campaign.ROOT, capture_output=True, text=True)
        if "no Python package matplotlib" in done.stderr:
            self.skipTest(done.stderr)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(picture.read_bytes().startswith(b"\x89PNG"))

    def test_only_one_plans_a_campaign(self):
        for what, words in (("make", ["make", "--sets", 2]), ("diagnose", ["diagnose"])):
            with self.copied() as (folder, vault), seal.planning(folder, what):
                with self.assertRaisesRegex(campaign.Wrong, f"another gap_blind {what} is at this campaign"):
                    run(words[0], "--campaign", folder, "--vault", vault, *words[1:], *(["--", *TRUE] if what == "diagnose" else []))
        with self.copied() as (folder, vault):  # not for ever
            for _ in range(2):
                self.assertEqual(ran("make", "--campaign", folder, "--vault", vault, "--sets", 2)[0], 0)

    def test_effects_that_there_are_not_are_refused(self):
        with self.assertRaisesRegex(campaign.Wrong, "no nothing; accepted: .*backlash"):
            run("make", "--campaign", self.folder.parent / "d", "--sets", 1, "--effects", "backlash,nothing")

    def test_written_once(self):
        before = self.answer().read_bytes()
        run("diagnose", "--campaign", self.folder, "--", *TRUE)
        self.assertEqual(self.answer().read_bytes(), before)
        with self.assertRaises(FileExistsError):
            seal.write_once(self.answer(), "{}")

    def tampered(self, change):
        sealed = json.loads((self.folder / "seals" / "0001.json").read_text())
        text = (self.vault / "0001.json").read_text()
        record = json.loads(self.answer("0001").read_text())
        text = change(sealed, record) or text
        return score.refused(sealed, text, record, self.folder / "sets" / "0001")

    def test_tampering_is_refused(self):
        self.assertIsNone(self.tampered(lambda sealed, record: None))
        self.assertIn("older", self.tampered(lambda sealed, record: record.update(started_ns=sealed["sealed_ns"] - 1)))
        self.assertIn("data", self.tampered(lambda sealed, record: record.update(data_sha256="0")))
        self.assertIn("sealed one", self.tampered(lambda sealed, record: '{"truth": []}'))

    def test_wilson(self):
        # 8 of 10: the textbook's 0.490 to 0.943
        p, low, high = figures.wilson(8, 10)
        self.assertAlmostEqual(low, 0.4902, places=3)
        self.assertAlmostEqual(high, 0.9433, places=3)


if __name__ == "__main__":
    sys.argv = sys.argv[:1]
    unittest.main()
