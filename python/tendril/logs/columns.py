"""LCM messages of one type as numpy columns, many at once.

LCM writes a message's fields one behind the other, big-endian, and what differs from one message to the next is only
how long its arrays and strings are. So all messages of equal lengths are rows of one structured array, without a loop
over messages or fields.
"""

from __future__ import annotations

import dataclasses
import functools
import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..messages.fields import FIELDS

NUMPY = {
    "double": ">f8",
    "float": ">f4",
    "int64_t": ">i8",
    "int32_t": ">i4",
    "int16_t": ">i2",
    "int8_t": "i1",
    "boolean": "i1",
    "byte": "u1",
}
FINGERPRINT_SIZE = 8
# Fields with lengths that a robot does not change.
OF_A_ROBOT = ("num_tendons", "num_bending", "num_covariance", "num_drives", "num_bins")
LENGTH = struct.Struct(">i")


@dataclasses.dataclass(frozen=True)
class Field:
    """A field of a message: one value, or an array of one dimension."""

    name: str
    type: str  # of LCM: "double", "string", ...
    count: str | int | None  # field with the array's length, a constant length, or None: one value


@functools.cache
def fields_of(kind: str) -> tuple[Field, ...]:
    """Of a type of lcm_types ("state_t"), in their order."""
    return tuple(Field(*field) for field in FIELDS[kind])


@dataclasses.dataclass(frozen=True)
class Group:
    """Messages of equal lengths: `rows[i]` is message `indices[i]` of those given. Strings, and arrays of them, are
    fields of their own, "NAME.0", "NAME.1", ..., as bytes without the zero that ends them."""

    kind: str
    indices: NDArray[np.int64]
    rows: NDArray[Any]
    counts: dict[str, int]  # entries of each string array

    def strings(self, name: str, row: int) -> list[str]:
        """A string field's text, or those of an array of them."""
        parts = range(self.counts[name])
        return [self.rows[f"{name}.{i}"][row].tobytes().decode(errors="replace") for i in parts]


class _Walk:
    """From the first byte of a message to its last: where each field is, and where the lengths are that decide it."""

    def __init__(self, kind: str, data: bytes):
        self.names: list[str] = []
        self.formats: list[Any] = []
        self.offsets: list[int] = []
        self.lengths: list[int] = []  # offsets of the lengths, 4 bytes each
        self.counts: dict[str, int] = {}
        self.data, self.at = data, FINGERPRINT_SIZE
        needed = {field.count for field in fields_of(kind)}
        known: dict[str, int] = {}
        for field in fields_of(kind):
            if field.name in needed:
                known[field.name] = LENGTH.unpack_from(data, self.at)[0]
                self.lengths.append(self.at)
            n = known[field.count] if isinstance(field.count, str) else field.count
            if field.type == "string":
                self._strings(field.name, 1 if n is None else n)
            else:
                self._numbers(field, n)
        if self.at != len(data):
            raise ValueError(f"not a whole {kind}")

    def _numbers(self, field: Field, n: int | None) -> None:
        one = np.dtype(NUMPY[field.type])
        self._add(field.name, one if n is None else (one, (n,)), one.itemsize * (1 if n is None else n))

    def _strings(self, name: str, n: int) -> None:
        self.counts[name] = n
        for i in range(n):
            size = LENGTH.unpack_from(self.data, self.at)[0]
            self.lengths.append(self.at)
            self.at += LENGTH.size
            self._add(f"{name}.{i}", f"V{size - 1}", size)

    def _add(self, name: str, form: Any, size: int) -> None:
        self.names.append(name)
        self.formats.append(form)
        self.offsets.append(self.at)
        self.at += size

    def dtype(self) -> np.dtype[Any]:
        parts = {"names": self.names, "formats": self.formats, "offsets": self.offsets, "itemsize": self.at}
        return np.dtype(parts)  # type: ignore[call-overload, no-any-return]

    def deciding(self) -> NDArray[np.int64]:
        """Offsets of all bytes of the lengths."""
        offsets = np.array(self.lengths, dtype=np.int64)[:, None] + np.arange(LENGTH.size)
        return offsets.reshape(-1)


def grouped(kind: str, data: Sequence[bytes]) -> Iterator[Group]:
    """All of these messages, each whole (_core.message_type says so), in as few groups as their lengths allow."""
    by_size: dict[int, list[int]] = {}
    for i, message in enumerate(data):
        by_size.setdefault(len(message), []).append(i)
    for size, members in by_size.items():
        indices = np.array(members, dtype=np.int64)
        block = np.frombuffer(b"".join([data[i] for i in members]), dtype=np.uint8).reshape(-1, size)
        while len(indices):
            walk = _Walk(kind, block[0].tobytes())
            deciding = walk.deciding()
            same = (block[:, deciding] == block[0, deciding]).all(axis=1)
            rows = np.ascontiguousarray(block[same]).view(walk.dtype())[:, 0]
            yield Group(kind, indices[same], rows, walk.counts)
            indices, block = indices[~same], block[~same]


class Columns:
    """Messages of one type in the order in which they were given."""

    def __init__(self, kind: str, data: Sequence[bytes]):
        self.kind = kind
        self.groups = list(grouped(kind, data))
        indices = np.concatenate([group.indices for group in self.groups])
        self._order = np.argsort(indices)
        ends = np.cumsum([len(group.indices) for group in self.groups])
        self._of_group = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))[self._order]
        self._row = np.concatenate([np.arange(len(group.indices)) for group in self.groups])[self._order]

    def __len__(self) -> int:
        return len(self._order)

    def numbers(self, name: str) -> NDArray[Any]:
        """Of a field with one value, or with an array of one length in all messages (n x length)."""
        parts = [group.rows[name] for group in self.groups]
        return np.concatenate(parts)[self._order].astype(parts[0].dtype.newbyteorder("="), copy=False)

    def lengths(self, name: str) -> NDArray[np.int64]:
        """Of an array field in each message."""
        parts = [np.full(len(g.indices), self._length(g, name), dtype=np.int64) for g in self.groups]
        return np.concatenate(parts)[self._order]

    def entries(self, name: str) -> NDArray[Any]:
        """Of an array field of numbers: those of all messages, one behind the other."""
        if len(set(self.lengths(name).tolist())) == 1:
            return self.numbers(name).reshape(-1)
        return np.concatenate([self._group(i).rows[name][self._row[i]] for i in range(len(self))])

    def strings(self, name: str) -> Iterable[list[str]]:
        """Of a string field or an array of them: those of each message."""
        return (self.strings_at(name, i) for i in range(len(self)))

    def strings_at(self, name: str, i: int) -> list[str]:
        return self._group(i).strings(name, int(self._row[i]))

    def string_at(self, name: str, i: int) -> str:
        """Of a string field in message i."""
        return self.strings_at(name, i)[0]

    def _group(self, i: int) -> Group:
        return self.groups[int(self._of_group[i])]

    @staticmethod
    def _length(group: Group, name: str) -> int:
        if name in group.counts:
            return group.counts[name]
        shape = group.rows.dtype[name].shape
        return int(shape[0]) if shape else 1
