"""LCM messages as protobuf, and the schema that says what they mean.

Every number keeps a fixed width (double, sfixed64, sfixed32), so that messages of equal lengths are equal bytes but for
their values: one template, filled by columns. protobuf's own encoder would take minutes for an hour of cycles.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.message import Message

from .columns import Field, Group, fields_of

PACKAGE = "tendril"
FIXED64, LENGTH_DELIMITED, FIXED32, VARINT = 1, 2, 5, 0
# LCM's type: that of protobuf, its form on the wire, and of one value there.
TYPES: dict[str, tuple[int, int, str]] = {
    "double": (FieldDescriptorProto.TYPE_DOUBLE, FIXED64, "<f8"),
    "float": (FieldDescriptorProto.TYPE_FLOAT, FIXED32, "<f4"),
    "int64_t": (FieldDescriptorProto.TYPE_SFIXED64, FIXED64, "<i8"),
    "int32_t": (FieldDescriptorProto.TYPE_SFIXED32, FIXED32, "<i4"),
    "int16_t": (FieldDescriptorProto.TYPE_SFIXED32, FIXED32, "<i4"),
    "int8_t": (FieldDescriptorProto.TYPE_SFIXED32, FIXED32, "<i4"),
    "boolean": (FieldDescriptorProto.TYPE_BOOL, VARINT, "?"),
    "byte": (FieldDescriptorProto.TYPE_BYTES, LENGTH_DELIMITED, "u1"),
    "string": (FieldDescriptorProto.TYPE_STRING, LENGTH_DELIMITED, "V"),
}


def to_bytes(message: Message) -> bytes:
    data: bytes = message.SerializeToString()
    return data


def schema_name(kind: str) -> str:
    return f"{PACKAGE}.{kind}"


@functools.cache
def schema(kind: str) -> bytes:
    """A FileDescriptorSet with the one message of this type of lcm_types; fields have LCM's names and order."""
    file = FileDescriptorProto(name=f"{PACKAGE}/{kind}.proto", package=PACKAGE, syntax="proto3")
    message = file.message_type.add(name=kind)
    for number, field in enumerate(fields_of(kind), 1):
        repeated = field.count is not None and field.type != "byte"
        message.field.add(
            name=field.name,
            json_name=field.name,
            number=number,
            type=TYPES[field.type][0],
            label=FieldDescriptorProto.LABEL_REPEATED if repeated else FieldDescriptorProto.LABEL_OPTIONAL,
        )
    return to_bytes(FileDescriptorSet(file=[file]))


def schema_of_class(message: type[Message]) -> bytes:
    """A FileDescriptorSet with this message and all that it needs."""
    files: dict[str, FileDescriptorProto] = {}

    def add(descriptor: Any) -> None:
        if descriptor.name not in files:
            for needed in descriptor.dependencies:
                add(needed)
            files[descriptor.name] = FileDescriptorProto()
            descriptor.CopyToProto(files[descriptor.name])

    add(message.DESCRIPTOR.file)
    return to_bytes(FileDescriptorSet(file=files.values()))


def varint(value: int) -> bytes:
    parts = []
    while value > 0x7F:
        parts.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*parts, value])


class _Template:
    """The bytes of a message without its values, and where those go."""

    def __init__(self, group: Group):
        self.bytes = b""
        self.names: list[str] = []
        self.formats: list[Any] = []
        self.offsets: list[int] = []
        for number, field in enumerate(fields_of(group.kind), 1):
            if field.type == "string":
                for i in range(group.counts[field.name]):
                    self._delimited(number, f"{field.name}.{i}", group.rows.dtype[f"{field.name}.{i}"])
            else:
                self._numbers(number, field, group.rows.dtype[field.name].shape)

    def _numbers(self, number: int, field: Field, shape: tuple[int, ...]) -> None:
        _, wire, form = TYPES[field.type]
        if not shape:
            self._value(varint(number << 3 | wire), field.name, np.dtype(form))
        elif shape[0]:  # an empty array is no field at all, while an empty string may be one of several
            self._delimited(number, field.name, np.dtype((form, shape)))

    def _delimited(self, number: int, name: str, form: np.dtype[Any]) -> None:
        """A string, bytes or a packed array."""
        self._value(varint(number << 3 | LENGTH_DELIMITED) + varint(form.itemsize), name, form)

    def _value(self, before: bytes, name: str, form: np.dtype[Any]) -> None:
        self.bytes += before
        if form.itemsize == 0:
            return
        self.names.append(name)
        self.formats.append(form)
        self.offsets.append(len(self.bytes))
        self.bytes += bytes(form.itemsize)

    def filled(self, group: Group) -> bytes:
        out = np.empty((len(group.rows), len(self.bytes)), dtype=np.uint8)
        out[:] = np.frombuffer(self.bytes, dtype=np.uint8)
        for name, form, offset in zip(self.names, self.formats, self.offsets):
            values = group.rows[name]
            if form.kind == "V" and form.subdtype is None:
                values = _valid_text(values)
            elif form.base.kind == "b":
                values = values != 0
            values = np.ascontiguousarray(values.astype(form.base, copy=False))
            out[:, offset : offset + form.itemsize] = values.view(np.uint8).reshape(len(out), form.itemsize)
        return out.tobytes()


def _valid_text(values: Any) -> Any:
    """Strings with '?' for what is not UTF-8: protobuf refuses the whole message for it."""
    text = np.array(values)
    as_bytes = text.view(np.uint8).reshape(len(text), -1)
    for row in np.flatnonzero((as_bytes > 0x7F).any(axis=1)):
        try:
            as_bytes[row].tobytes().decode()
        except UnicodeDecodeError:
            as_bytes[row][as_bytes[row] > 0x7F] = ord("?")
    return text


def encoded(group: Group) -> list[bytes]:
    """Each of the group's messages, in the order of its rows."""
    template = _Template(group)
    data, size = template.filled(group), len(template.bytes)
    return [data[at : at + size] for at in range(0, len(data), size)]
