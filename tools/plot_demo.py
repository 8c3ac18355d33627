#!/usr/bin/env python3
"""Draws what `tendril demo` recorded: reads DIR/samples.csv and DIR/summary.json, writes DIR/*.png.
Knows the columns of the samples and nothing of how they came about."""
import argparse
import json
import math
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
# One colour a role in every picture: what was wanted is black, what happened blue, what the controller believes orange.
WANTED, TRUE, BELIEVED, IDEAL = "#000000", "#0072B2", "#E69F00", "#009E73"
TENDONS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7F3C8D", "#666666"]


class Failure(Exception):
    """One line for the user."""


def version():
    """The project's version, as the build has it."""
    found = re.search(r"project\(tendril VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text()) \
        if (ROOT / "CMakeLists.txt").exists() else None
    return found.group(1) if found else "unknown"


class Run:
    """The samples of one motion by column name, with what several pictures need."""

    def __init__(self, folder):
        import numpy as np
        self.folder = folder
        try:
            self.summary = json.loads((folder / "summary.json").read_text())
            lines = (folder / "samples.csv").read_text().splitlines()
        except OSError as e:
            raise Failure(f"{e.filename}: {e.strerror}; it should be a folder that `tendril demo` wrote") from e
        except json.JSONDecodeError as e:
            raise Failure(f"{folder / 'summary.json'}: not JSON (line {e.lineno}); run the demo again") from e
        if len(lines) < 3:
            raise Failure(f"{folder / 'samples.csv'}: fewer than two samples; run the demo again")
        names = lines[0].split(",")
        rows = []
        for number, line in enumerate(lines[1:], 2):
            fields = line.split(",")
            try:
                if len(fields) != len(names):
                    raise ValueError
                rows.append([float(f) if f else math.nan for f in fields])
            except ValueError as e:
                raise Failure(f"{folder / 'samples.csv'}:{number}: not {len(names)} numbers; run the demo again") from e
        self.columns = dict(zip(names, np.array(rows).T))
        self.t = self["t_s"]
        self.sections = [s for s in ("", "_1", "_2", "_3", "_4") if f"us_desired_rad{s}" in self.columns]
        self.tendons = 0
        while f"tension_measured_N_{self.tendons + 1}" in self.columns:
            self.tendons += 1
        moves = np.nonzero(np.abs(np.diff(self.tip("target"), axis=1)).sum(axis=0) > 0)[0]
        # Until the target moves the robot is only brought to the beginning of the motion.
        self.start = self.t[moves[0]] if len(moves) else self.t[0]
        self.moving = (self.t >= self.start) & (self.t <= (self.t[moves[-1]] if len(moves) else self.t[-1]))

    def __getitem__(self, name):
        if name not in self.columns:
            raise Failure(f"{self.folder / 'samples.csv'}: no column {name}; written by another version of the demo?")
        return self.columns[name]

    def tip(self, what):
        """3 rows (x, y, z in metres) of target, true or estimate."""
        import numpy as np
        return np.array([self[f"tip_{what}_{a}_m"] for a in "xyz"])

    def figure(self, key):
        """A number of the summary, NaN when it has none."""
        value = self.summary.get(key)
        return float(value) if isinstance(value, (int, float)) else math.nan

    def name(self):
        return {"circle": "Circle", "planar": "Planar bend"}.get(self.summary.get("trajectory"),
                                                                 str(self.summary.get("trajectory", self.folder.name)))

    def friction_model(self):
        return "with friction compensation" if self.summary.get("compensation") else "without friction compensation"


def new_figure(width, height, rows, columns=1, sharex=True, **margins):
    from matplotlib.figure import Figure
    figure = Figure(figsize=(width, height), dpi=100)
    axes = figure.subplots(rows, columns, squeeze=False, sharex="col" if sharex else False)
    figure.subplots_adjust(**{**dict(left=0.09, right=0.98, top=0.9, bottom=0.09, hspace=0.12, wspace=0.22), **margins})
    for a in axes.flat:
        a.grid(True, color="#dddddd", linewidth=0.6)
        a.set_axisbelow(True)
        for side in ("top", "right"):
            a.spines[side].set_visible(False)
    return figure, axes


def shade_approach(axes, run):
    """Greys the time before the motion; the first panel says so."""
    for i, a in enumerate(axes.flat):
        a.axvspan(run.t[0], run.start, color="#f0f0f0", zorder=0, label="approach" if i == 0 else None)
        a.set_xlim(run.t[0], run.t[-1])


def tip_path(run):
    import numpy as np
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D  # noqa: F401  registers the projection
    figure = Figure(figsize=(7.2, 6.2), dpi=100)
    a = figure.add_subplot(projection="3d")
    figure.subplots_adjust(left=0, right=0.95, bottom=0.02, top=0.92)
    target, true = run.tip("target") * 1e3, run.tip("true") * 1e3
    before = run.t <= run.start
    a.plot(*true[:, before], color=TRUE, alpha=0.35, linewidth=1.2, label="tip, approach")
    a.plot(*target[:, run.moving], color=WANTED, linestyle=(0, (4, 2)), linewidth=1.8, label="wanted")
    a.plot(*true[:, run.moving], color=TRUE, linewidth=1.4, label="tip")
    a.scatter([0], [0], [0], color="#666666", marker="s", s=30, label="base")
    everything = np.hstack([target[:, run.moving], true, [[0], [0], [0]]])
    low, high = np.nanmin(everything, axis=1), np.nanmax(everything, axis=1)
    span = np.maximum(high - low, 0.4 * (high - low).max())  # a plane motion keeps some depth
    middle = (high + low) / 2
    for axis, m, s, set_limits in zip("xyz", middle, span, (a.set_xlim, a.set_ylim, a.set_zlim)):
        set_limits(m - 0.55 * s, m + 0.55 * s)
        getattr(a, f"set_{axis}label")(f"{axis} [mm]")
    a.set_box_aspect(span, zoom=0.88)
    a.view_init(elev=24, azim=-58)
    a.legend(loc="upper left", frameon=False)
    figure.suptitle(f"{run.name()}: the tip keeps {run.figure('tip_rms_error_m') * 1e3:.2f} mm (rms) "
                    f"from the path wanted,\n{run.friction_model()}")
    return figure


def tip_axes(run):
    import numpy as np
    figure, axes = new_figure(9, 7.6, 4)
    target, true, believed = (run.tip(w) * 1e3 for w in ("target", "true", "estimate"))
    for i, name in enumerate("xyz"):
        a = axes[i, 0]
        a.plot(run.t, target[i], color=WANTED, linestyle="--", linewidth=1.6, label="wanted", zorder=4)
        a.plot(run.t, true[i], color=TRUE, label="tip")
        a.plot(run.t, believed[i], color=BELIEVED, linewidth=1, label="controller's estimate")
        a.set_ylabel(f"{name} [mm]")
        low, high = a.get_ylim()
        if high - low < 2:  # noise is not to look like motion
            a.set_ylim((low + high) / 2 - 1, (low + high) / 2 + 1)
    a = axes[3, 0]
    error = np.linalg.norm(true - target, axis=0)
    a.plot(run.t, error, color=TRUE, label="tip")
    a.plot(run.t, np.linalg.norm(believed - target, axis=0), color=BELIEVED, linewidth=1, label="estimate")
    if run.moving.any():
        a.set_ylim(0, 1.25 * np.nanmax(error[run.moving]) or 1)
    a.set_ylabel("distance to\nwanted [mm]")
    a.set_xlabel("time [s]")
    shade_approach(axes, run)
    axes[0, 0].legend(ncol=4, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    figure.suptitle(f"{run.name()}, tip by axis: error {run.figure('tip_rms_error_m') * 1e3:.2f} mm rms, "
                    f"{run.figure('tip_max_error_m') * 1e3:.2f} mm at most", x=0.09, ha="left")
    return figure


def bending(run):
    import numpy as np
    n = len(run.sections)
    figure, axes = new_figure(9, 3 + 2.6 * n, 2 * n, top=0.86 if n == 1 else 0.92)
    for k, suffix in enumerate(run.sections):
        which = "" if n == 1 else f"section {k + 1}: "
        for what, color, style, label in (("desired", WANTED, "--", "desired"), ("true", TRUE, "-", "true"),
                                          ("estimate", BELIEVED, "-", "estimated")):
            u, v = run[f"us_{what}_rad{suffix}"], run[f"vs_{what}_rad{suffix}"]
            angle = np.hypot(u, v)
            plane = np.arctan2(v, u)
            bent = angle > 0.05  # a straight robot has no bending plane
            # Continuous where it is defined, and within one turn of zero at the beginning of the motion.
            plane[bent] = np.unwrap(plane[bent])
            plane[~bent] = np.nan
            order = 5 if what == "desired" else 3
            axes[2 * k, 0].plot(run.t, angle, color=color, linestyle=style, label=label, zorder=order,
                                linewidth=1.6 if what == "desired" else 1.2)
            axes[2 * k + 1, 0].plot(run.t, plane, color=color, linestyle=style, zorder=order,
                                    linewidth=1.6 if what == "desired" else 1.2)
        axes[2 * k, 0].set_ylabel(f"{which}bending\nangle [rad]")
        axes[2 * k + 1, 0].set_ylabel(f"{which}bending-\nplane angle [rad]")
        low, high = axes[2 * k + 1, 0].get_ylim()
        if high - low < 0.5:
            axes[2 * k + 1, 0].set_ylim((low + high) / 2 - 0.25, (low + high) / 2 + 0.25)
    axes[-1, 0].set_xlabel("time [s]")
    shade_approach(axes, run)
    axes[0, 0].legend(ncol=4, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    worst = 0.0
    for s in run.sections:
        u = run[f"us_true_rad{s}"] - run[f"us_desired_rad{s}"]
        v = run[f"vs_true_rad{s}"] - run[f"vs_desired_rad{s}"]
        worst = max(worst, float(np.nanmax(np.hypot(u, v)[run.moving])) if run.moving.any() else 0.0)
    figure.suptitle(f"{run.name()}: bending follows within {worst * 1e3:.0f} mrad", x=0.09, ha="left")
    return figure


def displacements(run):
    import numpy as np
    figure, axes = new_figure(9, 6, 2, left=0.105)
    worst = 0.0
    for j in range(run.tendons):
        wanted, measured, true = (run[f"displacement_{w}m_{j + 1}"] * 1e3 for w in ("desired_", "", "true_"))
        color = TENDONS[j % len(TENDONS)]
        axes[0, 0].plot(run.t, wanted, color=color, linestyle="--", linewidth=1.6)
        axes[0, 0].plot(run.t, measured, color=color, label=f"tendon {j + 1}")
        axes[1, 0].plot(run.t, measured - wanted, color=color)
        axes[1, 0].plot(run.t, true - wanted, color=color, linestyle=":", linewidth=1.4)
        worst = max(worst, float(np.nanmax(np.abs(measured - true)[run.moving])) if run.moving.any() else 0.0)
    axes[0, 0].set_ylabel("tendon displacement [mm]\n(dashed: desired)")
    axes[1, 0].set_ylabel("less desired [mm]\n(dotted: in the robot)")
    axes[1, 0].set_xlabel("time [s]")
    shade_approach(axes, run)
    axes[0, 0].legend(ncol=run.tendons + 1, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    figure.suptitle(f"{run.name()}: tendons stretch, motor and robot differ by up to {worst:.2f} mm", x=0.09, ha="left")
    return figure


def tensions(run):
    import numpy as np
    figure, axes = new_figure(9, 1.6 + 2.1 * run.tendons, run.tendons, top=1 - 0.8 / (1.6 + 2.1 * run.tendons),
                              bottom=0.5 / (1.6 + 2.1 * run.tendons))
    for j in range(run.tendons):
        a, n = axes[j, 0], j + 1
        a.plot(run.t, run[f"tension_measured_N_{n}"], color=BELIEVED, linewidth=2.6, alpha=0.6, label="load cell (motor side)")
        a.plot(run.t, run[f"tension_desired_motor_N_{n}"], color=WANTED, linestyle="--", linewidth=1.1,
               label="commanded, motor side")
        a.plot(run.t, run[f"tension_desired_base_N_{n}"], color=IDEAL, linestyle="--", linewidth=1.8,
               label="ideal, robot base", zorder=5)
        a.plot(run.t, run[f"tension_base_true_N_{n}"], color=TRUE, linewidth=1.2, label="true, robot base")
        a.set_ylabel(f"tendon {n}\ntension [N]")
        a.set_ylim(bottom=min(0, float(np.nanmin(run[f"tension_measured_N_{n}"]))))
    axes[-1, 0].set_xlabel("time [s]")
    shade_approach(axes, run)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, ncol=5, loc="upper left", bbox_to_anchor=(0.08, 1 - 0.32 / (1.6 + 2.1 * run.tendons)),
                  frameon=False, fontsize=9, columnspacing=1.2, handlelength=1.6)
    figure.suptitle(f"{run.name()}, tensions {run.friction_model()}: the base misses its ideal by "
                    f"{run.figure('base_tension_error_rms_N'):.3f} N rms", x=0.09, ha="left",
                    y=1 - 0.06 / (1.6 + 2.1 * run.tendons), va="top")
    return figure


def friction_loss(run):
    figure, axes = new_figure(10, 4.6, 1, 2, sharex=False, bottom=0.13, top=0.84, left=0.085)
    over_time, over_tension = axes[0]
    for j in range(run.tendons):
        base, motor = run[f"tension_base_true_N_{j + 1}"], run[f"tension_motor_true_N_{j + 1}"]
        color = TENDONS[j % len(TENDONS)]
        over_time.plot(run.t, motor - base, color=color, label=f"tendon {j + 1}")
        expected = run[f"tension_desired_motor_N_{j + 1}"] - run[f"tension_desired_base_N_{j + 1}"]
        over_time.plot(run.t, expected, color=color, linestyle="--", linewidth=1)
        over_tension.plot(base[run.moving], (motor - base)[run.moving], color=color, linewidth=1.1)
    over_time.axvspan(run.t[0], run.start, color="#f0f0f0", zorder=0, label="approach")
    over_time.set_xlim(run.t[0], run.t[-1])
    over_time.set_xlabel("time [s]")
    over_time.set_ylabel("motor side less robot side [N]\n(dashed: compensated)")
    over_tension.set_xlabel("tension at the robot's base [N]")
    over_tension.set_ylabel("motor side less robot side [N]")
    for a in (over_time, over_tension):
        a.axhline(0, color="#888888", linewidth=0.8)
    low, high = over_tension.get_ylim()
    over_tension.text(0.03, 0.95, "pulled: the motor must do more", transform=over_tension.transAxes, va="top",
                      color="#555555")
    if low < 0 < high:
        over_tension.text(0.03, 0.05, "released: friction holds for the motor", transform=over_tension.transAxes,
                          color="#555555")
    over_time.legend(ncol=run.tendons + 1, loc="lower left", bbox_to_anchor=(0, 1), frameon=False, fontsize=9)
    figure.suptitle(f"{run.name()}: guide pulleys take {run.figure('friction_loss_mean_N'):.2f} N in the mean, "
                    f"{run.figure('friction_loss_max_N'):.2f} N at most, and change sign with the direction",
                    x=0.085, ha="left")
    return figure


PICTURES = {f.__name__: f for f in (tip_path, tip_axes, bending, displacements, tensions, friction_loss)}


def main():
    parser = argparse.ArgumentParser(prog="plot_demo.py", description="Draws what `tendril demo` recorded.")
    parser.add_argument("folders", nargs="+", metavar="DIR", type=pathlib.Path,
                        help="a folder of the demo with samples.csv and summary.json; the pictures go there too")
    parser.add_argument("--version", action="version", version=f"plot_demo.py {version()}")
    folders = parser.parse_args().folders
    try:
        import matplotlib
    except ImportError:
        raise Failure("no matplotlib for this Python: sudo apt-get install python3-matplotlib") from None
    matplotlib.use("Agg")
    matplotlib.rcParams.update({"font.size": 10, "axes.titlesize": 11, "figure.titlesize": 12, "lines.linewidth": 1.3,
                                "path.simplify_threshold": 0.5})
    for folder in folders:
        run = Run(folder)
        for name, draw in PICTURES.items():
            target = folder / f"{name}.png"
            try:
                draw(run).savefig(target)
            except OSError as e:
                raise Failure(f"cannot write {target}: {e.strerror}") from e


if __name__ == "__main__":
    try:
        main()
    except Failure as failure:
        print(f"plot_demo.py: {failure}", file=sys.stderr)
        sys.exit(1)
