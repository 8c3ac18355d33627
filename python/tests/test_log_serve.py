"""The live bridge: who may read along, and that what comes over LCM arrives as it was sent."""

import contextlib
import json
import socket
import struct
import subprocess
import sys
import threading

import pytest

foxglove = pytest.importorskip("foxglove", reason="the extra 'serve' is not installed")
lcm = pytest.importorskip("lcm", reason="the extra 'serve' is not installed")
websockets = pytest.importorskip("websockets.sync.client")
from websockets.exceptions import InvalidStatus

from log_help import Reader, every_kind, fields, plain

from tendril.serve.bridge import Bridge
from tendril.serve.guard import MOST_VIEWERS, Admission, Guard, ServeError, hidden_address

PROTOCOL = "foxglove.sdk.v1"


def request(host="127.0.0.1:8765", origin=None, more=""):
    lines = ["GET / HTTP/1.1", f"Host: {host}", "Upgrade: websocket"]
    lines += [f"Origin: {origin}"] if origin else []
    return ("\r\n".join(lines) + f"\r\n{more}\r\n").encode()


@pytest.mark.parametrize("origin", [None, "https://app.foxglove.dev", "file://"])
@pytest.mark.parametrize(
    "host", ["127.0.0.1:8765", "localhost:8765", "localhost", "[::1]:8765", "LOCALHOST:1"]
)
def test_foxglove_may_read_along(host, origin):
    assert Admission("127.0.0.1").refusal(request(host, origin)) is None


@pytest.mark.parametrize(
    "asked",
    [
        request("evil.example"),
        request("localhost.evil.example"),
        request("192.168.0.7:8765"),
        request("[::1].evil.example"),
        request(more="Host: localhost\r\n"),
        request(origin="https://evil.example"),
        request(origin="null"),
        request(origin="http://app.foxglove.dev"),
        request(origin="https://app.foxglove.dev.evil.example"),
        request(origin="https://app.foxglove.dev", more="Origin: https://evil.example\r\n"),
        request(origin="http://localhost:8765"),
        b"POST / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"\r\n\r\n",
    ],
)
def test_others_may_not(asked):
    assert Admission("127.0.0.1").refusal(asked)


def test_options_admit_more():
    open_to_all = Admission("0.0.0.0", ["rig.lab"], ["http://lab.example:8080/"])
    assert open_to_all.refusal(request("192.168.0.7:8765")) is None
    assert open_to_all.refusal(request("Rig.lab:8765", "http://lab.example:8080")) is None
    assert open_to_all.refusal(request("rig.evil.example")) and open_to_all.refusal(
        request(origin="http://evil.example")
    )


@pytest.fixture()
def served():
    """A bridge from an LCM of its own to a guarded server: the LCM, the port, what was reported, the hidden place."""
    said, context, inner = [], foxglove.Context(), hidden_address()
    server = foxglove.start_server(name="test", host=inner, port=0, context=context)
    guard = Guard("127.0.0.1", 0, (inner, server.port), Admission("127.0.0.1"), said.append)
    connection = lcm.LCM("memq://")
    bridge, stop = Bridge(connection, "TENDRIL", context), threading.Event()

    def run():
        while not stop.is_set():
            bridge.step()

    thread = threading.Thread(target=run)
    thread.start()
    yield connection, guard.port, said, server.port
    stop.set()
    thread.join()
    guard.stop()
    bridge.close()
    server.stop()


def viewer(port, **options):
    return websockets.connect(
        f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], proxy=None, max_size=None, **options
    )


def publish(connection, given):
    for ending, message in given:
        connection.publish(f"TENDRIL_{ending}", message if isinstance(message, bytes) else message.encode())


def advertised(page, wanted):
    """Channels by their topics, once all of the wanted ones are there."""
    channels = {}
    while not wanted <= set(channels):
        message = page.recv(timeout=20)
        if isinstance(message, str) and (read := json.loads(message))["op"] == "advertise":
            channels |= {channel["topic"]: channel for channel in read["channels"]}
    return channels


def test_what_comes_over_lcm_arrives_as_it_was_sent(served):
    import base64

    connection, port, *_ = served
    given = every_kind(3)
    with viewer(port, origin="https://app.foxglove.dev") as page:
        assert json.loads(page.recv(timeout=20))["op"] == "serverInfo"
        publish(connection, given)
        channels = advertised(page, {"/TENDRIL/state", "/TENDRIL/cycle", "/TENDRIL/scene", "/TENDRIL/log"})
        ids = {i: channels[f"/TENDRIL/{name}"] for i, name in enumerate(("state", "cycle", "scene"))}
        page.send(
            json.dumps(
                {
                    "op": "subscribe",
                    "subscriptions": [{"id": i, "channelId": c["id"]} for i, c in ids.items()],
                }
            )
        )
        given, sent, seen = every_kind(3, seed=5), {}, threading.Event()

        def keep_publishing():
            """Again and again, a second later each time: when a subscription takes effect is not signalled."""
            while not seen.wait(0.3):
                for _, message in given:
                    message.utime += 10**6
                sent.update(
                    {1000 * m.utime: type(m).decode(m.encode()) for ending, m in given if ending == "CYCLE"}
                )
                publish(connection, given)

        publisher = threading.Thread(target=keep_publishing, daemon=True)
        publisher.start()
        reader, drawn, read = Reader(), 0, {}
        while len(read) < 3 or not drawn:
            frame = page.recv(timeout=20)
            if isinstance(frame, str) or frame[0] != 1:
                continue
            subscription, time_ns = struct.unpack_from("<IQ", frame, 1)
            channel = ids[subscription]
            message = reader.read(channel["schemaName"], base64.b64decode(channel["schema"]), frame[13:])
            drawn += channel["topic"] == "/TENDRIL/scene"
            if channel["topic"] == "/TENDRIL/cycle":
                read[time_ns] = message
        seen.set()
        publisher.join()
    for time_ns, message in read.items():
        original = sent[time_ns]
        assert {name: plain(getattr(message, name)) for name in original.__slots__} == fields(original)


def test_other_pages_are_refused_and_named_and_the_server_behind_is_hidden(served):
    _, port, said, inner_port = served
    with pytest.raises(InvalidStatus) as error:
        viewer(port, origin="https://evil.example")
    assert error.value.response.status_code == 403
    assert said == ["pages of 'https://evil.example' are not accepted; --origin ORIGIN accepts one more"]
    for address, at in (("127.0.0.2", port), ("127.0.0.1", inner_port)):
        with socket.socket() as other:
            other.settimeout(5)
            assert other.connect_ex((address, at)) != 0


def test_viewers_cannot_send(served):
    _, port, *_ = served
    with viewer(port) as page:
        assert json.loads(page.recv(timeout=20))["capabilities"] == []


def test_a_flood_of_other_bytes_is_left_out(served):
    connection, port, *_ = served
    with viewer(port) as page:
        publish(connection, [("STATE", b"\x00" * n) for n in range(300)] + every_kind(1))
        advertised(page, {"/TENDRIL/state"})


def test_connections_that_ask_for_nothing_keep_no_viewer_out(served):
    _, port, *_ = served
    with contextlib.ExitStack() as silent:
        for _ in range(MOST_VIEWERS + 1):
            silent.enter_context(socket.create_connection(("127.0.0.1", port)))
        with viewer(port) as page:
            assert json.loads(page.recv(timeout=20))["op"] == "serverInfo"


def test_a_port_in_use_is_one_line(served):
    with pytest.raises(ServeError, match="is in use; give another one with --port"):
        Guard("127.0.0.1", served[1], ("127.0.0.1", 1), Admission("127.0.0.1"), print)


@pytest.mark.parametrize(
    "words, status, line",
    [
        (["--port", "99999"], 2, "--port"),
        (["--address", "rig"], 2, "no address"),
        (["--lcm", "tcp://nowhere"], 1, "LCM address"),
        (["--address", "192.0.2.1", "--lcm", "memq://"], 1, "192.0.2.1 cannot be opened"),
    ],
)
def test_bad_words_are_one_line(words, status, line):
    command = [sys.executable, "-P", "-m", "tendril.serve", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (status, "")
    assert (
        done.stderr.count("\n") == 1 and done.stderr.startswith("tendril: log: ") and line in done.stderr
    ), done.stderr


def test_an_address_that_others_reach_is_warned_of():
    words = ["--address", "0.0.0.0", "--port", "0", "--lcm", "memq://", "--duration", "0.2"]
    command = [sys.executable, "-P", "-m", "tendril.serve", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0 and "ws://0.0.0.0:" in done.stdout
    assert "every machine that reaches it reads along" in done.stderr and done.stderr.count("\n") == 1
