#!/usr/bin/env python3
"""tools/gap_table with a made-up program in tendril's place: which cases it makes, what it counts as found, that it goes
on where it stopped. Knows the forms of the program's answers, not how they come about."""
import csv
import json
import pathlib
import shutil
import stat
import subprocess
import tempfile
import time
import unittest

from cluster import cluster

TABLE = pathlib.Path(__file__).resolve().parent.parent.parent / "tools" / "gap_table"

# Finds what is planted, but: calls `late` `lag` or says that it may be either, sees no `faint` below 3 floors, cannot
# simulate `stuck`, blames `sticky` where there is no gap, and finds only the first of two.
FAKE = r'''#!/usr/bin/python3 -B
import json, pathlib, sys
EFFECTS = [("stiff", ["all"], "C4", True), ("late", ["all", "tendon:1", "tendon:2"], "C1", False), ("lag", ["all"], "C1", False),
           ("faint", ["unit:1", "unit:2"], "C4", True), ("stuck", ["all"], "C2", False), ("sticky", ["all"], "C2", False)]
def option(name):
    return sys.argv[sys.argv.index(name) + 1]
here = pathlib.Path(sys.argv[0]).parent
with open(here / "calls", "a") as calls:
    calls.write(" ".join(sys.argv[1:4]) + "\n")
if sys.argv[2] == "explain":
    print(json.dumps([dict(effect=n, places=w, first_cut=c, controller_can_use_it=e, nuisance=False, confusable=["lag"] * (n in ("late", "faint")), parameters=[
        dict(name="scale", nominal=1, lower=0, upper=2, shape=False), dict(name="tau", nominal=5, lower=1, upper=9, shape=True)])
        for n, w, c, e in EFFECTS]))
elif sys.argv[2] == "simulate":
    data = pathlib.Path(option("--out"))
    data.mkdir(parents=True)
    planted = []
    for i, word in enumerate(sys.argv):
        if word != "--effect":
            continue
        name, *rest = sys.argv[i + 1].split()
        v = dict(r.split("=") for r in rest)
        if name == "stuck":
            sys.exit("tendril: it is stuck")
        size = float(v["sigma"])
        planted.append(dict(effect=name, where=v["where"], parameters={v["vary"]: 1 + 0.01 * size},
                            sigma=dict(asked=abs(size), reached=min(abs(size), 20), channel="tip position",
                                       limited="" if abs(size) <= 20 else "bound")))
    text = json.dumps(dict(seed=1, effects=planted))
    pathlib.Path(option("--truth")).write_text(text)
    (data / "hidden").write_text(text)
else:
    truth = json.loads((pathlib.Path(sys.argv[5]) / "hidden").read_text())["effects"]
    verdict, causes, accepted = "no_gap", [dict(effect="no_gap", where="", p=0.9, group=0, parameters={})], []
    cuts = dict((n, c) for n, _, c, _ in EFFECTS)
    if truth and not (truth[0]["effect"] == "faint" and truth[0]["sigma"]["reached"] < 3):
        t = truth[0]
        value = t["parameters"]["scale"]
        p = dict(scale=dict(value=1 + (value - 1) * 1.02, ci=[0, 2]))
        causes = [dict(effect=t["effect"], where=t["where"], p=0.95, group=0, parameters=p)]
        verdict = "attributed"
        if t["effect"] == "late":
            causes.insert(0, dict(effect="lag", where="all", p=0.96, group=0, parameters=p))
            if t["sigma"]["reached"] >= 3:
                verdict = "ambiguous_group"
                for c in causes:
                    c["group"] = 1
        accepted = causes[:1]
        if "--without" in sys.argv and option("--without") == t["effect"]:
            name = dict(stiff=None, faint="lag").get(t["effect"], "sticky")
            verdict = "attributed" if name else "unexplained"
            causes = accepted = [dict(effect=name or "unknown", where="all", p=0.95, group=0, parameters={})]
            if t["effect"] == "lag":  # beside what looks like it, something that does not
                causes = accepted = [dict(c, effect=e) for e, c in (("late", causes[0]), ("stiff", causes[0]))]
    elif not truth and "null_02" in sys.argv[5]:
        verdict = "attributed"
        causes.insert(0, dict(effect="sticky", where="all", p=0.95, group=0, parameters={}))
        accepted = causes[:1]
    report = pathlib.Path(option("--out"))
    report.mkdir(parents=True)
    (report / "report.json").write_text(json.dumps(dict(
        verdict=verdict, sentence="", location=[dict(cut=cuts.get(causes[0]["effect"], "C2"), first=True)] if accepted else [],
        causes=causes, accepted=accepted, leftover_sigma=0, confusable=[], degradations=[],
        closed=dict(pooled=dict(value=0.99, ci=[0.98, 1.0]) if accepted else None, channels={}),
        provenance=dict(version="1", revision="r"))))
'''


class GapTable(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scheduler = cls.enterClassContext(cluster())

    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.tendril = self.folder / "tendril"
        self.tendril.write_text(FAKE)
        self.tendril.chmod(self.tendril.stat().st_mode | stat.S_IXUSR)
        (self.folder / "robot.yaml").write_text("")
        self.out = self.folder / "out"

    def run_table(self, *arguments, where=None):
        return subprocess.run(["/usr/bin/python3", "-B", str(TABLE), "--tendril", str(self.tendril), "--robot",
                               str(self.folder / "robot.yaml"), "--out", str(self.out),
                               *(where or ("--scheduler", self.scheduler)), *arguments],
                              capture_output=True, text=True, timeout=100)

    def calls(self, word):
        return (self.folder / "calls").read_text().count(word)

    def rows(self):
        with open(self.out / "table.csv", newline="") as file:
            return {row["case"]: row for row in csv.DictReader(file)}

    def figures(self):
        return json.loads((self.out / "summary.json").read_text())["figures"]

    def test_what_is_found_is_counted(self):
        done = self.run_table("--effects", "stiff,late,faint", "--nulls", "10", "--numbers", "2", "--pairs", "0")
        self.assertEqual(done.returncode, 0, done.stderr)
        rows, figures = self.rows(), self.figures()
        self.assertEqual(len(rows), 9 + 10 + 2)
        outcome = {name: row["outcome"] for name, row in rows.items()}
        self.assertEqual([outcome[f"stiff_{s}"] for s in (1, 3, 10)], ["right"] * 3)
        # Another name is right only where the verdict says that it stands for the group of both.
        self.assertEqual([outcome[f"late_{s}"] for s in (1, 3, 10)], ["another named", "in its group", "in its group"])
        self.assertEqual([outcome[f"faint_{s}"] for s in (1, 3, 10)], ["not seen", "right", "right"])
        self.assertEqual((figures["first cause, group-exact, at 1 sigma"]["k"],
                          figures["first cause, group-exact, at 3 sigma and more"]["k"]), (1, 6))
        self.assertEqual(figures["first cut at 3 sigma and more"]["k"], 6)
        self.assertEqual(figures["seen at 1 sigma (any verdict of a gap)"]["k"], 2)
        self.assertEqual(figures["confidently wrong (p >= 0.9), all cases"]["k"], 2)  # late at 1, and the null
        self.assertEqual((figures["false alarms without a gap"]["k"], figures["false alarms without a gap"]["n"]), (1, 10))
        # Wilson's interval of 1 in 10, from a table.
        low, high = figures["false alarms without a gap"]["ci"]
        self.assertAlmostEqual(low, 0.0179, places=3)
        self.assertAlmostEqual(high, 0.4042, places=3)
        self.assertAlmostEqual(figures["parameter error at 3 sigma, median"]["median"], 0.02, places=6)
        self.assertAlmostEqual(float(rows["stiff_3"]["parameter_error"]), 0.02, places=4)
        self.assertEqual((rows["stiff_3"]["closed"], rows["stiff_3"]["closed_low"]), ("0.99", "0.98"))
        self.assertEqual(figures["only numbers wrong: a law accused"]["k"], 0)
        self.assertTrue((self.out / "table.png").stat().st_size > 1000)
        text = (self.out / "table.md").read_text()
        self.assertIn("| false alarms without a gap | 1 of 10 | 10.0 % [1.8, 40.4] |", text)
        self.assertFalse(any((self.out / "sets").iterdir()), "logs are left behind")

    def test_effects_taken_out_of_the_library(self):
        done = self.run_table("--effects", "stiff,faint,late,lag", "--sigma", "3", "--left-out", "5", "--nulls", "0", "--numbers", "0",
                              "--pairs", "0")
        self.assertEqual(done.returncode, 0, done.stderr)
        rows, figures = self.rows(), self.figures()
        self.assertEqual([rows[f"{n}_left_out"]["outcome"] for n in ("stiff", "faint", "late", "lag")],
                         ["right", "what looks like it", "another named", "another named"])
        self.assertEqual((figures["left out of the library: unexplained"]["k"],
                          figures["left out of the library: any cause that is not said to look like it, p >= 0.9"]["k"]), (1, 2))
        # They are no singles, and a wrong name there is counted there.
        self.assertEqual(figures["first cause, group-exact, at 3 sigma"]["n"], 4)
        self.assertEqual(figures["confidently wrong (p >= 0.9), all cases"]["n"], 4)

    def test_pairs_count_when_both_are_named(self):
        self.assertIn(self.run_table("--effects", "none", "--nulls", "0", "--numbers", "0", "--pairs", "4").returncode, (0, 1))
        cases = [json.loads(p.read_text()) for p in (self.out / "cases").glob("pair_??.json")]
        self.assertEqual(len(cases), 4)
        for c in cases:
            effects = c["case"]["effects"]
            self.assertEqual(len({e["effect"] for e in effects}), 2)
            self.assertEqual(abs(effects[0]["sigma"]), 10)
        done = [c for c in cases if not c["trouble"]]
        self.assertEqual(self.figures()["both of a pair"]["k"], 0)
        self.assertEqual(self.figures()["both of a pair"]["n"], len(done))

    def test_it_goes_on_where_it_stopped(self):
        options = ("--effects", "stiff,faint", "--sigma", "3,10", "--nulls", "1", "--numbers", "0", "--pairs", "0")
        self.assertEqual(self.run_table(*options).returncode, 0)
        first = self.rows()
        self.assertEqual(self.calls("gap diagnose"), 5)
        self.assertEqual(self.run_table(*options).returncode, 0)
        self.assertEqual(self.calls("gap diagnose"), 5)
        (self.out / "cases" / "stiff_3.json").write_text("{ cut short")
        self.assertEqual(self.run_table(*options).returncode, 0)
        self.assertEqual(self.calls("gap diagnose"), 6)
        again = self.rows()
        for row in (*first.values(), *again.values()):
            row.pop("seconds")
        self.assertEqual(first, again)
        # Another seed is another table.
        self.assertEqual(self.run_table(*options, "--seed", "7").returncode, 0)
        self.assertEqual(self.calls("gap diagnose"), 11)

    def test_a_record_stands_for_the_folder(self):
        record = self.folder / "record.jsonl"
        few = ("--sigma", "3", "--nulls", "1", "--numbers", "0", "--pairs", "0", "--record", str(record))
        self.assertEqual(self.run_table("--effects", "stiff", *few).returncode, 0)
        shutil.rmtree(self.out)  # the computer is gone
        self.assertEqual(self.run_table("--effects", "stiff,late", *few).returncode, 0)
        self.assertEqual(self.calls("gap diagnose"), 3)
        self.assertEqual([self.rows()[name]["outcome"] for name in ("stiff_3", "late_3", "null_01")],
                         ["right", "in its group", "right"])
        self.assertEqual(self.run_table("--effects", "stiff", *few).returncode, 0)
        self.assertEqual(len(record.read_text().splitlines()), 3)  # what this run did not ask for stays
        record.write_text("{}\n")
        done = self.run_table("--effects", "stiff", *few)
        self.assertEqual(done.returncode, 2)
        self.assertIn("record.jsonl:1: not a line of a record", done.stderr)

    def test_workers_of_this_machine_make_the_same_table(self):
        options = ("--effects", "stiff,late", "--nulls", "3", "--numbers", "1", "--pairs", "0")
        tables = []
        for where in (("--jobs", "2"), ("--scheduler", self.scheduler)):
            self.assertEqual(self.run_table(*options, where=where).returncode, 0)
            self.assertEqual(json.loads((self.out / "summary.json").read_text())["missing"], 0)
            tables.append(self.rows())
            for row in tables[-1].values():
                row.pop("seconds")
            shutil.move(self.out, f"{self.out}{len(tables)}")
        self.assertEqual(*tables)
        self.assertEqual(list(tables[0]), list(tables[1]))  # in the same order
        self.assertEqual(self.calls("gap simulate"), 2 * (6 + 3 + 1))
        shutil.move(f"{self.out}1", self.out)
        self.assertEqual(self.run_table(*options, "--only-table").returncode, 0)
        self.assertEqual(self.calls("gap simulate"), 2 * (6 + 3 + 1))

    def test_a_case_that_fails_is_named_and_the_others_are_made(self):
        done = self.run_table("--effects", "stiff,stuck", "--sigma", "3", "--nulls", "0", "--numbers", "0", "--pairs", "0")
        self.assertEqual(done.returncode, 1)
        rows = self.rows()
        self.assertEqual(rows["stuck_3"]["outcome"], "failed")
        self.assertEqual(rows["stuck_3"]["trouble"], "not made: tendril: it is stuck")
        self.assertEqual(rows["stiff_3"]["outcome"], "right")
        self.assertEqual(self.figures()["first cause, group-exact, at 3 sigma"]["n"], 1)
        self.assertEqual(self.figures()["cases that failed"]["k"], 1)

    def test_sizes_that_cannot_be_reached_do_not_count_as_that_size(self):
        done = self.run_table("--effects", "stiff", "--sigma", "10,50", "--nulls", "0", "--numbers", "0", "--pairs", "0", "--keep")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.figures()["first cause, group-exact, at 50 sigma"]["n"], 0)
        self.assertEqual(self.rows()["stiff_50"]["reached_sigma"], "20")
        self.assertTrue((self.out / "sets" / "stiff_50" / "data" / "hidden").exists())

    def test_wrong_use_is_told(self):
        for arguments, says in ((("--effects", "gremlins"), "no effect 'gremlins'"), (("--sigma", "0"), "expected sizes"),
                                (("--sigma", "a"), "expected sizes"), (("--scheduler", "cluster"), "expected tcp://HOST:PORT"),
                                (("--jobs", "0"), "from 1 to 1000"), (("--robot", "gone.yaml"), "gone.yaml: no such file"),
                                (("--tendril", "gone"), "no tendril program found"), (("--nulls", "-1"), "0 to 1000"),
                                (("--effects", "none", "--nulls", "0", "--numbers", "0", "--pairs", "0"), "no cases: "),
                                (("--only-table",), "--only-table: none of the ")):
            done = self.run_table(*arguments)
            self.assertEqual(done.returncode, 2, arguments)
            self.assertIn(says, done.stderr)
            self.assertNotIn("Traceback", done.stderr)
            self.assertFalse(self.out.exists())

    def test_stopped_by_hand_it_leaves_a_table(self):
        self.tendril.write_text(FAKE.replace("import json, pathlib, sys", "import json, pathlib, sys, time\nif sys.argv[2] == 'diagnose' and '_10' in sys.argv[5]: time.sleep(60)"))
        child = subprocess.Popen(["/usr/bin/python3", "-B", str(TABLE), "--tendril", str(self.tendril), "--robot",
                                  str(self.folder / "robot.yaml"), "--out", str(self.out), "--effects", "stiff", "--jobs", "1",
                                  "--nulls", "0", "--numbers", "0", "--pairs", "0"], stdout=subprocess.DEVNULL,
                                 stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + 60
        while time.monotonic() < end and not (self.out / "sets" / "stiff_10" / "data" / "hidden").exists():
            time.sleep(0.05)
        time.sleep(0.5)
        child.terminate()
        said = child.communicate(timeout=60)[1]
        self.assertEqual(child.returncode, 130, said)
        self.assertIn("goes on from here", said)
        self.assertEqual(set(self.rows()), {"stiff_1", "stiff_3"})


if __name__ == "__main__":
    unittest.main()
