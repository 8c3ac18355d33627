# Sealed campaigns: sets with something unknown planted, a diagnosis that never sees the answers, and the score.
# make and again know the plant, score.py what was planted; diagnose knows folders, hashes and a command, nothing else.
import argparse
import contextlib
import json
import os
import platform
import secrets
import shutil
import signal
import sys
from importlib import metadata
from pathlib import Path

from tests.blind import score
from tests.blind.seal import (HEAD, LEDGER, WRONG_USE, NotRun, Wrong, confined, diagnose_one, digest, end_of, enter, entered, listed,
                              may_be_vault, mine, now, parts_of, seal_of, seal_sha, sha, shard_ids, vault_of, write_once)

ROOT = Path(__file__).resolve().parents[2]
KINDS = dict(single=0.38, parameter=0.15, null=0.2, nuisance_null=0.05, unlisted=0.08, pair=0.08, weak=0.03, no_tracker=0.03)
JITTERS_S = (3e-6, 2e-5)  # drawn from, and not written down before c13


def kinds_of(count, rng):
    """Kinds for `count` sets: whole parts by the composition, the rest by chance, in random order."""
    names, kinds = list(KINDS), []
    for name in names:
        kinds += [name] * int(KINDS[name] * count)
    while len(kinds) < count:
        kinds.append(rng.choices(names, [KINDS[n] * count % 1 + 1e-9 for n in names])[0])
    rng.shuffle(kinds)
    return kinds


def draw(kind, rng, among=None, chain=True):
    """What to plant: list of (name, where, sigma, sign); what lists name only `among` these; the untied chain with `chain`."""
    from tests.blind import effects
    groups = dict(single=("listed", "scale", "sensor"), parameter=("scale",), unlisted=("unlisted",), pair=("listed", "scale"),
                  weak=("listed", "scale"), no_tracker=("listed", "scale"))
    if kind not in groups:
        return []
    pool = [e for e in effects.LIST.values() if e.kind in groups[kind]]
    if not chain:
        pool = [e for e in pool if e.name != "free_chain"]
    if among and kind != "unlisted":
        pool = [e for e in pool if e.name in among]
    if kind == "no_tracker":
        pool = [e for e in pool if not e.name.startswith("tracker")]
    if len(pool) < (2 if kind == "pair" else 1):
        raise Wrong(f"--effects {','.join(among)}: too few for sets of kind {kind}, which draw {'two' if kind == 'pair' else 'one'}"
                    f" of kind {' or '.join(groups[kind])} (python -m tests.blind.make --list)")

    def one(sigma):
        e = rng.choice(pool)
        pool.remove(e)
        parts = dict(tendon=3, unit=4).get(e.scope)
        alone = parts and e.on_one and (not e.on_all or rng.random() < 0.4)
        where = f"{e.scope}:{rng.randint(1, parts)}" if alone else "all"
        return e.name, where, sigma, rng.choice((-1, 1)) if e.low < 0 else 1

    log_uniform = lambda a, b: a * (b / a) ** rng.random()
    if kind == "pair":
        s = log_uniform(5, 30)
        return [one(s), one(s / log_uniform(1, 5))]
    return [one(log_uniform(3, 30) if kind in ("weak", "no_tracker") else log_uniform(0.1, 30))]


def make(o):
    import random
    from tests.blind import effects
    folder, vault = Path(o.campaign), Path(o.vault or o.campaign.rstrip("/") + ".vault")
    may_be_vault(vault, folder)
    strange = sorted(set(o.effects or ()) - set(effects.LIST))
    if strange:
        raise Wrong(f"--effects: no {', '.join(strange)}; accepted: {', '.join(effects.LIST)}")
    ids = shard_ids(o.sets, o.shard)
    rng = random.SystemRandom()
    for kind in KINDS:
        draw(kind, rng, o.effects, o.mujoco > 0)  # refused before anything is made
    for d in (folder / "sets", folder / "seals", vault):
        d.mkdir(parents=True, exist_ok=True)
    vault.chmod(0o700)
    with contextlib.suppress(FileExistsError):
        write_once(folder / "vault", f"{vault.resolve()}\n")
    part, whole = map(int, o.shard.split("/"))
    for other in parts_of(vault):
        if other[1:] != (whole, o.sets):
            raise Wrong(f"--shard {o.shard} of --sets {o.sets}: this campaign was begun as {other[1]} parts of {other[2]} sets; "
                        "the composition holds for these, so take them or another folder")
    # Drawn once: what is interrupted goes on with the kinds that were left, not with new ones.
    path = vault / f"{part}_of_{whole}_of_{o.sets}.kinds"
    with contextlib.suppress(FileExistsError):
        write_once(path, json.dumps(kinds_of(len(ids), rng)))
    try:
        kinds = json.loads(path.read_text())
        if len(kinds) != len(ids) or not set(kinds) <= set(KINDS):
            raise ValueError
    except (ValueError, TypeError, RecursionError):
        raise Wrong(f"{path}: not the kinds of {len(ids)} sets that make wrote; put it back from a copy")
    if not ids:
        print(f"--shard {o.shard}: of {o.sets} sets none is in this part", flush=True)
    elif all((folder / "seals" / f"{k:04d}.json").exists() for k in ids):
        print(f"nothing to make: all {len(ids)} sets of this part are sealed", flush=True)
    for k, kind in zip(ids, kinds):
        name = f"{k:04d}"
        with mine(folder / "seals" / f".{name}.lock") as free:
            if free and not (folder / "seals" / f"{name}.json").exists():
                make_one(o, folder, vault, name, kind, rng)


def make_one(o, folder, vault, name, kind, rng):
    import yaml
    from tests.blind import effects, make as generator
    for leftover in (folder / "sets" / name, folder / "sets" / f"{name}_followup"):
        shutil.rmtree(leftover, ignore_errors=True)
    robot_name = rng.choice(["rig_90mm"] * 4 + ["rig_60mm"])
    robot = yaml.safe_load((ROOT / "config" / "robots" / f"{robot_name}.yaml").read_text())
    cell = rng.choice(["motor_side"] * 4 + ["robot_side"])
    # A robot without a gap is now and then moved too little, or has no tracker: neither tells that something is planted.
    like = rng.choice([kind] * 8 + ["weak", "no_tracker"]) if kind == "null" else kind
    seed = rng.getrandbits(48)
    for _ in range(5):  # again where what was drawn cannot be made
        items, sizes = [], []
        for effect, where, sigma, sign in draw(kind, rng, o.effects, o.mujoco > 0):
            amount, size, channel = generator.amount_for(robot, effect, where, sigma, seed, sign, cell)
            items.append((effect, where, amount))
            sizes.append(dict(wanted_sigma=sigma, sigma=size, channel=channel))
        others = ["cocontraction", "circle", "steps", "multisine", "ladder", "hold"]
        families = ["triangle"] + rng.sample(others, o.families - 1)
        # Some of what both plants can do is done by the other one, the untied chain always.
        names = {effect for effect, _, _ in items}
        either = kind != "nuisance_null" and all(n in generator.MUJOCO or effects.LIST[n].cut == "C6" for n in names)
        plant = "mujoco" if "free_chain" in names or (either and rng.random() < o.mujoco) else "lagrange"
        nuisance = 0.0
        if kind == "nuisance_null":
            nuisance, size = generator.small_nuisance(robot, seed, cell)
            sizes.append(dict(wanted_sigma=0.0, sigma=size, channel="any"))
        common = dict(robot_name=robot_name, items=items, seed=seed, load_cell=cell, tracker=like != "no_tracker",
                      colour=rng.choice([0, 0, 0.5, 0.9]), lost=rng.choice([0, 0, 0, 0.03]),
                      jitter=rng.choice([JITTERS_S[0], *JITTERS_S]), nuisance=nuisance, plant=plant)
        try:
            extra = {}
            if kind == "weak":
                answer = generator.make_set(folder / "sets" / name, None, families=["weak", "weak"], **common)
                extra = generator.make_set(folder / "sets" / f"{name}_followup", None, families=families, **common)
                extra = dict(followup_sha256=extra["sha256_of_data"])
                answer["followup_families"] = families
            else:
                answer = generator.make_set(folder / "sets" / name, None,
                                            families=["weak", "weak"] if like == "weak" else families, **common)
            break
        except RuntimeError:
            shutil.rmtree(folder / "sets" / name, ignore_errors=True)
    else:
        raise RuntimeError(f"set {name}: five draws could not be simulated")
    answer.update(extra, id=name, set_kind=kind, sizes=sizes, nonce=secrets.token_hex(32), made_by=maker())
    text = json.dumps(answer, indent=1) + "\n"
    path = vault / f"{name}.json"
    path.unlink(missing_ok=True)
    write_once(path, text)
    seal = dict(id=name, answer_sha256=sha(text.encode()), data_sha256=answer["sha256_of_data"], sealed_ns=now(), **extra)
    write_once(folder / "seals" / f"{name}.json", json.dumps(seal) + "\n")
    print(f"set {name} sealed {seal['answer_sha256'][:16]}", flush=True)


def maker():
    """What the last bits of the data depend on."""
    versions = {}
    for package in ("numpy", "numba", "scipy", "mujoco"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[package] = metadata.version(package)
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return dict(versions, processor=line.partition(":")[2].strip())
    return dict(versions, processor=platform.machine())


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


KEEP = ("verdict", "sentence", "location", "causes", "accepted", "closed", "leftover_sigma", "confusable", "baselines",
        "degradations", "provenance")


def diagnose(o):
    """0 where all that was looked at has an answer that can be counted, 1 where that went wrong now, 3 where it had before."""
    folder = Path(o.campaign)
    if not any((folder / "seals").glob("*.json")):
        raise Wrong(f"--campaign {folder}: no sealed sets in its folder seals; gap_blind make writes them")
    vault = vault_of(folder, o.vault)
    command = o.command or [str(o.tendril), "gap", "diagnose", "--robot", "{robot}", "--out", "{out}", "--no-next", "{set}"]
    for place, what in (("{set}", "where the data are"), ("{out}", "where to leave report.json")):
        if not any(place in word for word in command[1:]):
            raise Wrong(f"the command after -- does not say {place}, by which it learns {what}; write {place} into it")
    program = shutil.which(command[0])
    if not program:
        raise Wrong(f"{command[0]}: no such program; give --tendril or the command after --")
    ledger, head = vault / LEDGER, folder / HEAD
    if entered(ledger, head) is None and head.exists() and vault.is_dir():  # told before anything is spent, as a damaged one is
        raise Wrong(f"{ledger} is gone, in which {head} knows of lines; put it back as diagnose left it")
    with contextlib.suppress(PermissionError):
        folder.chmod(0o700)  # the order and times of seals say something of what was planted
    prefix, how = confined(vault, folder)
    command[0] = str(Path(program).absolute())  # it runs elsewhere
    (folder / "answers").mkdir(exist_ok=True)
    facts = dict(program_sha256=sha(Path(program).read_bytes()), confined=bool(prefix), vault=how)
    good, there, begun, failed, gone = True, 0, False, [], []
    for k in shard_ids(o.sets or 100000, o.shard):
        if not (folder / "seals" / f"{k:04d}.json").exists():
            continue
        there += 1
        try:
            seal = seal_of(folder, f"{k:04d}")
        except ValueError as wrong:
            print(f"{k:04d}: not answered: {wrong}", flush=True)
            good = False
            continue
        for name in [f"{k:04d}"] + [f"{k:04d}_followup"] * ("followup_sha256" in seal):
            answer = folder / "answers" / f"{name}.json"
            if answer.exists():
                failed += [name] * (not says_something(answer))
                continue
            if not (folder / "sets" / name).exists():
                gone.append(name)
                continue
            begun = True
            with mine(folder / "answers" / f".{name}.lock") as free:
                if not free or answer.exists():
                    continue
                try:
                    good &= answer_one(folder, vault, name, seal, command, facts, prefix, o.timeout)
                except (NotRun, OSError, ValueError, KeyError) as wrong:  # of this set alone; nothing is answered
                    print(f"{name}: not answered: {wrong}", flush=True)
                    good = False
    if failed:
        print(f"{len(failed)} failed to answer before: {listed(failed)}; they are not done again, and count as failed", flush=True)
    if gone:
        print(f"the data of {len(gone)} are gone: {listed(gone)}; put them back into {folder / 'sets'} to have them answered", flush=True)
    if not there:
        print(f"--shard {o.shard}: no sealed set is in this part", flush=True)
    elif good and not (begun or failed or gone):
        print("nothing to diagnose: every sealed set of this part is answered", flush=True)
    if ledger.exists():
        print(f"ledger of answers: {end_of(ledger)}; note it elsewhere: score says it again", flush=True)
    return 1 if not good else 3 if failed or gone else 0


def says_something(answer):
    """Whether an answer that was given holds a report."""
    try:
        return json.loads(answer.read_text())["report"] is not None
    except (ValueError, KeyError, TypeError, RecursionError):
        return False


def answer_one(folder, vault, name, seal, command, facts, prefix, timeout_s):
    data, before = folder / "sets" / name, digest(folder / "sets" / name)
    if before != seal["followup_sha256" if name.endswith("_followup") else "data_sha256"]:
        raise NotRun("its data are not the sealed ones")
    facts = dict(facts, seal_sha256=seal_sha(seal))

    def note(**what):
        if vault.is_dir():
            enter(vault / LEDGER, folder / HEAD, name, **what, seal_sha256=facts["seal_sha256"])
    # Before it runs, so that nobody looks at what it finds and begins anew without a trace.
    note(begun_ns=now(), program_sha256=facts["program_sha256"])
    try:
        report, run = diagnose_one(command, data, prefix, timeout_s)
    except NotRun as wrong:
        note(not_answered=str(wrong))
        raise
    if run["exit_code"] in WRONG_USE:
        said = (run["error"].strip().splitlines() or ["it said nothing"])[-1]
        note(not_answered=f"exit code {run['exit_code']}: {said}")
        raise Wrong(f"set {name}: the command was not run as it should be, exit code {run['exit_code']}: {said}; nothing was answered, "
                    "only that it was begun is written down; mend the command (one that fails at a set has to exit with 1)")
    if report:
        try:
            score.check_report(report)
        except (ValueError, TypeError, KeyError) as wrong:
            report, run["error"] = None, f"report.json: {wrong}"
    answer = dict(id=name, data_sha256=before, **facts, report=report and {key: report[key] for key in KEEP if key in report}, **run)
    text = json.dumps(answer) + "\n"
    write_once(folder / "answers" / f"{name}.json", text)
    note(sha256=sha(text.encode()))
    failed = run["error"].strip()[-200:] or f"exit code {run['exit_code']}"
    print(f"{name}: {report['verdict'] if report else 'failed: ' + failed}, "
          f"{(run['finished_ns'] - run['started_ns']) / 1e9:.1f} s", flush=True)
    return report is not None


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
    make="0 every set of the part is sealed or another process is at it; 1 a set could not be made",
    diagnose="0 every sealed set of the part is answered, or another process is at it; 1 a set failed to answer or could not be "
             "answered; 3 none did so now, but sets failed before or their data are gone",
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
    m.add_argument("--shard", default="1/1", help="i/n: this part of the sets (default: 1/1, all)")
    d = parser("diagnose", "run the diagnosis on what is sealed, once a set")
    d.add_argument("--campaign", required=True, help="folder that make filled; answers go into its folder answers")
    d.add_argument("--vault", help="what the diagnosis must not read (default: where make put it)")
    d.add_argument("--sets", type=at_least(1, int), help="only the first so many (default: all that are sealed)")
    d.add_argument("--shard", default="1/1", help="i/n: this part of the sets (default: 1/1, all)")
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
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what is running ends with it, as with Ctrl-C
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
