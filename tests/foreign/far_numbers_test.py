"""A change that one marker sees, so large that it moves the numbers of the robot far from where they were learned: the
body of a one-section robot is 1.54 times as stiff (set 0000 of records/f1.json). Where the posterior of the numbers counts
as a quadratic all the way, the likeliest change is a tilted base. Argument: the program's path."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent / "far_numbers"


def main():
    with tempfile.TemporaryDirectory() as folder:
        robot, map_file = HERE / "robot.yaml", HERE / "map.yaml"
        before, after, report = (str(Path(folder) / name) for name in ("before", "after", "report"))
        for command in (
            ["import", "--robot", robot, "--map", map_file, HERE / "before.csv", "--out", before],
            ["import", "--robot", robot, "--map", map_file, HERE / "after.csv", "--out", after],
            ["diagnose", "--robot", robot, after, "--before", before, "--out", report, "--no-next"],
        ):
            done = subprocess.run([sys.argv[1], "gap", *command], capture_output=True, text=True)
            if done.returncode:
                sys.exit(done.stderr)
        first = json.loads((Path(report) / "report.json").read_text())["causes"][0]
    low, high = first["parameters"]["scale"]["ci"] if "scale" in first["parameters"] else (0, 0)
    if (first["effect"], first["where"]) != ("bending_stiffness", "all") or not low < 1.541 < high or first["p"] < 0.9:
        sys.exit(f"expected bending_stiffness all with a scale of 1.541, not {first}")


main()
