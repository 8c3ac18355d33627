"""What colcon and ros2 launch read of the package, beside fakes of both."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from xml.etree import ElementTree

import rclpy
import tendril
from conftest import ROBOT, SOURCE
from launch import LaunchContext
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch_ros.actions import Node
from tendril_ros2.bridge import Bridge

PACKAGE = SOURCE / "ros2"


def test_version_is_the_projects():
    version = re.search(r"project\(tendril VERSION ([0-9.]+)", (SOURCE / "CMakeLists.txt").read_text())[1]
    assert ElementTree.parse(PACKAGE / "package.xml").getroot().findtext("version") == version


def test_installed_are_program_and_launch_file(tmp_path):
    for part in ("setup.py", "setup.cfg", "package.xml", "resource", "launch", "tendril_ros2"):
        (tmp_path / part).symlink_to(PACKAGE / part)
    words = [sys.executable, "setup.py", "-q", "install", "--root", "root", "--prefix", "/usr"]
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    installed = {path.relative_to(tmp_path / "root" / "usr").as_posix() for path in (tmp_path / "root").rglob("*")}
    assert {
        "lib/tendril_ros2/bridge",  # where ros2 run looks
        "share/tendril_ros2/package.xml",
        "share/tendril_ros2/launch/tendril.launch.py",
        "share/ament_index/resource_index/packages/tendril_ros2",
    } <= installed
    assert any(name.endswith("tendril_ros2/conversions.py") for name in installed)


def test_launch_starts_the_bridge_and_the_frames_of_the_robot(daemon, guard):
    launch = runpy.run_path(str(PACKAGE / "launch" / "tendril.launch.py"))
    actions = launch["generate_launch_description"]().actions
    arguments = {a.name: a.default_value for a in actions if isinstance(a, DeclareLaunchArgument)}
    (bridge,) = (a for a in actions if isinstance(a, Node))
    given = bridge.parameters[0]
    rclpy.parameters.clear()
    rclpy.parameters.update({name: value.value_type(arguments[value.value.name]) for name, value in given.items()})
    Bridge(lambda url, prefix: daemon, lambda url, prefix: guard)
    assert set(arguments) == set(given) | {"robot"} and set(given) <= set(rclpy.nodes[-1].declared)
    (frames,) = (a for a in actions if isinstance(a, OpaqueFunction))
    (publisher,) = frames.function(LaunchContext(**(arguments | {"robot": str(ROBOT)})))
    assert publisher.executable == "robot_state_publisher"
    assert publisher.parameters[0]["robot_description"].value == tendril.load_robot(ROBOT).to_urdf()


def test_without_a_daemon_the_bridge_starts_alone(monkeypatch):
    launch = runpy.run_path(str(PACKAGE / "launch" / "tendril.launch.py"))
    arguments = {name: default for name, (default, _) in launch["ARGUMENTS"].items()}

    def nobody(url, prefix):
        raise tendril.DaemonError("no daemon answers")

    monkeypatch.setattr(tendril, "Client", nobody)
    (told,) = launch["_frames"](LaunchContext(**arguments))
    assert isinstance(told, LogInfo) and "no daemon answers; or give robot:=FILE" in told.msg
