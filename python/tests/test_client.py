"""A client against a simulated robot: commands, states and events; what is wrong is said and leaves nothing armed."""

from __future__ import annotations

import copy
import dataclasses
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import tendril
from tendril import messages

from conftest import SOURCE, program
from simulated import simulated_robot


@pytest.fixture(scope="module")
def robot():
    with simulated_robot() as process:
        yield process


@pytest.fixture()
def client(robot):
    with tendril.Client() as client:
        yield client


def wait_until(client, condition, what, timeout=20.0):
    end = time.monotonic() + timeout
    for state in client:
        if condition(state):
            return state
        assert time.monotonic() < end, f"{what}: still {state.mode_text}, {state.status_text}"
    raise AssertionError("the states ended")


def straighten(client):
    """Disarmed while bent, a robot is left with slack tendons, and its next motion ends in a fault."""
    client.send_bending([0, 0], speed=1.0)
    wait_until(client, lambda s: np.abs(s.bending_desired_rad).max() < 1e-3, "straight")
    time.sleep(0.3)


@pytest.mark.parametrize("kind", [tendril.State, tendril.Event, tendril.Statistics])
def test_dataclasses_mirror_the_messages(kind):
    message = {
        tendril.State: messages.state_t,
        tendril.Event: messages.event_t,
        tendril.Statistics: messages.statistics_t,
    }[kind]
    fields = [name for name in message.__slots__ if not name.startswith("num_")]
    assert [field.name for field in dataclasses.fields(kind)] == fields


def test_bends_as_it_is_told_and_is_disarmed_on_leaving(robot):
    with tendril.Client() as client:
        assert "running" in client.arm()
        assert "accepted" in client.send_bending([0.3, -0.2], speed=1.0)
        state = wait_until(client, lambda s: np.allclose(s.bending_desired_rad, [0.3, -0.2], atol=1e-3), "bend")
        assert state.running and state.tension_measured_N.shape == (3,)
        model = tendril.Model(client.robot())
        arc = model.fk(model.spread(state.bending_desired_rad)).position
        assert np.allclose(arc, state.tip_desired_W_m, atol=1e-12)
        assert "accepted" in client.send_tip(arc, speed=1.0)
        assert client.send_tip(arc, timeout=0) == ""
        # The high half of a sequence number names the sender: this process, on this host.
        assert client.state().command_sequence >> 32 == tendril._core.sender()
        assert client.daemon().prefix == "TENDRIL"
        straighten(client)
    with tendril.Client() as client:
        wait_until(client, lambda s: s.disarmed, "disarm")


def test_homes_and_holds_until_armed(robot):
    with tendril.Client() as client:
        wait_until(client, lambda s: s.disarmed, "disarm")
        assert "tensions now" in client.home()
        state = client.state()
        assert state.mode == messages.state_t.MODE_HOLD
        assert np.all(state.tension_measured_N > 0.1)
        with pytest.raises(tendril.DaemonError, match=r"refused in this mode.*\(204, mode hold"):
            client.home()  # only a robot with its drives off is homed
        with pytest.raises(ValueError, match="1 to 3600"):
            client.home(timeout=0)
        assert "running" in client.arm()


def test_homing_that_takes_too_long_is_ended():
    with simulated_robot("--effect", "slack m=0.004", prefix="SLACK"), tendril.Client(prefix="SLACK") as client:
        wait_until(client, lambda s: s.mode == messages.state_t.MODE_CONFIGURED, "configured")  # before the second counts
        with pytest.raises(tendril.DaemonError, match="not homed within 1 s"):
            client.home(timeout=1)
        wait_until(client, lambda s: s.disarmed, "disarm")


def test_what_a_daemon_with_a_key_does_not_take_is_no_success(tmp_path, monkeypatch):
    key, file = tmp_path / "key", tmp_path / "daemon.yaml"
    key.write_text("0123456789abcdef" * 4)
    key.chmod(0o600)
    (tmp_path / "robots").symlink_to(SOURCE / "config" / "robots")
    shipped = (SOURCE / "config" / "tendrild.yaml").read_text()
    assert "\nlcm:\n" in shipped
    file.write_text(shipped.replace("\nlcm:\n", f"\nlcm:\n  key_file: {key}\n"))
    monkeypatch.setenv("TENDRIL_KEY_FILE", str(key))
    with simulated_robot("--daemon", str(file), prefix="KEYED"), tendril.Client(prefix="KEYED") as operator:
        operator.arm()
        monkeypatch.delenv("TENDRIL_KEY_FILE")
        with tendril.Client(prefix="KEYED") as other:
            with pytest.raises(tendril.DaemonError, match="takes none of these commands: .*not signed"):
                other.follow("circle")
            began = time.monotonic()
            with pytest.raises(tendril.DaemonError, match="did not take the command: .*not signed"):
                other.arm()
            assert time.monotonic() - began < 5
        assert operator.state().running
        operator.disarm()  # with the key that it opened with
        assert operator.state().disarmed


def test_an_exception_disarms_too(robot):
    with pytest.raises(ZeroDivisionError), tendril.Client() as client:
        client.arm()
        1 / 0
    with tendril.Client() as client:
        wait_until(client, lambda s: s.disarmed, "disarm")


def test_watching_disarms_nothing(robot):
    with tendril.Client() as first:
        first.arm()
        with tendril.Client() as second:
            assert second.state().running
            with pytest.raises(ValueError, match="there is no motion 'cirle'"):
                second.follow("cirle")  # nothing was sent
            with pytest.raises(ValueError, match="millimetres"):
                second.send_tip([0, 0, 60])
            found = second.statistics() or time.sleep(1.5) or second.statistics()
            assert found is not None and found.drive_node_id.size == 3
        time.sleep(0.2)
        assert first.state().running


def test_refusals_have_reason_and_remedy(client):
    with pytest.raises(tendril.DaemonError, match="refused"):
        client.send_bending([0.1, 0.1])  # not armed
    with pytest.raises(ValueError, match="millimetres"):
        client.send_tip([0, 0, 60])
    with pytest.raises(ValueError, match=r"tip has shape \(2,\); expected \(3,\)"):
        client.send_tip([0, 0.05])
    with pytest.raises(ValueError, match=r"bending\[1\] is nan"):
        client.send_bending([0, np.nan])
    for arguments in ({"stretch": 2}, {"stretch": np.nan}, {"speed": "fast"}, {"jerk": -1}, {"nearest": 1}):
        with pytest.raises(ValueError, match=next(iter(arguments))):
            client.follow("circle", **arguments)
    with pytest.raises(ValueError, match=r"timeout has shape \(1,\)"):
        client.state(timeout=[1])
    with pytest.raises(ValueError, match="prefix is NoneType; give a text"):
        tendril.Client(prefix=None)
    with pytest.raises(ValueError, match="timeout is -1"):
        client.arm(timeout=-1)
    client.close()
    with pytest.raises(ValueError, match="closed"):
        client.state()


def test_nobody_there_is_said():
    with (
        tendril.Client(prefix="NOBODY") as client,
        pytest.raises(tendril.DaemonError, match="no daemon answers"),
    ):
        client.state(timeout=0.3)
    with pytest.raises(tendril.DaemonError):
        tendril.Client(url="udpm://1.2.3.4:80")


@pytest.mark.parametrize(
    "arms",
    [
        "client = tendril.Client()\nclient.arm()\nprint(client.state().mode_text)",
        "tendril.Client().arm()\nprint(tendril.Client().state().mode_text)",
    ],
    ids=["held", "dropped"],
)
def test_a_program_that_ends_leaves_nothing_armed(robot, arms):
    script = f"import tendril\n{arms}\n"
    done = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "running\n", "")
    with tendril.Client() as client:
        assert client.state().disarmed


def test_a_forked_process_leaves_the_robot_to_its_parent(robot):
    script = (
        "import os, sys, tendril\n"
        "client = tendril.Client()\nclient.arm()\nchild = os.fork()\n"
        "if child == 0:\n"
        "    try:\n        client.state()\n    except ValueError as error:\n        sys.exit('closed' not in str(error))\n"
        "print(os.waitpid(child, 0)[1], client.state().mode_text)\n"
    )
    done = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "0 running\n", "")


def test_a_client_is_not_copied(client):
    with pytest.raises(TypeError, match="not copied"):
        copy.copy(client)


def test_follows_points_and_named_motions(client):
    client.arm()
    model = tendril.Model(client.robot())
    angle = np.linspace(0, 1.5, 16)
    path = model.fk(model.spread(0.3 * np.column_stack([np.cos(angle), np.sin(angle)]))).position
    said = client.follow(path, speed=0.8)
    assert "error of the estimated tip against the motion" in said
    state = client.state()
    assert np.linalg.norm(state.tip_desired_W_m - path[-1]) < 1e-4
    with pytest.raises(ValueError, match="there is no motion 'cirle'; accepted: circle, planar"):
        client.follow("cirle")
    with pytest.raises(ValueError, match=r"path has shape \(4,\)"):
        client.follow([0, 0, 0, 0])
    with pytest.raises(tendril.DaemonError):
        client.follow(10 * path)
    straighten(client)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_ends_a_program_disarms(robot, number):
    script = (
        "import tendril\n"
        "with tendril.Client() as client:\n"
        "    client.arm()\n"
        "    print('armed', flush=True)\n"
        "    for state in client:\n"
        "        pass\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "armed\n"
    begin = time.monotonic()
    process.send_signal(number)
    _, errors = process.communicate(timeout=20)
    assert time.monotonic() - begin < 5
    assert "KeyboardInterrupt" in errors if number == signal.SIGINT else process.returncode == 128 + number
    with tendril.Client() as client:
        wait_until(client, lambda s: s.disarmed, "disarm")


def test_messages_serve_plain_lcm_programs(client):
    lcm = pytest.importorskip("lcm")
    heard = []
    connection = lcm.LCM(tendril.client.DEFAULT_URL)
    connection.subscribe("TENDRIL_STATE", lambda _channel, data: heard.append(messages.state_t.decode(data)))
    end = time.monotonic() + 5
    while not heard and time.monotonic() < end:
        connection.handle_timeout(100)
    assert heard and heard[0].num_tendons == 3 and heard[0].mode == client.state().mode


def test_a_square_in_twenty_lines(robot):
    program = SOURCE / "examples" / "square.py"
    lines = [
        line for line in program.read_text().splitlines() if line.strip() and not line.strip().startswith("#")
    ]
    assert len(lines) <= 20
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    assert "largest distance" in done.stdout


def test_a_fault_is_told_with_its_own_remedy(client):
    client.arm()
    program("fault", "emcy", "node=2", "code=0x7320")
    wait_until(client, lambda state: state.mode_text == "fault", "no fault")
    with pytest.raises(tendril.DaemonError, match="see the drive's error code, then clear"):
        client.follow("circle")
    client.clear()
