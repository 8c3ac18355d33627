"""Whom the view answers, and what it takes from a page."""

import contextlib
import socket
import time
import urllib.error
import urllib.request

import pytest

viser = pytest.importorskip("viser", reason="the extra 'view' is not installed")
pytest.importorskip("lcm", reason="the extra 'view' is not installed")

from view_help import refused

from tendril.view import __main__ as program
from tendril.view import server


def answer(port, host=None, **headers):
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}/", headers={"Host": host or f"127.0.0.1:{port}", **headers}
    )
    try:
        with urllib.request.urlopen(request, timeout=10) as response:
            return response.status, response.headers
    except urllib.error.HTTPError as e:
        return e.code, e.headers


def test_serves_its_page_to_this_machine_only(served):
    port = served.get_port()
    status, headers = answer(port)
    assert status == 200
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert answer(port, f"localhost:{port}")[0] == 200
    # Another address of this machine: the whole of 127.0.0.0/8 is, and only what listens on all of them answers there.
    with socket.socket() as other:
        other.settimeout(5)
        assert other.connect_ex(("127.0.0.2", port)) != 0


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1.evil.example:80", "0.0.0.0", "localhost.evil.example", "localhost:80;img-src *", ""],
)
def test_refuses_other_hosts(served, host):
    # A name of another site that resolves to 127.0.0.1 (DNS rebinding) would make its page ours.
    status, _ = answer(served.get_port(), host or "[::]")
    assert status == 403


@pytest.mark.parametrize(
    "origin",
    [
        "https://evil.example",
        "null",
        "http://127.0.0.1",
        "http://localhost:{port}",
        "https://127.0.0.1:{port}",
        "http://127.0.0.1:{port}.evil.example",
    ],
)
def test_refuses_other_origins(served, origin):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    port = served.get_port()
    origin = origin.format(port=port)
    assert answer(port, Origin=origin)[0] == 403
    with pytest.raises(InvalidStatus) as error:
        connect(
            f"ws://127.0.0.1:{port}", origin=origin, subprotocols=[f"viser-v{viser.__version__}"], proxy=None
        )
    assert error.value.response.status_code == 403


def own_page(port):
    from websockets.sync.client import connect

    return connect(
        f"ws://127.0.0.1:{port}",
        origin=f"http://127.0.0.1:{port}",
        proxy=None,
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,
    )


def test_a_page_behind_a_tunnel_has_another_port():
    assert server.refusal(["localhost:9000"], ["http://localhost:9000"]) is None
    assert server.refusal(["localhost:9000"], ["http://localhost:8095"]) is not None
    assert server.refusal(["127.0.0.1:1", "127.0.0.1:1"], []) is not None
    assert server.refusal([], []) is not None


def test_takes_no_message_but_a_controls_value(served, monkeypatch):
    from viser import _messages
    import msgspec.msgpack

    tunnels = []
    monkeypatch.setattr(type(served), "request_share_url", lambda self, verbose=True: tunnels.append(1))
    slider = served.gui.add_slider("time", 0.0, 10.0, 0.1, 0.0)

    def send(page, kind, **fields):
        page.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def settled(holds):
        end = time.monotonic() + 10
        while not holds() and time.monotonic() < end:
            time.sleep(0.02)
        return holds()

    uuid = slider._impl.uuid
    with own_page(served.get_port()) as page:
        page.recv(timeout=10)
        send(page, "ShareUrlRequest")
        for updates in (
            {"removed": True},
            {"value": float("nan")},
            {"value": [1.0]},
            {"value": 7.0, "update_cb": []},
        ):
            send(page, "GuiUpdateMessage", uuid=uuid, updates=updates)
        send(page, "GuiUpdateMessage", uuid=uuid, updates={"value": 4.0})  # in the order they were sent
        assert settled(lambda: slider.value == 4.0)
    assert not slider._impl.removed and not tunnels
    handlers = served._websock_server._incoming_handlers
    assert set(handlers) == {_messages.GuiUpdateMessage}


def test_a_port_in_use_is_one_line(served, capsys, circle):
    port = str(served.get_port())
    assert program.main([str(circle), "--port", port, "--no-browser"]) == 1
    printed = capsys.readouterr()
    assert (
        printed.err.count("\n") == 1
        and f"port {port} of 127.0.0.1 is in use" in printed.err
        and "--port" in printed.err
    )


def test_does_not_start_where_the_guard_is_not_in_place(monkeypatch):
    monkeypatch.setattr(server, "_guarded_websockets", lambda: contextlib.nullcontext([]))
    refused(lambda: server.start(0, "test"), "could not be kept to 127.0.0.1")
