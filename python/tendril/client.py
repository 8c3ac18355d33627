"""A client of a running daemon, real or simulated (`tendril sim`), over LCM."""

from __future__ import annotations

import atexit
import dataclasses
import os
import pathlib
import signal
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from ._arrays import Array, numbers, vector
from .errors import ConfigError, DaemonError, Error
from .messages import event_t, run_t, state_t, statistics_t

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"

_Message = TypeVar("_Message")
_Found = TypeVar("_Found")


def _mirror(kind: type[_Message], message: Any) -> _Message:
    """The dataclass `kind` with the fields of an LCM message: lists of numbers become arrays."""
    values = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        value = getattr(message, field.name)
        is_list = isinstance(value, (list, tuple))
        values[field.name] = np.array(value) if is_list and "Array" in str(field.type) else value
    return kind(**values)


@dataclasses.dataclass(frozen=True, eq=False)
class State:
    """State of robot and controller in a cycle: the fields of LCM's `state_t`, without the counts.

    Bending is (us, vs) = angle (cos, sin) of each section [rad], (2K,); tendon values are in tendon order, (M,), pull
    positive; positions are in the base frame. NaN: not known.
    """

    utime: int
    """Start of the cycle [us since the epoch]; in simulation: simulated time."""
    cycle: int
    """Number of the cycle since the start of the controller."""
    mode: int
    """`tendril.messages.state_t.MODE_...`"""
    mode_text: str
    """The same in words, such as 'running'."""
    status: int
    """Number of the most severe status of this cycle; 0: ok, 400 and above: fault."""
    status_text: str
    """Its meaning."""
    status_remedy: str
    """Remedy; empty when none is needed."""
    reported: Array
    """Numbers of all statuses of this cycle, the most severe first."""
    commands_accepted: int
    """Commands accepted since start."""
    commands_refused: int
    """Commands refused since start."""
    command_sequence: int
    """Sequence number of the last command seen, as sent."""
    command_status: int
    """Reason of the last command's refusal; 0: accepted."""
    command_status_text: str
    """The same in words, with the remedy."""
    target_tip_W_m: Array
    """Commanded tip [m], (3,); NaN when bending or tensions were commanded."""
    target_distance_m: float
    """Distance from there to the nearest reachable point [m]; 0: reachable."""
    bending_target_rad: Array
    """Target of the motion [rad], (2K,)."""
    bending_desired_rad: Array
    """Present reference within the limits of the trajectory [rad], (2K,)."""
    bending_rate_desired_radps: Array
    """Its rate [rad/s], (2K,)."""
    bending_estimate_rad: Array
    """Bending from tendon displacements and tensions [rad], (2K,)."""
    bending_covariance_rad2: Array
    """Covariance of the estimate by the sensors' noise and resolution [rad^2], row by row, (2K * 2K,)."""
    tip_desired_W_m: Array
    """Tip of the desired bending [m], (3,)."""
    tip_estimate_W_m: Array
    """Tip of the estimated bending [m], (3,)."""
    orientation_estimate_WT: Array
    """Unit quaternion w, x, y, z of the tip frame in the base frame, (4,)."""
    tension_desired_base_N: Array
    """Desired tensions at the robot's base, from the model [N], (M,)."""
    tension_desired_motor_N: Array
    """Desired tensions at the motor side, friction compensated [N], (M,)."""
    tension_measured_N: Array
    """Load cells, on their side of the pulleys [N], (M,)."""
    tension_base_estimate_N: Array
    """Tensions at the robot's base, from the load cells [N], (M,)."""
    displacement_desired_m: Array
    """Tendons pulled in since pretension, desired [m], (M,)."""
    displacement_m: Array
    """The same, measured at the spool [m], (M,)."""
    torque_desired_Nm: Array
    """Desired torques at the motor shaft [N m], (M,)."""
    torque_measured_Nm: Array
    """Torques at the motor shaft from the drives' current [N m], (M,)."""

    @property
    def running(self) -> bool:
        """True where targets are taken."""
        return bool(self.mode == state_t.MODE_RUNNING)

    @property
    def faulted(self) -> bool:
        """True in mode fault: `clear()`, then `arm()`."""
        return bool(self.mode == state_t.MODE_FAULT)

    @property
    def disarmed(self) -> bool:
        """True where the drives are disabled, or about to be."""
        return self.mode in (
            state_t.MODE_DISCONNECTED,
            state_t.MODE_CONFIGURED,
            state_t.MODE_SAFE_STOP,
            state_t.MODE_FAULT,
        )


@dataclasses.dataclass(frozen=True)
class Event:
    """A single event for operators: the fields of LCM's `event_t`."""

    utime: int
    """When it happened [us since the epoch]; in simulation: simulated time."""
    status: int
    """Status number; 0: information."""
    status_text: str
    """Meaning of the number."""
    source: str
    """Source, for example 'bus', 'gateway', 'daemon'."""
    text: str
    """One line, with the remedy."""


@dataclasses.dataclass(frozen=True, eq=False)
class Statistics:
    """Timing of the loop, drives and bus, once a second: the fields of LCM's `statistics_t`, without the counts.

    Counts are since the daemon's start.
    """

    utime: int
    """[us since the epoch]"""
    cycles: int
    """Cycles run."""
    deadline_misses: int
    """Whole cycles skipped."""
    bin_below_ns: Array
    """Upper edge of each bin of the histograms, exclusive [ns]."""
    wake_latency_counts: Array
    """Cycles in each bin: wake-up less the grid point."""
    compute_counts: Array
    """Cycles in each bin: the controller's step."""
    round_trip_counts: Array
    """Cycles in each bin: SYNC to the last feedback."""
    wake_latency_ns: Array
    """Median, 99 %, 99.9 %, maximum [ns]."""
    compute_ns: Array
    """Median, 99 %, 99.9 %, maximum [ns]."""
    round_trip_ns: Array
    """Median, 99 %, 99.9 %, maximum [ns]."""
    miss_cycle: Array
    """The late cycles, oldest first."""
    miss_skipped: Array
    """Periods skipped before each."""
    miss_cause: list[str]
    """The part of each cycle that took longest."""
    messages_ignored: int
    """LCM messages that could not be decoded."""
    publish_failed: int
    """LCM messages that could not be sent."""
    last_fault_utime: int
    """[us since the epoch]; 0: none since start."""
    last_fault_status: int
    """Status number."""
    last_fault_text: str
    """Its meaning, with tendon and node where it concerns one."""
    can_sent: int
    """Frames."""
    can_received: int
    """Frames."""
    can_send_refused: int
    """The interface's queue was full."""
    can_receive_dropped: int
    """The reader was too slow."""
    can_error_frames: int
    """Error frames of the interface."""
    can_bus_off: int
    """Times that the interface went off the bus."""
    can_malformed: int
    """From a drive's identifier, with invalid length or contents."""
    can_foreign: int
    """That only the daemon may send, from another sender."""
    bus_load: float
    """Of the bit rate, over the last second, 0 to 1."""
    drive_node_id: Array
    """CANopen node id of each drive, (M,)."""
    drive_state: Array
    """`tendril.messages.cycle_t.DRIVE_...` of each drive, (M,)."""
    drive_statusword: Array
    """Object 0x6041, (M,)."""
    drive_error_code: Array
    """Last emergency code; 0: none, (M,)."""
    drive_serial: Array
    """Object 0x1018:04; 0: not read yet, (M,)."""
    drive_age_cycles: Array
    """Age of the feedback [cycles]; 0: arrived in the last cycle, (M,)."""
    drive_worst_age_cycles: Array
    """The same, the worst over the last second, (M,)."""
    voluntary_switches: int
    """Waits of the real-time thread for anything but the bus: should stay 0."""
    involuntary_switches: int
    """Preemption by a higher priority."""
    minor_faults: int
    """Page faults: should stay 0."""
    major_faults: int
    """Page faults from disk."""


# No drive pulls in these.
_LIMP = (state_t.MODE_DISCONNECTED, state_t.MODE_CONFIGURED, state_t.MODE_FAULT)

_open: weakref.WeakSet[Client] = weakref.WeakSet()


@atexit.register
def _close_all() -> None:
    """A program that ends leaves nothing armed that it armed."""
    for client in list(_open):
        client.close()


def _leave(number: int, _frame: Any) -> None:
    raise SystemExit(128 + number)


def _leave_on_signals() -> None:
    """SIGTERM and SIGHUP (the terminal closes) end a program at once, past every `with` and `atexit`. Where it leaves
    them to their default, they end it as Ctrl-C does instead."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _leave)


class Client:
    """Operates a daemon over LCM: commands out, states and events in.

    As a context manager it disarms on leaving the block, also after an exception or Ctrl-C, if it commanded anything;
    without one it does so when it is closed, or the program ends. From the first command on, SIGTERM and SIGHUP end the
    program by SystemExit, unless it handles or ignores them:

        with tendril.Client() as client:
            client.arm()
            client.send_tip([0.02, 0.0, 0.055])

    Iteration yields each state as it arrives. Commands carry this process's own sender number; while another program is
    in control, the daemon refuses them. Every command goes through the daemon's gate; refusals raise `DaemonError` with
    reason and remedy.

    Args:
        url: LCM address, as in the daemon file's `lcm.url`; None: LCM_DEFAULT_URL, or this computer alone.
        prefix: of the channels, as in the daemon file's `lcm.channel_prefix`.
    """

    def __init__(self, url: str | None = None, prefix: str = "TENDRIL") -> None:
        self._armed = False
        try:
            self._core = _core.Client(url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL, prefix)
        except Error as error:
            raise DaemonError(str(error)) from None
        _open.add(self)

    # ---- receiving ----

    def state(self, timeout: float = 2.0) -> State:
        """The newest state, if it came within the last half second; else the next one.

        Raises DaemonError when there is none within `timeout` seconds.
        """
        _number, message = self._await(timeout, lambda part: self._core.state(0.5, part))
        return _mirror(State, state_t.decode(message))

    def states(self, timeout: float = 2.0) -> Iterator[State]:
        """Each state that arrives from now on; up to a thousand wait for a slow reader.

        Ends with DaemonError after `timeout` seconds without one.
        """
        newest = self._core.state(1e9, 0.0)
        number = 0 if newest is None else newest[0]
        while True:
            number, message = self._following(number, timeout)
            yield _mirror(State, state_t.decode(message))

    def __iter__(self) -> Iterator[State]:
        return self.states()

    def events(self) -> list[Event]:
        """The events that arrived since the last call, oldest first."""
        return [_mirror(Event, event_t.decode(event)) for event in self._core.events()]

    def statistics(self) -> Statistics | None:
        """The newest statistics; None before the first, which comes within a second."""
        found = self._core.statistics()
        return None if found is None else _mirror(Statistics, statistics_t.decode(found))

    def robot(self, timeout: float = 3.0) -> _core.Robot:
        """The robot that the daemon controls, as it describes it once a second."""
        return _core.parse_robot(self._run(timeout).robot_yaml, "the daemon's robot")

    def daemon(self, timeout: float = 3.0) -> _core.Daemon:
        """The daemon's own file, as it describes it once a second."""
        return _core.parse_daemon(self._run(timeout).daemon_yaml, "the daemon's file")

    # ---- commands ----

    def arm(self, timeout: float = 15.0, waiting: Callable[[str], None] | None = None) -> str:
        """Enables the drives and pretensions; from hold: follow commands again.

        Waits until targets are taken, also for a daemon and drives that are still starting.

        Args:
            timeout: at most so long [s]; 0: does not wait.
            waiting: called with what is waited for, when it does not come soon.

        Returns:
            A line on where the robot is now.
        """
        self._take_charge()
        try:
            answer = self._mode("arm", timeout, waiting)
            if timeout > 0:
                self._until((state_t.MODE_RUNNING,), 2.0)
            return answer
        except (KeyboardInterrupt, SystemExit):
            self._disarm_quietly(0)
            raise

    def disarm(self, timeout: float = 10.0) -> str:
        """Ramps the tensions down and disables the drives; waits until they are.

        Args:
            timeout: at most so long [s]; 0: does not wait.
        """
        answer = self._mode("disarm", min(timeout, 2.0))
        self._armed = False
        if timeout > 0:
            self._until(_LIMP, timeout)
        return answer

    def hold(self, timeout: float = 2.0) -> str:
        """Stops the motion and stays there; `arm()` goes on."""
        return self._mode("hold", timeout)

    def clear(self, timeout: float = 2.0) -> str:
        """Acknowledges a fault."""
        return self._mode("clear", timeout)

    def send_tip(
        self,
        tip: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        speed: float = 0.0,
        valid_for: float = 1.0,
        timeout: float = 2.0,
    ) -> str:
        """Moves the tip to a point.

        Args:
            tip: in the base frame [m], (3,).
            velocity: the target moves on with it [m/s] until the command expires, (3,).
            speed: bending speed towards the target [rad/s]; 0: the daemon's default.
            valid_for: age at which the command is refused, and a moving target stops [s].
            timeout: for the daemon's answer [s]; 0: does not wait, for streams of targets.

        Returns:
            A line on what was accepted; empty with timeout 0.
        """
        point = vector("tip", tip, 3, "x, y, z in the base frame [m]")
        along = vector("velocity", [0, 0, 0] if velocity is None else velocity, 3, "dx, dy, dz [m/s]")
        return self._target(
            lambda: self._core.tip(list(point), list(along), speed, valid_for, timeout), speed, valid_for, timeout
        )

    def send_bending(
        self,
        bending: ArrayLike,
        rate: ArrayLike | None = None,
        *,
        speed: float = 0.0,
        valid_for: float = 1.0,
        timeout: float = 2.0,
    ) -> str:
        """Bends each section: (us, vs) = angle (cos, sin) of its bending plane.

        Args:
            bending: us1, vs1, ... [rad], (2K,).
            rate: the target moves on with it [rad/s] until the command expires, (2K,).
            speed, valid_for, timeout: as in `send_tip`.
        """
        bends = vector("bending", bending, None, "us, vs of each section [rad]")
        rates = [] if rate is None else list(vector("rate", rate, bends.size, "rates of us, vs [rad/s]"))
        return self._target(
            lambda: self._core.bending(list(bends), rates, speed, valid_for, timeout), speed, valid_for, timeout
        )

    def send_tension(self, tension: ArrayLike, *, valid_for: float = 1.0, timeout: float = 2.0) -> str:
        """Holds tensions at the robot's base [N], one a tendon, (M,)."""
        tensions = vector("tension", tension, None, "one tension a tendon [N]")
        return self._target(
            lambda: self._core.tension(list(tensions), valid_for, timeout), 0.0, valid_for, timeout
        )

    def follow(
        self,
        path: str | ArrayLike,
        *,
        times: ArrayLike | None = None,
        corners: bool = False,
        nearest: bool = False,
        speed: float = 0.0,
        acceleration: float = 0.0,
        jerk: float = 0.0,
        stretch: float = 1.0,
        robot: str | os.PathLike[str] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> str:
        """Follows a motion with an armed robot, from its first target to its end, as `tendril follow` does.

        Args:
            path: a motion by name ('circle', 'planar', 'fast_circle', 'square', 'spiral'); or points: tips in the base
                frame [m], (N, 3), or bends of all sections [rad], (N, 2K).
            times: of the points [s], (N,), increasing; None: as fast as the limits allow.
            corners: along straight lines of the tip, at rest in each point; else through the points without stopping.
            nearest: replace points out of reach by the nearest that the tip can reach.
            speed: of a section's bend at most [rad/s]; 0: the daemon's default.
            acceleration: [rad/s^2]; 0: that speed in 0.25 s.
            jerk: [rad/s^3]; 0: that acceleration in 0.1 s.
            stretch: `times` are multiplied by this.
            robot: robot file in place of the daemon's own.
            progress: called once a second with a line.

        Returns:
            What was done and how well it was followed, a line each.

        Raises:
            DaemonError: what goes wrong on the way; the robot then holds the last target.
            ValueError: points that make no sense.
        """
        request = _core.MotionRequest()
        request.nearest, request.stretch = nearest, stretch
        request.speed, request.acceleration, request.jerk = speed, acceleration, jerk
        tell = None if progress is None else (lambda line, _share: progress(line))
        self._take_charge()
        file = "" if robot is None else os.fspath(robot)
        with tempfile.TemporaryDirectory(prefix="tendril-") as folder:
            _word(request, path, times, corners, pathlib.Path(folder))
            return _daemon_errors(lambda: self._core.follow(request, file, tell))

    # ---- life ----

    def close(self) -> None:
        """Disarms if this client commanded anything, and closes the connection."""
        if self._core.closed:
            return
        try:
            if self._armed:
                self._disarm_quietly(10.0)
        finally:
            self._core.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Client(url={self._core.url!r}, prefix={self._core.prefix!r})"

    def _mode(self, request: str, timeout: float, waiting: Callable[[str], None] | None = None) -> str:
        _seconds("timeout", timeout)
        tell = None if waiting is None else (lambda what, _share: waiting(what))
        return _daemon_errors(lambda: self._core.mode(request, timeout, tell))

    def _target(self, send: Callable[[], str], speed: float, valid_for: float, timeout: float) -> str:
        _seconds("timeout", timeout)
        if not 0 <= float(numbers("speed", speed, "rad/s")) <= 1e3:
            raise ValueError(f"speed is {speed}; give 0 to 1000 rad/s, 0 for the daemon's own")
        if not 1e-3 <= float(numbers("valid_for", valid_for, "seconds")) <= 3600:
            raise ValueError(f"valid_for is {valid_for}; give 0.001 to 3600 s")
        self._take_charge()
        return _daemon_errors(send)

    def _take_charge(self) -> None:
        """From now on whatever ends this program disarms."""
        self._armed = True
        _leave_on_signals()

    def _disarm_quietly(self, timeout: float) -> None:
        """Whoever leaves hears of the error that made it leave, not of a daemon that is gone."""
        try:
            self.disarm(timeout)
        except DaemonError:
            pass

    def _following(self, number: int, timeout: float) -> tuple[int, bytes]:
        """The state after the `number`-th, with its number."""
        return self._await(timeout, lambda part: self._core.next(number, part))

    def _until(self, modes: tuple[int, ...], timeout: float) -> None:
        """Until the newest state shows one of these modes."""
        end = time.monotonic() + timeout
        number, message = self._await(timeout, lambda part: self._core.state(0.5, part))
        while state_t.decode(message).mode not in modes:
            number, message = self._following(number, max(end - time.monotonic(), 0.0))

    def _run(self, timeout: float) -> Any:
        return run_t.decode(self._await(timeout, self._core.run))

    def _await(self, timeout: float, find: Callable[[float], _Found | None]) -> _Found:
        """What `find(time)` finds, waited for in parts, so that Ctrl-C is heard."""
        end = time.monotonic() + _seconds("timeout", timeout)
        while True:
            left = end - time.monotonic()
            if (found := find(min(max(left, 0.0), 0.1))) is not None:
                return found
            if left <= 0:
                raise DaemonError(self._core.nobody_answers(timeout))


def _word(
    request: _core.MotionRequest, path: str | ArrayLike, times: ArrayLike | None, corners: bool, folder: pathlib.Path
) -> None:
    """The path in the words of `tendril follow`."""
    if isinstance(path, str):
        named = ("circle", "planar", "fast_circle", "square", "spiral")
        if path not in named:
            raise ValueError(f"there is no motion {path!r}; accepted: {', '.join(named)}, or points")
        if times is not None or corners:
            raise ValueError(f"times and corners go with points, not with the motion {path!r}")
        request.kind = path
        return
    points = numbers("path", path, "tips [m] (N, 3) or bends [rad] (N, 2K)")
    if points.ndim != 2 or points.shape[0] < 2 or (points.shape[1] != 3 and points.shape[1] % 2):
        raise ValueError(f"path has shape {points.shape}; expected (N, 3) tips [m] or (N, 2K) bends [rad], N >= 2")
    tips = points.shape[1] == 3
    if corners and (not tips or times is not None):
        raise ValueError("corners goes with tips and without times")
    names = ["tip_x_m", "tip_y_m", "tip_z_m"]
    if not tips:
        names = [f"{x}s_{k}" for k in range(1, points.shape[1] // 2 + 1) for x in "uv"]
    if corners:
        request.kind = "line"
        request.tips = [",".join(map(repr, map(float, point))) for point in points]
        return
    request.kind = "via"
    if times is not None:
        request.kind, names = "csv", ["t_s", *names]
        at = vector("times", times, len(points), "one time a point [s]")
        points = np.column_stack([at, points])
    rows = [",".join(names)] + [",".join(map(repr, map(float, row))) for row in points]
    file = folder / "path"
    file.write_text("\n".join(rows) + "\n")
    request.points = str(file)


def _daemon_errors(call: Callable[[], str]) -> str:
    try:
        return call()
    except ConfigError:
        raise
    except Error as error:
        raise DaemonError(str(error)) from None


def _seconds(name: str, value: float) -> float:
    if not 0 <= float(numbers(name, value, "seconds")) <= 3600:
        raise ValueError(f"{name} is {value}; give 0 to 3600 s")
    return float(value)
