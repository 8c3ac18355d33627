"""An MCAP file: every message in protobuf, with the robot's frames, body and log lines."""

from __future__ import annotations

import contextlib
import pathlib
from collections.abc import Sequence
from typing import Any

from mcap.writer import CompressionType, Writer

from .. import _core
from ..logs import layouts
from ..logs.batch import Part
from ..logs.encode import Encoder
from ..logs.output import Output, schema_of
from .files import NewFiles

CHUNK = 4 * 2**20  # bytes


class McapFile:
    """Streams: what it keeps is an index entry a chunk."""

    def __init__(self, path: pathlib.Path, files: NewFiles, robot: _core.Robot | None):
        self.path, self._files = path, files
        for layout in layouts.paths_beside(path):
            files.require_free(layout)
        self.encoder = Encoder(robot)
        self._stream = files.add(path).open("wb")
        self._writer: Any = Writer(self._stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=f"tendril {_core.version()}")
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self.messages = 0

    def write(self, parts: Sequence[Part]) -> None:
        add = self._writer.add_message
        for output in self.encoder.encode(parts):
            channel = self._channels.get((output.topic, output.schema)) or self._new_channel(output)
            add(channel, output.time_ns, output.data, output.time_ns)
            self.messages += 1

    def _new_channel(self, output: Output) -> int:
        schema = self._schemas.get(output.schema)
        if schema is None:
            schema = self._writer.register_schema(output.schema, "protobuf", schema_of(output.schema))
            self._schemas[output.schema] = schema
        channel: int = self._writer.register_channel(output.topic, "protobuf", schema)
        self._channels[output.topic, output.schema] = channel
        return channel

    def finish(self, about: dict[str, str]) -> list[str]:
        """`about` becomes the file's metadata. Returns remarks."""
        self._writer.add_metadata("tendril", about)
        self._writer.finish()
        self._stream.close()
        for path, text in layouts.beside(self.path, self.encoder.sources()).items():
            self._files.add(path).write_text(text)
        return self.encoder.remarks(ended=True)

    def abandon(self) -> None:
        with contextlib.suppress(OSError):  # of a full disk, already reported
            self._stream.close()
