"""Messages as ROS 2 generates them: fields of one type each, which a value of another is refused for."""

from __future__ import annotations

import copy
from typing import Any


class Message:
    FIELDS: dict[str, Any] = {}  # name: a value of its type

    def __init__(self, **given: Any) -> None:
        unknown = set(given) - set(self.FIELDS)
        assert not unknown, f"{type(self).__name__} has no {unknown}"
        for name, value in self.FIELDS.items():
            object.__setattr__(self, name, copy.deepcopy(value))
        for name, value in given.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        assert name in self.FIELDS, f"{type(self).__name__} has no field {name}"
        kind = self.FIELDS[name]
        if isinstance(kind, Sequence):
            assert isinstance(value, (list, tuple)) and all(
                type(v) is kind.of or isinstance(v, kind.of) and issubclass(kind.of, Message) for v in value
            ), (name, value)
        else:
            assert type(value) is type(kind), (name, value)
            if isinstance(kind, bytes):
                assert len(value) == 1, (name, value)
        object.__setattr__(self, name, value)


class Sequence(list):  # type: ignore[type-arg]
    """An empty sequence of a type."""

    def __init__(self, of: type = float) -> None:
        super().__init__()
        self.of = of

    def __deepcopy__(self, memo: dict[int, Any]) -> list[Any]:
        return []


def message(name: str, /, **fields: Any) -> type[Message]:
    return type(name, (Message,), {"FIELDS": fields})
