# The score of sealed campaigns: opens the seals, checks hashes and order, and counts. Knows nothing of plants.
import json
import math
import os
import shutil
import stat
import sys
from pathlib import Path

from tests.blind.figures import picture, table
from tests.blind.seal import (HEAD, LEDGER, OPENED, NotRun, Wrong, diagnose_one, digest, end_of, enter, entered, listed, now,
                              ids_of, parts_of, seal_of, seal_sha, sha, vault_of, write_once)

CONFIDENT = 0.9
VERDICTS = ("no_gap", "attributed", "ambiguous_group", "unexplained", "insufficient_data")
IN_RECORD = ("verdict", "causes", "location", "accepted", "closed", "baselines")


def need(holds, what):
    if not holds:
        raise ValueError(what)


def checked(truth, record):
    """ValueError that says what is wrong with a set's truth or with what was answered."""
    text, numbers = (lambda v: isinstance(v, str)), (lambda v: isinstance(v, (int, float)) and math.isfinite(v))
    all_of = lambda v, holds: isinstance(v, list) and all(isinstance(x, dict) and holds(x) for x in v)
    need(isinstance(truth, dict) and isinstance(record, dict), "truth or record is no object")
    need(text(truth.get("id")) and text(truth.get("robot")) and text(truth.get("load_cell")), "truth without id, robot or load_cell")
    need(text(truth.get("set_kind")), "truth without set_kind")
    need(all_of(truth.get("truth"), lambda t: text(t.get("effect")) and text(t.get("where")) and text(t.get("cut"))), "truth's effects")
    need(bool(truth["truth"]) == (truth["set_kind"] not in ("null", "nuisance_null")), "effects do not go with set_kind")
    need(all_of(truth.get("sizes"), lambda x: numbers(x.get("sigma")) and x["sigma"] >= 0), "truth's sizes")
    need(text(record.get("id")) and text(record.get("data_sha256")) and text(record.get("program_sha256")), "record without id or hashes")
    need(isinstance(record.get("started_ns"), int), "record without time")
    need(text(record.get("vault", "")) and text(record.get("seal_sha256", "")), "record's vault or seal_sha256")
    if record.get("report") is not None:
        check_report(record["report"])


def check_report(report):
    """ValueError that says what is wrong with a diagnosis's report."""
    text, numbers = (lambda v: isinstance(v, str)), (lambda v: isinstance(v, (int, float)) and math.isfinite(v))
    all_of = lambda v, holds: isinstance(v, list) and all(isinstance(x, dict) and holds(x) for x in v)
    cause = lambda c: text(c.get("effect")) and text(c.get("where"))
    need(isinstance(report, dict) and report.get("verdict") in VERDICTS, f"verdict; accepted are {', '.join(VERDICTS)}")
    need(all_of(report.get("causes"), lambda c: cause(c) and numbers(c.get("p")) and 0 <= c["p"] <= 1), "causes")
    need(bool(report["causes"]) or report["verdict"] not in ("attributed", "ambiguous_group"), "causes, of which there is none")
    need(all_of(report.get("location", []), lambda f: text(f.get("cut"))), "location")
    need(all_of(report.get("accepted", []), cause) and all_of(report.get("baselines", []), lambda b: cause(b) and text(b.get("name"))),
         "accepted or baselines")
    closed = report.get("closed") or {}
    check_closed(closed)


def check_closed(closed):
    share = lambda v: v is None or (isinstance(v, dict) and (v.get("value") is None or
                                                            (isinstance(v["value"], (int, float)) and math.isfinite(v["value"]))))
    need(isinstance(closed, dict) and all(share(closed.get(k)) for k in ("pooled", "ceiling")), "closed")


def refused(seal, answer_text, record, data=None):
    """Why a record does not count, or None."""
    if sha(answer_text.encode()) != seal["answer_sha256"]:
        return "the opened answer is not the sealed one"
    if record.get("seal_sha256", seal_sha(seal)) != seal_sha(seal):  # answers up to c15 do not name it
        return "its seal is not the one it was diagnosed under"
    wanted = seal["followup_sha256"] if record["id"].endswith("_followup") else seal["data_sha256"]
    if record["data_sha256"] != wanted or (data is not None and data.exists() and digest(data) != wanted):
        return "the data are not the sealed ones"
    if record["started_ns"] < seal["sealed_ns"]:
        return "the diagnosis is older than the seal"
    return None


class Case:
    """One scored set: truth beside diagnosis."""

    def __init__(self, truth, record, oracle=None, sealed=None):
        """sealed: the opened text and its seal, where they are known (ValueError where something is amiss)."""
        checked(truth, record)
        need(oracle is None or isinstance(oracle, dict), "oracle")
        check_closed((oracle or {}).get("closed") or {})
        self.opened, self.record, self.oracle, self.sealed = truth, record, oracle, sealed
        self.followup = record["id"].endswith("_followup")
        self.truth, self.kind, self.id = truth["truth"], truth["set_kind"], truth["id"]
        self.sigma = max([s["sigma"] for s in truth["sizes"]], default=0.0)
        self.channel = truth["sizes"][0]["channel"] if truth["sizes"] else ""
        self.robot, self.cell = truth["robot"], truth["load_cell"]
        self.report = record["report"]
        r = self.report or {}
        self.verdict = r.get("verdict", "failed")
        self.causes = r.get("causes", [])
        self.p = {(c["effect"], c["where"]): c["p"] for c in self.causes}
        self.unknown = sum(c["p"] for c in self.causes if c["effect"] == "unknown") + (self.verdict == "unexplained")
        self.wanted = [(t["effect"], t["where"]) for t in self.truth]

    def line(self):
        """What a score is made of, for the record that outlives logs and vault: causes that nobody gave weight are left out."""
        report = self.report and {k: self.report[k] for k in IN_RECORD if k in self.report}
        if report:
            group = self.top and self.top.get("group")
            report["location"] = [f for f in report.get("location", []) if f.get("first")]
            report["causes"] = [{k: c[k] for k in ("effect", "where", "p", "group") if k in c} for k, c in enumerate(self.causes)
                                if k < 5 or c["p"] >= 0.001 or c["effect"] in ("unknown", "no_gap") or
                                (group and c.get("group") == group)]
            report["accepted"] = [{k: c[k] for k in ("effect", "where")} for c in report.get("accepted", [])]
            closed = report.get("closed") or {}
            report["closed"] = {k: {"value": closed[k].get("value")} for k in ("pooled", "ceiling") if closed.get(k)}
            report["build"] = self.build
        kept = ("id", "data_sha256", "program_sha256", "seal_sha256", "started_ns", "finished_ns", "confined", "vault")
        line = dict(record=dict({k: self.record[k] for k in kept if k in self.record}, report=report), oracle=self.oracle)
        if self.sealed:
            return dict(opened=self.sealed[0], seal=self.sealed[1], **line)
        return dict(truth={k: self.opened[k] for k in ("id", "truth", "set_kind", "sizes", "robot", "load_cell")}, **line)

    @property
    def top(self):
        return self.causes[0] if self.causes else None

    @staticmethod
    def same(cause, wanted):
        # one value for all is the same as the robot's, its sections' or all units'
        norm = lambda w: "all" if w in ("", "all", "section:1") else w
        return cause["effect"] == wanted[0] and norm(cause["where"]) == norm(wanted[1])

    def group_hit(self):
        """The top cause is the true one, or stands in one group with it and the verdict says that it is a group."""
        if not self.top or not self.wanted:
            return False
        if self.same(self.top, self.wanted[0]):
            return True
        g = self.top.get("group", 0)
        return self.verdict == "ambiguous_group" and g > 0 and any(
            c.get("group") == g and self.same(c, self.wanted[0]) for c in self.causes)

    def alarm(self):
        """A gap is claimed. A diagnosis that failed to answer has a row of its own."""
        return self.verdict not in ("no_gap", "insufficient_data", "failed")

    def names_causes(self):
        return self.verdict in ("attributed", "ambiguous_group")

    def confident_wrong(self):
        """The first line is a cause that was not planted, and the answer is sure of it (or of its group)."""
        if not self.names_causes() or self.top["effect"] in ("no_gap", "unknown"):
            return False
        return self.top["p"] >= CONFIDENT and not self.group_hit() and not any(self.same(self.top, w) for w in self.wanted)

    def confident_besides(self):
        """Any accepted cause that was not planted, and the answer is sure of it."""
        accepted = (self.report or {}).get("accepted", [])
        return self.names_causes() and any(
            c["p"] >= CONFIDENT and any(self.same(c, (a["effect"], a["where"])) for a in accepted)
            and not any(self.same(c, w) for w in self.wanted) for c in self.causes)

    @property
    def build(self):
        """Version and revision, as far as the report (or what a record kept of it) says them."""
        report = self.report or {}
        made = report.get("provenance") or {}
        return [made[k] for k in ("version", "revision") if k in made] or report.get("build", [])

    def first_cut(self):
        return next((f["cut"] for f in self.report["location"] if f.get("first")), None) if self.report else None


def told(program, case, data):
    """What the diagnosis closes when the effect is told, after the seal is open: a report, kept beside the sets."""
    if case.kind not in ("single", "parameter") or case.sigma <= 1 or not data.exists():
        return None
    kept = data.parent.parent / "oracle" / f"{case.id}.json"
    if not kept.exists():
        kept.parent.mkdir(exist_ok=True)
        command = [program, "gap", "diagnose", "--robot", "{robot}", "--out", "{out}", "--no-next", "--only", case.wanted[0][0],
                   "{set}"]
        try:
            report, facts = diagnose_one(command, data, [], 3600)
            trouble = facts["error"].strip()[-200:]
        except NotRun as wrong:
            report, trouble = None, wrong
        if report is None:  # not kept: the next time it is tried again
            print(f"oracle, {case.id}: {trouble}", file=sys.stderr, flush=True)
            return None
        write_once(kept, json.dumps({"closed": report["closed"]}) + "\n")
    return json.loads(kept.read_text())


class Ledger:
    """What the ledger of answers says of each name; entries None: there is no ledger."""

    def __init__(self, entries):
        self.there = entries is not None
        self.given, self.begun, self.seals = {}, {}, {}  # hashes of answers, how often it was begun, hashes of its seal
        self.late, was_opened = [], False
        for entry in entries or ():
            name = entry["name"]
            if name == OPENED:
                was_opened = True
                continue
            self.late += [name] * (was_opened and entry["sha256"] != "")
            self.given.setdefault(name, []).extend(filter(None, [entry["sha256"]]))
            self.begun[name] = self.begun.get(name, 0) + ("begun_ns" in entry)
            self.seals.setdefault(name, set()).update(filter(None, [entry["seal_sha256"]]))

    def refusal(self, name, answer, seal):
        """Why it does not vouch for this answer, or None."""
        written = self.given.get(name, [])
        if not self.there:
            return None
        if len(written) > 1:
            return f"answered {len(written)} times"
        if not written:
            return "not in the ledger of answers"
        if written != [sha(answer.encode())]:
            return "not the answer that was given"
        if self.seals.get(name, set()) - {seal_sha(seal)}:
            return "its seal is not the one it was diagnosed under"
        return None


class Opening:
    """Sealed sets opened one by one: each answer becomes a case or a refusal."""

    def __init__(self, folder, vault, oracle, ledger):
        self.folder, self.vault, self.oracle, self.ledger = folder, vault, oracle, ledger
        self.cases, self.refusals, self.dataless, self.unlisted, self.unbound = [], [], [], [], 0

    def take(self, name):
        try:
            seal = seal_of(self.folder, name)
        except ValueError as wrong:
            self.refusals.append((name, str(wrong)))
            return
        try:
            text = (self.vault / f"{name}.json").read_text()
            truth = json.loads(text)
            for which in [name] + [f"{name}_followup"] * ("followup_sha256" in seal):
                self.take_answer(which, seal, text, truth)
        except FileNotFoundError as wrong:
            self.refusals.append((name, f"{Path(wrong.filename).name} is not in the vault (--vault)"))
        except (ValueError, KeyError, OSError, TypeError, OverflowError, RecursionError) as wrong:
            self.refusals.append((name, f"{name}.json in the vault, or its data: {type(wrong).__name__}: "
                                        f"{getattr(wrong, 'strerror', None) or wrong}; put them back from a copy"))

    def take_answer(self, which, seal, text, truth):
        path, data = self.folder / "answers" / f"{which}.json", self.folder / "sets" / which
        if not data.exists():
            self.dataless.append(which)
        if not path.exists():
            times = self.ledger.begun.get(which, 0)
            self.refusals.append((which, f"begun {times} times, not answered" if times > 1 else "begun, not answered" if times else
                                  "not diagnosed"))
            return
        try:
            answer = path.read_text()
            record = json.loads(answer)
            case = Case(truth, record, sealed=(text, seal))
            need(record["id"] == which, "another set's answer")
        except (ValueError, OSError, KeyError, TypeError, OverflowError, RecursionError) as wrong:
            self.refusals.append((which, f"its answer: {wrong}"))
            return
        why = refused(seal, text, record, data)
        if os.stat(path).st_mode & stat.S_IWUSR:
            why = why or "the answer's file can be rewritten"
        if self.ledger.there and not self.ledger.given.get(which):
            self.unlisted.append(which)
        why = why or self.ledger.refusal(which, answer, seal)
        if why:
            self.refusals.append((which, why))
            return
        self.unbound += "seal_sha256" not in record
        if self.oracle and not case.followup:
            case.oracle = told(self.oracle, case, data.resolve())
        self.cases.append(case)

    def notes(self, gone):
        """What is to be said of all of them together."""
        twice = [f"{name} ({times} times)" for name, times in sorted(self.ledger.begun.items()) if times > 1]
        if twice:
            yield f"begun more than once, as what was stopped may be: {listed(twice)}"
        if self.unbound:
            yield (f"{self.unbound} answers not bound to their seals: they do not say under which they were given (up to c15 none "
                   "does)")
        if self.dataless:
            yield f"the data of {len(self.dataless)} are gone, and were not compared with the seals: {listed(self.dataless)}"
        if gone or self.unlisted:
            yield (f"{len(gone)} in the vault or its ledger without a seal here, {len(self.unlisted)} answers not in the ledger: "
                   "where two vaults were copied into one, take them apart and name both campaigns, score CAMPAIGN1 CAMPAIGN2")


def opened(folder, vault, oracle):
    """A campaign's cases, what is refused, its parts, and what else is to be said of it: (cases, [(name, why)],
    [(part, of how many, sets of the whole)], [note])."""
    if not vault.is_dir():
        raise Wrong(f"{vault}: the answers of {folder} are not there; name their folder with --vault")
    sealed = sorted(p.stem for p in (folder / "seals").glob("*.json"))
    ledger = Ledger(entered(vault / LEDGER, folder / HEAD))
    parts, notes = parts_of(vault), []
    drawn = {f"{k:04d}" for part in parts for k in ids_of(*part)}
    gone = ({p.stem for p in vault.glob("*.json")} | {name.removesuffix("_followup") for name in ledger.given}) - set(sealed)
    opening = Opening(folder, vault, oracle, ledger)
    opening.refusals += [(name, "its seal is gone") for name in sorted(gone)]
    opening.refusals += [(name, "drawn, not made") for name in sorted(drawn - set(sealed) - gone)]
    if ledger.there:
        enter(vault / LEDGER, folder / HEAD, OPENED, opened_ns=now())  # before any is: what is answered from now on shows
        notes.append(f"ledger of answers: {end_of(vault / LEDGER)}")
    else:
        notes.append("its ledger of answers is " + ("gone" if (folder / HEAD).exists() else "not there (nor is it where the vault was away "
                     "from the diagnosis)") + ", so that nobody knows whether a set was answered twice")
    if ledger.late:
        notes.append(f"{len(ledger.late)} answered after seals had been opened: {listed(ledger.late)}")
    for name in sealed:
        opening.take(name)
    return opening.cases, opening.refusals, parts, notes + list(opening.notes(gone))


def recorded(path):
    """The same of the record of a campaign that was opened before."""
    cases, refusals, parts, notes, head = [], [], [], [], None
    try:
        lines = path.read_text().splitlines()
    except (OSError, ValueError) as wrong:
        raise Wrong(f"{path}: {wrong}")
    for number, line in enumerate(lines, 1):
        try:
            x = json.loads(line)
            need(isinstance(x, dict), "no object")
            if number == 1 and "lines" in x:
                head, parts = x, [tuple(part) for part in x["parts"]]
                need(isinstance(x["sha256"], str) and all(len(p) == 3 and all(isinstance(n, int) for n in p) for p in parts), "first line")
                continue
            if "refused" in x:
                need(isinstance(x["refused"], list) and len(x["refused"]) == 2, "refused takes a set and a reason")
                refusals.append(tuple(map(str, x["refused"])))
                continue
            if "note" in x:
                notes.append(str(x["note"]))
                continue
            truth = json.loads(x["opened"]) if "opened" in x else x["truth"]
            case = Case(truth, x["record"], x["oracle"], (x["opened"], x["seal"]) if "opened" in x else None)
            why = refused(x["seal"], x["opened"], x["record"]) if case.sealed else None
            if why:
                refusals.append((x["record"]["id"], why))
            else:
                cases.append(case)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as wrong:
            raise Wrong(f"{path}:{number}: not a line of a record: {type(wrong).__name__}: {wrong}; "
                        "take the record as score --record wrote it")
    if lines and not head:
        notes.append(f"{path}: without the first line that tells how many follow (records of before it was written have none): that "
                     "lines were lost or changed would not be seen")
    if not cases and not refusals:
        raise Wrong(f"{path}: neither a campaign with sealed sets nor the record of one (it is empty)")
    if head and (len(lines) - 1 != head["lines"] or sha("\n".join(lines[1:]).encode()) != head["sha256"]):
        raise Wrong(f"{path}: its first line is of other lines ({head['lines']}, there are {len(lines) - 1}): "
                    "take the record as score --record wrote it")
    return cases, refusals, parts, notes


def head_of(lines, parts):
    """First line of a record: what shows that none of the others was lost or changed by accident."""
    return json.dumps(dict(lines=len(lines), sha256=sha("\n".join(lines).encode()), parts=parts), separators=(",", ":"))


def score(o):
    cases, refusals, parts, notes, counted = [], [], [], [], set()
    if o.record and Path(o.record).exists():
        raise Wrong(f"--record {o.record}: is there already, and written once; give another name")
    if o.oracle and not shutil.which(o.oracle):
        raise Wrong(f"--oracle {o.oracle}: no such program")
    for output in (o.json, o.record, o.picture):
        if output and not Path(output).absolute().parent.is_dir():
            raise Wrong(f"{output}: no folder {Path(output).absolute().parent}")
        if output and Path(output).is_dir():
            raise Wrong(f"{output}: a folder; name a file in it")
    if o.picture and Path(o.picture).suffix not in (".png", ".svg", ".pdf"):
        raise Wrong(f"--picture {o.picture}: accepted are names in .png, .svg and .pdf")
    if o.picture:
        import matplotlib.figure  # noqa: F401  (where it is missing, that is told before anything is written)
    for campaign in map(Path, o.campaigns):
        if campaign.is_file():
            if o.oracle:
                raise Wrong(f"--oracle needs the sets, which {campaign} has not: name the campaign's folder")
            more = recorded(campaign)
        elif any((campaign / "seals").glob("*.json")):
            more = opened(campaign, vault_of(campaign, o.vault), o.oracle)
        else:
            raise Wrong(f"{campaign}: neither a campaign with sealed sets nor the record of one (--record)")
        for case in more[0]:
            same = case.record["id"], case.record["data_sha256"]
            if same in counted:
                raise Wrong(f"{campaign}: set {case.record['id']} is in it or in what was named before already; each counts once")
            counted.add(same)
        cases += more[0]
        refusals += more[1]
        parts += more[2]
        notes += [(campaign, note) for note in more[3]]
    sets = [c for c in cases if not c.followup]
    lines, numbers = table(sets, [c for c in cases if c.followup], refusals)
    # What is to last comes before what is printed, which nobody may be there to read.
    if o.json:
        finite = lambda v: ({k: finite(x) for k, x in v.items()} if isinstance(v, dict) else [finite(x) for x in v]
                            if isinstance(v, (list, tuple)) else None if isinstance(v, float) and not math.isfinite(v) else v)
        Path(o.json).write_text(json.dumps(finite(dict(numbers, sets=len(sets), refused=refusals, notes=[n for _, n in notes])), indent=1)
                                + "\n")
    if o.picture:
        picture(numbers, o.picture)
    if o.record:
        written = [json.dumps(x, separators=(",", ":")) for x in [c.line() for c in cases] + [dict(refused=r) for r in refusals] +
                   [dict(note=n) for _, n in notes]]
        write_once(Path(o.record), "\n".join([head_of(written, sorted(parts)), *written]) + "\n")
    bare = sorted(c.id for c in sets if not c.sealed)
    print(f"{len(sets)} sealed sets, {len(refusals)} refused")
    if bare:
        print(f"Of {len(bare)} the record holds no seal, so that none was checked: {listed(bare)}")
    for whole, count in sorted({part[1:] for part in parts if part[1] > 1}):  # of earlier campaigns, which were made by hand in parts
        there = sorted(part[0] for part in parts if part[1:] == (whole, count))
        print(f"Parts of {count} sets: {', '.join(map(str, there))} of {whole}")
    for campaign, note in notes:
        print(f"{campaign}: {note}")
    print()
    print("\n".join(lines))
