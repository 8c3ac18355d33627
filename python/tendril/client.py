"""A client of a running daemon, real or simulated (`tendril sim`), over LCM."""

from __future__ import annotations

import atexit
import os
import pathlib
import signal
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from ._arrays import Array, file_name, flag, number, numbers, text, vector
from .errors import ConfigError, DaemonError, Error
from .messages import event_t, run_t, state_t, statistics_t
from .state import DRIVES_OFF, FIRST_FAULT, Event, State, Statistics, mirror

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"

_Found = TypeVar("_Found")

_open: weakref.WeakSet[Client] = weakref.WeakSet()
# Commanded something, and not closed since: kept here, so that a client that the program drops is disarmed in the end too.
_in_control: set[Client] = set()


@atexit.register
def _close_all() -> None:
    """A program that ends leaves nothing armed that it armed."""
    for client in list(_open):
        client.close()


def _leave_to_parent() -> None:
    """A forked process has the robot of no client: it is the parent's to command and to disarm."""
    for client in list(_open):
        client._core.leave_to_parent()
    _in_control.clear()


os.register_at_fork(after_in_child=_leave_to_parent)


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
        address = text("url", url or os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL)
        try:
            self._core = _core.Client(address, text("prefix", prefix))
        except Error as error:
            raise DaemonError(str(error)) from None
        _open.add(self)

    # ---- receiving ----

    def state(self, timeout: float = 2.0) -> State:
        """The newest state, if it came within the last half second; else the next one.

        Raises DaemonError when there is none within `timeout` seconds.
        """
        _number, message = self._await(timeout, lambda part: self._core.state(0.5, part))
        return mirror(State, state_t.decode(message))

    def states(self, timeout: float = 2.0) -> Iterator[State]:
        """Each state that arrives from now on; up to a thousand wait for a slow reader.

        Ends with DaemonError after `timeout` seconds without one.
        """
        newest = self._core.state(1e9, 0.0)
        number = 0 if newest is None else newest[0]
        while True:
            number, message = self._following(number, timeout)
            yield mirror(State, state_t.decode(message))

    def __iter__(self) -> Iterator[State]:
        return self.states()

    def events(self) -> list[Event]:
        """The events that arrived since the last call, oldest first."""
        return [mirror(Event, event_t.decode(event)) for event in self._core.events()]

    def statistics(self) -> Statistics | None:
        """The newest statistics; None before the first, which comes within a second."""
        found = self._core.statistics()
        return None if found is None else mirror(Statistics, statistics_t.decode(found))

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
        _seconds("timeout", timeout)
        self._take_control()
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
            self._until(DRIVES_OFF, timeout)
        return answer

    def hold(self, timeout: float = 2.0) -> str:
        """Stops the motion and stays there; `arm()` goes on."""
        return self._mode("hold", timeout)

    def home(self, timeout: float = 120.0) -> str:
        """Winds in the tendons' slack gently, pretensions, and sets displacement to zero; then holds, `arm()` goes on.

        Waits until the robot is homed, at most `timeout` [s]; then, and on Ctrl-C, it disarms: nothing winds in unwatched.

        Returns:
            A line with the tensions now.
        """
        if _seconds("timeout", timeout) < 1:
            raise ValueError(f"timeout is {timeout}; give 1 to 3600 s")
        end = time.monotonic() + timeout
        self._take_control()
        try:
            self._after(state_t.MODE_DISCONNECTED, end)  # a daemon or drives that are still starting
            self._mode("home", 2.0)
            self._after(state_t.MODE_CONFIGURED, time.monotonic() + 2.0)  # states come here later than the answer
            state = self._after(state_t.MODE_HOMING, end)
        except (KeyboardInterrupt, SystemExit):
            self._disarm_quietly(0)
            raise
        if state.mode == state_t.MODE_HOMING:
            self._disarm_quietly(0)
            raise DaemonError(f"not homed within {timeout:g} s; the daemon was asked to disarm")
        if state.mode != state_t.MODE_HOLD:
            why = f"{state.status_text}; {state.status_remedy}" if state.status >= FIRST_FAULT else "aborted"
            raise DaemonError(f"homing: {why}; mode {state.mode_text}")
        return "homed; tensions now " + " ".join(f"{t:.2f}" for t in state.tension_measured_N) + " N; the robot holds"

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
        return self._target(self._core.tip, point, along, speed=speed, valid_for=valid_for, timeout=timeout)

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
        rates = np.zeros(0) if rate is None else vector("rate", rate, bends.size, "rates of us, vs [rad/s]")
        return self._target(self._core.bending, bends, rates, speed=speed, valid_for=valid_for, timeout=timeout)

    def send_tension(self, tension: ArrayLike, *, valid_for: float = 1.0, timeout: float = 2.0) -> str:
        """Holds tensions at the robot's base [N], one a tendon, (M,)."""
        tensions = vector("tension", tension, None, "one tension a tendon [N]")
        return self._target(self._core.tension, tensions, valid_for=valid_for, timeout=timeout)

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
        request.nearest = flag("nearest", nearest)
        request.speed = number("speed", speed, "rad/s")
        request.acceleration = number("acceleration", acceleration, "rad/s^2")
        request.jerk = number("jerk", jerk, "rad/s^3")
        request.stretch = number("stretch", stretch, "above 0")
        if request.stretch <= 0 or (times is None and request.stretch != 1):
            raise ValueError(f"stretch is {stretch}; give a number above 0, and times, which it multiplies")
        if min(request.speed, request.acceleration, request.jerk) < 0:
            raise ValueError("speed, acceleration or jerk is negative; give 0 for the daemon's own, or more")
        tell = None if progress is None else (lambda line, _share: progress(line))
        file = "" if robot is None else file_name("robot", robot)
        with tempfile.TemporaryDirectory(prefix="tendril-") as folder:
            _word(request, path, times, corners, pathlib.Path(folder))
            self._take_control()
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
            _in_control.discard(self)
            self._core.close()

    def _take_control(self) -> None:
        """From now on whatever ends this program disarms."""
        self._armed = True
        _in_control.add(self)
        _leave_on_signals()

    def _leave_control(self) -> None:
        self._armed = False
        _in_control.discard(self)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a client is not copied: who closes it disarms the robot; open another one: tendril.Client()")

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

    def _target(
        self, send: Callable[..., str], *target: Array, valid_for: float, timeout: float, speed: float | None = None
    ) -> str:
        """Checks what targets of every kind have in common, and sends one; `speed`: None where the kind has none."""
        _seconds("timeout", timeout)
        options = {"valid_for": valid_for, "timeout": timeout}
        if speed is not None:
            if not 0 <= number("speed", speed, "rad/s") <= 1e3:
                raise ValueError(f"speed is {speed}; give 0 to 1000 rad/s, 0 for the daemon's own")
            options["speed"] = speed
        if not 1e-3 <= number("valid_for", valid_for, "seconds") <= 3600:
            raise ValueError(f"valid_for is {valid_for}; give 0.001 to 3600 s")
        before = self._armed
        self._take_control()
        try:
            return _daemon_errors(lambda: send(*(values.tolist() for values in target), **options))
        except ValueError:
            if not before:
                self._leave_control()  # nothing was sent
            raise

    def _disarm_quietly(self, timeout: float) -> None:
        """Whoever leaves hears of the error that made it leave, not of a daemon that is gone."""
        try:
            self.disarm(timeout)
        except DaemonError:
            pass

    def _following(self, number: int, timeout: float) -> tuple[int, bytes]:
        """The state after the `number`-th, with its number."""
        return self._await(timeout, lambda part: self._core.next(number, part))

    def _after(self, mode: int, end: float) -> State:
        """The first state in another mode, or the newest at `end` [s of the monotonic clock]."""
        number, message = self._await(2.0, lambda part: self._core.state(0.5, part))
        while (state := mirror(State, state_t.decode(message))).mode == mode and time.monotonic() < end:
            number, message = self._following(number, 2.0)
        return state

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
    if not 0 <= number(name, value, "seconds") <= 3600:
        raise ValueError(f"{name} is {value}; give 0 to 3600 s")
    return float(value)
