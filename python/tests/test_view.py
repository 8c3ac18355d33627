"""The view: what it reads, what it draws, whom it answers. A browser is not needed here; see test_view_page.py."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="the extra 'view' is not installed")
lcm = pytest.importorskip("lcm", reason="the extra 'view' is not installed")

import tendril

import view_help
from conftest import SOURCE

from tendril.view import __main__ as program
from tendril.view import (
    colours,
    frames,
    geometry,
    logs,
    panel,
    readings,
    robots,
    scene,
    server,
    sets,
    show,
    sources,
)
from tendril.view.frames import ViewError


@pytest.fixture
def served():
    opened = server.start(0, "test")
    yield opened
    server.stop(opened)


@pytest.fixture(scope="module")
def circle(tmp_path_factory):
    return view_help.circle_log(tmp_path_factory.mktemp("logs") / "circle.lcmlog")


def refused(call, *words):
    with pytest.raises(ViewError) as error:
        call()
    line = str(error.value)
    assert "\n" not in line
    for word in words:
        assert word in line, line


# ---- whom it answers ----


def answer(port, host=None, **headers):
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}/", headers={"Host": host or f"127.0.0.1:{port}", **headers}
    )
    try:
        with urllib.request.urlopen(request, timeout=10) as response:
            return response.status, response.headers
    except urllib.error.HTTPError as e:
        return e.code, e.headers


def test_serves_its_page_to_this_machine_only(served):
    port = served.get_port()
    status, headers = answer(port)
    assert status == 200
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert answer(port, f"localhost:{port}")[0] == 200
    # Another address of this machine: the whole of 127.0.0.0/8 is, and only what listens on all of them answers there.
    with socket.socket() as other:
        other.settimeout(5)
        assert other.connect_ex(("127.0.0.2", port)) != 0


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example:80", "0.0.0.0", "localhost.evil.example", ""]
)
def test_refuses_other_hosts(served, host):
    # A name of another site that resolves to 127.0.0.1 (DNS rebinding) would make its page ours.
    status, _ = answer(served.get_port(), host or "[::]")
    assert status == 403


@pytest.mark.parametrize(
    "origin",
    [
        "https://evil.example",
        "null",
        "http://127.0.0.1",
        "http://localhost:{port}",
        "https://127.0.0.1:{port}",
        "http://127.0.0.1:{port}.evil.example",
    ],
)
def test_refuses_other_origins(served, origin):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    port = served.get_port()
    origin = origin.format(port=port)
    assert answer(port, Origin=origin)[0] == 403
    with pytest.raises(InvalidStatus) as error:
        connect(
            f"ws://127.0.0.1:{port}", origin=origin, subprotocols=[f"viser-v{viser.__version__}"], proxy=None
        )
    assert error.value.response.status_code == 403


def own_page(port):
    from websockets.sync.client import connect

    return connect(
        f"ws://127.0.0.1:{port}",
        origin=f"http://127.0.0.1:{port}",
        proxy=None,
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,
    )


def test_a_page_behind_a_tunnel_has_another_port():
    assert server.refusal(["localhost:9000"], ["http://localhost:9000"]) is None
    assert server.refusal(["localhost:9000"], ["http://localhost:8095"]) is not None
    assert server.refusal(["127.0.0.1:1", "127.0.0.1:1"], []) is not None
    assert server.refusal([], []) is not None


def test_takes_no_message_but_a_controls_value(served, monkeypatch):
    from viser import _messages
    import msgspec.msgpack

    tunnels = []
    monkeypatch.setattr(type(served), "request_share_url", lambda self, verbose=True: tunnels.append(1))
    slider = served.gui.add_slider("time", 0.0, 10.0, 0.1, 0.0)

    def send(page, kind, **fields):
        page.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def settled(holds):
        end = time.monotonic() + 10
        while not holds() and time.monotonic() < end:
            time.sleep(0.02)
        return holds()

    uuid = slider._impl.uuid
    with own_page(served.get_port()) as page:
        page.recv(timeout=10)
        send(page, "ShareUrlRequest")
        for updates in (
            {"removed": True},
            {"value": float("nan")},
            {"value": [1.0]},
            {"value": 7.0, "update_cb": []},
        ):
            send(page, "GuiUpdateMessage", uuid=uuid, updates=updates)
        send(page, "GuiUpdateMessage", uuid=uuid, updates={"value": 4.0})  # in the order they were sent
        assert settled(lambda: slider.value == 4.0)
    assert not slider._impl.removed and not tunnels
    handlers = served._websock_server._incoming_handlers
    assert set(handlers) == {_messages.GuiUpdateMessage}


def test_a_port_in_use_is_one_line(served, capsys, circle):
    port = str(served.get_port())
    assert program.main([str(circle), "--port", port, "--no-browser"]) == 1
    printed = capsys.readouterr()
    assert (
        printed.err.count("\n") == 1
        and f"port {port} of 127.0.0.1 is in use" in printed.err
        and "--port" in printed.err
    )


def test_does_not_start_where_the_guard_is_not_in_place(monkeypatch):
    import contextlib

    monkeypatch.setattr(server, "_guarded_websockets", lambda: contextlib.nullcontext([]))
    refused(lambda: server.start(0, "test"), "could not be kept to 127.0.0.1")


# ---- logs ----


def test_a_log_becomes_frames(circle):
    recording = sources.open_sources([str(circle)], None)[0]
    assert recording.robots[0].name == "rig_60mm" and recording.title == "circle"
    assert recording.duration_s == pytest.approx(3.985, abs=0.02)
    steps = np.diff([frame.time_s for frame in recording.frames])
    assert steps.min() > 1 / 61 and steps.max() < 0.03  # 200 messages a second, at most 60 frames
    pose = recording.frames[recording.at(1.0)].poses[0]
    np.testing.assert_allclose(pose.q_rad.reshape(-1, 2).sum(axis=0), [0, 1], atol=0.05)
    np.testing.assert_allclose(pose.cell_N, 1.2 * pose.tension_N)
    assert recording.frames[0].note == "running"
    assert "estimated" in recording.robots[0].measured_is
    # The tip of the drawn body is the one in the log: written here from the arc's own formula.
    disks = geometry.points_of(recording.robots[0], pose.q_rad).disks
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
    assert all(np.linalg.norm(frame.poses[0].q_rad) < 0.3 for frame in recording.frames)
    assert "estimated" in recording.robots[0].measured_is


def test_values_that_are_not_finite_hide_the_robot(tmp_path):
    bends = [(0.1, 0.0), (float("nan"), 0.0), (float("inf"), 0.0), (0.2, 0.0)]
    messages = [("STATE", view_help.state_message(0.1 * k, bend)) for k, bend in enumerate(bends)]
    recording = logs.read_log(
        view_help.write_log(tmp_path / "a.lcmlog", [("RUN", view_help.run_message()), *messages])
    )
    assert [bool(np.isfinite(f.poses[0].q_rad).all()) for f in recording.frames] == [True, False, False, True]
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


@pytest.mark.parametrize("file", ["rig_60mm.yaml", "two_section.yaml"])
def test_the_arcs_through_a_tip_are_those_it_was_made_of(file):
    robot = robots.drawn(robots.load_robot(str(SOURCE / "config/robots" / file)))
    sections = len(robot.units)
    bends = np.random.default_rng(1).uniform(-0.9, 0.9, (20, 2 * sections))
    bends[0] = 0
    poses = robot.model.disks(np.array([robot.spread(bend) for bend in bends]))[:, -1]
    found = geometry.bending_of_tips(robot, poses[:, :3, 3], poses[:, :3, :3])
    np.testing.assert_allclose(found, bends, atol=1e-6)
    tip = np.array([[np.nan] * 3, poses[1, :3, 3]])
    assert np.isnan(geometry.bending_of_tips(robot, tip)[0]).all()


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
    assert pose.q_rad.reshape(-1, 2).sum(axis=0) == pytest.approx([1.2 * np.sin(0.9), 0], abs=0.02)
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


# ---- what is drawn ----


def test_colours_follow_the_limits():
    found = colours.of_tensions(np.array([0.3, 8.0, 0.1, 9.0, np.nan, 0.27]), 0.3, 8.0)
    assert tuple(found[0]) == tuple(colours.STOPS[0]) and tuple(found[1]) == tuple(colours.STOPS[-1])
    assert tuple(found[2]) == colours.BELOW and tuple(found[3]) == colours.ABOVE
    assert tuple(found[4]) == colours.NOT_KNOWN and tuple(found[5]) == tuple(colours.STOPS[0])


def test_a_frame_is_drawn_where_the_model_says(served, circle):
    recording = logs.read_log(circle)
    drawing = scene.Drawing(served, recording.robots)
    body = drawing.bodies[0]
    frame = recording.frames[100]
    drawing.draw(list(recording.frames[:101]))
    points = geometry.points_of(recording.robots[0], frame.poses[0].q_rad)
    scale = 1 / recording.robots[0].length_m
    np.testing.assert_allclose(body.disks.batched_positions, scale * points.disks[:, :3, 3], atol=1e-6)
    np.testing.assert_allclose(
        body.backbone.handle.batched_scales[:, 2].sum(), 1, rtol=0.01
    )  # its length is kept
    colour = colours.of_tensions(frame.poses[0].tension_N, 0.3, 8.0)
    np.testing.assert_array_equal(body.tendons.handle.batched_colors[::4], colour)  # four pieces a tendon
    np.testing.assert_allclose(
        body.cells.bars.batched_scales[:, 2], 0.5 * frame.poses[0].cell_N / 10, atol=1e-6
    )
    np.testing.assert_allclose(
        body.measured.ball.batched_positions[0], scale * frame.poses[0].measured_tip_m, atol=1e-6
    )
    np.testing.assert_allclose(
        body.measured.trail.points[-1, 1], scale * frame.poses[0].measured_tip_m, atol=1e-6
    )
    hidden = frames.Pose(np.full(8, np.nan), *(np.full(3, np.nan),) * 4)
    drawing.draw([frames.Frame(0.0, (hidden,))])
    assert body.disks.batched_scales.max() < 1e-5 and not body.cells.bars.visible
    assert np.isfinite(body.measured.trail.points).all()


@pytest.mark.parametrize("gravity", [[0, 0, -9.81], [0, 0, 9.81], [9.81, 0, 0], [0, -9.81, 0], [0, 0, 0]])
def test_up_is_against_gravity(served, circle, gravity):
    import dataclasses

    robot = dataclasses.replace(
        logs.read_log(circle).robots[0], gravity_W_mps2=np.array(gravity, dtype=float)
    )
    scene.Drawing(served, (robot, robot))
    camera = served.initial_camera
    up, looking = np.array(camera.up), np.array(camera.look_at) - np.array(camera.position)
    assert up @ gravity == pytest.approx(-np.linalg.norm(gravity), abs=1e-9)
    assert abs(up @ looking) < 0.9 * np.linalg.norm(looking)  # not along the line of sight


def test_the_clock_runs_rests_and_begins_again():
    clock = panel.Clock(10.0)
    clock.advance(4.0)
    assert clock.at_s == 4.0
    clock.speed = 0.5
    clock.advance(2.0)
    assert clock.at_s == 5.0
    clock.playing = False
    clock.advance(2.0)
    assert clock.at_s == 5.0
    clock.playing, clock.speed = True, 2.0
    clock.advance(3.0)
    assert clock.at_s == pytest.approx(1.0)
    resting = panel.Clock(10.0, 2.5)
    resting.advance(1.0)
    assert resting.at_s == 2.5


def test_words_of_a_log_are_text_and_no_script(circle):
    recording = logs.read_log(circle)
    frame = frames.Frame(0.0, recording.frames[0].poses, "<script>alert(1)</script>{1+1}")
    recording.remarks = ("<img src=x onerror=alert(1)>",)
    shown = panel.words(recording, frame, "", 30)
    assert "<script" not in shown and "<img" not in shown and "&lt;script&gt;" in shown


def test_a_run_is_chosen_and_time_sought(served, circle):
    first, second = logs.read_log(circle), logs.read_log(circle)
    second.frames = list(second.frames[:20])
    showing = show.Show(served, [first, second])
    showing.step(0.0)
    showing.step(1.5)
    assert showing.panel.frames()[-1].time_s == pytest.approx(1.5, abs=0.02)
    assert showing.panel.frames()[0].time_s == 0  # a trail of three seconds
    showing.panel.trail_s = 0.5
    assert showing.panel.frames()[0].time_s == pytest.approx(1.0, abs=0.02)
    for chosen, run in (("2 circle.lcmlog", 1), ("no such run", 1)):
        showing.panel._wanted = chosen
        showing.step(0.0)
        assert showing.panel.chosen == run
    showing.step(0.1)
    assert showing.panel.frames()[-1].time_s <= second.duration_s


# ---- the command ----


def command(*words):
    return subprocess.run(
        [sys.executable, "-P", "-m", "tendril.view", *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    "words, status, line",
    [
        (["--port", "99999"], 2, "--port"),
        (["--port", "http"], 2, "--port"),
        (["--duration", "nan"], 2, "--duration"),
        (["--robot", "x.yaml"], 2, "--robot is for logs"),
        (["--at", "1"], 2, "--at is a time of a recording"),
        (["nowhere.lcmlog"], 1, "no such file"),
        (["--lcm", "tcp://nowhere"], 1, "LCM address"),
    ],
)
def test_bad_words_are_one_line(words, status, line):
    done = command(*words)
    assert (done.returncode, done.stdout) == (status, "")
    assert (
        done.stderr.count("\n") == 1 and done.stderr.startswith("tendril: view: ") and line in done.stderr
    ), done.stderr


def test_help_names_every_option():
    done = command("--help")
    assert done.returncode == 0
    for word in (
        "SOURCE",
        "--robot",
        "--lcm",
        "--prefix",
        "--port",
        "--no-browser",
        "--duration",
        "127.0.0.1",
    ):
        assert word in done.stdout


@pytest.mark.skipif(not shutil.which("tendril"), reason="the program is not on the path")
def test_tendril_hands_over_to_the_view():
    def handed_over(python, *words):
        environment = {**os.environ, "TENDRIL_PYTHON": python}
        done = subprocess.run(
            ["tendril", "view", *words],
            capture_output=True,
            text=True,
            timeout=60,
            env=environment,
            check=False,
        )
        assert done.stdout == "" and done.stderr.count("\n") == 1, done.stderr
        return done.returncode, done.stderr

    assert handed_over(sys.executable, "--", "-nowhere")[1].startswith(
        "tendril: view: '-nowhere': no such file"
    )
    status, line = handed_over("/usr/bin/false", "nowhere")
    assert status == 1 and "pip install './python[view]'" in line
    assert handed_over(sys.executable, "--port", "99999")[0] == 2
    assert handed_over(sys.executable, "--robot", "x.yaml")[0] == 2
