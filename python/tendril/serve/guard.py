"""Who may read along.

foxglove-sdk 0.30.3 accepts websockets from any web page and any host name. So its server listens on a random loopback
address, one of 16 million, at a random port. The guard listens at the address that the user chose. It checks the Host and
the Origin of each request, and forwards the connection only where both are accepted.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import errno
import http
import http.client
import io
import ipaddress
import os
import re
import secrets
import threading
from collections.abc import Callable, Sequence

FOXGLOVE = ("https://app.foxglove.dev", "file://")  # its page, and its program on a desktop
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")
LARGEST_HEAD = 16 * 1024  # bytes of a request before its websocket begins
HEAD_WITHIN_S = 10.0
MOST_VIEWERS = 32
MOST_CONNECTIONS = (
    4 * MOST_VIEWERS
)  # with those that have sent no request yet: beyond, they are closed at once
BLOCK = 64 * 1024


class ServeError(Exception):
    """One line for the user: what is wrong, where, the remedy."""


def hidden_address() -> str:
    """A loopback address that no page can find by trying."""
    return "127." + ".".join(str(1 + secrets.randbelow(254)) for _ in range(3))


def is_loopback(address: str) -> bool:
    if address == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(address).is_loopback
    return False


def _is_ip(name: str) -> bool:
    with contextlib.suppress(ValueError):
        ipaddress.ip_address(name)
        return True
    return False


class Admission:
    """Which requests are forwarded."""

    def __init__(self, address: str, hosts: Sequence[str] = (), origins: Sequence[str] = ()):
        self._names = {*LOOPBACK_NAMES, address.lower(), *(host.lower() for host in hosts)}
        self._origins = {*FOXGLOVE, *(origin.lower().rstrip("/") or origin for origin in origins), "file://"}
        # The owner of a name can make it resolve to this machine (DNS rebinding); an address cannot.
        self._any_address = not is_loopback(address)

    def refusal(self, head: bytes) -> str | None:
        """Why a request is refused; None where it is not."""
        line, _, rest = head.partition(b"\r\n")
        try:
            headers = http.client.parse_headers(io.BytesIO(rest))
        except http.client.HTTPException:
            return "not a request"
        if not line.startswith(b"GET ") or (headers.get("Upgrade") or "").lower() != "websocket":
            return "this is a websocket for Foxglove; open a connection to it there"
        hosts, origins = headers.get_all("Host") or [], headers.get_all("Origin") or []
        host = hosts[0].strip().lower() if len(hosts) == 1 else ""
        match = re.fullmatch(r"(?:\[([0-9a-f:.]+)\]|([^:\[\]]+))(?::[0-9]+)?", host)
        name = (match[1] or match[2]) if match else ""
        if not (name in self._names or self._any_address and _is_ip(name)):
            return f"the host '{', '.join(hosts)}' is not accepted; --host NAME accepts one more"
        for origin in origins:
            if origin.strip().lower() not in self._origins:
                return f"pages of '{origin.strip()}' are not accepted; --origin ORIGIN accepts one more"
        return None


def _answer(reason: str) -> bytes:
    status, text = http.HTTPStatus.FORBIDDEN, f"{reason}\n".encode()
    head = (
        f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: text/plain; charset=utf-8\r\n"
        f"X-Content-Type-Options: nosniff\r\nContent-Length: {len(text)}\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + text


class Guard:
    """Listens at `address`:`port` (0: any that is free) on a thread of its own and forwards what is admitted to `inner`."""

    def __init__(
        self,
        address: str,
        port: int,
        inner: tuple[str, int],
        admission: Admission,
        report: Callable[[str], None],
    ):
        self._inner, self._admission, self._report = inner, admission, report
        self._connections = self._admitted = 0
        self._opened: concurrent.futures.Future[int] = concurrent.futures.Future()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._listen(address, port)), daemon=True)
        self._thread.start()
        try:
            self.port = self._opened.result()
        except OSError as e:
            # asyncio's own text names the address again and again, and its numbers of unknown addresses are no errno.
            known = os.strerror(e.errno) if e.errno and e.errno > 0 else "no address of this machine"
            why = "is in use" if e.errno == errno.EADDRINUSE else f"cannot be opened ({known})"
            raise ServeError(
                f"port {port} of {address} {why}; give another one with --port or --address"
            ) from None

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    async def _listen(self, address: str, port: int) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        try:
            server = await asyncio.start_server(self._serve, address, port, limit=LARGEST_HEAD)
        except Exception as e:
            self._opened.set_exception(e)
            return
        self._opened.set_result(server.sockets[0].getsockname()[1])
        await self._stop.wait()
        server.close()  # and asyncio.run ends the connections

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._connections += 1
        try:
            if self._connections > MOST_CONNECTIONS:
                return
            # Also where this task is ended: asyncio would report it as an error of ours.
            with contextlib.suppress(
                OSError, asyncio.IncompleteReadError, asyncio.TimeoutError, asyncio.CancelledError
            ):
                await self._first(reader, writer)
        finally:
            self._connections -= 1
            writer.close()

    async def _first(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), HEAD_WITHIN_S)
        except asyncio.LimitOverrunError:
            return
        reason = self._admission.refusal(head)
        if reason is None and self._admitted >= MOST_VIEWERS:
            reason = f"{MOST_VIEWERS} viewers read along already"
        if reason is not None:
            self._report(reason)
            writer.write(_answer(reason))
            await writer.drain()
            return
        inner_reader, inner_writer = await asyncio.open_connection(*self._inner)
        inner_writer.write(head)
        ways = [_pump(reader, inner_writer), _pump(inner_reader, writer)]
        tasks = [asyncio.ensure_future(way) for way in ways]
        self._admitted += 1
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            self._admitted -= 1
            inner_writer.close()


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while block := await reader.read(BLOCK):
            writer.write(block)
            await writer.drain()
