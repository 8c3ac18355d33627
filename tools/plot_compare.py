#!/usr/bin/env python3
"""Draws what `tendril compare` found: reads DIR/compare.json and DIR/*.csv, writes DIR/compare.png.
Knows the columns of the samples and nothing of how they came about."""
import csv
import json
import pathlib
import sys

COLOURS = ["#999999", "#D55E00", "#0072B2", "#009E73", "#CC79A7"]


def samples(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [float(r[name]) if r[name] else float("nan") for r in rows] for name in rows[0]}


def main():
    if len(sys.argv) != 2:
        print("usage: plot_compare.py DIR", file=sys.stderr)
        return 2
    folder = pathlib.Path(sys.argv[1])
    try:
        import matplotlib
        matplotlib.use("Agg")
        import matplotlib.pyplot as plt
        import numpy as np
    except ImportError as e:
        print(f"{e}; install python3-matplotlib, or leave plots out with --no-plots", file=sys.stderr)
        return 1
    try:
        found = json.loads((folder / "compare.json").read_text())
        found["trajectories"] = [t for t in found["trajectories"] if (folder / f"{t['trajectory']}.csv").exists()]
        data = {t["trajectory"]: samples(folder / f"{t['trajectory']}.csv") for t in found["trajectories"]}
    except (OSError, ValueError, KeyError, IndexError) as e:
        print(f"{folder}: {e}; it should be a folder that `tendril compare` wrote", file=sys.stderr)
        return 1
    figure, axes = plt.subplots(len(data), 2, figsize=(11, 3.8 * len(data)), squeeze=False, layout="constrained")
    for (errors, path), trajectory in zip(axes, found["trajectories"]):
        s = data[trajectory["trajectory"]]
        t = np.array(s["t_s"])
        wanted = np.array([s[f"wanted_{a}_m"] for a in "xyz"])
        flat = trajectory["trajectory"] == "planar"
        a, b = (0, 2) if flat else (0, 1)
        path.plot(1e3 * wanted[a], 1e3 * wanted[b], "k--", lw=1, label="wanted")
        # The samples of a comparison of laws are those of its first plant that did not end in a fault.
        runs = trajectory["runs"]
        if "law" in runs[0]:
            runs = [r for r in runs if r["plant"] == runs[0]["plant"] and not r["fault"]]
        laws = list(found.get("laws", []))  # each has its colour, whether or not another ended in a fault
        for i, run in enumerate(runs):
            tip = np.array([s[f"tip_{a}_m_{i + 1}"] for a in "xyz"])
            name = run.get("law") or pathlib.Path(run["controller"]).name + (
                ", on its own plant" if run["role"] == "own_plant" else "")
            colour = COLOURS[(laws.index(run["law"]) if run.get("law") in laws else i) % len(COLOURS)]
            errors.plot(t, 1e3 * np.linalg.norm(tip - wanted, axis=0), color=colour,
                        label=f"{name}: rms {1e3 * run['tip_rms_error_m']:.2f} mm")
            path.plot(1e3 * tip[a], 1e3 * tip[b], color=colour, lw=1)
        errors.set_title(trajectory["description"], fontsize=10)
        errors.set(xlabel="time [s]", ylabel="tip error [mm]", ylim=(0, None))
        errors.legend(fontsize=8)
        path.set(xlabel=f"{'xyz'[a]} [mm]", ylabel=f"{'xyz'[b]} [mm]")
        path.set_title("tip, wanted dashed", fontsize=10)
        path.set_aspect("equal", adjustable="datalim")
        for axis in (errors, path):
            axis.grid(alpha=0.3)
    figure.savefig(folder / "compare.png", dpi=130)
    return 0


if __name__ == "__main__":
    sys.exit(main())
