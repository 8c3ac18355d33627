"""The controls and words beside the picture, and what they do to time. Knows nothing of what is drawn."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from . import colours
from .frames import DrawnRobot, Frame, Recording

SPEEDS = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "5": 5.0}
WORDS_PER_S = 5  # how often words change: nobody reads thirty numbers a second


class Clock:
    """The time that is shown of a recording: runs, rests, or follows a hand on the slider."""

    def __init__(self, duration_s: float, rest_at_s: float | None = None):
        self.duration_s, self.at_s = duration_s, rest_at_s or 0.0
        self.playing, self.speed = rest_at_s is None, 1.0

    def advance(self, by_s: float) -> None:
        if not self.playing:
            return
        self.at_s += self.speed * by_s
        if self.at_s > self.duration_s:  # from the start again
            self.at_s = 0.0 if self.duration_s <= 0 else self.at_s % self.duration_s


def legend(robot: DrawnRobot, grid_mm: float) -> str:
    """What the colours mean, as HTML."""

    def dot(colour: tuple[int, int, int], text: str) -> str:
        return f'<div><span style="color:{colours.css(colour)}">&#9679;</span> {html.escape(text)}</div>'

    bar = (
        f'<div style="height:10px;border-radius:3px;background:{colours.gradient_css()}"></div>'
        '<div style="display:flex;justify-content:space-between">'
        f"<span>{robot.least_tension_N:g} N</span><span>tension</span><span>{robot.most_tension_N:g} N</span></div>"
    )
    return (
        f'<div style="padding:0 1em;font-size:0.85em;line-height:1.5">{bar}'
        + "".join(
            [
                dot(colours.BELOW, "tendon below its least tension"),
                dot(colours.ABOVE, "tendon above its limit"),
                dot(colours.REFERENCE, robot.reference_is),
                dot(colours.MEASURED, robot.measured_is),
                f"<div>&#9633; {grid_mm:g} mm</div>",
            ]
        )
        + "</div>"
    )


def words(recording: Recording, frame: Frame | None, silence: str, frames_per_s: float) -> str:
    """What is the case at this moment, as HTML."""
    lines = [f"<b>{html.escape(silence)}</b>"] if silence else []
    if frame is not None:
        first = frame.poses[0]
        lines.append(f"<b>{frame.time_s:.2f} s</b> {html.escape(frame.note)}")
        error = np.linalg.norm(first.reference_tip_m - first.measured_tip_m)
        if np.isfinite(error):
            lines.append(f"tip off its reference: {1e3 * error:.2f} mm")
        if np.isfinite(first.tension_N).any():
            values = " ".join("–" if np.isnan(t) else f"{t:.2f}" for t in first.tension_N)
            lines.append(f"tensions [N]: {values}")
        if not all(np.isfinite(pose.q).all() for pose in frame.poses):
            lines.append("a robot without finite values at this moment is not drawn")
    lines += [html.escape(remark) for remark in recording.remarks]
    lines.append(f"{frames_per_s:.0f} frames/s")
    return '<div style="padding:0 1em;font-size:0.85em;line-height:1.5">' + "<br>".join(lines) + "</div>"


class Panel:
    """The controls of a recording (with a clock), or of a running daemon (without)."""

    def __init__(self, server: Any, recordings: list[Recording], clock: Clock | None, grid_mm: float):
        self.recordings, self.live = recordings, clock is None
        self.chosen, self.trail_s, self.back_s = 0, 3.0, 0.0
        self._titles: list[str] = []
        self._wanted = ""  # controls answer on threads of their own, and a page may send any text
        self.clock = clock or Clock(0.0)
        self.gui = server.gui
        self.gui.reset()
        self.gui.main_panel.dock_right()
        self.state = self.gui.add_html("")
        self._add_time()
        self._add_trail()
        self.legend = self.gui.add_html(legend(recordings[0].robots[0], grid_mm))

    @property
    def recording(self) -> Recording:
        return self.recordings[self.chosen]

    def choose(self) -> None:
        """Takes the run that was asked for; between two frames, so that one is of one run."""
        if self._wanted in self._titles:
            self.chosen = self._titles.index(self._wanted)

    def _add_time(self) -> None:
        if self.live:
            self.time = self.gui.add_slider("seconds back", 0.0, 60.0, 0.1, 0.0)
            self.time.on_update(lambda event: setattr(self, "back_s", float(self.time.value)))
            return
        if len(self.recordings) > 1:
            titles = [f"{n + 1} {recording.title}" for n, recording in enumerate(self.recordings)]
            choice = self.gui.add_dropdown("run", titles, initial_value=titles[0])
            choice.on_update(lambda event: setattr(self, "_wanted", choice.value))
            self._titles = titles
        longest = max(max(recording.duration_s for recording in self.recordings), 0.01)
        self.time = self.gui.add_slider("time [s]", 0.0, longest, 0.01, 0.0)
        self.time.on_update(self._seek)
        playing = self.gui.add_checkbox("play", self.clock.playing)
        playing.on_update(lambda event: setattr(self.clock, "playing", bool(playing.value)))
        speed = self.gui.add_dropdown("speed", list(SPEEDS), initial_value="1")
        speed.on_update(lambda event: setattr(self.clock, "speed", SPEEDS.get(speed.value, 1.0)))

    def _seek(self, event: Any) -> None:
        if event.client is not None:  # moved by a hand, not by the clock
            self.clock.at_s = float(self.time.value)

    def _add_trail(self) -> None:
        trail = self.gui.add_slider("trail [s]", 0.0, 20.0, 0.5, self.trail_s)
        trail.on_update(lambda event: setattr(self, "trail_s", float(trail.value)))

    def frames(self) -> list[Frame]:
        """The frame of this moment, last, and those of its trail."""
        recording = self.recording
        if not recording.frames:
            return []
        self.clock.duration_s = recording.duration_s
        end_s = (
            recording.duration_s - self.back_s if self.live else min(self.clock.at_s, recording.duration_s)
        )
        last = recording.at(end_s)
        first = recording.at(end_s - self.trail_s)
        return [recording.frames[i] for i in range(first, last + 1)]

    def tell(self, frame: Frame | None, silence: str, frames_per_s: float) -> None:
        self.state.content = words(self.recording, frame, silence, frames_per_s)
        if not self.live:
            self.time.value = round(min(self.clock.at_s, self.time.max), 2)
