#!/usr/bin/python3 -B
"""Draws the robot in motion: reads DIR, a folder that `tendril demo` wrote, and the robot file; writes one picture with
backbone, disks, tendons coloured by tension, the reference path and the path that the tip followed.
Knows the columns of the samples and the holes of the robot file."""
import argparse
import pathlib
import sys

from plot_demo import REFERENCE_LINE, TRUE, UNDATED, Failure, Run, version

INK, PAPER, DISK = "#1f2a33", "#ffffff", "#dfe5ea"


def sections_of(path):
    """A section's number of units, its disks' radius [m], and its holes' angle [rad] and distance [m]."""
    import yaml
    try:
        sections = yaml.safe_load(path.read_text())["body"]["sections"]
        return [(s["units"], float(s["disk_diameter_m"]) / 2,
                 [(float(t["angle_rad"]), float(t["radius_m"])) for t in s["tendons"]]) for s in sections]
    except (OSError, KeyError, TypeError, yaml.YAMLError) as e:
        raise Failure(f"{path}: not a robot file ({e})") from e


def frames(run, row):
    """Positions [m] and rotations of the base and of each disk at one sample; the backbone is untwisted."""
    import numpy as np
    rotation, start, found = np.eye(3), np.zeros(3), [(np.zeros(3), np.eye(3))]
    for disk in run.disk_positions(row).T:
        chord = (disk - start) / np.linalg.norm(disk - start)
        tangent = rotation[:, 2]
        axis = np.cross(tangent, chord)
        sine = np.linalg.norm(axis)
        half = np.arctan2(sine, tangent @ chord)
        if sine > 1e-12:
            axis /= sine
            cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
            rotation = (np.eye(3) + np.sin(2 * half) * cross + (1 - np.cos(2 * half)) * cross @ cross) @ rotation
        found.append((disk, rotation))
        start = disk
    return found


def draw_pose(a, run, row, sections, colour_of, strength):
    """The robot at one sample; `strength`: 1, or less for one of the poses behind."""
    import numpy as np
    from matplotlib.colors import to_rgba
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
    poses = [(1e3 * p, r) for p, r in frames(run, row)]
    turns = np.linspace(0, 2 * np.pi, 40)
    a.plot(*(1e3 * run.backbone(row)), color=INK, linewidth=2.6 * (0.5 + strength / 2), alpha=strength, zorder=6)
    first, tendon = 0, 0
    for units, radius_m, holes in sections:
        for angle, distance in holes:
            # A tendon runs straight from hole to hole, from the base to the last disk of its section.
            hole = 1e3 * distance * np.array([np.cos(angle), np.sin(angle), 0])
            points = [p + r @ hole for p, r in poses[:first + units + 1]]
            tendon += 1
            colour = colour_of(run[f"tension_base_true_N_{tendon}"][row])
            a.add_collection3d(Line3DCollection([points], colors=[colour], linewidths=2.4 * (0.4 + 0.6 * strength),
                                                alpha=strength, zorder=7))
        for p, r in poses[first:first + units + 1]:
            rim = [p + r @ (1e3 * radius_m * np.array([np.cos(t), np.sin(t), 0])) for t in turns]
            a.add_collection3d(Poly3DCollection([rim], facecolors=to_rgba(DISK, 0.6 * strength),
                                                edgecolors=to_rgba(INK, strength), linewidths=0.8, zorder=5))
        first += units


def robot_in_motion(run, sections):
    import numpy as np
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D  # noqa: F401  registers the projection
    moving = np.nonzero(run.moving)[0]
    if not run.disks or not len(moving):
        raise Failure(f"{run.folder}: no motion of a robot with disks in it")
    tensions = np.array([run[f"tension_base_true_N_{j + 1}"][moving] for j in range(run.tendons)])
    scale = ScalarMappable(Normalize(0, np.ceil(np.nanmax(tensions))), colormaps["plasma"].resampled(256))
    figure = Figure(figsize=(10, 5.4), dpi=120, facecolor=PAPER)
    a = figure.add_axes([-0.02, -0.34, 1.0, 1.55], projection="3d", computed_zorder=False)
    target, true = 1e3 * run.tip("target")[:, moving], 1e3 * run.tip("true")[:, moving]
    a.plot(*target, **{**REFERENCE_LINE, "linewidth": 6, "zorder": 3}, label="reference path of the tip")
    a.plot(*true, color=TRUE, linewidth=1.8, zorder=4, label="path that the tip followed")
    every = [moving[round(f * (len(moving) - 1))] for f in (0.9, 0.24, 0.42, 0.66)]
    for row, strength in zip(every, (0.2, 0.3, 0.3, 1.0)):
        draw_pose(a, run, row, sections, scale.to_rgba, strength)
    points = np.hstack([target, true, np.zeros((3, 1))])
    low, high = np.nanmin(points, axis=1), np.nanmax(points, axis=1)
    middle, span = (low + high) / 2, (high - low).max()
    for m, set_limits in zip(middle, (a.set_xlim, a.set_ylim, a.set_zlim)):
        set_limits(m - 0.5 * span, m + 0.5 * span)
    a.set_box_aspect((1, 1, 1), zoom=1.02)
    a.view_init(elev=17, azim=-62)
    a.set_axis_off()
    bar = figure.colorbar(scale, cax=figure.add_axes([0.87, 0.14, 0.014, 0.5]))
    bar.set_label("tension of the tendons at the base [N]")
    bar.outline.set_visible(False)
    figure.legend(*a.get_legend_handles_labels(), loc="lower left", bbox_to_anchor=(0.02, 0.05), frameon=False)
    return figure


def main():
    parser = argparse.ArgumentParser(prog="plot_robot.py", description=__doc__.split(":")[0] + ".")
    parser.add_argument("folder", metavar="DIR", type=pathlib.Path, help="folder of one motion that the demo wrote")
    parser.add_argument("picture", metavar="PICTURE", type=pathlib.Path, help="file to write: .png, .svg or .pdf")
    parser.add_argument("--robot", type=pathlib.Path, help="robot file (default: the one that the demo used)")
    parser.add_argument("--version", action="version", version=f"plot_robot.py {version()}")
    o = parser.parse_args()
    try:
        import matplotlib
        import yaml  # noqa: F401
    except ImportError as e:
        raise Failure(f"no {e.name} for this Python: sudo apt-get install python3-{e.name}") from None
    matplotlib.use("Agg")
    matplotlib.rcParams.update({"font.size": 11, "svg.hashsalt": "tendril", "pdf.fonttype": 42})
    run = Run(o.folder)
    robot = o.robot or pathlib.Path(str(run.summary.get("plant", "")))
    try:
        robot_in_motion(run, sections_of(robot)).savefig(o.picture, metadata=UNDATED.get(o.picture.suffix[1:]))
    except (OSError, ValueError) as e:
        raise Failure(f"cannot write {o.picture}: {e}") from e


if __name__ == "__main__":
    try:
        main()
    except Failure as failure:
        print(f"plot_robot.py: {failure}", file=sys.stderr)
        sys.exit(1)
