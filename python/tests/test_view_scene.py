"""What the view draws, and its clock and controls."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")
pytest.importorskip("lcm", reason="the extra 'view' is not installed")

from tendril.view import colours, frames, geometry, logs, panel, scene, show


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
    points = geometry.points_of(recording.robots[0], frame.poses[0].q)
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
