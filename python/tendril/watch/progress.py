"""What is being done, on the standard error: one line that changes on a terminal, nothing elsewhere."""

from __future__ import annotations

import sys
import time


class Line:
    """Called as `line(stage, share)`; as a context it clears what it drew."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()
        self._start = time.monotonic()
        self._drawn = False

    def __call__(self, stage: str, share: float) -> None:
        if not self._shown:
            return
        took = time.monotonic() - self._start
        print(
            f"\r\033[K  {stage:<48.48} {100 * share:3.0f} %  {took:5.0f} s",
            end="",
            file=sys.stderr,
            flush=True,
        )
        self._drawn = True

    def __enter__(self) -> Line:
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
