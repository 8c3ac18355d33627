"""A simulated robot to operate, as a user starts it: `tendril sim --headless` beside the test, in the test's network."""

from __future__ import annotations

import contextlib
import signal
import subprocess
from collections.abc import Iterator


@contextlib.contextmanager
def simulated_robot(*options: str, prefix: str = "TENDRIL") -> Iterator[subprocess.Popen[str]]:
    words = ["tendril", "sim", "--headless", "--prefix", prefix, *options]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "Ctrl-C stops" in line, line
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
