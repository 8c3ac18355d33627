#!/usr/bin/env python3
"""Draws what `tendril demo` recorded: reads DIR/samples.csv and DIR/summary.json, writes DIR/*.png, *.svg and *.pdf.
Knows the columns of the samples and nothing of how they came about."""
import argparse
import json
import math
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
FORMATS = ("png", "svg", "pdf")
UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}  # the same run gives the same files
# One look a role in every picture. A reference is wide and pale and lies below; the truth is thin and whole; what the
# controller measures or estimates is dotted and lies above, so that the truth shows through it.
TRUE, BELIEVED, IDEAL = "#0072B2", "#D55E00", "#009E73"
REFERENCE_LINE = dict(color="#b9b9b9", linewidth=4, solid_capstyle="butt", zorder=2)
IDEAL_LINE = dict(color="#93d3bd", linewidth=4, solid_capstyle="butt", zorder=2)
TRUE_LINE = dict(color=TRUE, linewidth=1.3, zorder=4)
BELIEVED_LINE = dict(color=BELIEVED, linewidth=1.3, linestyle=(0, (1.2, 2.2)), zorder=5)


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
        self.disks = 0
        while f"disk_x_m_{self.disks + 1}" in self.columns:
            self.disks += 1
        self.moving = (self.t >= self.start) & (self.t <= (self.t[moves[-1]] if len(moves) else self.t[-1]))

    def __getitem__(self, name):
        if name not in self.columns:
            raise Failure(f"{self.folder / 'samples.csv'}: no column {name}; written by another version of the demo?")
        return self.columns[name]

    def tip(self, what):
        """3 rows (x, y, z in metres) of target, true or estimate."""
        import numpy as np
        return np.array([self[f"tip_{what}_{a}_m"] for a in "xyz"])

    def backbone(self, row):
        """3 rows (x, y, z in metres) of the backbone at one sample, from base to tip: arcs through the disks, the first
        tangent to z, each other to the one before."""
        import numpy as np
        points, start, tangent = [np.zeros(3)], np.zeros(3), np.array([0.0, 0.0, 1.0])
        for disk in self.disk_positions(row).T:
            chord = disk - start
            length = np.linalg.norm(chord)
            half = np.arccos(np.clip(tangent @ chord / length, -1, 1))  # half the arc's bend
            across = chord / length - tangent * np.cos(half)
            across /= np.linalg.norm(across) or 1
            arc = length / np.sinc(half / np.pi)
            for part in np.linspace(0, 1, 9)[1:]:
                turn = part * half
                points.append(start + part * arc * np.sinc(turn / np.pi) * (tangent * np.cos(turn) + across * np.sin(turn)))
            start = start + chord
            tangent = tangent * np.cos(2 * half) + across * np.sin(2 * half)
        return np.array(points).T

    def disk_positions(self, row):
        """3 rows (x, y, z in metres) of the disks at one sample, from base to tip."""
        import numpy as np
        return np.array([[self[f"disk_{a}_m_{i}"][row] for i in range(1, self.disks + 1)] for a in "xyz"])

    def figure(self, key):
        """A number of the summary, NaN when it has none."""
        value = self.summary.get(key)
        return float(value) if isinstance(value, (int, float)) else math.nan

    def name(self):
        return {"circle": "Circle", "planar": "Planar bend"}.get(self.summary.get("trajectory"),
                                                                 str(self.summary.get("trajectory", self.folder.name)))

    def friction_model(self):
        return "with friction compensation" if self.summary.get("compensation") else "without friction compensation"


def new_figure(title, row_height, rows, columns=1):
    """A figure of panels one above the other; sizes in inches, so that title and legend have the same room in each."""
    from matplotlib.figure import Figure
    width, top, bottom, left = 9.0, 0.78, 0.55, 0.95
    height = top + bottom + row_height * rows
    figure = Figure(figsize=(width, height), dpi=100)
    axes = figure.subplots(rows, columns, squeeze=False, sharex="col", sharey="col" if columns > 1 else False)
    figure.subplots_adjust(left=left / width, right=1 - 0.12 / width, top=1 - top / height, bottom=bottom / height,
                           hspace=0.16, wspace=0.26)
    for a in axes.flat:
        a.grid(True, color="#e2e2e2", linewidth=0.6)
        a.set_axisbelow(True)
        for side in ("top", "right"):
            a.spines[side].set_visible(False)
    figure.suptitle(title, x=left / width, ha="left", y=1 - 0.1 / height, va="top")
    return figure, axes


def legend(figure, axes):
    """One line between title and panels, beside no curve."""
    found = {}
    for a in axes.flat:
        for handle, label in zip(*a.get_legend_handles_labels()):
            found.setdefault(label, handle)
    figure.legend(found.values(), found.keys(), ncol=len(found), loc="upper left", frameon=False, fontsize=9,
                  bbox_to_anchor=(figure.subplotpars.left - 0.012, 1 - 0.36 / figure.get_figheight()),
                  columnspacing=1.4, handlelength=1.8)


def shade_approach(axes, run):
    """Greys the time before the motion; the legend says so."""
    for a in axes.flat:
        a.axvspan(run.t[0], run.start, color="#f3f3f3", zorder=0, label="approach")
        a.set_xlim(run.t[0], run.t[-1])


def least_range(a, least):
    """Noise is not to look like motion."""
    low, high = a.get_ylim()
    if high - low < least:
        a.set_ylim((low + high) / 2 - least / 2, (low + high) / 2 + least / 2)


def draw_robot(a, run):
    """The whole robot before the motion and at its quarters. Returns its points, 3 rows [mm], and its tips by quarter."""
    import numpy as np
    moving = np.nonzero(run.moving)[0]
    if not run.disks or not len(moving):
        return np.zeros((3, 1)), {}
    bend = sum(np.hypot(run[f"us_true_rad{s}"][0], run[f"vs_true_rad{s}"][0]) for s in run.sections)
    rest = dict(color="#cfcfcf", linewidth=7, zorder=3, label="robot before the motion")
    if bend < 0.02:
        rest["label"] += ", straight"
    quarter = dict(color="#4d4d4d", linewidth=2, zorder=5, label="robot at each quarter of the motion")
    shapes, tips = [1e3 * run.backbone(0)], {}
    a.plot(*shapes[0], solid_capstyle="round", **rest)
    for f, name in ((0, "0"), (0.25, "¼"), (0.5, "½"), (0.75, "¾"), (1, "1")):
        row = moving[round(f * (len(moving) - 1))]
        shape, disks = 1e3 * run.backbone(row), 1e3 * run.disk_positions(row)
        if f == 1 and np.linalg.norm(shape[:, -1] - shapes[1][:, -1]) < 0.1 * np.linalg.norm(shapes[0][:, -1]):
            break  # it ends where it began
        a.plot(*shape, **quarter)
        a.plot(*disks, color=quarter["color"], linestyle="none", marker="o", markersize=4, zorder=5)
        quarter["label"] = None
        shapes.append(shape)
        tips[name] = shape[:, -1]
    return np.hstack(shapes), tips


def name_quarters(a, tips, curves):
    """The quarter beside each tip, on the side that is farthest from all curves (3 rows) as one sees them."""
    import numpy as np
    from mpl_toolkits.mplot3d import proj3d

    def seen(points):
        return np.array(proj3d.proj_transform(*points, a.get_proj())[:2]).T

    on_paper = a.transData.transform(seen(curves))
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    offsets = 14 * np.array([np.cos(turns), np.sin(turns)]).T  # points
    for name, tip in tips.items():
        at = seen(tip[:, None])[0]
        places = a.transData.transform(at) + offsets * a.figure.dpi / 72
        clear = np.linalg.norm(places[:, None] - on_paper[None], axis=2).min(axis=1)
        a.annotate(name, at, xytext=offsets[clear.argmax()], textcoords="offset points", ha="center", va="center")


def tip_path(run):
    import numpy as np
    from matplotlib.figure import Figure
    from matplotlib.ticker import MultipleLocator
    from mpl_toolkits.mplot3d import Axes3D  # noqa: F401  registers the projection
    figure = Figure(figsize=(7.6, 6.6), dpi=100)
    a = figure.add_subplot(projection="3d", computed_zorder=False)
    figure.subplots_adjust(left=0.0, right=0.95, bottom=0.04, top=0.88)
    target, true = run.tip("target") * 1e3, run.tip("true") * 1e3
    robot, tips = draw_robot(a, run)
    a.plot(*true[:, run.t <= run.start], color=TRUE, linewidth=1.2, linestyle=":", label="tip, approach", zorder=6)
    a.plot(*target[:, run.moving], **{**REFERENCE_LINE, "zorder": 4}, label="tip, reference")
    a.plot(*true[:, run.moving], **{**TRUE_LINE, "zorder": 6}, label="tip, true")
    a.scatter([0], [0], [0], color="#222222", marker="s", s=36, label="base", zorder=7, depthshade=False)
    everything = np.hstack([target[:, run.moving], true, robot])
    low, high = np.nanmin(everything, axis=1), np.nanmax(everything, axis=1)
    largest = (high - low).max()
    span = np.maximum(high - low, 0.4 * largest)  # a plane motion keeps some depth
    # One step on all axes, about a fifth of the longest: labels of the short ones stay apart too.
    decade = 10 ** math.floor(math.log10(largest / 5)) if largest > 0 else 1
    step = decade * next(s for s in (1, 2, 2.5, 5, 10) if s * decade >= largest / 5)
    for axis, m, s, set_limits in zip("xyz", (high + low) / 2, span, (a.set_xlim, a.set_ylim, a.set_zlim)):
        set_limits(m - 0.55 * s, m + 0.55 * s)
        getattr(a, f"set_{axis}label")(f"{axis} [mm]", labelpad=8)
        getattr(a, f"{axis}axis").set_major_locator(MultipleLocator(step))
        a.tick_params(axis=axis, pad=3)
    a.set_box_aspect(span, zoom=0.9)
    a.view_init(elev=24, azim=-58)
    name_quarters(a, tips, everything[:, np.isfinite(everything).all(axis=0)])
    figure.legend(*a.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.03, 0.95), ncol=2, frameon=False,
                  fontsize=9)
    figure.suptitle(f"{run.name()}: tip error {run.figure('tip_rms_error_m') * 1e3:.2f} mm rms, {run.friction_model()}",
                    x=0.04, ha="left", y=0.985, va="top")
    return figure


def tip_axes(run):
    import numpy as np
    figure, axes = new_figure(f"{run.name()}, tip by axis: error {run.figure('tip_rms_error_m') * 1e3:.2f} mm rms, "
                              f"{run.figure('tip_max_error_m') * 1e3:.2f} mm at most", 1.5, 5)
    target, true, believed = (run.tip(w) * 1e3 for w in ("target", "true", "estimate"))
    for i, name in enumerate("xyz"):
        a = axes[i, 0]
        a.plot(run.t, target[i], **REFERENCE_LINE, label="reference")
        a.plot(run.t, true[i], **TRUE_LINE, label="true")
        a.plot(run.t, believed[i], **BELIEVED_LINE, label="controller's estimate")
        a.set_ylabel(f"{name} [mm]")
        least_range(a, 2)
    for a, one, other, color, what in ((axes[3, 0], true, target, TRUE, "true less\nreference [mm]"),
                                       (axes[4, 0], believed, true, BELIEVED, "estimate less\ntrue [mm]")):
        error = np.linalg.norm(one - other, axis=0)
        a.plot(run.t, error, color=color)
        if run.moving.any():
            a.set_ylim(0, 1.25 * np.nanmax(error[run.moving]) or 1)
        a.set_ylabel(what)
    axes[-1, 0].set_xlabel("time [s]")
    shade_approach(axes, run)
    figure.align_ylabels(axes[:, 0])
    legend(figure, axes)
    return figure


def bending(run):
    import numpy as np
    n = len(run.sections)
    errors = [1e3 * np.hypot(run[f"us_true_rad{s}"] - run[f"us_desired_rad{s}"],
                             run[f"vs_true_rad{s}"] - run[f"vs_desired_rad{s}"]) for s in run.sections]
    worst = max(float(np.nanmax(e[run.moving])) for e in errors) if run.moving.any() else 0.0
    figure, axes = new_figure(f"{run.name()}: bending follows within {worst:.0f} mrad", 1.6, 3 * n)
    for k, suffix in enumerate(run.sections):
        which = "" if n == 1 else f"section {k + 1}: "
        angle_axes, plane_axes, error_axes = axes[3 * k:3 * k + 3, 0]
        for what, look, label in (("desired", REFERENCE_LINE, "reference"), ("true", TRUE_LINE, "true"),
                                  ("estimate", BELIEVED_LINE, "controller's estimate")):
            u, v = run[f"us_{what}_rad{suffix}"], run[f"vs_{what}_rad{suffix}"]
            angle = np.hypot(u, v)
            plane = np.arctan2(v, u)
            bent = angle > 0.05  # a straight robot has no bending plane
            # Continuous where it is defined, and within one turn of zero at the beginning of the motion.
            plane[bent] = np.unwrap(plane[bent])
            plane[~bent] = np.nan
            angle_axes.plot(run.t, angle, **look, label=label)
            plane_axes.plot(run.t, plane, **look)
        error_axes.plot(run.t, errors[k], **TRUE_LINE)
        error_axes.set_ylim(bottom=0)
        angle_axes.set_ylabel(f"{which}bending\nangle [rad]")
        plane_axes.set_ylabel(f"{which}bending-\nplane angle [rad]")
        error_axes.set_ylabel(f"{which}true less\nreference [mrad]")
        least_range(plane_axes, 0.5)
    axes[-1, 0].set_xlabel("time [s]")
    shade_approach(axes, run)
    figure.align_ylabels(axes[:, 0])
    legend(figure, axes)
    return figure


def displacements(run):
    import numpy as np
    stretch = [np.abs(run[f"displacement_m_{j}"] - run[f"displacement_true_m_{j}"])[run.moving]
               for j in range(1, run.tendons + 1)]
    worst = 1e3 * max((float(np.nanmax(s)) for s in stretch if s.size), default=0.0)
    figure, axes = new_figure(f"{run.name()}: tendons stretch, motor and robot differ by up to {worst:.2f} mm", 1.6,
                              run.tendons, 2)
    for j in range(run.tendons):
        wanted, measured, true = (run[f"displacement_{w}m_{j + 1}"] * 1e3 for w in ("desired_", "", "true_"))
        axes[j, 0].plot(run.t, wanted, **REFERENCE_LINE, label="reference")
        axes[j, 0].plot(run.t, true, **TRUE_LINE, label="true, in the robot")
        axes[j, 0].plot(run.t, measured, **BELIEVED_LINE, label="measured at the motor")
        axes[j, 1].axhline(0, color="#888888", linewidth=0.8)
        axes[j, 1].plot(run.t, true - wanted, **TRUE_LINE)
        axes[j, 1].plot(run.t, measured - wanted, **BELIEVED_LINE)
        axes[j, 0].set_ylabel(f"tendon {j + 1}\ndisplacement [mm]")
        axes[j, 1].set_ylabel("less reference [mm]")
    for a in axes[-1]:
        a.set_xlabel("time [s]")
    shade_approach(axes, run)
    figure.align_ylabels(axes)
    legend(figure, axes)
    return figure


def tensions(run):
    import numpy as np
    figure, axes = new_figure(f"{run.name()}, tensions {run.friction_model()}: base error "
                              f"{run.figure('base_tension_error_rms_N'):.3f} N rms", 2.1, run.tendons)
    for j in range(run.tendons):
        a, n = axes[j, 0], j + 1
        a.plot(run.t, run[f"tension_desired_motor_N_{n}"], **REFERENCE_LINE, label="reference, motor side")
        a.plot(run.t, run[f"tension_measured_N_{n}"], color=BELIEVED, linewidth=1.1, zorder=3,
               label="load cell, motor side")
        a.plot(run.t, run[f"tension_desired_base_N_{n}"], **IDEAL_LINE, label="reference, robot base")
        a.plot(run.t, run[f"tension_base_true_N_{n}"], **TRUE_LINE, label="true, robot base")
        a.set_ylabel(f"tendon {n}\ntension [N]")
        a.set_ylim(bottom=min(0, float(np.nanmin(run[f"tension_measured_N_{n}"]))))
    axes[-1, 0].set_xlabel("time [s]")
    shade_approach(axes, run)
    legend(figure, axes)
    return figure


def friction_loss(run):
    figure, axes = new_figure(f"{run.name()}: guide pulleys take {run.figure('friction_loss_mean_N'):.2f} N in the mean, "
                              f"{run.figure('friction_loss_max_N'):.2f} N at most", 1.7, run.tendons, 2)
    for j in range(run.tendons):
        over_time, over_tension = axes[j]
        base, ideal = run[f"tension_base_true_N_{j + 1}"], run[f"tension_desired_base_N_{j + 1}"]
        loss = run[f"tension_motor_true_N_{j + 1}"] - base
        expected = run[f"tension_desired_motor_N_{j + 1}"] - ideal
        over_time.plot(run.t, expected, **REFERENCE_LINE, label="compensated")
        over_time.plot(run.t, loss, **TRUE_LINE, label="true")
        over_tension.plot(ideal[run.moving], expected[run.moving], **REFERENCE_LINE)
        over_tension.plot(base[run.moving], loss[run.moving], **TRUE_LINE)
        over_time.set_ylabel(f"tendon {j + 1}, motor\nless base [N]")
        over_tension.set_ylabel("motor less base [N]")
        for a in (over_time, over_tension):
            a.axhline(0, color="#888888", linewidth=0.8)
    shade_approach(axes[:, :1], run)
    axes[-1, 0].set_xlabel("time [s]  (above 0: pulled in; below: paid out)")
    axes[-1, 1].set_xlabel("tension at the robot's base [N], motion only")
    figure.align_ylabels(axes)
    legend(figure, axes)
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
                                "path.simplify_threshold": 0.5, "svg.hashsalt": "tendril", "pdf.fonttype": 42})
    for folder in folders:
        run = Run(folder)
        for name, draw in PICTURES.items():
            figure = draw(run)
            for kind in FORMATS:
                target = folder / f"{name}.{kind}"
                try:
                    figure.savefig(target, metadata=UNDATED.get(kind))
                except OSError as e:
                    raise Failure(f"cannot write {target}: {e.strerror}") from e


if __name__ == "__main__":
    try:
        main()
    except Failure as failure:
        print(f"plot_demo.py: {failure}", file=sys.stderr)
        sys.exit(1)
