"""What goes wrong, as exceptions. Wrong shapes, values that are not finite and wrong names are ValueError."""

from __future__ import annotations

import re

_PLACE = re.compile(r"(?P<file>.+?)(?::(?P<line>\d+))?: (?:(?P<key>[A-Za-z_][\w.\[\]]*|\(top level\)): )?")


class Error(RuntimeError):
    """Work that failed; the text is one line with the remedy."""


class ConfigError(Error, ValueError):
    """A file that is not as it must be. The text is `file:line: key: what is wrong; accepted; remedy`.

    Attributes:
        file: path of the file.
        line: line in it, from 1; None where the error has none, as for a missing file.
        key: key of the file, such as `sections[0].units`; None where it is about none.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        place = _PLACE.match(text)
        self.file: str | None = place["file"] if place else None
        self.line: int | None = int(place["line"]) if place and place["line"] else None
        self.key: str | None = place["key"] if place else None


class ModelError(Error):
    """A row whose case has no solution, such as tensions under which the robot buckles.

    Attributes:
        row: the row, from 0.
    """

    def __init__(self, text: str, row: int) -> None:
        super().__init__(f"row {row}: {text}")
        self.row = row
        self._made_of = (text, row)

    def __reduce__(self) -> tuple[type[ModelError], tuple[str, int]]:
        """Made anew from its own arguments in another process: a pool that cannot do it waits without end."""
        return ModelError, self._made_of


class DaemonError(Error):
    """No daemon answers, or it refuses; the text has reason and remedy."""


def install(extra: str) -> str:
    """How to install an extra of this package, which is in no registry."""
    return f"pip install './python[{extra}]' in the checkout"
