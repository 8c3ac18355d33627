"""Sealed campaign over two foreign simulators as position-controlled robots: each set is a table of postures before and
one after a withheld change, a column map and a robot file that knows little. `tendril gap diagnose` has to name the
change.

Files in the folder: sets, seals and answers by number; summary.json; table.md. The truth is in the folder beside it
that ends in .vault, hashed before anything is diagnosed and out of the diagnosis's reach (tests/blind/seal.py). What
was made or answered is kept, and the same command goes on."""

import argparse
import contextlib
import importlib
import json
import os
import secrets
import shutil
import signal
import sys
from pathlib import Path

INSTALL = (
    "install tests/foreign/requirements.txt into an environment of its own and name its Python, "
    "PYTHON=.../bin/python tools/gap_foreign ..."
)

try:
    import numpy as np

    from tests.blind import seal
    from tests.foreign import draw, table
    from tools.workers import Task, Workers, Wrong, positive
except ModuleNotFoundError as missing:
    if __name__ != "__main__":
        raise
    sys.exit(print(f"gap_foreign: {sys.executable} has no package {missing.name}; {INSTALL}", file=sys.stderr) or 2)

ROOT = Path(__file__).resolve().parents[2]
MODULES = dict(cable="tests.foreign.mujoco_cable", elastica="tests.foreign.elastica_rod")
PACKAGES = dict(cable="mujoco", elastica="pyelastica")  # as pip names them
FEWEST, MOST = 100, 150  # postures of a table
LOOKED_AT = 25  # of those after the change, for how far it moves the tip
TIMEOUT_S = 3600
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


def planned(o, folder, vault):
    """(plant, change) of every set; what is interrupted goes on with the plan that was made."""
    for d in (folder / "sets", folder / "seals", folder / "answers", vault):
        d.mkdir(parents=True, exist_ok=True)
    vault.chmod(0o700)
    with contextlib.suppress(FileExistsError):
        seal.write_once(folder / "vault", f"{vault.resolve()}\n")
    kinds = draw.kinds_of(o.sets, plants_of(o), np.random.default_rng(o.seed))
    plan = dict(sets=o.sets, seed=o.seed, plant=o.plant, kinds=kinds)
    path = vault / "plan.json"
    with contextlib.suppress(FileExistsError):
        seal.write_once(path, json.dumps(plan))
    begun = json.loads(path.read_text())
    for key in ("sets", "seed", "plant"):
        if begun[key] != plan[key]:
            raise Wrong(
                f"--{key} {plan[key]}: this campaign was begun with {begun[key]}; repeat that, or name another "
                "folder with --out"
            )
    return begun["kinds"]


# ---- make ----


def make(o, folder, vault, kinds):
    """Sets that could not be made."""
    how = dict(folder=str(folder), vault=str(vault), seed=o.seed)
    tasks = [
        Task(f"{k:04d}", make_one, (how, k, *kind))
        for k, kind in enumerate(kinds)
        if not (folder / "seals" / f"{k:04d}.json").exists()
    ]
    lost = []
    with seal.planning(folder, "make"), Workers(o.jobs) as workers:
        for done in workers.results(tasks):
            if isinstance(done.error, (Wrong, ModuleNotFoundError)):
                raise done.error
            if done.error:
                lost.append(done.task.name)
            print(
                f"{done.task.name}: " + (f"not made: {done.error}" if done.error else f"sealed {done.value[:16]}"),
                flush=True,
            )
    return lost


def make_one(how, number, plant, change):
    """A task: draws, simulates and seals one set; the SHA-256 of its answer."""
    folder, vault, name = Path(how["folder"]), Path(how["vault"]), f"{number:04d}"
    data = folder / "sets" / name
    shutil.rmtree(data, ignore_errors=True)
    data.mkdir()
    answer = made(data, np.random.default_rng([how["seed"], number]), plant, change)
    answer.update(
        id=name, plant=plant, seed=[how["seed"], number], data_sha256=seal.digest(data), nonce=secrets.token_hex(32)
    )
    text = json.dumps(answer, indent=1) + "\n"
    (vault / f"{name}.json").unlink(missing_ok=True)
    seal.write_once(vault / f"{name}.json", text)
    sealed = dict(
        id=name, answer_sha256=seal.sha(text.encode()), data_sha256=answer["data_sha256"], sealed_ns=seal.now()
    )
    seal.write_once(folder / "seals" / f"{name}.json", json.dumps(sealed) + "\n")
    return sealed["answer_sha256"]


def made(data, rng, plant, change):
    """Writes one set's files; what was planted."""
    simulate = importlib.import_module(MODULES[plant]).postures
    robot = draw.robot(rng)
    what = draw.change(robot, change, rng)
    lab = table.laboratory(robot, rng)
    before, after = (draw.postures(robot, rng, int(rng.integers(FEWEST, MOST + 1))) for _ in range(2))
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


def diagnose(o, folder, vault):
    """Asks of every sealed set without an answer; names of those that gave none."""
    tendril, threads = program(o.tendril), max(1, (os.cpu_count() or 1) // o.jobs)
    command = [shutil.which("sh"), "-c", ASK, tendril, "{set}", "{out}", str(threads)]
    seal.confined(vault, folder)  # refused before anything is begun
    facts = dict(program_sha256=seal.sha(Path(tendril).read_bytes()))
    sealed = [path.name for path in sorted((folder / "seals").glob("*.json"))]
    tasks = [Task(name[:-5], seal.run_sealed, ()) for name in sealed if not (folder / "answers" / name).exists()]
    lost = []
    with seal.planning(folder, "diagnose"), Workers(o.jobs) as workers:
        for done in workers.results(tasks, lambda task: begun(task, folder, vault, command, facts)):
            if done.error:
                lost.append(done.task.name)
                print(f"{done.task.name}: not answered: {done.error}", flush=True)
            else:
                write_answer(folder, vault, done.task.name, *done.value, facts)
    for claim in (folder / "answers").glob(".????.*"):
        claim.unlink()
    return lost


def begun(task, folder, vault, command, facts):
    """Written down before the program runs, so that nobody looks at what it finds and begins anew without a trace."""
    sealed, data = seal.seal_of(folder, task.name), folder / "sets" / task.name
    if seal.digest(data) != sealed["data_sha256"]:
        raise Wrong(f"{data}: not the sealed data; put them back from a copy")
    what = dict(begun_ns=seal.now(), seal_sha256=seal.seal_sha(sealed), **facts)
    seal.enter(vault / seal.LEDGER, folder / seal.HEAD, task.name, **what)
    claim = folder / "answers" / f".{task.name}.{secrets.token_hex(8)}"
    shell_sha256 = seal.sha(Path(command[0]).read_bytes())
    return task._replace(arguments=(str(data), command, shell_sha256, str(vault), str(folder), str(claim), TIMEOUT_S))


def program(given):
    for place in [given] if given else [ROOT / "build" / "release" / "bin" / "tendril", shutil.which("tendril")]:
        if place and os.access(place, os.X_OK) and not os.path.isdir(place):
            return str(Path(place).resolve())
    raise Wrong(
        f"no tendril program{f' at {given}' if given else ''}; build it (tools/setup) or name it with --tendril FILE"
    )


def write_answer(folder, vault, name, report, run, how, facts):
    if run["exit_code"] in seal.WRONG_USE:
        said = (run["error"].strip().splitlines() or ["it said nothing"])[-1]
        raise Wrong(
            f"set {name}: the program was called wrongly, exit code {run['exit_code']}: {said}; nothing was answered"
        )
    text = json.dumps(dict(id=name, report=report, **run, **how, **facts)) + "\n"
    seal.write_once(folder / "answers" / f"{name}.json", text)
    seal.enter(vault / seal.LEDGER, folder / seal.HEAD, name, sha256=seal.sha(text.encode()))
    said = report["verdict"] if report else f"failed: {run['error'].strip()[-200:] or run['exit_code']}"
    print(f"{name}: {said}, {(run['finished_ns'] - run['started_ns']) / 1e9:.0f} s", flush=True)


# ---- score ----


def score(folder, vault):
    """Opens the seals of what was answered: a dictionary a set."""
    results = []
    for path in sorted((folder / "answers").glob("[0-9]*.json")):
        sealed, text = seal.seal_of(folder, path.stem), (vault / path.name).read_text()
        if seal.sha(text.encode()) != sealed["answer_sha256"]:
            raise Wrong(f"{vault / path.name}: not the sealed answer; put it back from a copy")
        given, answer = json.loads(path.read_text()), json.loads(text)
        if given["started_ns"] < sealed["sealed_ns"]:
            raise Wrong(f"{path}: answered before it was sealed; make the campaign anew")
        results.append(judged(answer, given))
    seal.enter(vault / seal.LEDGER, folder / seal.HEAD, seal.OPENED, opened_ns=seal.now(), sets=len(results))
    return results


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


def totals(results, sets):
    wrong = sum(r["wrong_p"] > 0.5 for r in results)
    missing = f" ({sets - len(results)} without an answer)" if len(results) < sets else ""
    return f"named {sum(r['named'] for r in results)} of {sets}{missing}, wrong above 0.5: {wrong}"


# ---- command line ----


def whole(text):
    if not (text.isascii() and text.isdecimal() and len(text) < 19):
        raise argparse.ArgumentTypeError(f"'{text}': expected a whole number from 0")
    return int(text)


def options():
    a = argparse.ArgumentParser(
        prog="gap_foreign",
        description=__doc__.partition("\n\n")[0],
        epilog="Exit codes: 0 every set has an answer, whatever came out; 1 not; 2 wrong use; 130 stopped by hand.",
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
    folder = o.out.absolute()
    if folder.exists() and not folder.is_dir():
        raise Wrong(f"--out {o.out}: is a file; name a folder")
    vault = folder.with_name(folder.name + ".vault")
    program(o.tendril)  # refused before anything is made
    may_simulate(plants_of(o))
    seal.may_be_vault(vault, folder)
    kinds = planned(o, folder, vault)
    lost = make(o, folder, vault, kinds) + diagnose(o, folder, vault)
    results = score(folder, vault)
    line = totals(results, o.sets)
    (folder / "summary.json").write_text(
        json.dumps(dict(sets=results, totals=line, not_answered=sorted(set(lost))), indent=1) + "\n"
    )
    (folder / "table.md").write_text(f"{tabled(results)}\n{line}\n")
    print(f"\n{tabled(results)}\n{folder / 'table.md'}\n{line}")
    return 1 if lost or any(r["verdict"] == "failed" for r in results) else 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends it as Ctrl-C does
    try:
        sys.exit(main())
    except Wrong as error:
        sys.exit(print(f"gap_foreign: {error}", file=sys.stderr) or 2)
    except ModuleNotFoundError as missing:
        sys.exit(print(f"gap_foreign: {sys.executable} has no package {missing.name}; {INSTALL}", file=sys.stderr) or 2)
    except (RuntimeError, OSError, KeyError, ValueError) as error:
        print(f"gap_foreign: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("gap_foreign: stopped; what is done stays, and the same command goes on", file=sys.stderr)
        sys.exit(130)
