"""The bridge and the robot's frames: ros2 launch tendril_ros2 tendril.launch.py prefix:=TENDRIL"""

import tendril
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "robot": ("", "robot file of the frames; empty: the robot of the daemon that answers"),
    "lcm_url": ("", "LCM address, as lcm.url of the daemon's file; empty: LCM_DEFAULT_URL, or this computer alone"),
    "prefix": ("TENDRIL", "of the daemon's channels, as lcm.channel_prefix"),
    "rate": ("50.0", "of the topics [Hz]"),
    "valid_for": ("0.5", "age at which a target is refused, and a moving one stops [s]"),
}
KINDS = {"lcm_url": str, "prefix": str, "rate": float, "valid_for": float}


def _urdf(context: LaunchContext) -> str:
    robot, url, prefix = (LaunchConfiguration(name).perform(context) for name in ("robot", "lcm_url", "prefix"))
    if robot:
        return tendril.load_robot(robot).to_urdf()
    with tendril.Client(url or None, prefix) as client:
        return client.robot().to_urdf()


def _frames(context: LaunchContext) -> list[Node | LogInfo]:
    """robot_state_publisher wants the robot when it starts; without it the bridge waits for a daemon alone."""
    try:
        robot = {"robot_description": ParameterValue(_urdf(context), value_type=str)}
    except tendril.Error as error:
        return [LogInfo(msg=f"no frames: {error}; or give robot:=FILE")]
    return [
        Node(package="robot_state_publisher", executable="robot_state_publisher", parameters=[robot], output="screen")
    ]


def generate_launch_description() -> LaunchDescription:
    given = {name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, kind in KINDS.items()}
    return LaunchDescription(
        [
            DeclareLaunchArgument(name, default_value=value, description=text)
            for name, (value, text) in ARGUMENTS.items()
        ]
        + [
            Node(package="tendril_ros2", executable="bridge", parameters=[given], output="screen"),
            OpaqueFunction(function=_frames),
        ]
    )
