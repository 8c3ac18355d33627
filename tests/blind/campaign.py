# Sealed campaigns: sets with something unknown planted, a diagnosis that never sees the answers, and the score.
# This process plans and alone writes the ledger; its workers make sets (draw.py) and run the diagnosis (seal.py).
import argparse
import contextlib
import json
import os
import random
import secrets
import shutil
import signal
import sys
from pathlib import Path

from tests.blind import score
from tests.blind.draw import JITTERS_S, KINDS, ROOT, draw, kinds_of, make_one
from tests.blind.seal import (HEAD, LEDGER, WRONG_USE, Wrong, confined, digest, end_of, enter, entered, listed, may_be_vault, now, parts_of,
                              planning, run_sealed, seal_of, seal_sha, sha, vault_of, write_once)
from tools.workers import Task, Workers, add_arguments


def make(o):
    folder, vault = Path(o.campaign).absolute(), Path(o.vault or o.campaign.rstrip("/") + ".vault").absolute()
    may_be_vault(vault, folder)
    kinds = begun(o, folder, vault)
    how = dict(folder=str(folder), vault=str(vault), effects=o.effects, families=o.families, mujoco=o.mujoco)
    with planning(folder, "make"), Workers(o.jobs, o.scheduler) as workers:
        todo = [(f"{k:04d}", kind) for k, kind in enumerate(kinds) if not (folder / "seals" / f"{k:04d}.json").exists()]
        if not todo:
            print(f"nothing to make: all {o.sets} sets are sealed", flush=True)
        lost = seal_all(workers, [Task(name, make_one, (how, name, kind)) for name, kind in todo])
    return 1 if lost else 0


def seal_all(workers, tasks):
    """Has every set of these tasks made and sealed, and says so; names of those that could not be."""
    lost = []
    for done in workers.results(tasks):
        if isinstance(done.error, (Wrong, ModuleNotFoundError)):
            raise done.error
        if done.error:
            lost.append(done.task.name)
            print(f"set {done.task.name}: not made: {done.error}", file=sys.stderr, flush=True)
        else:
            print(f"set {done.task.name} sealed {done.value[:16]}", flush=True)
    return lost


def begun(o, folder, vault):
    """Makes the folders of a campaign where they are not there; the kinds of its sets, drawn once: what is interrupted goes on
    with the kinds that were left, not with new ones."""
    from tests.blind import effects
    strange = sorted(set(o.effects or ()) - set(effects.LIST))
    if strange:
        raise Wrong(f"--effects: no {', '.join(strange)}; accepted: {', '.join(effects.LIST)}")
    rng = random.SystemRandom()
    for kind in KINDS:
        draw(kind, rng, o.effects, o.mujoco > 0)  # refused before anything is made
    for d in (folder / "sets", folder / "seals", vault):
        d.mkdir(parents=True, exist_ok=True)
    vault.chmod(0o700)
    with contextlib.suppress(FileExistsError):
        write_once(folder / "vault", f"{vault.resolve()}\n")
    for part, whole, sets in parts_of(vault):
        if (whole, sets) != (1, o.sets):
            raise Wrong(f"--sets {o.sets}: this campaign was begun with {sets} sets{f' in {whole} parts' if whole > 1 else ''}; the "
                        "composition holds for these, so take another folder" + (f" or --sets {sets}" if whole == 1 else ""))
    path = vault / f"1_of_1_of_{o.sets}.kinds"
    with contextlib.suppress(FileExistsError):
        write_once(path, json.dumps(kinds_of(o.sets, rng)))
    try:
        kinds = json.loads(path.read_text())
        if len(kinds) != o.sets or not set(kinds) <= set(KINDS):
            raise ValueError
    except (ValueError, TypeError, RecursionError):
        raise Wrong(f"{path}: not the kinds of {o.sets} sets that make wrote; put it back from a copy")
    return kinds


def again(o):
    """Opened sets of a record once more, from what was drawn: for whoever wants to see what was missed. 1 where the data are not
    the same to the last bit."""
    cases = [case for record in o.records for case in score.recorded(Path(record))[0]]
    opened = {}
    for case in cases:
        if case.sealed and opened.setdefault(case.id, case.opened) != case.opened and case.id in o.set:
            raise Wrong(f"--set {case.id}: two of these records hold another set of that name; name one of them alone")
    missing = [name for name in o.set if name not in opened]
    if missing:
        raise Wrong(f"--set {missing[0]}: " + (f"these records hold {len(opened)} sets, {min(opened)} to {max(opened)}" if opened else
                                               "these records hold no seeds (c9 is the first that does)"))
    same = True
    for name in o.set:
        same &= make_again(Path(o.out), name, opened[name])
    return 0 if same else 1


def make_again(out, name, answer):
    from tests.blind import make as generator
    sets = {name: (answer["families"], answer["sha256_of_data"])}
    if "followup_families" in answer:
        sets[f"{name}_followup"] = answer["followup_families"], answer["followup_sha256"]
    elif answer["set_kind"] == "weak":
        print(f"{name}: the motions of its follow-up were not written down before c13, it is not made", flush=True)
    items = [(t["effect"], t["where"], t["amount"]) for t in answer["truth"]]
    same = True
    for folder, (families, wanted) in sets.items():
        if (out / folder).exists():
            raise Wrong(f"--out {out}: there is a {folder} in it already; take another folder or move it")
        for jitter in [answer["jitter_s"]] if "jitter_s" in answer else JITTERS_S:
            shutil.rmtree(out / folder, ignore_errors=True)
            made = generator.make_set(
                out / folder, None, answer["robot"], items, answer["seed"], families, load_cell=answer["load_cell"],
                tracker=answer["tracker"], colour=answer["colour"], lost=answer["lost"], jitter=jitter, strength=answer["strength"],
                scatter_Nm=answer["scatter_Nm"], plant=answer["plant"], nuisance=answer["nuisance"])
            if made["sha256_of_data"] == wanted:
                break
        whole = made["sha256_of_data"] == wanted
        planted = ", ".join(f"{t['effect']} {t['where']} {s['sigma']:.3g} sigma" for t, s in zip(answer["truth"], answer["sizes"]))
        print(f"{out / folder}: {planted or 'nothing planted'}; " + ("the same data" if whole else
              "not the same to the last bit (another processor or other packages, or made by an earlier plant)"), flush=True)
        same &= whole
    return same


def diagnose(o):
    """0 where all that was looked at has an answer that can be counted, 1 where that went wrong now, 3 where it had before."""
    folder = Path(o.campaign).absolute()
    if not any((folder / "seals").glob("*.json")):
        raise Wrong(f"--campaign {o.campaign}: no sealed sets in its folder seals; gap_blind make writes them")
    vault = vault_of(folder, o.vault).absolute()
    command = o.command or [str(o.tendril), "gap", "diagnose", "--robot", "{robot}", "--out", "{out}", "--no-next", "{set}"]
    for place, what in (("{set}", "where the data are"), ("{out}", "where to leave report.json")):
        if not any(place in word for word in command[1:]):
            raise Wrong(f"the command after -- does not say {place}, by which it learns {what}; write {place} into it")
    program = shutil.which(command[0])
    if not program:
        raise Wrong(f"{command[0]}: no such program; give --tendril or the command after --")
    command[0] = str(Path(program).absolute())  # it runs elsewhere
    ledger, head = vault / LEDGER, folder / HEAD
    if entered(ledger, head) is None and head.exists() and vault.is_dir():  # told before anything is spent, as a damaged one is
        raise Wrong(f"{ledger} is gone, in which {head} knows of lines; put it back as diagnose left it")
    with contextlib.suppress(PermissionError):
        folder.chmod(0o700)  # the order and times of seals say something of what was planted
    if not vault.exists():
        print(f"{vault} is not on this machine: nothing to hide", flush=True)
    if not o.scheduler:
        confined(vault, folder)  # refused before anything is begun
    (folder / "answers").mkdir(exist_ok=True)
    with planning(folder, "diagnose"):
        answers = Answers(folder, vault, command, o.timeout)
        tasks = answers.planned(o.sets)
        with answers, Workers(o.jobs, o.scheduler) as workers:
            for done in workers.results(tasks, answers.begin):
                answers.take(done)
        return answers.told(bool(tasks))


class Answers:
    """The one who plans writes down what is begun and answered; the workers only run the command. As a context it writes down
    too what was begun and then stopped."""

    def __init__(self, folder, vault, command, timeout_s, program=None, **facts):
        """program: the file whose hash is written down and guarded, where it is not the command's first word. facts: what every
        answer is to say besides."""
        self.folder, self.vault, self.command, self.timeout_s = folder, vault, command, timeout_s
        self.program, self.facts = program or command[0], facts
        self.program_sha256 = sha(Path(self.program).read_bytes())
        self.seals, self.at_work, self.digests = {}, {}, {}  # by name: seal; claim; SHA-256 of the data
        self.good, self.there, self.failed, self.gone = True, 0, [], []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        for name in list(self.at_work):
            self.end(name, not_answered="stopped")

    def planned(self, first):
        """A task for each sealed set that has no answer, in order."""
        tasks = []
        for path in sorted((self.folder / "seals").glob("[0-9]*.json"))[:first]:
            self.there += 1
            try:
                seal = seal_of(self.folder, path.stem)
            except ValueError as wrong:
                self.not_answered(path.stem, wrong)
                continue
            for name in [path.stem] + [f"{path.stem}_followup"] * ("followup_sha256" in seal):
                answer = self.folder / "answers" / f"{name}.json"
                if answer.exists():
                    self.failed += [name] * (not says_something(answer))
                elif not (self.folder / "sets" / name).exists():
                    self.gone.append(name)
                else:
                    self.seals[name] = seal
                    tasks.append(Task(name, run_sealed, ()))
        return tasks

    def begin(self, task):
        """Before it runs, so that nobody looks at what it finds and begins anew without a trace."""
        name = task.name
        if name in self.at_work:
            self.end(name, not_answered="its worker died")
        seal, data = self.seals[name], self.folder / "sets" / name
        self.digests[name] = digest(data)
        if self.digests[name] != seal["followup_sha256" if name.endswith("_followup") else "data_sha256"]:
            self.not_answered(name, "its data are not the sealed ones")
            return False
        self.at_work[name] = self.folder / "answers" / f".{name}.{secrets.token_hex(8)}"
        self.note(name, begun_ns=now(), program_sha256=self.program_sha256)
        return task._replace(arguments=(str(data), self.command, self.program_sha256, str(self.vault), str(self.folder),
                                        str(self.at_work[name]), self.timeout_s, self.program))

    def note(self, name, **what):
        if self.vault.is_dir():
            enter(self.vault / LEDGER, self.folder / HEAD, name, **what, seal_sha256=seal_sha(self.seals[name]))

    def end(self, name, **what):
        self.at_work.pop(name).unlink(missing_ok=True)
        self.note(name, **what)

    def not_answered(self, name, why):
        print(f"{name}: not answered: {why}", flush=True)
        self.good = False

    def take(self, done):
        name = done.task.name
        if done.error:  # of this set alone, unless the command or the machine cannot be used at all; nothing is answered
            self.end(name, not_answered=str(done.error))
            if isinstance(done.error, Wrong):
                raise done.error
            self.not_answered(name, done.error)
            return
        report, run, how = done.value
        if run["exit_code"] in WRONG_USE:
            said = (run["error"].strip().splitlines() or ["it said nothing"])[-1]
            self.end(name, not_answered=f"exit code {run['exit_code']}: {said}")
            raise Wrong(f"set {name}: the command was not run as it should be, exit code {run['exit_code']}: {said}; nothing was answered, "
                        "only that it was begun is written down; mend the command (one that fails at a set has to exit with 1)")
        self.answer(name, report, run, how)

    def answer(self, name, report, run, how):
        if report:
            try:
                score.check_report(report)
            except (ValueError, TypeError, KeyError) as wrong:
                report, run["error"] = None, f"report.json: {wrong}"
        facts = dict(program_sha256=self.program_sha256, **self.facts, **how, seal_sha256=seal_sha(self.seals[name]))
        text = json.dumps(dict(id=name, data_sha256=self.digests[name], **facts,
                               report=report, **run)) + "\n"
        write_once(self.folder / "answers" / f"{name}.json", text)
        self.end(name, sha256=sha(text.encode()))
        failed = run["error"].strip()[-200:] or f"exit code {run['exit_code']}"
        print(f"{name}: {report['verdict'] if report else 'failed: ' + failed}, "
              f"{(run['finished_ns'] - run['started_ns']) / 1e9:.1f} s", flush=True)
        self.good &= report is not None

    def told(self, begun):
        """Prints what the run left to say; the exit code."""
        if self.failed:
            print(f"{len(self.failed)} failed to answer before: {listed(self.failed)}; they are not done again, and count as failed",
                  flush=True)
        if self.gone:
            print(f"the data of {len(self.gone)} are gone: {listed(self.gone)}; put them back into {self.folder / 'sets'} to have them "
                  "answered", flush=True)
        if self.good and not (begun or self.failed or self.gone):
            print("nothing to diagnose: every sealed set is answered", flush=True)
        if (self.vault / LEDGER).exists():
            print(f"ledger of answers: {end_of(self.vault / LEDGER)}; note it elsewhere: score says it again", flush=True)
        return 1 if not self.good else 3 if self.failed or self.gone else 0


def says_something(answer):
    """Whether an answer that was given holds a report."""
    try:
        return json.loads(answer.read_text())["report"] is not None
    except (ValueError, KeyError, TypeError, RecursionError):
        return False


def share(text):
    value = float(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text}: accepted are 0 to 1")
    return value


def at_least(least, kind):
    def number(text):
        value = kind(text)
        if not least <= value < 1e9:
            raise argparse.ArgumentTypeError(f"{text}: accepted are {least} and more")
        return value
    number.__name__ = kind.__name__
    return number


CODES = dict(  # exit codes, for --help
    make="0 every set is sealed; 1 a set could not be made",
    diagnose="0 every sealed set is answered; 1 a set failed to answer or could not be answered; 3 none did so now, but sets failed "
             "before or their data are gone",
    again="0 the same data; 1 not to the last bit",
    score="0 counted, whatever came out; 1 a file could not be read or written; 141 what it printed to was closed")


def main():
    a = argparse.ArgumentParser(prog="gap_blind", description="Sealed test of tendril gap diagnose on a foreign plant's data.")
    sub = a.add_subparsers(dest="what", required=True)

    def parser(name, does):
        return sub.add_parser(name, help=does, description=does[0].upper() + does[1:] + ".",
                              epilog=f"Exit codes: {CODES[name]}; 2 wrong use or damaged input; 130 stopped by hand.")
    m = parser("make", "draw, simulate and seal")
    m.add_argument("--campaign", required=True, help="folder of sets, seals and answers")
    m.add_argument("--vault", help="folder of the opened truth, new or empty at first (default: CAMPAIGN.vault)")
    m.add_argument("--sets", type=at_least(1, int), required=True, help="of the whole campaign")
    m.add_argument("--families", type=int, default=5, choices=range(2, 8), help="kinds of excitation in a set (default: 5)")
    m.add_argument("--effects", metavar="LIST", type=lambda text: text.split(","),
                   help="draw those that the library has among these only, with commas between (default: all)")
    m.add_argument("--mujoco", metavar="SHARE", type=share, default=0.25,
                   help="of the sets that both plants can do, so many are MuJoCo's (default: 0.25; 0: none, the untied chain neither)")
    add_arguments(m)
    d = parser("diagnose", "run the diagnosis on what is sealed, once a set")
    d.add_argument("--campaign", required=True, help="folder that make filled; answers go into its folder answers")
    d.add_argument("--vault", help="what the diagnosis must not read (default: where make put it)")
    d.add_argument("--sets", type=at_least(1, int), help="only the first so many (default: all that are sealed)")
    add_arguments(d)
    d.add_argument("--tendril", default="tendril", help="the program (default: the one in PATH)")
    d.add_argument("--timeout", type=at_least(1, float), default=3600, metavar="SECONDS",
                   help="for one set, 1 and more; what takes longer has failed to answer (default: 3600)")
    d.add_argument("command", nargs="*", help="another command after --, with {set} and {out} in it, and {robot} where it needs that; "
                                              "exit codes 2, 126 and 127 mean that it was called wrongly, and stop all")
    g = parser("again", "make opened sets of a record once more, to look at what was missed")
    g.add_argument("records", nargs="+", help="files that score --record wrote")
    g.add_argument("--set", action="append", required=True, metavar="ID", help="which, such as 0076; may be given several times")
    g.add_argument("--out", required=True, metavar="DIR", help="folder for them; each becomes DIR/ID")
    s = parser("score", "open the seals and count")
    s.add_argument("campaigns", nargs="+", help="folders, or records of campaigns opened before; all are counted together")
    s.add_argument("--vault", help="folder of the opened truth (default: where make put it)")
    s.add_argument("--json", metavar="FILE", help="the table's numbers")
    s.add_argument("--picture", metavar="FILE", help="reliability diagram, detection curve and confusion matrix (.png, .svg or .pdf)")
    s.add_argument("--record", metavar="FILE", help="also what the score is made of, a line a set; written once")
    s.add_argument("--oracle", metavar="TENDRIL", help="also let this program fit the effect that it is told, on every single")
    o = a.parse_args()
    return dict(make=make, diagnose=diagnose, again=again, score=score.score)[o.what](o) or 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends it as Ctrl-C does
    try:
        code = main()
        sys.stdout.flush()
        sys.exit(code)
    except BrokenPipeError:  # whoever read it, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except Wrong as error:
        print(f"gap_blind: {error}", file=sys.stderr)
        sys.exit(2)
    except PermissionError as error:
        print(f"gap_blind: {error.filename}: may not be read or written; change its rights or name another folder", file=sys.stderr)
        sys.exit(1)
    except (RuntimeError, OSError, KeyError, ValueError) as error:
        print(f"gap_blind: {error}", file=sys.stderr)
        sys.exit(1)
    except ModuleNotFoundError as missing:
        picture = (missing.name or "").startswith("matplotlib")
        which, python = (("it (Debian: python3-matplotlib)", "/usr/bin/python3") if picture else
                         ("those of tests/blind/requirements.txt", ".../bin/python"))
        print(f"gap_blind: no Python package {missing.name}: install {which} and name the Python that has {'it' if picture else 'them'}, "
              f"PYTHON={python} tools/gap_blind ...", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("gap_blind: stopped; what is done stays, and the same command goes on", file=sys.stderr)
        sys.exit(130)
