"""Log lines: events, and each change of mode or status of the states."""

from __future__ import annotations

from collections.abc import Iterator

from foxglove_schemas_protobuf import Log_pb2

from ..state import FIRST_FAULT
from .columns import Columns
from .protobuf import to_bytes
from .scene import timestamp


def level_of(status: int) -> Log_pb2.Log.Level.ValueType:
    if status == 0:
        return Log_pb2.Log.INFO
    return Log_pb2.Log.ERROR if status >= FIRST_FAULT else Log_pb2.Log.WARNING


def line(time_ns: int, level: Log_pb2.Log.Level.ValueType, name: str, message: str) -> bytes:
    return to_bytes(Log_pb2.Log(timestamp=timestamp(time_ns), level=level, name=name, message=message))


class Lines:
    """Of one daemon. What it yields: the index of the message that a line comes from, and the line."""

    def __init__(self) -> None:
        self._mode: int | None = None
        self._status = 0

    def of_events(self, events: Columns, times_ns: list[int]) -> Iterator[tuple[int, bytes]]:
        for i, status in enumerate(events.numbers("status").tolist()):
            text, meaning = events.string_at("text", i), events.string_at("status_text", i)
            message = f"{status} {meaning}: {text}" if status else text
            yield i, line(times_ns[i], level_of(status), events.string_at("source", i), message)

    def of_states(self, states: Columns, times_ns: list[int]) -> Iterator[tuple[int, bytes]]:
        modes, statuses = states.numbers("mode").tolist(), states.numbers("status").tolist()
        for i, (mode, status) in enumerate(zip(modes, statuses)):
            if mode == self._mode and status == self._status:
                continue
            if mode != self._mode:
                text = states.string_at("mode_text", i)
                yield i, line(times_ns[i], Log_pb2.Log.INFO, "state", f"mode: {text}")
            if status != self._status:
                yield i, line(times_ns[i], level_of(status), "state", self._status_line(states, i, status))
            self._mode, self._status = mode, status

    def _status_line(self, states: Columns, i: int, status: int) -> str:
        if status == 0:
            return f"no longer {self._status}: ok"
        remedy = states.string_at("status_remedy", i)
        text = states.string_at("status_text", i)
        return f"{status} {text}" + (f"; {remedy}" if remedy else "")
