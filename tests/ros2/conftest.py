"""What the tests share: the bridge beside a stand-in of its daemon."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest
import rclpy
import tendril
from tendril.messages import state_t, statistics_t

SOURCE = pathlib.Path(__file__).parents[2]
ROBOT = SOURCE / "config" / "robots" / "rig_60mm.yaml"


class Daemon:
    """Stands in for `tendril.Client`; `commands`: all that it was sent; `refuses`: why it refuses, or nothing."""

    def __init__(self) -> None:
        self.commands, self.refuses, self.answers, self.closed = [], "", True, False
        self.changed, self.news, self.statistic = {}, [], None
        self.mode, self.meanwhile = state_t.MODE_CONFIGURED, lambda: None

    def state(self, timeout):
        if not self.answers:
            raise tendril.DaemonError("no daemon answers; start one")
        message = state_t()
        values = {name: getattr(message, name) for name in tendril.State.__dataclass_fields__}
        values |= dict(
            mode=self.mode,
            mode_text="running",
            status=0,
            status_text="ok",
            bending_estimate_rad=np.array([0.8, -0.4]),
            displacement_m=np.array([1e-3, -5e-4, 0.0]),
            displacement_desired_m=np.array([2e-3, 0.0, 0.0]),
            tension_base_estimate_N=np.array([2.0, np.nan, 0.3]),
            tension_desired_base_N=np.array([2.5, 0.3, 0.3]),
            tip_estimate_W_m=np.array([0.01, 0.02, 0.05]),
            tip_desired_W_m=np.array([0.011, 0.02, 0.05]),
            orientation_estimate_WT=np.array([1.0, 0, 0, 0]),
        )
        return tendril.State(**(values | self.changed))

    def robot(self, timeout):
        return tendril.load_robot(ROBOT)

    def events(self):
        news, self.news = self.news, []
        return news

    def statistics(self):
        return self.statistic

    def _take(self, *command):
        self.commands.append(command)
        if self.refuses:
            raise tendril.DaemonError(self.refuses)
        return f"{command[0]}: done"

    def arm(self):
        self.meanwhile()
        answer = self._take("arm")
        self.mode = state_t.MODE_RUNNING
        return answer

    def disarm(self):
        answer = self._take("disarm")
        self.mode = state_t.MODE_CONFIGURED
        return answer

    def hold(self):
        return self._take("hold")

    def clear(self):
        return self._take("clear")

    def send_tip(self, tip, *, valid_for, timeout):
        return self._take("tip", list(tip), valid_for, timeout)

    def send_bending(self, bending, *, valid_for, timeout):
        if len(bending) != 2:
            raise ValueError("bending has 3 numbers; expected us, vs")
        return self._take("bending", list(bending), valid_for, timeout)

    def send_tension(self, tension, *, valid_for, timeout):
        return self._take("tension", list(tension), valid_for, timeout)

    def close(self):
        self.closed = True


class Guard:
    """Stands in for the guard: it is there, or it does not start; `told`: whether the robot is ours, as it was told."""

    def __init__(self) -> None:
        self.there, self.starts, self.told, self.in_order = True, 0, [], None

    def start(self):
        self.starts += 1

    def ready(self):
        return self.starts > 0 and self.there

    def tell(self, ours, now):
        self.told.append(ours)
        return self.there

    def leave(self, in_order):
        self.in_order = in_order


def some_statistics(**changed):
    message = statistics_t()
    values = {name: getattr(message, name) for name in tendril.Statistics.__dataclass_fields__}
    values |= dict(
        compute_ns=np.array([1000, 2000, 3000, 4000]),
        drive_node_id=np.array([1, 2]),
        drive_error_code=np.array([0, 0]),
        drive_worst_age_cycles=np.array([0, 1]),
        bus_load=0.5,
    )
    return tendril.Statistics(**(values | changed))


@pytest.fixture()
def daemon():
    return Daemon()


@pytest.fixture()
def guard():
    return Guard()


@pytest.fixture()
def bridge(daemon, guard):
    from tendril_ros2.bridge import Bridge

    rclpy.parameters.clear()
    return Bridge(lambda url, prefix: daemon, lambda url, prefix: guard)
