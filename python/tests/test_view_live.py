"""The view of a running daemon: states, robots and trackers as they come over LCM, in a network of its own
(tests/tools/own_network.sh); skipped where there is no route for it."""

import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")
lcm = pytest.importorskip("lcm", reason="the extra 'view' is not installed")

import view_help
from conftest import SOURCE

from tendril.view import live
from tendril.view.frames import ViewError

URL = "udpm://239.255.76.67:7667?ttl=0"


def there_is_a_route():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        return probe.connect_ex(("239.255.76.67", 7667)) == 0


def alone():
    """In a network of its own: nothing but loopback, so that no daemon of this machine is heard."""
    return [name for _, name in socket.if_nameindex()] == ["lo"]


needs_network = pytest.mark.skipif(
    not (there_is_a_route() and alone()), reason="run it by tests/tools/own_network.sh"
)


class Daemon:
    """Publishes as a daemon does."""

    def __init__(self, prefix="TENDRIL"):
        self.lcm, self.prefix = lcm.LCM(URL), prefix

    def say(self, ending, message):
        data = message if isinstance(message, bytes) else message.encode()
        self.lcm.publish(f"{self.prefix}_{ending}", data)


def polled(daemon_says, source, until, within_s=5):
    end = time.monotonic() + within_s
    while not until():
        assert time.monotonic() < end, "not within the time"
        daemon_says()
        source.poll()
        time.sleep(0.01)


@needs_network
def test_follows_a_daemon_and_says_when_it_is_silent():
    source, daemon = live.Live(URL, "TENDRIL"), Daemon()
    source.poll()
    assert "no daemon answers on " + URL in source.silence()
    daemon.say("STATE", view_help.state_message(0.0))
    polled(lambda: None, source, lambda: "RUN" in source.silence())
    step = iter(range(10_000))
    daemon.say("RUN", view_help.run_message())
    polled(
        lambda: daemon.say("STATE", view_help.state_message(0.01 * next(step))),
        source,
        lambda: source.recording and len(source.recording.frames) > 20,
    )
    assert source.silence() == ""
    pose = source.recording.frames[-1].poses[0]
    np.testing.assert_allclose(pose.q.reshape(-1, 2).sum(axis=0), [0.5, 0])
    np.testing.assert_allclose(pose.measured_tip_m, [0.01, 0, 0.05])
    # A tracker takes the place of the estimate, as measured.
    last = next(step)
    daemon.say("TRACKER", view_help.tracker_message(0.01 * last))
    polled(
        lambda: daemon.say("STATE", view_help.state_message(0.01 * next(step))),
        source,
        lambda: source.recording.frames[-1].poses[0].measured_tip_m[0] == 0.011,
    )
    assert "tracker" in source.recording.robots[0].measured_is
    polled(lambda: None, source, lambda: "has the daemon stopped" in source.silence())


@needs_network
def test_keeps_the_last_minute_and_begins_anew_with_a_daemon():
    source, daemon = live.Live(URL, "TENDRIL"), Daemon()
    daemon.say("RUN", view_help.run_message())
    step = iter(range(10_000))
    polled(
        lambda: daemon.say("STATE", view_help.state_message(2.0 * next(step))),
        source,
        lambda: source.recording and source.recording.frames and source.recording.duration_s > 100,
    )
    first, last = source.recording.frames[0].time_s, source.recording.frames[-1].time_s
    assert 55 < last - first <= live.KEPT_S
    polled(
        lambda: daemon.say("STATE", view_help.state_message(1.0)),
        source,
        lambda: len(source.recording.frames) == 1,
    )
    other = view_help.run_message(
        view_help.ROBOT.read_text().replace("max_tension_base_N: 8.0", "max_tension_base_N: 9.0")
    )
    daemon.say("RUN", other)
    polled(lambda: None, source, lambda: source.recording.robots[0].most_tension_N == 9)


@needs_network
def test_foreign_and_broken_messages_are_said_and_endured():
    source, daemon = live.Live(URL, "MINE"), Daemon("MINE")
    state = view_help.state_message(0.0).encode()
    daemon.say("RUN", view_help.run_message())
    polled(
        lambda: daemon.say("STATE", bytes([state[0] ^ 1]) + state[1:]),
        source,
        lambda: "another version" in source.silence(),
    )
    for data in (b"", state[:50], state[:-1], state + b"more"):
        daemon.say("STATE", data)
        daemon.say("TRACKER", data)
        daemon.say("RUN", data)
    polled(
        lambda: daemon.say("STATE", view_help.state_message(1.0)),
        source,
        lambda: len(source.recording.frames) > 0,
    )
    daemon.say("RUN", view_help.run_message("name: nothing"))
    polled(lambda: None, source, lambda: "cannot be drawn" in source.silence())


@needs_network
def test_thirty_frames_of_a_thousand_states_a_second():
    """The loop without a page: what is left of a core for everything else."""
    import threading

    source, daemon, stop = live.Live(URL, "TENDRIL"), Daemon(), threading.Event()

    def talk():
        k, begin = 0, time.monotonic()
        while not stop.is_set():
            if k % 1000 == 0:
                daemon.say("RUN", view_help.run_message())
            daemon.say("STATE", view_help.state_message(1e-3 * k))
            k += 1
            time.sleep(max(begin + 1e-3 * k - time.monotonic(), 0))

    talker = threading.Thread(target=talk, daemon=True)
    talker.start()
    try:
        frames, end = 0, time.monotonic() + 2
        while time.monotonic() < end:
            frames += source.poll()
            time.sleep(1 / 30)
    finally:
        stop.set()
        talker.join()
    times = [frame.time_s for frame in source.recording.frames]
    assert frames == len(times) > 20
    assert (np.diff(times) > 0).all()


def test_no_route_is_one_line(monkeypatch):
    def unreachable(self, address):
        raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(socket.socket, "connect", unreachable)
    with pytest.raises(ViewError, match=r"no multicast route to 239\.255\.76\.67; add one: 'ip link set lo"):
        live.Live(URL, "TENDRIL")


def test_nothing_of_the_view_publishes():
    """It listens: there is no call that sends, and no client of the package."""
    folder = SOURCE / "python/tendril/view"
    for path in folder.glob("*.py"):
        text = path.read_text()
        assert "publish" not in text.replace("nothing here publishes", ""), path
        assert "Client(" not in text and "send_" not in text, path


@needs_network
def test_the_command_waits_for_a_daemon_and_says_so():
    words = [sys.executable, "-P", "-u", "-m", "tendril.view", "--port", "0", "--no-browser"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    lines = []
    for line in process.stdout:
        lines.append(line)
        if "waiting" in line:
            break
    process.send_signal(signal.SIGINT)
    lines += process.communicate(timeout=30)[0].splitlines(keepends=True)
    assert process.returncode == 0, lines
    assert [line.split(":")[0] for line in lines] == [
        "tendril view",
        "http",
        "tendril view",
        "no page was open\n",
    ]
    assert "no daemon answers on " + URL in lines[2] and "same --lcm and --prefix" in lines[2]
