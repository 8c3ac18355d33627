"""A terminal for a program under test: tmux on a server of its own."""

from __future__ import annotations

import os
import pathlib
import shlex
import signal
import subprocess
import time
from collections.abc import Callable, Mapping


def until(what: str, holds: Callable[[], object], within_s: float = 20.0, shown: Callable[[], str] = lambda: "") -> None:
    end = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end, f"{what}: not within {within_s} s\n{shown()}"
        time.sleep(0.05)


class Terminal:
    def __init__(self, folder: pathlib.Path, command: list[str], environment: Mapping[str, str], size=(80, 24)) -> None:
        self._socket = str(folder / "tmux")
        self._environment = {**os.environ, "LC_ALL": "C.UTF-8", "TERM": "xterm-256color", **environment}
        self._pid_file = folder / "pid"
        # A shell between: tmux sends its own children on when they are stopped.
        words = f"echo $$ > {shlex.quote(str(self._pid_file))}; {shlex.join(command)}; :"
        # What a program that ended has said stays on the screen.
        session = ["new-session", "-d", "-x", str(size[0]), "-y", str(size[1]), words]
        self._tmux("-f", "/dev/null", "start-server", ";", "set-option", "-g", "remain-on-exit", "on", ";", *session)
        until("started", lambda: self._pid_file.exists() and self._child())
        self.pid = int(self._child())

    def _tmux(self, *words: str) -> str:
        done = subprocess.run(
            ["tmux", "-S", self._socket, *words], env=self._environment, capture_output=True, text=True, check=False
        )
        return done.stdout

    def shown(self) -> str:
        return self._tmux("capture-pane", "-p")

    def said(self) -> str:
        """With what has left the screen."""
        return self._tmux("capture-pane", "-p", "-J", "-S", "-")

    def key(self, *keys: str) -> None:
        self._tmux("send-keys", *keys)

    def hold(self, key: str, for_s: float, every_s: float = 0.033, delay_s: float = 0.0) -> None:
        """As a keyboard: the key, its delay, and repeats until it is let go."""
        end = time.monotonic() + for_s
        self.key(key)
        time.sleep(delay_s)
        while time.monotonic() < end:
            self.key(key)
            time.sleep(every_s)

    def until_shown(self, text: str, within_s: float = 20.0) -> None:
        until(f"'{text}' on the screen", lambda: text in self.shown(), within_s, self.shown)

    def _child(self) -> str:
        shell = self._pid_file.read_text().strip()
        return pathlib.Path(f"/proc/{shell}/task/{shell}/children").read_text().strip() if shell else ""

    def running(self) -> bool:
        return pathlib.Path(f"/proc/{self.pid}").exists()

    def kill_program(self, number: int = signal.SIGKILL) -> None:
        os.kill(self.pid, number)

    def close(self) -> None:
        """As the window's own button: its programs get SIGHUP."""
        self._tmux("kill-server")
