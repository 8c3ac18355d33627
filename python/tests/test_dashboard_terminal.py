"""The dashboard as its operator has it: `tendril status --watch` in a terminal, beside a simulated robot."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import tendril

from simulated import simulated_robot
from terminal import Terminal, until

pytest.importorskip("textual", reason="SKIPPED: textual is not installed")
pytestmark = pytest.mark.skipif(shutil.which("tmux") is None, reason="SKIPPED: no tmux; tools/setup installs it")

STILL_RAD = 1e-5


@pytest.fixture(scope="module")
def client():
    with simulated_robot(), tendril.Client() as client:
        client.state(timeout=10)
        yield client


def started(client, folder):
    """The dashboard, when it shows itself; started again where a busy machine kept the robot silent for two seconds."""
    for attempt in range(3):
        (folder / str(attempt)).mkdir()
        client.state(timeout=30)
        words = ["tendril", "status", "--watch", "--tip-speed", "14"]
        terminal = Terminal(folder / str(attempt), words, {"TENDRIL_PYTHON": sys.executable})
        try:
            until("shows itself", lambda: re.search("SPACE or d  disarm|tendril: status:", terminal.said()), 60, terminal.said)
        except AssertionError:
            terminal.close()
            raise
        said = terminal.said()
        if "no daemon" not in said:
            return terminal
        terminal.close()
    raise AssertionError(f"a robot that answers was not found three times:\n{said}")


@pytest.fixture()
def terminal(client, tmp_path):
    terminal = started(client, tmp_path)
    try:
        terminal.until_shown("SPACE or d  disarm")
        terminal.until_shown("rig_60mm", 60)
        yield terminal
    finally:
        terminal.close()
        until("disarmed", lambda: not client.state().running, 20)
        until("configured", lambda: client.state().mode_text == "configured", 20)


def arm(terminal, client):
    terminal.key("a")
    until("running", lambda: client.state().running, 20, terminal.shown)


def still(client):
    before = client.state().bending_desired_rad
    time.sleep(0.3)
    return np.abs(client.state().bending_desired_rad - before).max() < STILL_RAD


def test_jog_moves_release_stops_space_disarms(terminal, client):
    terminal.key("Right")
    arm(terminal, client)
    begin = client.state().tip_desired_W_m
    assert abs(begin[0]) < 1e-9, "a jog that is off moves nothing"
    terminal.key("j")
    terminal.until_shown("jog tip at 3.5 mm/s")  # a quarter of --tip-speed
    terminal.hold("Right", 1.2)
    let_go, at_release = time.monotonic(), client.state().tip_desired_W_m
    assert at_release[0] - begin[0] > 1e-3, terminal.shown()
    until("still", lambda: still(client), 5, terminal.shown)
    assert time.monotonic() - let_go < 1.5
    assert np.linalg.norm(client.state().tip_desired_W_m - at_release) < 2e-3
    assert client.state().running, "a jog that ended well does not end in hold"
    terminal.key("1")

    def bends():
        # Again, where a busy machine took the key too late for it to move anything.
        terminal.key("Up")
        return client.state().bending_desired_rad[1] > 0.005

    until("bends", bends, 5, terminal.shown)
    terminal.key("Space")
    until("disarmed", lambda: client.state().disarmed, 5, terminal.shown)

    def refused():
        # Again and again, as a person does: a target of a stream may be lost on a busy machine.
        terminal.key("Up")
        return "command refused in this mode" in terminal.shown()

    until("refused", refused, shown=terminal.shown)
    terminal.key("q")
    until("left", lambda: not terminal.running(), 10)


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL, "closed"])
def test_whatever_ends_it_leaves_the_robot_disarmed(terminal, client, end):
    arm(terminal, client)
    terminal.key("j")
    terminal.hold("Left", 0.5)
    if end == "closed":
        terminal.close()
    else:
        terminal.kill_program(end)
    until("disarmed", lambda: client.state().disarmed, 5)
    until("left", lambda: not terminal.running(), 10)


def test_one_that_is_stopped_moves_nothing_and_is_disarmed(terminal, client):
    arm(terminal, client)
    terminal.key("j")
    terminal.hold("Left", 0.5)
    terminal.kill_program(signal.SIGSTOP)
    time.sleep(0.5)
    assert still(client), "the daemon ends a target whose sender is silent"
    until("disarmed", lambda: client.state().disarmed, 10)
    terminal.kill_program(signal.SIGCONT)


def test_without_a_terminal_it_is_the_table(client):
    done = subprocess.Popen(["tendril", "status", "--watch"], stdout=subprocess.PIPE, text=True)
    try:
        assert done.stdout.readline().startswith(("robot", "mode"))
    finally:
        done.send_signal(signal.SIGINT)
        done.communicate(timeout=10)
    words = ["tendril", "status", "--watch", "--release", "100"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
    assert done.returncode == 2 and "--release is for the dashboard" in done.stderr and len(done.stderr.splitlines()) == 1
    done = subprocess.run([sys.executable, "-P", "-m", "tendril.dashboard"], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "needs a terminal" in done.stderr and len(done.stderr.splitlines()) == 1
