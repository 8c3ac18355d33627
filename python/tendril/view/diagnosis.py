"""A report of `tendril gap diagnose` with the runs that it was made from: the measured robot, the nominal one and the
corrected one side by side, the last two simulated with the signals that were recorded."""

from __future__ import annotations

import dataclasses
import pathlib
import shlex

import numpy as np

from .. import _core
from .._arrays import Array
from ..model import Model
from ..report import Report
from . import robots, sets
from .frames import DrawnRobot, Frame, Pose, Recording, ViewError, unknown


def read_report(path: pathlib.Path) -> Report:
    """Of a report.json, with the robot file that it was made with."""
    try:
        report = Report.load(path)
    except (OSError, RuntimeError, ValueError) as e:
        raise ViewError(f"{e}; accepted: the report.json of tendril gap diagnose, of this version") from None
    if not report.provenance.robot_yaml:
        raise ViewError(f"{path}: does not contain the robot file it was made with: diagnose again")
    return report


def runs_of_command(report: Report, path: pathlib.Path) -> list[str]:
    """The data of the recorded command line, where they still lie there: the words that are no options."""
    words = shlex.split(report.provenance.command)
    found = []
    takes_value = False
    for word in words[3:]:
        if word.startswith("--"):
            takes_value = "=" not in word and word not in ("--no-next", "--same-robot")
        elif takes_value:
            takes_value = False
        else:
            found.append(word)
    for start in (pathlib.Path(), path.resolve().parent, path.resolve().parent.parent):
        at = [start / word for word in found]
        if at and all(p.exists() for p in at):
            return [str(p) for p in at]
    lost = (
        f"the runs that it was made from ({', '.join(found)}) are not where they were"
        if found
        else "it does not say from which files its runs were read, as a report made in Python does not"
    )
    raise ViewError(f"{path}: {lost}; name them: tendril view {path} RUNS")


def simulated(robot: _core.Robot, run: _core.Run, times_s: Array) -> Array:
    """T rows of q: the shape that this robot would have had in the run, as the diagnosis simulates it; NaN where nothing
    recorded can drive a model."""
    try:
        return _core.replayed_shape(robot, run, run.time[0] + times_s)
    except RuntimeError:
        return unknown(len(times_s), len(Model(robot).coordinates))


def tips_of(robot: DrawnRobot, q: Array) -> Array:
    known = np.isfinite(q).all(axis=1)
    tips = unknown(len(q), 3)
    if known.any():
        tips[known] = np.asarray(robot.model.disks(q[known]))[:, -1, :3, 3]
    return tips


def side_by_side(measured: Recording, others: list[tuple[DrawnRobot, Array]]) -> Recording:
    """The measured robot, and each simulated one with the measured tip as its reference."""
    tips = [tips_of(robot, q) for robot, q in others]
    away = np.array(
        [np.linalg.norm(t - [f.poses[0].measured_tip_m for f in measured.frames], axis=1) for t in tips]
    )
    frames = []
    for i, frame in enumerate(measured.frames):
        first = frame.poses[0]
        poses = [dataclasses.replace(first, reference_tip_m=unknown(3))]
        for (robot, q), tip in zip(others, tips):
            poses.append(Pose(q[i], first.tension_N, unknown(robot.tendons), first.measured_tip_m, tip[i]))
        note = " · ".join(
            f"{robot.title}: {1e3 * away[n, i]:.2f} mm from the measured tip"
            for n, (robot, _) in enumerate(others)
            if np.isfinite(away[n, i])
        )
        frames.append(Frame(frame.time_s, tuple(poses), note))
    remarks = [*measured.remarks]
    for (robot, _), distances in zip(others, away):
        if np.isfinite(distances).any():
            rms = np.sqrt(np.nanmean(distances**2))
            remarks.append(f"{robot.title}: {1e3 * rms:.2f} mm rms from the measured tip")
    drawn = (measured.robots[0], *(robot for robot, _ in others))
    return Recording(measured.title, drawn, frames, tuple(remarks))


def corrected_robot(report: Report, nominal: _core.Robot, path: pathlib.Path) -> _core.Robot | None:
    """The nominal robot with the accepted causes; None where the report accepts none."""
    if not report.accepted:
        return None
    try:
        return report.corrected(nominal)
    except (RuntimeError, ValueError) as e:
        raise ViewError(f"{path}: its causes do not fit its robot: {e}") from None


def read_diagnosis(path: pathlib.Path, data: list[str]) -> list[Recording]:
    """One recording a run that can be drawn."""
    report = read_report(path)
    nominal = robots.parse_robot(report.provenance.robot_yaml, f"{path}: its robot")
    titles = {"nominal": nominal}
    corrected = corrected_robot(report, nominal, path)
    if corrected is not None:
        causes = [f"{cause.effect} {cause.where}".removesuffix(" all") for cause in report.accepted]
        titles[f"corrected: {' + '.join(causes)}"] = corrected
    data_set = sets.open_set(data or runs_of_command(report, path), nominal)
    names = {"coloured_by": "cell", "measured_is": "its tip", "reference_is": "measured tip"}
    measured_robot = robots.drawn(nominal, "measured", **names)
    drawn = [(robots.drawn(robot, title, **names), robot) for title, robot in titles.items()]
    recordings = []
    for run in data_set.runs:
        try:
            measured = sets.recording_of(measured_robot, sets.columns(run))
        except ViewError:
            continue
        times_s = np.array([frame.time_s for frame in measured.frames])
        recording = side_by_side(measured, [(d, simulated(robot, run, times_s)) for d, robot in drawn])
        recording.remarks = (report.sentence, *recording.remarks)
        recordings.append(recording)
    if not recordings:
        raise ViewError(
            f"{path}: none of its runs can be drawn; accepted: runs with bends, a tracked tip or tensions"
        )
    return recordings
