"""Log lines: events, and each change of mode or status of the states."""

from __future__ import annotations

from collections.abc import Iterator

from foxglove_schemas_protobuf import Log_pb2

from ..state import FIRST_FAULT
from .columns import Columns
from .protobuf import to_bytes
from .scene import timestamp

SETTLED_NS = 1_000_000_000  # a status that comes back sooner has not ended


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
        self._gone_ns: int | None = None  # since when the status is shown no more

    def of_events(self, events: Columns, times_ns: list[int]) -> Iterator[tuple[int, bytes]]:
        for i, status in enumerate(events.numbers("status").tolist()):
            text, meaning = events.string_at("text", i), events.string_at("status_text", i)
            message = f"{status} {meaning}: {text}" if status else text
            yield i, line(times_ns[i], level_of(status), events.string_at("source", i), message)

    def of_states(self, states: Columns, times_ns: list[int]) -> Iterator[tuple[int, bytes]]:
        modes, statuses = states.numbers("mode").tolist(), states.numbers("status").tolist()
        for i, (mode, status) in enumerate(zip(modes, statuses)):
            if status == self._status:
                self._gone_ns = None
                if mode == self._mode:
                    continue
            if mode != self._mode:
                text = states.string_at("mode_text", i)
                yield i, line(times_ns[i], Log_pb2.Log.INFO, "state", f"mode: {text}")
                self._mode = mode
            if status != self._status and (status != 0 or self._has_ended(times_ns[i])):
                text = self._status_line(states, i, status) if status else f"no longer {self._status}: ok"
                yield i, line(times_ns[i], level_of(status), "state", text)
                self._status, self._gone_ns = status, None

    def _has_ended(self, now_ns: int) -> bool:
        self._gone_ns = now_ns if self._gone_ns is None else self._gone_ns
        return now_ns - self._gone_ns >= SETTLED_NS

    def _status_line(self, states: Columns, i: int, status: int) -> str:
        remedy = states.string_at("status_remedy", i)
        text = states.string_at("status_text", i)
        return f"{status} {text}" + (f"; {remedy}" if remedy else "")
