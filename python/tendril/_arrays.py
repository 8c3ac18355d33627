"""Checks of what is given as numbers: shapes, finite values. Knows no equation."""

from __future__ import annotations

import operator
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def numbers(name: str, value: ArrayLike, meaning: str) -> Array:
    """`value` as an array of finite doubles. What numpy turns into doubles by leaving something out is refused."""
    try:
        given = np.asanyarray(value)
        if given.dtype.kind not in "buifO":
            raise TypeError(f"of type {given.dtype}")
        if np.ma.is_masked(given):
            raise TypeError("some values are masked")
        array = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        kind = type(value).__name__
        raise ValueError(f"{name} is {kind}, not numbers ({error}); give {meaning}") from None
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        value_there = array[where]
        place = f"[{', '.join(map(str, where))}]" if where else ""
        raise ValueError(f"{name}{place} is {value_there}; give finite numbers: {meaning}")
    return array


def number(name: str, value: ArrayLike, meaning: str) -> float:
    """One finite number."""
    array = numbers(name, value, meaning)
    if array.ndim != 0:
        raise ValueError(f"{name} has shape {array.shape}; give one number: {meaning}")
    return float(array)


def whole(name: str, value: Any, least: int, most: int) -> int:
    """A whole number of Python or numpy."""
    try:
        number_there = operator.index(value)
    except TypeError:
        number_there = least - 1
    if isinstance(value, (bool, np.bool_)) or not least <= number_there <= most:
        raise ValueError(f"{name} is {value!r}; give a whole number from {least} to {most}")
    return number_there


def flag(name: str, value: Any) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {value!r}; give True or False")
    return bool(value)


def text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{name} is {type(value).__name__}; give a text")
    return value


def file_name(name: str, path: Any) -> str:
    """The path of a file or folder, as UTF-8 text."""
    try:
        file = os.fsdecode(path)
        file.encode()
    except (TypeError, UnicodeEncodeError):
        raise ValueError(f"{name} is {path!r}; give a path as str or pathlib.Path, in UTF-8") from None
    if not file or "\0" in file:
        raise ValueError(f"{name} is {path!r}; give a path")
    return file


def vector(name: str, value: ArrayLike, count: int | None, meaning: str) -> Array:
    """One row of `count` numbers; None: any count but zero."""
    array = numbers(name, value, meaning)
    if array.ndim != 1 or array.size == 0 or (count is not None and array.size != count):
        expected = f"({count},)" if count is not None else "(n,)"
        raise ValueError(f"{name} has shape {array.shape}; expected {expected}: {meaning}")
    return array


class Batch:
    """Arguments that are one row each, or N rows each; one row goes with any number of rows."""

    def __init__(self) -> None:
        self.rows: int | None = None
        self._named = ""
        self._arrays: list[Array] = []

    def add(self, name: str, value: ArrayLike, columns: int, meaning: str) -> None:
        array = numbers(name, value, meaning)
        if array.ndim not in (1, 2) or array.shape[-1] != columns:
            raise ValueError(
                f"{name} has shape {array.shape}; expected ({columns},) or (N, {columns}): {meaning}"
            )
        if array.ndim == 2:
            if self.rows is not None and array.shape[0] != self.rows:
                raise ValueError(
                    f"{name} has {array.shape[0]} rows and {self._named} {self.rows}; "
                    f"give the same number of rows, or one for all, of shape ({columns},)"
                )
            self.rows, self._named = array.shape[0], name
        self._arrays.append(array)

    def tables(self) -> list[Any]:
        """Each argument as N x columns, C-contiguous."""
        rows = 1 if self.rows is None else self.rows
        return [
            np.ascontiguousarray(np.broadcast_to(array, (rows, array.shape[-1]))) for array in self._arrays
        ]

    def shaped(self, table: Array, *shape: int) -> Array:
        """A result of N rows as the caller gave its arguments; `shape` of one row, if not the table's own."""
        result = table.reshape(table.shape[0], *shape) if shape else table
        return result[0] if self.rows is None else result
