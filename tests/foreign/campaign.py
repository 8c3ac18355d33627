"""Sealed campaign over two foreign simulators as position-controlled robots: each set is a table of postures before and
one after a withheld change, a column map and a robot file that knows little. `tendril gap diagnose` has to name the
change.

Files in the folder: sets, seals and answers by number; summary.json; table.md. The truth is in the folder beside it
that ends in .vault, hashed before anything is diagnosed and out of the diagnosis's reach (tests/blind/seal.py). What
was made or answered is kept, and the same command goes on. The seals are opened once every set has an answer."""

import argparse
import contextlib
import importlib
import itertools
import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
from importlib import metadata
from pathlib import Path

INSTALL = (
    "install tests/foreign/requirements.txt into an environment of its own and name its Python, "
    "PYTHON=.../bin/python tools/gap_foreign ..."
)


def fail(text, code=2):
    """Ends the command with one line on the error stream."""
    print(f"gap_foreign: {text}", file=sys.stderr)
    sys.exit(code)


try:
    import numpy as np

    from tests.blind import score as blind, seal
    from tests.blind.campaign import Answers, seal_all
    from tests.blind.draw import maker
    from tests.foreign import draw, table
    from tools.workers import Task, Workers, Wrong, positive
except ModuleNotFoundError as missing:
    if __name__ != "__main__":
        raise
    fail(f"{sys.executable} has no package {missing.name}; {INSTALL}")

ROOT = Path(__file__).resolve().parents[2]
MODULES = dict(cable="tests.foreign.mujoco_cable", elastica="tests.foreign.elastica_rod")
PACKAGES = dict(cable="mujoco", elastica="pyelastica")  # as pip names them
FEWEST, MOST = 100, 150  # postures of a table
LOOKED_AT = 25  # of those after the change, for how far it moves the tip
DRAWS = 4  # of a set whose simulator finds no rest
TIMEOUT_S = 3600
OWN = {"sets", "seals", "answers", "vault"}  # what a campaign's folder holds before anything is made
# Both tables are imported with the same file and map, then the change is asked for.
ASK = (
    'set -e; "$0" gap import --robot "$1/robot.yaml" --map "$1/map.yaml" "$1/before.csv" --out "$2/before" >/dev/null; '
    '"$0" gap import --robot "$1/robot.yaml" --map "$1/map.yaml" "$1/after.csv" --out "$2/after" >/dev/null; '
    'exec "$0" gap diagnose --robot "$1/robot.yaml" "$2/after" --before "$2/before" --out "$2" --no-next --threads "$3"'
)


# ---- plan ----


def plants_of(o):
    return draw.PLANTS if o.plant == "both" else (o.plant,)


def may_simulate(plants):
    """Refuses a plant whose simulator this Python has not."""
    for plant in plants:
        try:
            importlib.import_module(MODULES[plant])
        except ModuleNotFoundError as missing:
            raise Wrong(
                f"--plant {plant}: {sys.executable} has no package {PACKAGES[plant]}, or not all that it needs "
                f"({missing.name}); {INSTALL}"
            ) from missing


def places(given):
    """(folder, vault) of the campaign that --out names. Refuses what is somebody else's before anything is written."""
    folder = Path(os.path.abspath(given))
    another = "name a new or an empty folder"
    if not folder.name:
        raise Wrong(f"--out {given}: is the root of all files; {another}")
    vault = folder.with_name(f"{folder.name}.vault")
    for path in (*folder.parents, folder, vault):
        if path.exists() and not path.is_dir():
            raise Wrong(f"--out {given}: {path} is a file; {another}")
    there = {path.name for path in folder.iterdir()} if folder.exists() else set()
    strange = sorted(there - OWN) or [d for d in sorted(there - {"vault"}) if any((folder / d).glob("*"))]
    plan, note = vault / "plan.json", folder / "vault"
    noted = note.read_text(errors="replace").partition("\n")[0] if note.is_file() else str(vault.resolve())
    if noted != str(vault.resolve()):
        raise Wrong(
            f"--out {given}: its answers are in {noted[:200]}, not in {vault}: a campaign of gap_blind, or one that "
            f"was moved; move both back, or {another}"
        )
    if any(vault.glob("*.kinds")):
        raise Wrong(f"--out {given}: is a campaign of gap_blind; {another}")
    if strange and not (note.is_file() and plan.exists()):
        gone = f"; where it is one, put {plan} back from a copy" if note.is_file() else ""
        raise Wrong(f"--out {given}: holds {strange[0]}, and is no campaign of gap_foreign; {another}{gone}")
    if not note.is_file() and vault.exists() and any(vault.iterdir()):
        raise Wrong(f"--out {given}: {vault} holds files, and is not this campaign's; {another} without one beside it")
    seal.may_be_vault(vault, folder)
    return folder, vault


def plan_of(path):
    """The plan that was made, None before. Wrong where its file is damaged."""
    try:
        plan = json.loads(path.read_text())
        pairs = set(itertools.product(draw.PLANTS, draw.CHANGES))
        if len(plan["kinds"]) != plan["sets"] or not {tuple(kind) for kind in plan["kinds"]} <= pairs:
            raise ValueError
        return {key: plan[key] for key in ("sets", "seed", "plant", "kinds")}
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError, RecursionError) as damaged:
        raise Wrong(f"{path}: not the plan that gap_foreign wrote; put it back from a copy") from damaged


def planned(o, folder, vault):
    """(plant, change) of every set, and the folders for them; what is interrupted goes on with the plan that was
    made."""
    kinds = draw.kinds_of(o.sets, plants_of(o), np.random.default_rng(o.seed))
    plan = dict(sets=o.sets, seed=o.seed, plant=o.plant, kinds=kinds)
    made = plan_of(vault / "plan.json") or plan
    for key in ("sets", "seed", "plant"):
        if made[key] != plan[key]:
            raise Wrong(
                f"--{key} {plan[key]}: this campaign was begun with {made[key]}; repeat that, or name another "
                "folder with --out"
            )
    for d in (folder, folder / "sets", folder / "seals", folder / "answers", vault):
        d.mkdir(parents=True, exist_ok=True)
    for d in (folder, vault):  # the order and times of seals say something of what was planted
        d.chmod(0o700)
    for path, text in ((folder / "vault", f"{vault.resolve()}\n"), (vault / "plan.json", json.dumps(plan))):
        with contextlib.suppress(FileExistsError):
            seal.write_once(path, text)
    return plan_of(vault / "plan.json")["kinds"]


# ---- make ----


def make(o, folder, vault, kinds):
    """Names of the sets that could not be made."""
    how = dict(folder=str(folder), vault=str(vault), seed=o.seed, postures=(FEWEST, MOST))
    with seal.planning(folder, "make", "gap_foreign", "--jobs"), Workers(o.jobs) as workers:
        tasks = [
            Task(f"{k:04d}", make_one, (how, k, *kind))
            for k, kind in enumerate(kinds)
            if not (folder / "seals" / f"{k:04d}.json").exists()
        ]
        return seal_all(workers, tasks)


def make_one(how, number, plant, change):
    """A task: draws, simulates and seals one set; the SHA-256 of its answer. What an earlier worker left of it is made
    anew, except where that had sealed it."""
    folder, vault, name = Path(how["folder"]), Path(how["vault"]), f"{number:04d}"
    if (folder / "seals" / f"{name}.json").exists():
        return seal.seal_of(folder, name)["answer_sha256"]
    data = folder / "sets" / name
    answer = drawn(data, [how["seed"], number], plant, change, how["postures"])
    answer.update(
        id=name, plant=plant, data_sha256=seal.digest(data), nonce=secrets.token_hex(32), made_by=made_by(plant)
    )
    text = json.dumps(answer, indent=1) + "\n"
    (vault / f"{name}.json").unlink(missing_ok=True)
    seal.write_once(vault / f"{name}.json", text)
    sealed = dict(
        id=name, answer_sha256=seal.sha(text.encode()), data_sha256=answer["data_sha256"], sealed_ns=seal.now()
    )
    seal.write_once(folder / "seals" / f"{name}.json", json.dumps(sealed) + "\n")
    return sealed["answer_sha256"]


def drawn(data, seed, plant, change, postures):
    """One set's files from a seed, and what was planted. Where the simulator finds no rest, a robot of the same kind is
    drawn again, with how often that was in its seed."""
    for again in range(DRAWS):
        shutil.rmtree(data, ignore_errors=True)
        data.mkdir()
        its = [*seed, again] if again else seed
        try:
            return dict(made(data, np.random.default_rng(its), plant, change, postures), seed=its, drawn_again=again)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            last = error
    shutil.rmtree(data)
    raise RuntimeError(
        f"the simulator of {plant} failed at {DRAWS} robots, at the last one with '{last}', and will again; begin "
        "another campaign, with another --seed and --out"
    )


def made_by(plant):
    """What the last bits of the data depend on."""
    return dict(maker(), **{PACKAGES[plant]: metadata.version(PACKAGES[plant])})


def made(data, rng, plant, change, postures):
    """Writes one set's files, tables of `postures` (from, to) rows; what was planted."""
    simulate = importlib.import_module(MODULES[plant]).postures
    robot = draw.robot(rng)
    what = draw.change(robot, change, rng)
    lab = table.laboratory(robot, rng)
    before, after = (draw.postures(robot, rng, int(rng.integers(postures[0], postures[1] + 1))) for _ in range(2))
    table.write_runs(data / "before.csv", lab, before, simulate(robot, before), rng)
    disks = simulate(draw.changed(robot, what), after)
    table.write_runs(data / "after.csv", lab, after, disks, rng)
    table.write_yaml(
        data / "robot.yaml", lab["robot_file"], "Written by hand before any run; numbers marked unknown are guesses."
    )
    table.write_yaml(data / "map.yaml", table.column_map(robot, lab), "Column map of before.csv and after.csv.")
    tip = disks[:LOOKED_AT, -1] - simulate(robot, after[:LOOKED_AT])[:, -1]
    moved = float(np.sqrt((tip**2).sum(1).mean()))
    return dict(truth=what, robot=robot, laboratory={k: v for k, v in lab.items() if k != "robot_file"}, moved_m=moved)


# ---- diagnose ----


def program(given):
    """(path, what it says of its version) of the tendril program."""
    for place in [given] if given else [ROOT / "build" / "release" / "bin" / "tendril", shutil.which("tendril")]:
        if place and os.access(place, os.X_OK) and not os.path.isdir(place):
            path = str(Path(place).resolve())
            break
    else:
        raise Wrong(
            f"no tendril program{f' at {given}' if given else ''}; build it (tools/setup) or name it with "
            "--tendril FILE"
        )
    try:
        asked = subprocess.run([path, "--version"], stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
        version = asked.stdout.decode(errors="replace").strip().splitlines()[0]
        if asked.returncode == 0 and version.startswith("tendril "):
            return path, version
    except (OSError, IndexError, subprocess.TimeoutExpired):
        pass
    raise Wrong(f"--tendril {path}: does not say a version of tendril to --version; name the tendril program")


def diagnose(o, folder, vault, tendril, version):
    """Asks of every sealed set without an answer, as tests/blind/campaign.py does."""
    threads = max(1, (os.cpu_count() or 1) // o.jobs)
    command = [shutil.which("sh"), "-c", ASK, tendril, "{set}", "{out}", str(threads)]
    seal.confined(vault, folder)  # refused before anything is asked
    ledger_of(folder, vault)
    with seal.planning(folder, "diagnose", "gap_foreign", "--jobs"):
        answers = Answers(folder, vault, command, TIMEOUT_S, program=tendril, version=version)
        tasks = answers.planned(None)
        if tasks:
            same_build(folder, answers.program_sha256, tendril)
        with answers, Workers(o.jobs) as workers:
            for done in workers.results(tasks, answers.begin):
                answers.take(done)
        answers.told(bool(tasks))


def same_build(folder, sha256, tendril):
    """Refuses to go on with another build than the one whose answers are there."""
    for path in sorted((folder / "answers").glob("[0-9]*.json")):
        given = read(path)
        if given.get("program_sha256") != sha256:
            raise Wrong(
                f"{tendril} is another build than the one that answered {path.name} ({given.get('version')}); name "
                "that one with --tendril, or begin anew in another folder with --out"
            )


# ---- score ----


def read(path):
    """An object of a JSON file of the campaign; Wrong where it is damaged."""
    try:
        content = json.loads(path.read_text())
        if isinstance(content, dict):
            return content
    except (OSError, ValueError, RecursionError):
        pass
    raise Wrong(f"{path}: not as gap_foreign wrote it; put it back from a copy")


def ledger_of(folder, vault):
    """What the ledger says, its chain of lines verified. Wrong where it is gone although there are answers."""
    lines = seal.entered(vault / seal.LEDGER, folder / seal.HEAD)
    if lines is None and ((folder / seal.HEAD).exists() or any((folder / "answers").glob("[0-9]*.json"))):
        raise Wrong(f"{vault / seal.LEDGER} is gone, in which every answer is entered; put it back from a copy")
    return blind.Ledger(lines)


def checked(folder, vault, name, ledger):
    """(seal, truth, answer, SHA-256 of the answer) of one set. Wrong where any is not what was sealed or entered."""
    path, truth = folder / "answers" / f"{name}.json", vault / f"{name}.json"
    try:
        sealed, text, opened = seal.seal_of(folder, name), path.read_text(), truth.read_text()
        if seal.sha(opened.encode()) != sealed["answer_sha256"]:
            raise Wrong(f"{truth}: not the sealed answer; put it back from a copy")
        why = ledger.refusal(name, text, sealed)
        if not why and name in ledger.late:
            why = "answered after seals had been opened"
        given = read(path)
        why = why or blind.refused(sealed, opened, given, folder / "sets" / name)
        if given["id"] != name:
            why = why or "another set's answer"
    except (OSError, ValueError, KeyError, TypeError) as damaged:
        raise Wrong(f"set {name}: {damaged}; put its seal, answer and truth back from a copy") from damaged
    if why:
        raise Wrong(
            f"{path}: {why}; put it, its set and its seal back as they were, or begin anew in another folder with --out"
        )
    return sealed, json.loads(opened), given, seal.sha(text.encode())


def one_build(sets):
    """(SHA-256, version) of the program that gave all these answers. Wrong where there were several."""
    builds = {(given["program_sha256"], given.get("version", "?")): name for name, (_, _, given, _) in sets.items()}
    if len(builds) > 1:
        said = ", ".join(f"{version} {sha256[:12]} (set {name})" for (sha256, version), name in sorted(builds.items()))
        raise Wrong(f"answers of {len(builds)} builds: {said}; begin anew in another folder with --out, with one build")
    return next(iter(builds))


def score(o, folder, vault, names):
    """Checks every answer, then opens the seals: what summary.json holds."""
    ledger = ledger_of(folder, vault)
    more = sorted(({path.stem for path in (folder / "seals").glob("*.json")} | set(ledger.given)) - set(names))
    if more:  # left out of the plan, it would be left out of the score
        raise Wrong(f"set {more[0]} is not in {vault / 'plan.json'}; put the plan back from a copy")
    sets = {name: checked(folder, vault, name, ledger) for name in names}
    sha256, version = one_build(sets)
    seal.enter(vault / seal.LEDGER, folder / seal.HEAD, seal.OPENED, opened_ns=seal.now(), sets=len(sets))
    results = []
    for name, (sealed, truth, given, answer) in sets.items():
        proof = dict(seal=sealed, given_sha256=answer, program_sha256=given["program_sha256"], begun=ledger.begun[name])
        made_again = {key: truth.get(key) for key in ("seed", "drawn_again", "made_by")}
        results.append(dict(judged(truth, given), **made_again, **proof))
    return dict(
        plan=dict(sets=o.sets, seed=o.seed, plant=o.plant),
        program=dict(sha256=sha256, version=version),
        ledger=seal.end_of(vault / seal.LEDGER),
        sets=results,
        totals=totals(results),
    )


def same(truth, robot):
    """(effect, where) of all that is the planted change by another name: the only section is all of them, and a tendon
    that is longer is a motor whose zero is off."""
    effect, where = truth["effect"], truth["where"]
    names = {(effect, where)}
    if where == "all" and effect == "bending_stiffness" and len(robot["sections"]) == 1:
        names.add((effect, "section:1"))
    if effect == "slack":
        names.add(("encoder_offset", where))
    return names


def judged(answer, given):
    truth, robot, report = answer["truth"], answer["robot"], given["report"]
    out = dict(
        id=answer["id"],
        plant=answer["plant"],
        robot=in_words(robot, answer["laboratory"]),
        truth=truth,
        moved_mm=1e3 * answer["moved_m"],
        noise_mm=1e3 * answer["laboratory"]["noise_m"],
        seconds=round((given["finished_ns"] - given["started_ns"]) / 1e9, 1),
    )
    if not report:
        return dict(
            out, verdict="failed", first=None, p=0.0, wrong_p=0.0, named=False, error=given["error"].strip()[-200:]
        )
    names = same(truth, robot)
    causes = [c for c in report["causes"] if c["effect"] not in ("no_gap", "unknown")]
    right = [c for c in causes if (c["effect"], c["where"]) in names]
    wrong = [c for c in causes if (c["effect"], c["where"]) not in names]
    first = causes[0] if causes else None
    established = report["verdict"] in ("attributed", "ambiguous_group")
    return dict(
        out,
        verdict=report["verdict"],
        first=first and {k: first[k] for k in ("effect", "where", "p", "parameters")},
        p=sum(c["p"] for c in right),
        wrong_p=max((c["p"] for c in wrong), default=0.0),
        named=bool(
            established
            and first
            and any(c is first or (first["group"] and c["group"] == first["group"]) for c in right)
        ),
        sentence=report["sentence"],
    )


def in_words(robot, lab):
    disks = "+".join(str(s["disks"]) for s in robot["sections"])
    length = 1e3 * sum(s["length_m"] for s in robot["sections"])
    each = "pairs" if robot["tendons"] == "pairs" else f"{robot['tendons']} tendons"
    return (
        f"{robot['mount']}, {length:.0f} mm, disks {disks}, {each}, frame {lab['frame']}, {len(lab['disks'])} markers"
    )


def tabled(results):
    lines = [
        "`moves`: rms move of the tip by the change, over the markers' noise. `size`: as found over as planted; of a",
        "weight only as far as the file's masses are right.",
        "",
        "| set | plant | robot | truth | moves | verdict, first cause | p | largest wrong p | size | seconds |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in results:
        t, first = r["truth"], r["first"]
        size = "-"
        if r["named"] and (first["effect"], first["where"]) == (t["effect"], t["where"]):
            size = f"{next(iter(first['parameters'].values()))['value']:.3g} / {t['value']:.3g} {t['unit']}".strip()
        said = f"{first['effect']} {first['where']}" if first else "-"
        lines.append(
            f"| {r['id']} | {r['plant']} | {r['robot']} | {t['effect']} {t['where']} | "
            f"{r['moved_mm'] / r['noise_mm']:.1f} | "
            f"{'' if r['named'] else '**not named** '}{r['verdict']}: {said} | {r['p']:.2f} | "
            f"{r['wrong_p']:.2f} | {size} | "
            f"{r['seconds']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def totals(results):
    wrong = sum(r["wrong_p"] > 0.5 for r in results)
    return f"named {sum(r['named'] for r in results)} of {len(results)}, wrong above 0.5: {wrong}"


# ---- command line ----


def whole(text):
    if not (text.isascii() and text.isdecimal() and len(text) < 19):
        raise argparse.ArgumentTypeError(f"'{text}': expected a whole number from 0")
    return int(text)


def options():
    a = argparse.ArgumentParser(
        prog="gap_foreign",
        description=__doc__.partition("\n\n")[0],
        epilog="Exit codes: 0 every set has a report and is scored, whatever came out; 1 a set could not be made or "
        "answered, so that no seal is opened, or a diagnosis failed, or a file could not be read or written; 2 wrong "
        "use or damaged input; 130 stopped by hand.",
    )
    a.add_argument("--sets", type=positive, default=30, help="of the whole campaign (default: %(default)s)")
    a.add_argument("--seed", type=whole, required=True, help="of robots, changes, postures and noise")
    a.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of the campaign; the truth goes into DIR.vault"
    )
    a.add_argument("--tendril", metavar="PATH", help="the program (default: the build's, else that in PATH)")
    a.add_argument("--plant", choices=[*draw.PLANTS, "both"], default="both", help="simulator (default: %(default)s)")
    a.add_argument(
        "--jobs", type=positive, default=os.cpu_count() or 1, metavar="N", help="sets at a time (default: one a core)"
    )
    return a.parse_args()


def main():
    o = options()
    folder, vault = places(o.out)
    may_simulate(plants_of(o))  # refused before anything is made, as what follows
    tendril, version = program(o.tendril)
    kinds = planned(o, folder, vault)
    if make(o, folder, vault, kinds):
        raise RuntimeError("not every set could be made, and nothing is diagnosed before; the same command tries again")
    diagnose(o, folder, vault, tendril, version)
    names = [f"{k:04d}" for k in range(o.sets)]
    missing = [name for name in names if not (folder / "answers" / f"{name}.json").exists()]
    if missing:
        raise RuntimeError(
            f"{len(missing)} of {o.sets} sets without an answer: {seal.listed(missing)}; no seal is opened before "
            "every set has one: mend what is said above, and the same command goes on"
        )
    summary = score(o, folder, vault, names)
    results, line = summary["sets"], summary["totals"]
    (folder / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    (folder / "table.md").write_text(f"{tabled(results)}\n{line}\n")
    print(f"\n{tabled(results)}\n{folder / 'table.md'}\n{line}")
    return 1 if any(r["verdict"] == "failed" for r in results) else 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends it as Ctrl-C does
    try:
        sys.exit(main())
    except Wrong as error:
        fail(error)
    except ModuleNotFoundError as missing:
        fail(f"{sys.executable} has no package {missing.name}; {INSTALL}")
    except (RuntimeError, OSError, KeyError, ValueError) as error:
        fail(error, 1)
    except KeyboardInterrupt:
        fail("stopped; what is done stays, and the same command goes on", 130)
