"""Tables, one file a channel: CSV or Parquet. A row is a message, a column a number or a text of it."""

from __future__ import annotations

import contextlib
import functools
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

from ..logs.batch import NS_PER_US, Part
from ..logs.columns import OF_A_ROBOT, Columns, Field, fields_of
from .files import NewFiles

ROWS_A_GROUP = 65536


def columns_of_field(field: Field, columns: Columns) -> dict[str, Any]:
    """The Arrow arrays of a field by the names of their columns: an array of a robot's size is a column an entry,
    TENSION_1, TENSION_2, ...; others are lists."""
    if field.count is None:
        if field.type == "string":
            return {field.name: pa.array([text for (text,) in columns.strings(field.name)], pa.string())}
        values = columns.numbers(field.name)
        return {field.name: pa.array(values != 0 if field.type == "boolean" else values)}
    if isinstance(field.count, int) or field.count in OF_A_ROBOT:
        values = columns.numbers(field.name)
        return {f"{field.name}_{i}": pa.array(np.ascontiguousarray(v)) for i, v in enumerate(values.T, 1)}
    lengths = columns.lengths(field.name)
    if field.type == "string":
        entries = pa.array([text for texts in columns.strings(field.name) for text in texts], pa.string())
    else:
        entries = pa.array(columns.entries(field.name))
    offsets = pa.array(np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32))
    return {field.name: pa.ListArray.from_arrays(offsets, entries)}


def table_of(part: Part, start_us: int) -> Any:
    """`seconds` since the log's first message, `time` and `recorded` (both UTC), and every field."""
    times = np.array(part.times_ns, dtype=np.int64)
    arrays: dict[str, Any] = {
        "seconds": pa.array(1e-9 * (times - NS_PER_US * start_us)),
        "time": pa.array(times).cast(pa.timestamp("ns", "UTC")),
        "recorded": pa.array(part.recorded_us).cast(pa.timestamp("us", "UTC")),
    }
    for field in fields_of(part.kind):
        arrays |= columns_of_field(field, part.columns)
    return pa.table(arrays)


def as_text(table: Any) -> Any:
    """CSV has no lists: their entries, separated by spaces, are a text."""
    for i, field in enumerate(table.schema):
        if pa.types.is_list(field.type):
            texts = [" ".join(map(str, entries)) for entries in table.column(i).to_pylist()]
            table = table.set_column(i, field.name, pa.array(texts, pa.string()))
    return table


class ParquetFile:
    ending = ".parquet"

    def __init__(self, path: pathlib.Path, schema: Any):
        self._writer = parquet.ParquetWriter(path, schema, compression="zstd")

    def write(self, table: Any) -> None:
        self._writer.write_table(table, row_group_size=ROWS_A_GROUP)

    def close(self) -> None:
        self._writer.close()


class CsvFile:
    ending = ".csv"

    def __init__(self, path: pathlib.Path, schema: Any):
        self._writer = csv.CSVWriter(path, as_text(schema.empty_table()).schema)

    def write(self, table: Any) -> None:
        self._writer.write(as_text(table))

    def close(self) -> None:
        self._writer.close()


class _Channel:
    """The file of a channel, and rows that wait for it."""

    def __init__(self, open_file: Callable[[Any], ParquetFile | CsvFile]):
        self._open_file = open_file
        self._file: ParquetFile | CsvFile | None = None
        self._schema: Any = None
        self._waiting: list[Any] = []
        self._rows = 0

    def add(self, table: Any) -> None:
        if self._schema is not None and table.schema != self._schema:
            self.close()  # another robot: its rows have other columns, and a file of their own
        self._schema = table.schema
        self._waiting.append(table)
        self._rows += len(table)
        if self._rows >= ROWS_A_GROUP:
            self._flush()

    def _flush(self) -> None:
        if self._file is None:
            self._file = self._open_file(self._schema)
        self._file.write(pa.concat_tables(self._waiting))
        self._waiting, self._rows = [], 0

    def close(self) -> None:
        if self._waiting:
            self._flush()
        self.abandon()

    def abandon(self) -> None:
        """Closes the file without what waits for it."""
        if self._file is not None:
            self._file.close()
            self._file = None


class Tables:
    """A folder with a file a channel. What is kept is at most a row group a channel."""

    def __init__(self, folder: pathlib.Path, files: NewFiles, kind: type[ParquetFile | CsvFile]):
        self._folder, self._files, self._kind = folder, files, kind
        files.make_folder(folder)
        self._channels: dict[tuple[str, str], _Channel] = {}
        self._names: set[str] = set()
        self._start_us: int | None = None

    def write(self, parts: Sequence[Part]) -> None:
        if self._start_us is None:
            self._start_us = min(int(part.recorded_us[0]) for part in parts)
        for part in parts:
            key = part.channel, part.kind
            if key not in self._channels:
                self._channels[key] = _Channel(functools.partial(self._new, part.channel))
            self._channels[key].add(table_of(part, self._start_us))

    def _new(self, channel: str, schema: Any) -> ParquetFile | CsvFile:
        stem = channel.replace("/", "_").replace("\0", "_")
        name, n = stem, 2
        while name in self._names:
            name, n = f"{stem}_{n}", n + 1
        self._names.add(name)
        return self._kind(self._files.add(self._folder / f"{name}{self._kind.ending}"), schema)

    def finish(self, about: dict[str, str]) -> list[str]:
        for channel in self._channels.values():
            channel.close()
        return []

    def abandon(self) -> None:
        for channel in self._channels.values():
            with contextlib.suppress(OSError):  # of a full disk, already reported
                channel.abandon()
