"""A message as Foxglove and PlotJuggler read it, and what its schema is."""

from __future__ import annotations

import functools
from typing import NamedTuple

from foxglove_schemas_protobuf import FrameTransforms_pb2, Log_pb2, SceneUpdate_pb2

from . import protobuf

FRAMES, SCENE, LINES = "foxglove.FrameTransforms", "foxglove.SceneUpdate", "foxglove.Log"
WELL_KNOWN = {
    FRAMES: FrameTransforms_pb2.FrameTransforms,
    SCENE: SceneUpdate_pb2.SceneUpdate,
    LINES: Log_pb2.Log,
}


class Output(NamedTuple):
    """One message in protobuf."""

    topic: str
    schema: str  # name of its type
    time_ns: int  # since the epoch
    data: bytes


@functools.cache
def schema_of(name: str) -> bytes:
    """The FileDescriptorSet of a type that an Output names."""
    if name in WELL_KNOWN:
        return protobuf.schema_of_class(WELL_KNOWN[name])
    return protobuf.schema(name.removeprefix(f"{protobuf.PACKAGE}."))
