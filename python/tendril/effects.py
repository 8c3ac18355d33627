"""The effects that a real robot has and the nominal model has not: their names."""

from __future__ import annotations

import difflib

from . import _core


def effects() -> list[str]:
    """Names of all effects; `tendril gap explain NAME` describes one (docs: Reference, Effects of the diagnosis)."""
    return _core.effect_names()


def check_effect(text: str) -> None:
    """Raises ValueError where the first word of an effect's text is no effect's name."""
    if not isinstance(text, str):
        raise ValueError(f"an effect is {type(text).__name__}; give a text such as 'backlash rad=0.05'")
    name = text.split()[0] if text.split() else ""
    names = effects()
    if "=" in name or name in names:
        return
    near = difflib.get_close_matches(name, names, 1, 0.3) or names[:1]
    raise ValueError(f"there is no effect {name!r}; did you mean {near[0]}? tendril.effects() lists all {len(names)}")
