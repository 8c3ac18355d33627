"""Disarms for a dashboard that can no longer do it: `python -m tendril.dashboard.guard`, started by the dashboard.

A process of its own in a session of its own, which neither the closed terminal nor what kills the dashboard ends. It
reads single letters from its input: `a`, armed or moved from here; `n`, nothing of ours; `q`, left in order. After an `a`
it disarms when the input ends, or when no letter comes for SILENT_S (a dashboard that hangs or was stopped).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from typing import IO

from .. import Client, DaemonError
from .._command_line import add_lcm_options

BEAT_EVERY_S = 0.5
SILENT_S = 5.0
_TRIES_FOR_S = 15.0
_READY_S = 10.0
_LEAVES_WITHIN_S = 5.0


class Guard:
    """The dashboard's side."""

    def __init__(self, url: str | None, prefix: str) -> None:
        self._words = [sys.executable, "-m", "tendril.dashboard.guard", "--prefix", prefix]
        if url:
            self._words += ["--lcm", url]
        self._process: subprocess.Popen[bytes] | None = None
        self._ready = False
        self._said, self._said_at = "", float("-inf")

    def start(self) -> None:
        """Starts it unless it runs; does not wait for it."""
        if self._process is not None and self._process.poll() is None:
            return
        self._ready, self._said = False, ""
        self._process = subprocess.Popen(
            self._words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def ready(self) -> bool:
        """Whether it stands by; waits for it while it starts."""
        try:
            self.start()
        except OSError:
            return False
        assert self._process is not None and self._process.stdout is not None
        if not self._ready:
            heard, _, _ = select.select([self._process.stdout], [], [], _READY_S)
            self._ready = bool(heard) and self._process.stdout.readline() == b"ready\n"
        return self._ready and self._process.poll() is None

    def tell(self, ours: bool, now: float) -> bool:
        """Whether the robot was armed or moved from here; at every tick. False: the guard is gone."""
        letter = "a" if ours else "n"
        if letter == self._said and now < self._said_at + BEAT_EVERY_S:
            return True
        self._said, self._said_at = letter, now
        return self._write(letter)

    def leave(self, in_order: bool) -> None:
        """Ends it; not in order: it disarms first."""
        if self._process is None or self._process.stdin is None:
            return
        if in_order:
            self._write("q")
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        if in_order:
            with contextlib.suppress(subprocess.TimeoutExpired):  # stopped: its end is not worth waiting for
                self._process.wait(_LEAVES_WITHIN_S)

    def _write(self, letter: str) -> bool:
        if self._process is None or self._process.stdin is None or self._process.poll() is not None:
            return False
        try:
            os.write(self._process.stdin.fileno(), letter.encode())
        except OSError:
            return False
        return True


def stand_by(letters: IO[bytes], client: Client, silent_after: float = SILENT_S) -> None:
    """Reads until the end of `letters`, and disarms when it must; when it is ended itself, too."""
    last = b"n"
    try:
        while True:
            heard, _, _ = select.select([letters], [], [], silent_after if last == b"a" else None)
            if not heard:
                _disarm(client)
                last = b"n"
                continue
            read = os.read(letters.fileno(), 4096)
            if b"q" in read:
                last = b"q"
            if b"q" in read or not read:
                return
            last = read[-1:]
    finally:
        if last == b"a":
            _disarm(client)


def _disarm(client: Client) -> None:
    end = time.monotonic() + _TRIES_FOR_S
    while time.monotonic() < end:
        try:
            client.disarm(timeout=1.0)
            return
        except DaemonError:
            pass  # nobody answers yet


def _main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tendril.dashboard.guard", description=__doc__)
    add_lcm_options(parser)
    options = parser.parse_args()
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    client = Client(options.lcm, options.prefix)

    def ended(*_: object) -> None:
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, ended)
    try:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        stand_by(sys.stdin.buffer, client)
    finally:
        client.close()
    return 0


if __name__ == "__main__":
    sys.exit(_main())
