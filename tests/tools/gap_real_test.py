#!/usr/bin/python3 -B
"""Published measurements of real robots through import and diagnosis, as tools/gap_real does it: one of the shorter sets,
and one without runs from before; after the program's path, `--all` asks for every set (the trunk's tables, shortened, are in
docs/guides/table-to-cause.md). Without the data only that it says so. Exit status 77: the rest was skipped."""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
TOOL = ROOT / "tools" / "gap_real"
TRUNK = ["trunk_a", "trunk_b", "trunk_c"]


def gap_real(*arguments):
    return subprocess.run([sys.executable, "-B", TOOL, *arguments], capture_output=True, text=True)


def check(condition, what):
    if not condition:
        sys.exit(f"gap_real_test: {what}")


def held_out_by_calibrate(program, runs, out):
    """Of each disk, in mm; the new file is read back."""
    robot, better, found = ROOT / "config" / "import" / "trunk_payload.yaml", f"{out}/better.yaml", f"{out}/found.json"
    for command in (["gap", "calibrate", "--robot", robot, runs, "--out", better, "--json", found], ["config", "check", better]):
        done = subprocess.run([program, *command], capture_output=True, text=True)
        check(done.returncode == 0, done.stderr)
    channels = json.loads(pathlib.Path(found).read_text())["channels"]
    return [1e3 * sum(c["held_out"] ** 2 for c in channels[i:i + 3]) ** 0.5 for i in range(0, len(channels), 3)]


def diagnosed(program, data, out, names):
    """The summary's sets by name."""
    done = gap_real("--data", data, "--out", out, "--tendril", program, "--sets", ",".join(names))
    check(done.returncode == 0, done.stderr)
    return {s["name"]: s for s in json.loads((pathlib.Path(out) / "summary.json").read_text())["sets"]}


def check_trunk(sets, floor_mm):
    """One change, the same in all runs, and no other beside it."""
    first = []
    for name, found in sets.items():
        cause, *others = found["causes"]
        first.append((cause["effect"], cause["where"]))
        check(cause["p"] >= 0.9 and all(c["p"] < 0.05 for c in others), f"{name}: {found['causes'][:3]}")
        check(found["verdict"] == "attributed", found["sentence"])
        # Where it was not fitted, the learned robot is some millimetres off, of 60 to 80 that it moves.
        floor = found["floor_mm_by_disk"]
        check(all(x <= y for x, y in zip(floor, floor_mm)), f"held out: {floor}")
    check(set(first) == {("tip_payload", "all")}, f"causes: {first}")


def check_validation(sets, most_mm):
    """Its authors' own validation runs: the robot learned from the others explains most of what the file leaves."""
    for name, most in most_mm.items():
        errors = sets[name]["held_out_rms_mm"]
        check(errors["calibrated"] < most < errors["nominal"], f"{name}: {errors}")
        named = [c for c in sets[name]["causes"] if c["effect"] not in ("no_gap", "unknown") and c["p"] > 0.5]
        check(not named, f"{name}: {named}")


def check_calibrate(program, found, runs, out):
    calibrated, floor = held_out_by_calibrate(program, runs, out), found["floor_mm_by_disk"]
    check(all(abs(x - y) < 1e-3 for x, y in zip(calibrated, floor)), f"held out: {calibrated}, {floor}")


def check_alone(program, data, out):
    """270 mm across, a robot that repeats itself to 4 mm: drawing, frame and statics bring its tip within a centimetre."""
    alone = diagnosed_alone(program, data, out)
    axes = [c for c in alone["closed"]["channels"].values() if c["channel"].startswith("tip") and c["unit"] == "m"]
    before, floor = (sum(c[key] ** 2 for c in axes) ** 0.5 for key in ("before", "floor"))
    check(before < 0.010, f"tip error {before}")
    check(0.002 < floor < 0.008, f"floor {floor}")
    check(next(place for place in alone["location"] if place["first"])["cut"] == "C4", alone["location"])
    # Friction, creep and wrong numbers cannot be told apart from positions alone: no single cause is named.
    check(alone["verdict"] in ("unexplained", "ambiguous_group"), alone["sentence"])
    families = {f["family"]: f for f in alone["closed"]["families"]}
    check(families["all"]["runs"] > 10, f"held out: {families}")
    told = "\n".join(alone["degradations"])
    for what in ("no load cell and no torque", "frame is unknown", "at rest at each row", "no orientation"):
        check(what in told, f"'{what}' is not in {told}")


def diagnosed_alone(program, data, out):
    """The report of a table of states at rest with nothing from before to compare it with."""
    runs, report, maps = f"{out}/alone", f"{out}/alone_report", ROOT / "config" / "import"
    tables = [data / "opencr_tdcr" / f"v4_{part}.csv" for part in ("train", "val")]
    for command in (["import", "--robot", maps / "opencr_tdcr_v4.yaml", "--map", maps / "opencr_tdcr_v4_map.yaml", *tables,
                     "--out", runs],
                    ["diagnose", "--robot", f"{runs}/robot.yaml", runs, "--out", report, "--no-next", "--refits", "6"]):
        done = subprocess.run([program, "gap", *command], capture_output=True, text=True)
        check(done.returncode == 0, done.stderr)
    return json.loads((pathlib.Path(report) / "report.json").read_text())


with tempfile.TemporaryDirectory() as out:
    absent = gap_real("--data", f"{out}/none", "--out", out)
    check(absent.returncode == 77 and len(absent.stderr.strip().splitlines()) == 1, f"no data: {absent}")
    check("--data" in absent.stderr, f"no remedy: {absent.stderr}")
    wrong = gap_real("--sets", "opencr_v5", "--out", out)
    check(wrong.returncode == 2 and "opencr_v4" in wrong.stderr, f"wrong set: {wrong}")
    for words, why in ((["--sets", ","], "names none"), (["--refits", "0"], "1 and more"), (["--out", __file__], "is a file")):
        wrong = gap_real("--out", out, *words)
        check(wrong.returncode == 2 and why in wrong.stderr, f"{words}: {wrong}")

    data = pathlib.Path(os.environ.get("TENDRIL_REAL_DATA", ROOT / ".." / "shared" / "real"))
    if not all((data / name).is_dir() for name in ("opencr_tdcr", "trunk_payload")):
        print(f"skipped: no opencr_tdcr and trunk_payload in {data}; TENDRIL_REAL_DATA names the folder")
        sys.exit(77)
    program, every = sys.argv[1], "--all" in sys.argv[2:]
    if every:
        sets = diagnosed(program, data, out, TRUNK + ["trunk_null", "opencr_v4", "opencr_v6"])
        check_trunk({name: sets[name] for name in TRUNK}, (1.6, 4.1, 7.2))
        check(sets["trunk_null"]["verdict"] == "no_gap", sets["trunk_null"]["sentence"])
        check_validation(sets, {"opencr_v4": 6, "opencr_v6": 16})
        check_calibrate(program, sets["trunk_a"], f"{out}/trunk_a/before/runs", out)
    else:
        check_validation(diagnosed(program, data, out, ["opencr_v4"]), {"opencr_v4": 6})
    check_alone(program, data, out)
