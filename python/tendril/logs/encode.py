"""From LCM messages to what Foxglove and PlotJuggler read: each message in protobuf, and beside it the robot's frames,
its body and lines for people."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

from .. import _core
from ..view import robots
from ..view.frames import DrawnRobot, ViewError
from . import protobuf
from .batch import Part
from .columns import Columns
from .lines import Lines
from .output import FRAMES, LINES, SCENE, Output
from .scene import Scene, Shape

DRAWN_PER_S = 30


def split(channel: str, kind: str) -> tuple[str, str]:
    """Prefix of the daemon and topic of a channel: "/TENDRIL/state" of TENDRIL_STATE."""
    ending = kind.removesuffix("_t")
    if channel.lower().endswith(f"_{ending}"):
        prefix = channel[: -len(ending) - 1]
        return prefix, f"/{prefix}/{ending}"
    return channel, f"/{channel}"


@dataclasses.dataclass(frozen=True)
class Source:
    """Where the motion of a robot is: in /PREFIX/state, or /PREFIX/cycle of a log without states."""

    prefix: str
    topic: str  # "state" or "cycle"
    tendons: int
    bendings: int


@dataclasses.dataclass(eq=False)
class _Daemon:
    """What is known of a daemon from its messages."""

    prefix: str
    given: DrawnRobot | None
    scene: Scene | None = None
    robot_yaml: str = ""
    source: Source | None = None
    drawn_ns: int = -(2**62)
    problem: str = ""
    lines: Lines = dataclasses.field(default_factory=Lines)

    def __post_init__(self) -> None:
        if self.given is not None:
            self.scene = Scene(self.prefix, self.given)

    def take_run(self, robot_yaml: str) -> None:
        if self.given is not None or robot_yaml == self.robot_yaml:
            return
        self.robot_yaml = robot_yaml
        try:
            self.scene = Scene(self.prefix, robots.drawn(robots.parse_robot(robot_yaml, "the log's robot")))
        except ViewError as e:
            self.scene, self.problem = None, str(e)

    def of_motion(self, columns: Columns, times_ns: list[int]) -> Iterator[tuple[int, str, str, bytes]]:
        """Of states, or of cycles where there are none: log lines and the drawn robot."""
        if columns.kind == "state_t":
            for i, line in self.lines.of_states(columns, times_ns):
                yield i, "log", LINES, line
        elif self.source is not None and self.source.topic == "state":
            return
        tendons, bendings = (int(columns.numbers(name)[0]) for name in ("num_tendons", "num_bending"))
        self.source = Source(self.prefix, columns.kind.removesuffix("_t"), tendons, bendings)
        for i, shape in self.shapes(columns, times_ns):
            drawn = self.scene.draw(shape) if self.scene else None
            if drawn is not None:
                yield i, "frames", FRAMES, drawn[0]
                yield i, "scene", SCENE, drawn[1]

    def shapes(self, columns: Columns, times_ns: list[int]) -> Iterator[tuple[int, Shape]]:
        """Those that are drawn, with the index of their message."""
        robot = self.scene.robot if self.scene else None
        if robot is None:
            return
        sizes = {"bending_estimate_rad": 2 * len(robot.units), "tension_base_estimate_N": robot.tendons}
        if any((columns.lengths(name) != size).any() for name, size in sizes.items()):
            self.problem = f"tendons or sections of the messages are not those of '{robot.name}'"
            return
        chosen = []
        for i, at in enumerate(times_ns):
            if at >= self.drawn_ns + 1e9 / DRAWN_PER_S or at < self.drawn_ns - 1e9:  # or the clock began anew
                self.drawn_ns = at
                chosen.append(i)
        if not chosen:
            return
        reference = "tip_desired_W_m" if columns.kind == "state_t" else "reference_tip_W_m"
        names = (*sizes, "tip_estimate_W_m", "orientation_estimate_WT", reference)
        values = [columns.numbers(name)[chosen] for name in names]
        for i, *row in zip(chosen, *values):
            yield i, Shape(times_ns[i], *row)


class Encoder:
    """Batches in the order in which they came. `robot` is drawn instead of the one that RUN messages name."""

    def __init__(self, robot: _core.Robot | None = None):
        self._robot = None if robot is None else robots.drawn(robot)
        self._daemons: dict[str, _Daemon] = {}

    def remarks(self, *, ended: bool = False) -> list[str]:
        """Why robots are not drawn, one line each. `ended`: no RUN message will come."""
        why = {d.prefix: d.problem for d in self._daemons.values() if d.problem}
        if ended:
            silent = [d.prefix for d in self._daemons.values() if d.source and not d.scene and not d.problem]
            why |= dict.fromkeys(silent, "no RUN message says which it is; give its file with --robot")
        return [f"{prefix}: the robot is not drawn: {reason}" for prefix, reason in why.items()]

    def sources(self) -> list[Source]:
        """Of each daemon whose motion came."""
        return [d.source for d in self._daemons.values() if d.source is not None]

    def encode(self, parts: Sequence[Part]) -> list[Output]:
        """What a batch gives, in the order of its messages."""
        outputs = [output for part in parts for output in self._of(part)]
        outputs.sort(key=lambda output: output[0])
        return [output for _, output in outputs]

    def _of(self, part: Part) -> list[tuple[int, Output]]:
        """Each with the place of its message in the batch."""
        outputs: list[tuple[int, Output]] = []
        prefix, topic = split(part.channel, part.kind)

        def add(i: int, topic: str, schema: str, data: bytes) -> None:
            outputs.append((part.places[i], Output(topic, schema, part.times_ns[i], data)))

        for group in part.columns.groups:
            for i, data in zip(group.indices.tolist(), protobuf.encoded(group)):
                add(i, topic, protobuf.schema_name(part.kind), data)
        for i, name, schema, data in self._beside(part, prefix):
            add(i, f"/{prefix}/{name}", schema, data)
        return outputs

    def _beside(self, part: Part, prefix: str) -> Iterator[tuple[int, str, str, bytes]]:
        """Index of the message, last part of the topic, schema and message of what a channel gives beside itself."""
        if part.kind not in ("run_t", "event_t", "state_t", "cycle_t"):
            return
        daemon = self._daemons.setdefault(prefix, _Daemon(prefix, self._robot))
        if part.kind == "run_t":
            daemon.take_run(part.columns.string_at("robot_yaml", len(part.columns) - 1))
        elif part.kind == "event_t":
            for i, line in daemon.lines.of_events(part.columns, part.times_ns):
                yield i, "log", LINES, line
        else:
            yield from daemon.of_motion(part.columns, part.times_ns)
