"""A viser server that only this machine's browser reaches, and only with the view's own page.

viser 1.1.1 by itself listens on every network, moves to another port when its own is taken, takes websockets from any
web page, opens a public tunnel (share.viser.studio) when a page asks for one, and sets any property of a control that
a page names. Here it listens on 127.0.0.1 and on its port alone, answers only requests whose Host and Origin are its
own, and takes two messages: the camera's pose and a control's value. If viser changes so that one of these cannot be
put in place, it does not start.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import http
import io
import logging
import math
import os
import re
import socket
from collections.abc import Iterator
from typing import Any

from ..errors import install
from .frames import ViewError

HOST = "127.0.0.1"
OWN_NAMES = ("127.0.0.1", "localhost")
LARGEST_MESSAGE = 2**20  # bytes; a page sends a camera's pose or a slider's place
# What the page may load and connect to: itself. "frame-ancestors": no other page shows it within itself.
PAGE_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; worker-src blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' ws://{host} data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def refusal(hosts: list[str], origins: list[str]) -> str | None:
    """Why a request with these Host and Origin headers is refused; None where it is not. The name counts and not the
    port, which differs where an SSH tunnel leads here; a page of another port has another origin than its Host.
    """
    host = hosts[0].lower() if len(hosts) == 1 else ""
    name = re.fullmatch(r"([^:]*)(:[0-9]+)?", host)
    if name is None or name[1] not in OWN_NAMES:
        return f"the view answers to {' and '.join(OWN_NAMES)} only, not to the host {', '.join(hosts) or '(none)'}"
    if any(origin.lower() != f"http://{host}" for origin in origins):
        return f"the view answers to its own page only, not to one of {', '.join(origins)}"
    return None


@contextlib.contextmanager
def _guarded_websockets() -> Iterator[list[tuple[str, int]]]:
    """viser offers no place for it, so its call of websockets' serve() is led through ours while it starts."""
    websockets_server: Any = importlib.import_module("websockets.asyncio.server")
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    serve = websockets_server.serve
    calls: list[tuple[str, int]] = []

    def guarded(handler: Any, host: str, port: int, *, process_request: Any, **options: Any) -> Any:
        def first(connection: Any, request: Any) -> Any:
            hosts = request.headers.get_all("Host")
            reason = refusal(hosts, request.headers.get_all("Origin"))
            if reason is not None:
                text = f"{reason}\n".encode()
                headers = Headers(
                    {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(text))}
                )
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, text)
            response = process_request(connection, request)
            if response is not None:
                response.headers["Content-Security-Policy"] = PAGE_POLICY.format(host=hosts[0])
                response.headers["X-Content-Type-Options"] = "nosniff"
            return response

        calls.append((host, port))
        return serve(handler, host, port, process_request=first, **{**options, "max_size": LARGEST_MESSAGE})

    websockets_server.serve = guarded
    try:
        yield calls
    finally:
        websockets_server.serve = serve


def require_free(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as e:
            if e.errno == errno.EADDRINUSE:
                what = "is in use, perhaps by another view"
            else:
                what = f"cannot be opened ({os.strerror(e.errno or 0)})"
            raise ViewError(
                f"port {port} of {HOST} {what}; give another one with --port, or 0 for any"
            ) from None


def _listen_to_two_messages(server: Any) -> None:
    from viser import _messages

    sockets = server._websock_server
    for message in list(sockets._incoming_handlers):
        sockets.unregister_handler(message)
    take = server.gui._handle_gui_updates

    async def guarded(client: Any, message: Any) -> None:
        value = message.updates.get("value")
        plain = isinstance(value, (bool, str)) or isinstance(value, (int, float)) and math.isfinite(value)
        if set(message.updates) == {"value"} and plain:
            with contextlib.suppress(ValueError, TypeError):
                await take(client, message)

    sockets.register_handler(_messages.GuiUpdateMessage, guarded)
    left = set(sockets._incoming_handlers)
    if left != {_messages.GuiUpdateMessage}:
        raise ViewError(f"this version of viser takes more messages than the view lets pass: {left}")


def start(port: int, title: str) -> Any:
    """A guarded viser.ViserServer on 127.0.0.1; port 0: any. ViewError where the port is not free or viser is
    missing."""
    try:
        import viser
    except ImportError as e:
        raise ViewError(
            f"the view needs {e.name}, which is not installed; install it: {install('view')}"
        ) from None
    require_free(port)
    os.environ.pop("_VISER_PORT_OVERRIDE", None)
    # A refused or broken connection is its page's matter and no line of ours.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with _guarded_websockets() as calls, contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=HOST, port=port, label=title, verbose=False)
    try:
        if calls != [(HOST, port)]:
            raise ViewError(
                f"the view's server could not be kept to {HOST}:{port} with viser {viser.__version__} (or the port was "
                "taken while it started); try again, or install the version that 'tendril[view]' names"
            )
        _listen_to_two_messages(server)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        server.scene.world_axes.visible = False
    except BaseException:
        stop(server)
        raise
    return server


def stop(server: Any) -> None:
    with contextlib.redirect_stdout(io.StringIO()):  # viser says that it stops
        server.stop()
