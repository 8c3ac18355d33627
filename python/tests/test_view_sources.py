"""What the view reads: logs, data sets and diagnoses, as frames. What cannot be shown is one line."""

import json

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")
pytest.importorskip("lcm", reason="the extra 'view' is not installed")

import tendril

import view_help
from conftest import SOURCE
from view_help import refused

from tendril.view import geometry, logs, readings, robots, sets, sources


def test_a_log_becomes_frames(circle):
    recording = sources.open_sources([str(circle)], None)[0]
    assert recording.robots[0].name == "rig_60mm" and recording.title == "circle"
    assert recording.duration_s == pytest.approx(3.985, abs=0.02)
    steps = np.diff([frame.time_s for frame in recording.frames])
    assert steps.min() > 1 / 61 and steps.max() < 0.03  # 200 messages a second, at most 60 frames
    pose = recording.frames[recording.at(1.0)].poses[0]
    np.testing.assert_allclose(pose.q.reshape(-1, 2).sum(axis=0), [0, 1], atol=0.05)
    np.testing.assert_allclose(pose.cell_N, 1.2 * pose.tension_N)
    assert recording.frames[0].note == "running"
    assert "estimated" in recording.robots[0].measured_is
    # The tip of the drawn body is the one in the log: written here from the arc's own formula.
    disks = geometry.points_of(recording.robots[0], pose.q).disks
    np.testing.assert_allclose(disks[-1, :3, 3], pose.measured_tip_m, atol=1e-9)


def test_a_tracker_is_shown_while_it_reads(tmp_path):
    states = [("STATE", view_help.state_message(0.02 * k)) for k in range(51)]
    tips = {0.2: (0.01, 0, 0.05), 0.25: (0.02, 0, 0.05), 0.3: None, 0.6: (0.03, 0, 0.05)}
    track = [
        ("TRACKER", view_help.tracker_message(t, tip or (0, 0, 0), valid=tip is not None))
        for t, tip in tips.items()
    ]
    path = tmp_path / "run.lcmlog"
    view_help.write_log(path, [("RUN", view_help.run_message()), *states, *track])
    recording = logs.read_log(path)
    assert "tracker" in recording.robots[0].measured_is
    shown = [
        recording.frames[recording.at(t + 1e-6)].poses[0].measured_tip_m[0]
        for t in (0.22, 0.28, 0.5, 0.6, 0.8)
    ]
    # On the line between two readings; not beside a lost one, nor far from any.
    np.testing.assert_allclose(shown, [0.014, np.nan, np.nan, 0.03, np.nan], atol=1e-9)
    assert sources.name_of(path) == tmp_path.name


def test_of_a_log_of_two_daemons_the_first_one_is_shown(tmp_path):
    both = [("RUN", view_help.run_message()), ("OTHER_RUN", view_help.run_message())]
    for k in range(11):
        both += [
            ("OTHER_STATE", view_help.state_message(0.1 * k, (0.9, 0.0))),
            ("OTHER_TRACKER", view_help.tracker_message(0.1 * k)),
            ("STATE", view_help.state_message(0.1 * k, (0.2, 0.0))),
        ]
    recording = logs.read_log(view_help.write_log(tmp_path / "both.lcmlog", both))
    assert len(recording.frames) == 11
    assert all(np.linalg.norm(frame.poses[0].q) < 0.3 for frame in recording.frames)
    assert "estimated" in recording.robots[0].measured_is


def test_values_that_are_not_finite_hide_the_robot(tmp_path):
    bends = [(0.1, 0.0), (float("nan"), 0.0), (float("inf"), 0.0), (0.2, 0.0)]
    messages = [("STATE", view_help.state_message(0.1 * k, bend)) for k, bend in enumerate(bends)]
    recording = logs.read_log(
        view_help.write_log(tmp_path / "a.lcmlog", [("RUN", view_help.run_message()), *messages])
    )
    assert [bool(np.isfinite(f.poses[0].q).all()) for f in recording.frames] == [True, False, False, True]
    assert any("2 of 4 frames hold no finite bending" in remark for remark in recording.remarks)


def test_logs_that_cannot_be_shown_are_one_line(tmp_path):
    state, run = view_help.state_message(0.0), view_help.run_message()
    other = bytes([state.encode()[0] ^ 1]) + state.encode()[1:]
    refused(
        lambda: logs.read_log(view_help.write_log(tmp_path / "v.lcmlog", [("RUN", run), ("STATE", other)])),
        "v.lcmlog",
        "STATE messages are of another version",
        "view it with the version",
    )
    refused(
        lambda: logs.read_log(view_help.write_log(tmp_path / "n.lcmlog", [("STATE", state)])),
        "no RUN message",
        "--robot",
    )
    refused(
        lambda: logs.read_log(view_help.write_log(tmp_path / "r.lcmlog", [("RUN", run)])), "no STATE or CYCLE"
    )
    (tmp_path / "e.lcmlog").write_bytes(b"")
    refused(lambda: logs.read_log(tmp_path / "e.lcmlog"), "no message at all")
    wrong = view_help.run_message("name: nothing\n")
    refused(
        lambda: logs.read_log(view_help.write_log(tmp_path / "y.lcmlog", [("RUN", wrong), ("STATE", state)])),
        "y.lcmlog",
        "the robot in this log",
    )
    two = robots.load_robot(str(SOURCE / "config/robots/two_section.yaml"))
    path = view_help.write_log(tmp_path / "two.lcmlog", [("STATE", state)])
    refused(lambda: logs.read_log(path, two), "1 sections", "--robot")
    cut = view_help.circle_log(tmp_path / "cut.lcmlog", seconds=0.5)
    cut.write_bytes(cut.read_bytes()[:-100])
    assert logs.read_log(cut).duration_s > 0.4


def test_a_damaged_log_shows_what_is_left(tmp_path):
    """lcm's reader takes a length of 2 GB as it is, and crashes."""
    path = view_help.circle_log(tmp_path / "circle.lcmlog", seconds=1.0)
    whole, whole_s = path.read_bytes(), logs.read_log(path).duration_s
    second = whole.index(logs.LCM_SYNC, 4)
    for place, damage in ((24, b"\x7f\xff\xff\xff"), (24, b"\xff" * 4), (20, b"\x7f\xff\xff\xff"), (0, b"none")):
        at = whole.index(logs.LCM_SYNC, second + 4) + place  # of the first state
        path.write_bytes(whole[:at] + damage + whole[at + 4 :])
        recording = logs.read_log(path)
        assert whole_s - 0.1 < recording.duration_s <= whole_s
        assert any("the log is damaged: the event at byte" in remark for remark in recording.remarks)


def test_words_that_are_no_source_are_one_line(tmp_path):
    refused(lambda: sources.open_sources([str(tmp_path / "nothing")], None), "no such file", "accepted")
    refused(lambda: sources.open_sources([str(tmp_path)], None), "the folder is empty")
    (tmp_path / "picture.png").write_bytes(b"x")
    refused(
        lambda: sources.open_sources([str(tmp_path / "picture.png")], None),
        "neither a log, a table nor a report",
    )
    (tmp_path / "report.json").write_text("{}")
    refused(lambda: sources.open_sources([str(tmp_path)], None), "report.json", "tendril gap diagnose")


# ---- shapes from measurements ----


@pytest.mark.parametrize("file", ["rig_60mm.yaml", "two_section.yaml", "rod_90mm.yaml"])
def test_the_arcs_through_a_tip_are_those_it_was_made_of(file):
    robot = robots.drawn(robots.load_robot(str(SOURCE / "config/robots" / file)))
    sections = len(robot.units)
    bends = np.random.default_rng(1).uniform(-0.9, 0.9, (20, 2 * sections))
    bends[0] = 0
    poses = robot.model.disks(robot.spread(bends))[:, -1]
    found = geometry.bending_of_tips(robot, poses[:, :3, 3], poses[:, :3, :3])
    np.testing.assert_allclose(found, bends, atol=1e-6)
    tip = np.array([[np.nan] * 3, poses[1, :3, 3]])
    assert np.isnan(geometry.bending_of_tips(robot, tip)[0]).all()
    points = geometry.points_of(robot, robot.spread(bends[1]))
    assert len(points.disks) == robot.disks and all(len(holes) <= robot.disks + 1 for holes in points.tendons_m)
    np.testing.assert_allclose(points.backbone_m[-1], points.disks[-1, :3, 3], atol=1e-12)


def test_quaternions_turn_as_the_rotations():
    rng = np.random.default_rng(2)
    directions = np.concatenate([rng.normal(size=(20, 3)), [[0, 0, 1], [0, 0, -1], [0, 0, -1e-9]]])
    turned = sets.rotations_of(geometry.rotations_to(directions))[:, :, 2]
    np.testing.assert_allclose(
        turned, directions / np.linalg.norm(directions, axis=1, keepdims=True), atol=1e-7
    )
    poses = np.tile(np.eye(4), (24, 1, 1))
    matrices = [np.linalg.qr(m)[0] for m in rng.normal(size=(20, 3, 3))]
    poses[:20, :3, :3] = [m * np.sign(np.linalg.det(m)) for m in matrices]
    for n in range(3):  # half a turn about each axis
        poses[20 + n, :3, :3] = np.diag(2 * np.eye(3)[n] - 1)
    np.testing.assert_allclose(
        sets.rotations_of(geometry.quaternions_of(poses)), poses[:, :3, :3], atol=1e-12
    )


def test_rows_between_two_readings_lie_on_the_line_between_them():
    t = np.array([0, 0.05, 0.1, 0.2, 0.35, 0.4])
    values = np.array(
        [[1, np.nan], [np.nan, np.inf], [2, 5], [np.nan, np.nan], [3, np.nan], [np.nan, np.nan]]
    )
    filled = readings.filled(t, values)
    np.testing.assert_allclose(filled[:, 0], [1, 1.5, 2, np.nan, 3, 3])  # 0.25 s are too long
    np.testing.assert_allclose(filled[:, 1], [5, 5, 5, 5, np.nan, np.nan])
    quaternions = np.array([[1, 0, 0, 0], [-0.9, -0.1, 0, 0], [np.nan] * 4, [0.8, 0.2, 0, 0]])
    np.testing.assert_array_equal(readings.same_side(quaternions)[[1, 3], 0], [0.9, 0.8])


def write_set(folder, rows, columns):
    folder.mkdir()
    (folder / "robot.yaml").write_text(view_help.ROBOT.read_text())
    (folder / "runs.yaml").write_text("runs:\n  - file: one.csv\n    family: circle\n")
    lines = [",".join("" if np.isnan(v) else f"{v:.9g}" for v in row) for row in rows]
    (folder / "one.csv").write_text("\n".join([",".join(columns), *lines]) + "\n")
    return folder


def test_a_set_shows_its_tip_and_its_cells(tmp_path):
    t = np.arange(0, 1, 0.01)
    theta = 1.2 * np.sin(t)
    tip = 0.06 * np.stack(
        [(1 - np.cos(theta)) / np.maximum(theta, 1e-9), 0 * t, np.sinc(theta / np.pi)], axis=1
    )
    tip[50] = np.nan
    rows = np.column_stack([t, np.full((100, 3), 0.7), tip])
    columns = ["t_s", *(f"tension_N_{j}" for j in (1, 2, 3)), "tip_x_m", "tip_y_m", "tip_z_m"]
    recording = sources.open_sources([str(write_set(tmp_path / "set", rows, columns))], None)[0]
    pose = recording.frames[recording.at(0.9)].poses[0]
    assert pose.q.reshape(-1, 2).sum(axis=0) == pytest.approx([1.2 * np.sin(0.9), 0], abs=0.02)
    assert list(pose.cell_N) == [0.7] * 3
    assert "arcs through the tracked tip" in recording.remarks[0]
    rows[:, 1:] = np.nan
    refused(
        lambda: sources.open_sources([str(write_set(tmp_path / "none", rows, columns))], None),
        "nothing can be drawn",
    )
    refused(
        lambda: sources.open_sources([str(write_set(tmp_path / "empty", rows[:0], columns))], None),
        "0 usable rows",
    )


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A softer robot's runs, and the report on them; beside each other as `tendril gap diagnose` leaves them."""
    folder = tmp_path_factory.mktemp("diagnosed")
    plan = folder / "plan.yaml"
    plan.write_text("runs:\n  - {family: circle, duration_s: 3}\n  - {family: triangle, duration_s: 4}\n")
    robot = tendril.load_robot(view_help.ROBOT)
    data = tendril.simulate(robot, ["bending_stiffness scale=0.9"], plan=plan)
    data.to_folder(folder / "runs")
    report = tendril.diagnose(robot, data, only=["bending_stiffness"], next=False)
    report.save(folder / "gap")
    assert [cause.effect for cause in report.accepted] == ["bending_stiffness"]
    return folder


def changed(report, to, **values):
    """A copy of a report with other values."""
    to.mkdir()
    content = json.loads(report.read_text())
    content["provenance"].update(values.pop("provenance", {}))
    (to / "report.json").write_text(json.dumps(content | values))
    return str(to)


def test_a_diagnosis_stands_side_by_side(diagnosed):
    recording = sources.open_sources([str(diagnosed / "gap"), str(diagnosed / "runs")], None)[0]
    titles = [robot.title for robot in recording.robots]
    assert titles == ["measured", "nominal", "corrected: bending_stiffness"]
    poses = [frame.poses for frame in recording.frames]
    away = np.array(
        [[np.linalg.norm(p[n].measured_tip_m - p[0].measured_tip_m) for p in poses] for n in (1, 2)]
    )
    nominal, corrected = np.sqrt(np.nanmean(away**2, axis=1))
    assert nominal > 5e-4 and corrected < 2e-4  # the tracker reads to 0.05 mm an axis
    assert f"nominal: {1e3 * nominal:.2f} mm rms" in recording.remarks[-2]
    assert f"nominal: {1e3 * away[0, 50]:.2f} mm" in recording.frames[50].note
    np.testing.assert_array_equal(poses[50][1].reference_tip_m, poses[50][0].measured_tip_m)


def test_a_diagnosis_without_a_cause_or_without_its_runs(diagnosed, tmp_path):
    report, runs = diagnosed / "gap/report.json", str(diagnosed / "runs")
    command = f"tendril gap diagnose --robot x.yaml {runs} --out gap"
    none = changed(report, tmp_path / "no", accepted=[], provenance={"command": command})
    only = sources.open_sources([none], None)[0]
    assert [robot.title for robot in only.robots] == ["measured", "nominal"]
    command = "tendril gap diagnose elsewhere --robot x.yaml"
    gone = changed(report, tmp_path / "gone", provenance={"command": command})
    refused(lambda: sources.open_sources([gone], None), "elsewhere", "not where they were", "tendril view")
    made = changed(report, tmp_path / "made", provenance={"command": ""})
    refused(lambda: sources.open_sources([made], None), "does not say from which files", "RUNS")
    later = changed(report, tmp_path / "later", format=99)
    refused(lambda: sources.open_sources([later], None), "format 99", "this version")
    refused(lambda: sources.open_sources([str(diagnosed / "gap")], "x.yaml"), "leave out --robot")
