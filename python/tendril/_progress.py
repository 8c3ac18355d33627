"""The progress of long work on the standard error: on a terminal one line that is redrawn, elsewhere a line now and then."""

from __future__ import annotations

import sys
import time

REDRAW_EVERY_S, LINE_EVERY_S = 0.1, 30.0


class Line:
    """Called as `line(stage, share)`; as a context it clears what it drew."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._start_s = self._shown_s = time.monotonic()
        self._drawn = False

    def __call__(self, stage: str, share: float) -> None:
        now_s = time.monotonic()
        if now_s < self._shown_s + (REDRAW_EVERY_S if self._terminal else LINE_EVERY_S):
            return
        self._shown_s = now_s
        text = f"  {stage:<48.48} {100 * share:3.0f} %  {now_s - self._start_s:5.0f} s"
        self._drawn = self._terminal
        print(
            f"\r\033[K{text}" if self._terminal else text,
            end="" if self._terminal else "\n",
            file=sys.stderr,
            flush=True,
        )

    def __enter__(self) -> Line:
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
