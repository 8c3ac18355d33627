#!/usr/bin/python3 -B
"""Published measurements of a real robot through import and diagnosis, as tools/gap_real does it; without the data only
that it says so. Exit status 77: the rest was skipped."""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
TOOL = ROOT / "tools" / "gap_real"


def gap_real(*arguments):
    return subprocess.run([sys.executable, "-B", TOOL, *arguments], capture_output=True, text=True)


def check(condition, what):
    if not condition:
        sys.exit(f"gap_real_test: {what}")


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
    if not (data / "opencr_tdcr").is_dir():
        print(f"skipped: no opencr_tdcr in {data}; TENDRIL_REAL_DATA names the folder")
        sys.exit(77)
    done = gap_real("--data", data, "--out", out, "--sets", "opencr_v4", "--tendril", sys.argv[1])
    check(done.returncode == 0, done.stderr)
    (v4,) = json.loads((pathlib.Path(out) / "summary.json").read_text())
    # 270 mm across, a robot that repeats itself to 4 mm: drawing, frame and statics bring its tip within a centimetre.
    check(v4["all"]["before_m"] < 0.010, f"tip error {v4['all']['before_m']}")
    check(0.002 < v4["all"]["floor_m"] < 0.008, f"floor {v4['all']['floor_m']}")
    check(v4["where"] == "C4", v4["where"])
    # Friction, creep and wrong numbers cannot be told apart from positions alone: no single cause is named.
    check(v4["verdict"] in ("unexplained", "ambiguous_group"), v4["sentence"])
    check(v4["held_out"] and v4["held_out"]["runs"] > 10, f"held out: {v4['held_out']}")
    told = "\n".join(v4["degradations"])
    for what in ("no load cell and no torque", "frame is unknown", "at rest at each row", "no orientation"):
        check(what in told, f"'{what}' is not in {told}")
