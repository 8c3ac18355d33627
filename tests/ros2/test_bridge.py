"""The bridge on a fake rclpy, beside a stand-in of the daemon: what it publishes, and what it passes on."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
import rclpy
import tendril
from builtin_interfaces.msg import Time
from conftest import ROBOT, some_statistics
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PointStamped
from std_msgs.msg import Float64MultiArray, Header
from tendril.messages import state_t


def only(node, topic):
    assert len(node.sent[topic]) == 1, topic
    return node.sent[topic][0]


def test_state_on_all_topics(bridge, daemon):
    bridge.publish()
    joints = only(bridge, "/joint_states")
    assert joints.name == [f"unit{i}_{d}" for i in (1, 2, 3, 4) for d in "uv"]
    model = tendril.Model(tendril.load_robot(ROBOT))
    np.testing.assert_allclose(joints.position, model.hinge_angles(model.spread([0.8, -0.4])))
    assert joints.position[0] == pytest.approx(0.1, rel=0.01) and joints.position[1] == pytest.approx(-0.05, rel=0.01)
    tendons = only(bridge, "/tendril/tendons")
    assert tendons.position == [1e-3, -5e-4, 0.0] and tendons.effort[0] == 2.0 and math.isnan(tendons.effort[1])
    assert only(bridge, "/tendril/tendon_references").effort == [2.5, 0.3, 0.3]
    assert only(bridge, "/tendril/sections").position == [0.8, -0.4]
    pose = only(bridge, "/tendril/tip")
    assert (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) == (0.01, 0.02, 0.05)
    assert pose.pose.orientation.w == 1.0 and pose.header.frame_id == "base_link"
    assert abs(pose.header.stamp.sec - time.time()) < 5
    assert only(bridge, "/tendril/tip_reference").point.x == 0.011


def test_what_is_not_known_is_not_published(bridge, daemon):
    nan = np.full(2, np.nan)
    daemon.changed = dict(
        bending_estimate_rad=nan, tip_estimate_W_m=np.full(3, np.nan), tip_desired_W_m=np.full(3, np.nan)
    )
    bridge.publish()
    for topic in ("/joint_states", "/tendril/tip", "/tendril/tip_reference"):
        assert bridge.sent[topic] == []
    assert len(bridge.sent["/tendril/tendons"]) == 1


def test_targets_pass_only_while_this_node_armed(bridge, daemon, guard):
    tip = PointStamped(point=Point(x=0.01, y=0.0, z=0.055))
    bridge.receive("/tendril/target_tip", tip)
    assert daemon.commands == [] and "call its service arm first" in bridge.logger.lines[-1][1]
    answer = bridge.call("/tendril/arm")
    assert answer.success and answer.message == "arm: done" and guard.told[-1] is True
    bridge.receive("/tendril/target_tip", tip)
    bridge.receive("/tendril/target_bending", Float64MultiArray(data=[0.1, 0.2]))
    bridge.receive("/tendril/target_tension", Float64MultiArray(data=[1.0, 1.0, 1.0]))
    assert daemon.commands[1:] == [
        ("tip", [0.01, 0.0, 0.055], 0.5, 0.0),
        ("bending", [0.1, 0.2], 0.5, 0.0),
        ("tension", [1.0, 1.0, 1.0], 0.5, 0.0),
    ]
    assert bridge.call("/tendril/disarm").success and guard.told[-1] is False
    bridge.receive("/tendril/target_tip", tip)
    assert daemon.commands[-1] == ("disarm",)


def test_a_disarm_during_an_arm_holds(bridge, daemon, guard):
    daemon.meanwhile = lambda: bridge.call("/tendril/disarm")
    answer = bridge.call("/tendril/arm")
    assert not answer.success and "disarmed while it was arming" in answer.message
    assert daemon.commands == [("disarm",), ("arm",), ("disarm",)]
    assert daemon.mode == state_t.MODE_CONFIGURED and guard.told[-1] is False


def test_a_refused_arm_gives_no_control(bridge, daemon, guard, monkeypatch):
    daemon.refuses = "refused (204): not commissioned"
    assert not bridge.call("/tendril/arm").success
    daemon.refuses = ""
    bridge.receive("/tendril/target_bending", Float64MultiArray(data=[0.1, 0.2]))
    assert daemon.commands == [("arm",)] and "call its service arm first" in bridge.logger.lines[-1][1]
    later = time.monotonic() + 2
    monkeypatch.setattr(time, "monotonic", lambda: later)
    bridge.publish()
    bridge.publish()
    assert guard.told[-1] is False


def test_control_ends_with_the_drives(bridge, daemon, guard, monkeypatch):
    bridge.call("/tendril/arm")
    daemon.mode = state_t.MODE_FAULT
    later = time.monotonic() + 2
    monkeypatch.setattr(time, "monotonic", lambda: later)
    bridge.publish()
    bridge.receive("/tendril/target_bending", Float64MultiArray(data=[0.1, 0.2]))
    assert daemon.commands == [("arm",)]
    bridge.leave()
    assert guard.in_order is True


def test_another_programs_robot_is_not_taken_over(bridge, daemon, guard):
    daemon.mode = state_t.MODE_RUNNING
    answer = bridge.call("/tendril/arm")
    assert not answer.success and "another program armed" in answer.message
    assert daemon.commands == [] and True not in guard.told


def test_an_arm_does_not_wait_for_drives(bridge, daemon):
    daemon.mode = state_t.MODE_DISCONNECTED
    answer = bridge.call("/tendril/arm")
    assert not answer.success and "drives are not there" in answer.message and daemon.commands == []


def test_nothing_is_armed_by_a_node_that_ends(bridge, daemon):
    bridge.leave()
    assert "this node ends" in bridge.call("/tendril/arm").message and daemon.commands == []


def test_the_guard_is_told_every_second_and_started_again(bridge, daemon, guard):
    told = len(guard.told)
    bridge.diagnose()
    assert len(guard.told) == told + 1 and guard.starts == 1
    guard.there = False
    bridge.diagnose()
    assert guard.starts == 2


def test_old_foreign_and_wrong_targets_are_refused(bridge, daemon):
    bridge.call("/tendril/arm")
    ahead = Time(sec=int(time.time()) + 9, nanosec=0)
    bridge.receive("/tendril/target_tip", PointStamped(header=Header(stamp=ahead)))
    assert "in the future" in bridge.logger.lines[-1][1]
    old = Time(sec=int(time.time()) - 3, nanosec=0)
    bridge.receive("/tendril/target_tip", PointStamped(header=Header(stamp=old)))
    assert "s old; valid_for is 0.5 s" in bridge.logger.lines[-1][1]
    bridge.receive("/tendril/target_tip", PointStamped(header=Header(frame_id="camera")))
    assert "frame 'camera'; give 'base_link'" in bridge.logger.lines[-1][1]
    bridge.receive("/tendril/target_bending", Float64MultiArray(data=[0.1, 0.2, 0.3]))
    assert "expected us, vs" in bridge.logger.lines[-1][1]
    assert daemon.commands == [("arm",)]


def test_nothing_is_armed_or_moved_without_the_guard(bridge, daemon, guard):
    guard.there = False
    answer = bridge.call("/tendril/arm")
    assert not answer.success and "does not start" in answer.message and daemon.commands == []
    guard.there = True
    bridge.call("/tendril/arm")
    guard.there = False
    bridge.receive("/tendril/target_bending", Float64MultiArray(data=[0.1, 0.2]))
    assert daemon.commands == [("arm",)] and "is gone" in bridge.logger.lines[-1][1]


def test_a_refusal_is_the_services_answer_and_a_line_for_targets(bridge, daemon):
    bridge.call("/tendril/arm")
    daemon.refuses = "refused (212): another program commands; let it disarm"
    answer = bridge.call("/tendril/hold")
    assert not answer.success and answer.message == daemon.refuses
    bridge.publish()
    daemon.changed = dict(commands_refused=1, command_status=204, command_status_text="beyond the limit")
    bridge.publish()
    assert bridge.logger.lines[-1] == ("warning", "refused: beyond the limit")


def test_a_failed_disarm_leaves_the_robot_to_the_guard(bridge, daemon, guard):
    bridge.call("/tendril/arm")
    daemon.refuses = "no answer"
    assert not bridge.call("/tendril/disarm").success
    bridge.leave()
    assert guard.in_order is False and daemon.closed


def test_whoever_never_armed_leaves_in_order(bridge, daemon, guard):
    bridge.publish()
    bridge.leave()
    assert guard.in_order is True and daemon.closed and True not in guard.told


def test_diagnostics(bridge, daemon):
    daemon.statistic = some_statistics(deadline_misses=2)
    daemon.news = [
        tendril.Event(0, 0, "", "daemon", "started"),
        tendril.Event(0, 412, "", "bus", "lost"),
        tendril.Event(0, 212, "", "gate", "refused"),
    ]
    bridge.diagnose()
    robot, loop, bus = only(bridge, "/diagnostics").status
    assert (robot.level, loop.level, bus.level) == (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.OK)
    assert [level for level, _ in bridge.logger.lines] == ["info", "error", "warning"]
    daemon.changed = dict(
        mode=7, mode_text="fault", status=412, status_text="drive lost", status_remedy="Check its cable."
    )
    daemon.statistic = some_statistics(deadline_misses=2, drive_error_code=np.array([0, 0x2310]))
    bridge.diagnose()
    robot, loop, bus = bridge.sent["/diagnostics"][-1].status
    assert (robot.level, loop.level, bus.level) == (DiagnosticStatus.ERROR, DiagnosticStatus.OK, DiagnosticStatus.ERROR)
    assert robot.message == "fault: drive lost. Check its cable." and "nodes [2]" in bus.message


def test_a_silent_daemon_is_stale_and_the_next_may_be_another_robot(bridge, daemon):
    bridge.publish()
    daemon.answers = False
    bridge.publish()
    bridge.diagnose()
    (status,) = only(bridge, "/diagnostics").status
    assert status.level == DiagnosticStatus.STALE and "no daemon answers" in status.message
    assert len(bridge.sent["/joint_states"]) == 1
    daemon.answers, daemon.robot = True, lambda timeout: tendril.load_robot(ROBOT.with_name("two_section.yaml"))
    daemon.changed = dict(bending_estimate_rad=np.zeros(4))
    bridge.publish()
    assert len(bridge.sent["/joint_states"][-1].name) == 16


def test_states_of_another_robot_wait_for_its_description(bridge, daemon):
    bridge.publish()
    daemon.changed = {"bending_estimate_rad": np.zeros(4)}
    bridge.publish()
    assert len(bridge.sent["/joint_states"]) == len(bridge.sent["/tendril/tendons"]) == 1
    daemon.robot = lambda timeout: tendril.load_robot(ROBOT.with_name("two_section.yaml"))
    bridge.publish()
    assert len(bridge.sent["/joint_states"][-1].name) == 16


def test_another_robot_of_as_many_sections_is_noticed(bridge, daemon):
    bridge.publish()
    daemon.robot = lambda timeout: tendril.load_robot(ROBOT.with_name("rig_90mm.yaml"))
    bridge.diagnose()
    daemon.changed = {"bending_estimate_rad": np.array([0.8, -0.4])}
    bridge.publish()
    other = tendril.Model(tendril.load_robot(ROBOT.with_name("rig_90mm.yaml")))
    np.testing.assert_array_equal(bridge.sent["/joint_states"][-1].position, other.hinge_angles(other.spread([0.8, -0.4])))
    assert bridge._model.robot.name == "rig_90mm"


@pytest.mark.parametrize("name, value", [("rate", 0.0), ("rate", math.nan), ("valid_for", 0.0)])
def test_parameters_out_of_range(daemon, guard, name, value):
    from tendril_ros2.bridge import Bridge

    rclpy.parameters.clear()
    rclpy.parameters[name] = value
    with pytest.raises(ValueError, match="give 0.1 to 1000 Hz"):
        Bridge(lambda url, prefix: daemon, lambda url, prefix: guard)
