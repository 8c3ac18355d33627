"""The node: republishes the daemon's state, and commands the daemon through its gate.

Whoever arms through this node is in control until the drives are off, or until it ends: closed, interrupted or
terminated, it disarms by `tendril.Client`; killed or hung, by the guard, a process of its own. Targets are passed on
only while this node is in control, and those that the daemon refuses are logged with the remedy.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
import tendril
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import Trigger
from tendril.dashboard.guard import Guard
from tendril.messages import state_t
from tendril.state import DRIVES_OFF, FIRST_FAULT

from . import conversions

# A queue of targets would be followed late.
NEWEST = QoSProfile(depth=1)
DIAGNOSTICS_EVERY_S = 1.0
# An arm shows in the state by then.
SHOWS_S = 1.0


class Bridge(Node):  # type: ignore[misc, unused-ignore]
    """One daemon's robot.

    Args:
        connect: opens a client of the daemon at an address, with a prefix of its channels.
        watch: makes the guard of the same, which disarms where this process no longer can.
    """

    def __init__(self, connect: Callable[..., Any] = tendril.Client, watch: Callable[..., Any] = Guard) -> None:
        super().__init__("tendril")
        url = self.declare_parameter("lcm_url", "").value or None
        prefix = self.declare_parameter("prefix", "TENDRIL").value
        self._model: tendril.Model | None = None
        self._statistics: tendril.Statistics | None = None
        self._lock = threading.Lock()  # of what follows, which callbacks of several threads share
        self._ours = False  # this node sent an arm, and the drives are not off since
        self._armed = False  # the daemon accepted it
        self._arming, self._shows_at, self._disarms, self._leaving = False, float("-inf"), 0, False
        self._refused: int | None = None
        self._base = self.declare_parameter("base_frame", "base_link").value
        self._valid_for = float(self.declare_parameter("valid_for", 0.5).value)
        rate_Hz = float(self.declare_parameter("rate", 50.0).value)
        if not 0.1 <= rate_Hz <= 1000 or not 1e-3 <= self._valid_for <= 3600:
            raise ValueError(
                f"rate is {rate_Hz} Hz, valid_for {self._valid_for} s; give 0.1 to 1000 Hz, 0.001 to 3600 s"
            )
        self._client, self._guard = connect(url, prefix), watch(url, prefix)
        self._guard.start()  # by the time that somebody arms it stands by
        self._advertise()
        self._listen()
        self.create_timer(1 / rate_Hz, self.publish, callback_group=MutuallyExclusiveCallbackGroup())
        self.create_timer(DIAGNOSTICS_EVERY_S, self.diagnose, callback_group=MutuallyExclusiveCallbackGroup())

    def _advertise(self) -> None:
        self._joints = self.create_publisher(JointState, "joint_states", 10)
        self._sections = self.create_publisher(JointState, "~/sections", 10)
        self._tendons = self.create_publisher(JointState, "~/tendons", 10)
        self._tendon_references = self.create_publisher(JointState, "~/tendon_references", 10)
        self._tip = self.create_publisher(PoseStamped, "~/tip", 10)
        self._tip_reference = self.create_publisher(PointStamped, "~/tip_reference", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def _listen(self) -> None:
        """Disarming and holding have threads of their own: they wait for no other service, nor for a target."""
        services, holding, disarming, targets = (MutuallyExclusiveCallbackGroup() for _ in range(4))
        self.create_service(Trigger, "~/arm", self._arm, callback_group=services)
        self.create_service(Trigger, "~/hold", self._mode("hold"), callback_group=holding)
        self.create_service(Trigger, "~/clear", self._mode("clear"), callback_group=services)
        self.create_service(Trigger, "~/disarm", self._disarm, callback_group=disarming)
        for kind, name, receive in (
            (PointStamped, "~/target_tip", self._target_tip),
            (Float64MultiArray, "~/target_bending", self._target_bending),
            (Float64MultiArray, "~/target_tension", self._target_tension),
        ):
            self.create_subscription(kind, name, receive, NEWEST, callback_group=targets)

    # ---- from the daemon ----

    def publish(self) -> None:
        """The newest state on all topics; nothing while no daemon answers."""
        self._keep_guard()
        try:
            state = self._client.state(timeout=0.0)
            self._follow(state)
            model = self._model_of(state)
        except tendril.Error:
            return
        if model is None:
            return
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._base)
        for publisher, message in (
            (self._joints, conversions.unit_joints(model, state, header)),
            (self._sections, conversions.sections(state.bending_estimate_rad, header)),
            (self._tendons, conversions.tendons(state.displacement_m, state.tension_base_estimate_N, header)),
            (
                self._tendon_references,
                conversions.tendons(state.displacement_desired_m, state.tension_desired_base_N, header),
            ),
            (self._tip, conversions.tip_pose(state, header)),
            (self._tip_reference, conversions.tip_reference(state, header)),
        ):
            if message is not None:
                publisher.publish(message)
        self._log_refusals(state)

    def diagnose(self) -> None:
        """The daemon's health, and its events as lines of the log."""
        self._keep_guard()  # however slow the topics are
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        try:
            message.status = [conversions.robot_status(self._client.state(timeout=0.0))]
            statistics = self._client.statistics()
            if statistics is not None:
                message.status += [
                    conversions.loop_status(statistics, self._statistics),
                    conversions.bus_status(statistics),
                ]
                self._statistics = statistics
        except tendril.Error as error:
            self._model = None  # what answers next may be another robot
            message.status = [conversions.silent(str(error))]
        self._diagnostics.publish(message)
        self._renew_model()
        for event in self._client.events():
            self._log(event.status, f"{event.source}: {event.text}")

    def _log(self, status: int, line: str) -> None:
        """A line each: rclpy refuses a place in the source that changes its severity."""
        if status >= FIRST_FAULT:
            self.get_logger().error(line)
        elif status:
            self.get_logger().warning(line)
        else:
            self.get_logger().info(line)

    def _model_of(self, state: tendril.State) -> tendril.Model | None:
        """The model of the robot in this state; None while the daemon has not said yet which it is."""

        def fits() -> bool:
            return self._model is not None and 2 * self._model.robot.sections == state.bending_estimate_rad.size

        if not fits():
            self._model = tendril.Model(self._client.robot(timeout=0.0))
        return self._model if fits() else None

    def _renew_model(self) -> None:
        """Another robot may have as many sections as the one before."""
        with contextlib.suppress(tendril.Error):
            robot = self._client.robot(timeout=0.0)
            if self._model is not None and robot.to_yaml() != self._model.robot.to_yaml():
                self._model = tendril.Model(robot)

    def _log_refusals(self, state: tendril.State) -> None:
        """Targets are sent without waiting for an answer: refusals show in the state."""
        before, self._refused = self._refused, state.commands_refused
        if before is not None and state.commands_refused > before and self._armed and state.command_status:
            self.get_logger().warning(f"refused: {state.command_status_text}", throttle_duration_sec=1.0)

    def leave(self) -> None:
        """Disarms what this node armed, and closes the connection; the guard disarms too, should this fail."""
        self._leaving = True
        self._guard.leave(in_order=not self._ours)
        self._client.close()

    # ---- commands ----

    def _guard_knows(self) -> bool:
        with self._lock:
            return bool(self._guard.tell(self._ours, time.monotonic()))

    def _keep_guard(self) -> None:
        """A guard that is gone is started again, and hears of an armed robot with the next beat."""
        if not self._guard_knows():
            with contextlib.suppress(OSError):
                self._guard.start()

    def _follow(self, state: tendril.State) -> None:
        """Drives that are off are under no control, whoever switched them off."""
        with self._lock:
            if state.mode in DRIVES_OFF and not self._arming and time.monotonic() > self._shows_at:
                self._ours = self._armed = False

    def _arm(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        asked = self._disarms
        why_not = self._why_not_arm()
        if why_not:
            return _answer(response, f"not armed: {why_not}")
        with self._lock:
            self._ours = self._arming = True
        try:
            if self._guard_knows():
                response = self._do(self._client.arm, response)
            else:
                _answer(response, "not armed: the process that disarms when this one ends is gone; try again")
        finally:
            with self._lock:
                # Without an answer it may have been armed all the same: then the state says so.
                self._arming, self._armed = False, bool(response.success)
                self._shows_at = time.monotonic() + SHOWS_S
        if self._disarms != asked:
            self._disarm(_request, response)
            return _answer(response, "not armed: disarmed while it was arming")
        return response

    def _why_not_arm(self) -> str:
        """Empty where nothing is in the way."""
        if self._leaving:
            return "this node ends"
        if not self._guard.ready():
            return "the process that disarms when this one ends does not start"
        try:
            mode = self._client.state(timeout=2.0).mode
        except tendril.Error as error:
            return str(error)
        if mode == state_t.MODE_DISCONNECTED:
            return "the drives are not there yet; switch them on, and try again"
        if mode not in DRIVES_OFF and not self._ours:
            return "another program armed this robot; disarm it first"
        return ""

    def _disarm(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        with self._lock:
            self._disarms += 1
        response = self._do(self._client.disarm, response)
        if response.success:
            with self._lock:
                self._ours = self._arming  # an arm that is under way is disarmed at its end
                self._armed = False
            self._guard_knows()
        return response

    def _mode(self, name: str) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        return lambda _request, response: self._do(getattr(self._client, name), response)

    def _do(self, command: Callable[[], str], response: Trigger.Response) -> Trigger.Response:
        try:
            return _answer(response, command(), done=True)
        except tendril.Error as error:
            return _answer(response, str(error))

    def _target_tip(self, message: PointStamped) -> None:
        frame, stamp, age_s = message.header.frame_id, message.header.stamp, 0.0
        if frame not in ("", self._base):
            self._refuse(f"target_tip is in frame '{frame}'; give '{self._base}'")
            return
        if stamp.sec or stamp.nanosec:
            now = self.get_clock().now().to_msg()
            age_s = now.sec - stamp.sec + 1e-9 * (now.nanosec - stamp.nanosec)
            if age_s > self._valid_for:
                self._refuse(f"target_tip is {age_s:.2f} s old; valid_for is {self._valid_for} s")
                return
            if age_s < -self._valid_for:
                self._refuse(f"target_tip is stamped {-age_s:.2f} s in the future; set the clocks")
                return
        self._send(self._client.send_tip, [message.point.x, message.point.y, message.point.z], max(age_s, 0.0))

    def _target_bending(self, message: Float64MultiArray) -> None:
        self._send(self._client.send_bending, list(message.data))

    def _target_tension(self, message: Float64MultiArray) -> None:
        self._send(self._client.send_tension, list(message.data))

    def _send(self, send: Callable[..., str], values: list[float], age_s: float = 0.0) -> None:
        if not self._armed:
            self._refuse("this node did not arm the robot; call its service arm first")
        elif not self._guard_knows():
            self._refuse("the process that disarms when this one ends is gone; disarm, and arm again")
        else:
            try:
                send(values, valid_for=max(1e-3, self._valid_for - age_s), timeout=0.0)
            except (tendril.Error, ValueError) as error:
                self._refuse(str(error))

    def _refuse(self, why: str) -> None:
        self.get_logger().warning(f"target not sent: {why}", throttle_duration_sec=1.0)


def _answer(response: Trigger.Response, message: str, done: bool = False) -> Trigger.Response:
    response.success, response.message = done, message
    return response


def main(arguments: list[str] | None = None) -> None:
    """Runs until it is interrupted or terminated; then disarms what it armed."""
    rclpy.init(args=arguments)
    bridge = Bridge()
    executor = MultiThreadedExecutor(num_threads=7)
    executor.add_node(bridge)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        bridge.leave()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
