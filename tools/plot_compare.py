#!/usr/bin/env python3
"""Draws what `tendril compare` found: reads DIR/compare.json and DIR/*.csv, writes DIR/compare.png, .svg and .pdf.
Knows the columns of the samples and nothing of how they came about."""
import csv
import json
import math
import pathlib
import re
import sys
import textwrap

FORMATS = ("png", "svg", "pdf")
UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}  # the same runs give the same files
COLOURS = ["#888888", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]
REFERENCE_LINE = dict(color="#cccccc", linewidth=5, solid_capstyle="butt", zorder=1)


def samples(path):
    with open(path, newline="") as file:
        rows = csv.DictReader(file)
        columns = {name: [] for name in rows.fieldnames or []}
        for row in rows:
            for name in columns:
                columns[name].append(float(row[name]) if row[name] else math.nan)
    return columns


def name_of(run):
    own = ", on its own plant" if run["role"] == "own_plant" else ""
    return run.get("law") or pathlib.Path(run["controller"]).name + own


def reason_of(fault):
    """"fault: too far off at t = 4.59 s (remedy)" -> "too far off"."""
    return re.sub(r"^fault: ", "", re.sub(r" at t = .*$", "", fault))


def look_of(index):
    return dict(color=COLOURS[index % len(COLOURS)], linestyle="-" if index < len(COLOURS) else "--")


def draw_motion(axes, trajectory, columns, order):
    """Errors over time, the tip's path, and a legend of its own beside both, with what ended in a fault. `order`: of the
    names, for their colours."""
    import numpy as np
    errors, path, words = axes
    t = np.array(columns["t_s"])
    reference = np.array([columns[f"wanted_{a}_m"] for a in "xyz"])
    a, b = (0, 2) if trajectory["trajectory"] == "planar" else (0, 1)
    handles, labels = path.plot(1e3 * reference[a], 1e3 * reference[b], **REFERENCE_LINE), ["reference of the tip"]
    # The samples of a comparison of laws are those of its first plant.
    runs = [r for r in trajectory["runs"] if "law" not in r or r["plant"] == trajectory["runs"][0]["plant"]]
    for i, run in enumerate(runs):
        tip = np.array([columns[f"tip_{c}_m_{i + 1}"] for c in "xyz"])
        look = look_of(order.index(name_of(run)))
        error = 1e3 * np.linalg.norm(tip - reference, axis=0)
        line, = errors.plot(t, error, linewidth=1.2, **look)
        path.plot(1e3 * tip[a], 1e3 * tip[b], linewidth=1.1, **look)
        label = f"{name_of(run)}: rms {1e3 * run['tip_rms_error_m']:.2f} mm"
        if run.get("fault"):
            there = np.nonzero(np.isfinite(error))[0]
            label = f"{name_of(run)}: FAULT " + (f"at {t[there[-1]]:.2f} s" if len(there) else "before this part")
            label += "\n" + textwrap.fill(reason_of(run["fault"]), 32)
            for plot, x, y in ((errors, t, error), (path, 1e3 * tip[a], 1e3 * tip[b])):
                plot.plot(x[there[-1:]], y[there[-1:]], color=look["color"], marker="X", markersize=9, zorder=5)
        handles.append(line)
        labels.append(label)
    errors.set_title(trajectory["description"], fontsize=10, loc="left")
    errors.set(xlabel="time [s]", ylabel="tip error [mm]", ylim=(0, None))
    path.set(xlabel=f"{'xyz'[a]} [mm]", ylabel=f"{'xyz'[b]} [mm]")
    path.set_aspect("equal", adjustable="datalim")
    words.axis("off")
    words.legend(handles, labels, loc="upper left", bbox_to_anchor=(-0.1, 1), fontsize=8.5, frameon=False, borderaxespad=0)


def draw_plants(axes, trajectories, order):
    """The tip's rms error of every law on every plant; what ended in a fault stands on a line above all others."""
    from matplotlib.ticker import LogLocator, NullLocator
    ticks, names, worst = [], [], 0.0
    at = {}
    for trajectory in trajectories:
        for run in trajectory["runs"]:
            key = (trajectory["trajectory"], run["plant"])
            if key not in at:
                at[key] = len(at) + sum(1.2 for other in trajectories[:trajectories.index(trajectory)])
                ticks.append(at[key])
                names.append(run["plant"])
            if not run["fault"]:
                worst = max(worst, 1e3 * run["tip_rms_error_m"])
    fault_mm = 3 * (worst or 1)
    for law in order:
        aside = 0.13 * (order.index(law) - (len(order) - 1) / 2)
        for fault, marker in ((False, "o"), (True, "X")):
            points = [(at[t["trajectory"], r["plant"]] + aside, fault_mm if fault else 1e3 * r["tip_rms_error_m"])
                      for t in trajectories for r in t["runs"] if r["law"] == law and bool(r["fault"]) == fault]
            axes.plot(*zip(*points) if points else ([], []), linestyle="none", marker=marker, markersize=5.5,
                      color=look_of(order.index(law))["color"], label=None if fault else law)
    for trajectory in trajectories:
        places = [x for (motion, _), x in at.items() if motion == trajectory["trajectory"]]
        axes.text(sum(places) / len(places), 1.02, trajectory["trajectory"], transform=axes.get_xaxis_transform(),
                  ha="center", va="bottom", fontsize=10)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.axhline(fault_mm, color="#888888", linewidth=0.8, zorder=0)
    axes.text(1.005, fault_mm, "fault", transform=axes.get_yaxis_transform(), va="center", fontsize=9)
    axes.set_ylim(top=1.5 * fault_mm)
    axes.set_xticks(ticks, names, rotation=45, ha="right", fontsize=8.5)
    axes.set_ylabel("tip error, rms [mm]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.005, 0.85), fontsize=8.5, frameon=False)


def draw(found, data):
    from matplotlib.figure import Figure
    motions = found["trajectories"]
    laws = list(found.get("laws", []))  # each has its colour, whether or not another ended in a fault
    order = laws or [name_of(r) for r in motions[0]["runs"]] if motions else []
    several = laws and len({r["plant"] for t in motions for r in t["runs"]}) > 1
    heights = [3.3] * len(motions) + [3.3] * bool(several)
    figure = Figure(figsize=(12.5, sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 3, width_ratios=(5, 3.6, 2.2), height_ratios=heights)
    for i, trajectory in enumerate(motions):
        axes = [figure.add_subplot(grid[i, k]) for k in range(3)]
        draw_motion(axes, trajectory, data[trajectory["trajectory"]], order)
    if several:
        draw_plants(figure.add_subplot(grid[-1, :]), motions, order)
    for a in figure.axes:
        a.grid(color="#e2e2e2", linewidth=0.6)
        a.set_axisbelow(True)
        for side in ("top", "right"):
            a.spines[side].set_visible(False)
    return figure


def main():
    if len(sys.argv) != 2:
        print("usage: plot_compare.py DIR", file=sys.stderr)
        return 2
    folder = pathlib.Path(sys.argv[1])
    try:
        import matplotlib
        matplotlib.use("Agg")
        import numpy  # noqa: F401  before any work is done
    except ImportError as e:
        print(f"{e}; install python3-matplotlib, or leave plots out with --no-plots", file=sys.stderr)
        return 1
    matplotlib.rcParams.update({"svg.hashsalt": "tendril", "pdf.fonttype": 42})
    try:
        found = json.loads((folder / "compare.json").read_text())
        data = {t["trajectory"]: samples(folder / f"{t['trajectory']}.csv") for t in found["trajectories"]}
        figure = draw(found, data)
    except (OSError, ValueError, KeyError, IndexError) as e:
        print(f"{folder}: {e}; it should be a folder that `tendril compare` wrote", file=sys.stderr)
        return 1
    for kind in FORMATS:
        figure.savefig(folder / f"compare.{kind}", dpi=110, metadata=UNDATED.get(kind))
    return 0


if __name__ == "__main__":
    sys.exit(main())
