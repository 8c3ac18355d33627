"""What the view's tests share: logs and robots written here, from the message types and robot files alone."""

import numpy as np
import pytest

from tendril import messages

from conftest import SOURCE

ROBOT = SOURCE / "config/robots/rig_60mm.yaml"
START = 1_700_000_000_000_000  # [us] of the logs


def run_message(robot_yaml=None):
    message = messages.run_t()
    message.utime = message.start_utime = START
    message.num_sections, message.num_units, message.num_tendons = 1, 4, 3
    message.version, message.git_revision = "0.1.0", "test"
    message.robot_yaml = ROBOT.read_text() if robot_yaml is None else robot_yaml
    return message


def state_message(
    time_s, bending=(0.5, 0.0), tensions=(1.0, 2.0, 3.0), tip=(0.01, 0.0, 0.05), mode="running"
):
    message = messages.state_t()
    message.num_bending, message.num_tendons, message.num_covariance, message.num_reported = 2, 3, 4, 0
    message.utime, message.cycle = START + round(1e6 * time_s), round(1e3 * time_s)
    message.mode, message.mode_text = 4, mode
    message.bending_target_rad = message.bending_desired_rad = message.bending_rate_desired_radps = (0.0, 0.0)
    message.bending_estimate_rad, message.bending_covariance_rad2 = tuple(bending), (0.0,) * 4
    message.target_tip_W_m, message.tip_desired_W_m = (0.0, 0.0, 0.06), (0.012, 0.0, 0.05)
    message.tip_estimate_W_m = tuple(tip)
    for name in (
        "tension_desired_base_N",
        "tension_desired_motor_N",
        "displacement_desired_m",
        "displacement_m",
        "torque_desired_Nm",
        "torque_measured_Nm",
    ):
        setattr(message, name, (0.0,) * 3)
    message.tension_measured_N = tuple(1.2 * t for t in tensions)
    message.tension_base_estimate_N = tuple(tensions)
    return message


def tracker_message(time_s, tip=(0.011, 0.0, 0.05), valid=True):
    message = messages.tracker_t()
    message.utime, message.valid, message.tip_W_m = START + round(1e6 * time_s), valid, tuple(tip)
    message.orientation_WT = (1.0, 0.0, 0.0, 0.0)
    return message


def write_log(path, messages, prefix="TENDRIL"):
    """`messages`: pairs of a channel's ending and a message or bytes."""
    import lcm

    log = lcm.EventLog(str(path), "w", overwrite=True)
    for ending, message in messages:
        data = message if isinstance(message, bytes) else message.encode()
        log.write_event(getattr(message, "utime", START), f"{prefix}_{ending}", data)
    log.close()
    return path


def circle_log(path, seconds=4.0, rate=200):
    """The tip goes round once in four seconds; tensions follow."""
    messages = [("RUN", run_message())]
    for k in range(int(seconds * rate)):
        t = k / rate
        bend = 1.0 * np.array([np.cos(np.pi / 2 * t), np.sin(np.pi / 2 * t)])
        tensions = 0.4 + 3 * (1 + np.cos(np.pi / 2 * t - 2 * np.pi / 3 * np.arange(3)))
        tip = 0.06 * np.array([*(bend * (1 - np.cos(1.0))), np.sin(1.0)])
        messages.append(("STATE", state_message(t, bend, tensions, tip)))
    return write_log(path, messages)


def refused(call, *words):
    """`call` raises ViewError of one line that has these words."""
    from tendril.view.frames import ViewError

    with pytest.raises(ViewError) as error:
        call()
    line = str(error.value)
    assert "\n" not in line
    for word in words:
        assert word in line, line
