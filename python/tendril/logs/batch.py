"""LCM messages as they come, sorted by channel and type into columns. Knows nothing of what becomes of them."""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .columns import OF_A_ROBOT, Columns, fields_of

# Channel, type or "", stamp [us], bytes: as _core.LogMessages.next gives them.
LcmMessage = tuple[str, str, int, bytes]
NOT_EXPORTED = "snapshot_t"  # the controller's memory, which only the build that wrote it reads
NS_PER_US = 1000


@dataclasses.dataclass(frozen=True, eq=False)
class Part:
    """Messages of one channel and type, of a robot whose sizes do not change."""

    channel: str
    kind: str
    places: list[int]  # of each message among all of the batch
    columns: Columns
    recorded_us: NDArray[np.int64]
    # Since the epoch: by the message's own utime; where it has none, when it was recorded.
    times_ns: list[int]


class Sorter:
    """Sorts batches; counts what no one can decode."""

    def __init__(self) -> None:
        self.left_out: collections.Counter[tuple[str, str]] = collections.Counter()  # channel, why

    def sort(self, messages: Sequence[LcmMessage]) -> list[Part]:
        """Runs first, then states: later channels are understood by them."""
        places: dict[tuple[str, str], list[int]] = {}
        for i, (channel, kind, _, _) in enumerate(messages):
            if kind in ("", NOT_EXPORTED):
                self.left_out[channel, _reason(channel, kind)] += 1
            else:
                places.setdefault((channel, kind), []).append(i)
        parts = [
            part for (channel, kind), at in places.items() for part in _parts(channel, kind, at, messages)
        ]
        first = ("run_t", "state_t")
        return sorted(parts, key=lambda part: first.index(part.kind) if part.kind in first else len(first))

    def remarks(self) -> list[str]:
        return [
            f"{channel}: {n} messages left out, {why}" for (channel, why), n in sorted(self.left_out.items())
        ]


def _parts(channel: str, kind: str, places: list[int], messages: Sequence[LcmMessage]) -> list[Part]:
    """One, or where another robot takes over one a stretch."""
    columns = Columns(kind, [messages[i][3] for i in places])
    sizes = [columns.numbers(field.name) for field in fields_of(kind) if field.name in OF_A_ROBOT]
    begins = sorted({int(i) + 1 for size in sizes for i in np.flatnonzero(np.diff(size))})
    if not begins:
        return [_part(channel, kind, places, messages, columns)]
    stretches = [stretch.tolist() for stretch in np.split(np.array(places), begins)]
    return [
        _part(channel, kind, stretch, messages, Columns(kind, [messages[i][3] for i in stretch]))
        for stretch in stretches
    ]


def _part(
    channel: str, kind: str, places: list[int], messages: Sequence[LcmMessage], columns: Columns
) -> Part:
    recorded = np.array([messages[i][2] for i in places], dtype=np.int64)
    utime = columns.numbers("utime")
    times: Any = np.where(utime > 0, utime, recorded) * NS_PER_US
    return Part(channel, kind, places, columns, recorded, times.tolist())


def _reason(channel: str, kind: str) -> str:
    if kind == NOT_EXPORTED:
        return "the controller's memory, which only tendril replay reads"
    if channel == "LCM_SELF_TEST":
        return "by which LCM tests its network"
    if _core.is_channel_of_tendril(channel):
        return "of another version of Tendril: use the one that wrote them"
    return "of another program"
