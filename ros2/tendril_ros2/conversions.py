"""What a daemon publishes, as ROS messages. Knows no node, and nothing of LCM."""

from __future__ import annotations

import math

import numpy as np
import tendril
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped, PoseStamped
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from tendril.state import FIRST_FAULT

Array = NDArray[np.float64]


def _numbers(values: Array) -> list[float]:
    return [float(value) for value in values]


def unit_joints(model: tendril.Model, state: tendril.State, header: Header) -> JointState | None:
    """The joints of the URDF for the estimated bend, shared equally by the units of a section; None: not known."""
    if not np.isfinite(state.bending_estimate_rad).all():
        return None
    angles = model.hinge_angles(model.spread(state.bending_estimate_rad))
    names = [f"unit{unit}_{direction}" for unit in range(1, model.robot.units + 1) for direction in "uv"]
    return JointState(header=header, name=names, position=_numbers(angles))


def sections(bending: Array, header: Header) -> JointState:
    """us, vs of each section [rad]."""
    names = [f"section{k}_{d}" for k in range(1, len(bending) // 2 + 1) for d in "uv"]
    return JointState(header=header, name=names, position=_numbers(bending))


def tendons(displacement_m: Array, tension_N: Array, header: Header) -> JointState:
    """Pulled in since pretension [m] as position, tension at the robot's base [N] as effort; NaN: not known."""
    names = [f"tendon{j}" for j in range(1, len(displacement_m) + 1)]
    return JointState(header=header, name=names, position=_numbers(displacement_m), effort=_numbers(tension_N))


def tip_pose(state: tendril.State, header: Header) -> PoseStamped | None:
    """The estimated tip; None: not known."""
    where, turned = state.tip_estimate_W_m, state.orientation_estimate_WT
    if not (np.isfinite(where).all() and np.isfinite(turned).all()):
        return None
    message = PoseStamped(header=header)
    message.pose.position.x, message.pose.position.y, message.pose.position.z = _numbers(where)
    orientation = message.pose.orientation
    orientation.w, orientation.x, orientation.y, orientation.z = _numbers(turned)
    return message


def tip_reference(state: tendril.State, header: Header) -> PointStamped | None:
    """The tip of the present reference; None: there is none."""
    if not np.isfinite(state.tip_desired_W_m).all():
        return None
    message = PointStamped(header=header)
    message.point.x, message.point.y, message.point.z = _numbers(state.tip_desired_W_m)
    return message


def _status(level: bytes, name: str, text: str, values: dict[str, object]) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(level=level, name=f"tendril: {name}", message=text, hardware_id="tendrild", values=pairs)


def silent(why: str) -> DiagnosticStatus:
    """No daemon answers."""
    return _status(DiagnosticStatus.STALE, "robot", why, {})


def robot_status(state: tendril.State) -> DiagnosticStatus:
    """Mode, and the most severe status with its remedy: from FIRST_FAULT on a fault, any other a limit that acts."""
    level = DiagnosticStatus.OK if state.status == 0 else DiagnosticStatus.WARN
    if state.faulted or state.status >= FIRST_FAULT:
        level = DiagnosticStatus.ERROR
    text = state.mode_text if state.status == 0 else f"{state.mode_text}: {state.status_text}. {state.status_remedy}"
    values = {
        "mode": state.mode_text,
        "status": state.status,
        "commands accepted": state.commands_accepted,
        "commands refused": state.commands_refused,
    }
    return _status(level, "robot", text.strip(), values)


def loop_status(now: tendril.Statistics, before: tendril.Statistics | None) -> DiagnosticStatus:
    """Timing of the loop; a warning where cycles were missed since `before`."""
    missed = now.deadline_misses - (before.deadline_misses if before else 0)
    level = DiagnosticStatus.WARN if missed > 0 else DiagnosticStatus.OK
    text = f"{missed} cycles missed" if missed > 0 else "every cycle in time"
    p99_us = now.compute_ns[1] / 1e3 if len(now.compute_ns) > 1 else math.nan
    values = {
        "cycles": now.cycles,
        "cycles missed since start": now.deadline_misses,
        "computation, 99 % [us]": f"{p99_us:.1f}",
    }
    return _status(level, "loop", text, values)


def bus_status(now: tendril.Statistics) -> DiagnosticStatus:
    """Load of the bus, and errors of its drives."""
    faulty = [int(node) for node, code in zip(now.drive_node_id, now.drive_error_code) if code != 0]
    level = DiagnosticStatus.ERROR if faulty else DiagnosticStatus.OK
    text = f"drives with an error: nodes {faulty}" if faulty else "all drives without an error"
    values: dict[str, object] = {"load [%]": f"{100 * now.bus_load:.1f}", "bus-off": now.can_bus_off}
    for node, code, age in zip(now.drive_node_id, now.drive_error_code, now.drive_worst_age_cycles):
        values[f"node {node}"] = f"error 0x{int(code):04X}, oldest feedback {int(age)} cycles"
    return _status(level, "bus", text, values)
