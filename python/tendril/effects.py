"""The effects that a real robot has and the nominal model has not: their names."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from . import _core


def effects() -> list[str]:
    """Names of all effects; `tendril gap explain NAME` describes one (docs: Reference, Effects of the diagnosis)."""
    return _core.effect_names()


def effect_texts(name: str, given: Sequence[str], what: str) -> list[str]:
    """An argument that is a list of effects, each known; `what`: what each of them is, as 'names'."""
    if isinstance(given, str):
        raise ValueError(f"{name} is the text {given!r}; give a list of {what}: [{given!r}]")
    for text in given:
        _check_effect(text)
    return list(given)


def _check_effect(text: str) -> None:
    """Raises ValueError where the first word of an effect's text is no effect's name."""
    if not isinstance(text, str):
        raise ValueError(f"an effect is {type(text).__name__}; give a text such as 'backlash rad=0.05'")
    name = text.split()[0] if text.split() else ""
    names = effects()
    if "=" in name or name in names:
        return
    near = difflib.get_close_matches(name, names, 1, 0.3) or names[:1]
    raise ValueError(f"there is no effect {name!r}; did you mean {near[0]}? tendril.effects() lists all {len(names)}")
