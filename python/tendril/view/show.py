"""The loop: thirty times a second the frame of the moment onto the server, until it is stopped."""

from __future__ import annotations

import html
import threading
import time
from typing import Any

from .frames import DrawnRobot, Recording
from .live import Live
from .panel import WORDS_PER_S, Clock, Panel
from .scene import Drawing

FRAMES_PER_S = 30
FIRST_WITHIN_S = 2.0  # a daemon that is there is heard by then


class Rate:
    """Frames and processor time since a page is there."""

    def __init__(self) -> None:
        self.frames, self.seconds, self.busy_s = 0, 0.0, 0.0
        self.shown = 0.0  # of the last second
        self._window = (time.monotonic(), 0)

    def count(self, period_s: float, busy_s: float) -> None:
        self.frames, self.seconds, self.busy_s = (
            self.frames + 1,
            self.seconds + period_s,
            self.busy_s + busy_s,
        )
        begin, frames = self._window
        if time.monotonic() - begin >= 1:
            self.shown = (self.frames - frames) / (time.monotonic() - begin)
            self._window = (time.monotonic(), self.frames)

    def line(self) -> str:
        if self.seconds <= 0:
            return "no page was open"
        return (
            f"{self.frames} frames in {self.seconds:.1f} s: {self.frames / self.seconds:.1f} frames/s, "
            f"{100 * self.busy_s / self.seconds:.0f} % of a core"
        )


class Show:
    """Recordings, or a running daemon, on a server."""

    def __init__(
        self,
        server: Any,
        recordings: list[Recording] | None = None,
        live: Live | None = None,
        rest_at_s: float | None = None,
    ) -> None:
        self.server, self.live = server, live
        self.recordings = recordings or [Recording("live", (), [])]
        self.rate = Rate()
        self._rest_at_s = rest_at_s  # begin at rest at this time of the recording
        self.panel: Panel | None = None
        self._drawn_robots: tuple[DrawnRobot, ...] = ()
        self._told_s = 0.0
        self._said, self._say_from_s = "", time.monotonic() + FIRST_WITHIN_S
        self._waiting: Any = server.gui.add_html("") if live is not None else None

    def _silence(self) -> str:
        return self.live.silence() if self.live else ""

    def _prepare(self) -> Panel | None:
        """Scene and panel for the robots of this moment; None while there are none."""
        if self.live is not None:
            if self.live.recording is None:
                return None
            self.recordings = [self.live.recording]
        elif self.panel is not None:
            self.panel.choose()
        recording = self.panel.recording if self.panel and self.live is None else self.recordings[0]
        if recording.robots != self._drawn_robots:
            self.drawing = Drawing(self.server, recording.robots)
            self._drawn_robots = recording.robots
            if self.live is not None or self.panel is None:
                clock = Clock(recording.duration_s, self._rest_at_s) if self.live is None else None
                self.panel = Panel(self.server, self.recordings, clock, self.drawing.grid_mm)
        return self.panel

    def _say_silence(self) -> None:
        """On the terminal too, once each time that it begins or ends."""
        silence = self._silence()
        kind = silence.partition(" for ")[0]
        if time.monotonic() < self._say_from_s or kind == self._said:
            return
        print(f"tendril view: {silence or 'states arrive'}", flush=True)
        self._said = kind

    def step(self, by_s: float) -> None:
        """The next frame."""
        if self.live is not None:
            self.live.poll()
        now = time.monotonic()
        tell = now - self._told_s >= 1 / WORDS_PER_S
        panel = self._prepare()
        if panel is None:
            if tell:
                self._told_s = now
                self._waiting.content = f'<div style="padding:0 1em">{html.escape(self._silence())}</div>'
            return
        panel.clock.advance(by_s)
        frames = panel.frames()
        if frames:
            self.drawing.draw(frames)
        if tell:
            self._told_s = now
            panel.tell(frames[-1] if frames else None, self._silence(), self.rate.shown)

    def run(self, stop: threading.Event, seconds: float = 0.0) -> None:
        """Until `stop` is set, or for some seconds from the first page on (0: without end)."""
        period = 1 / FRAMES_PER_S
        self.step(0.0)
        before, due = time.monotonic(), time.monotonic() + period
        busy = time.process_time()
        while not stop.wait(max(due - time.monotonic(), 0)):
            now = time.monotonic()
            due = max(due + period, now)  # what a busy machine misses is left out, not made up for
            if self.server.get_clients():
                self.step(now - before)
                self.rate.count(now - before, time.process_time() - busy)
            elif self.live is not None:
                self.live.poll()
            if self.live is not None:
                self._say_silence()
            before, busy = now, time.process_time()
            if seconds and self.rate.seconds >= seconds:
                return
