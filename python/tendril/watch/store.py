"""The database of watched robots (SQLite). One transaction an entry: after a kill or on a full disk an entry is there
as a whole, or not at all. Knows nothing of what the numbers mean."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import pathlib
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import Error

APPLICATION = 0x54474157  # 'TGAW', in the file's head: another program's database is not taken for one
# Of a database. 2: with entries that are `diagnosed`, which programs for 1 cannot read; without these it stays 1, for
# such programs too.
PLAIN, FORMAT = 1, 2
SCHEMA = """
CREATE TABLE entries (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  robot TEXT NOT NULL,
  accepted INTEGER REFERENCES entries(id),  -- the state that it is compared with; NULL: it is one itself
  at REAL NOT NULL,                         -- [s since the epoch] when it was recorded
  digest TEXT NOT NULL,                     -- of its runs
  about TEXT NOT NULL                       -- JSON: all else
);
CREATE UNIQUE INDEX once ON entries(accepted, digest) WHERE accepted IS NOT NULL;
CREATE INDEX course ON entries(robot, accepted, at);
CREATE TABLE numbers (
  entry INTEGER NOT NULL REFERENCES entries(id),
  effect TEXT NOT NULL, place TEXT NOT NULL, name TEXT NOT NULL,
  unit TEXT NOT NULL, value REAL NOT NULL, deviation REAL NOT NULL, material REAL NOT NULL,
  PRIMARY KEY (entry, effect, place, name)
) WITHOUT ROWID;
"""


class StoreError(Error):
    """What is wrong with the database, in one line with the remedy."""


@dataclass(frozen=True, order=True)
class Key:
    """Which number: a parameter of an effect at a place."""

    effect: str
    where: str
    name: str

    def __str__(self) -> str:
        return " ".join(
            part for part in (self.effect, self.where if self.where != "all" else "", self.name) if part
        )


@dataclass(frozen=True)
class Number:
    """A value with its standard deviation, and the change of it that matters; 0 where that is not known."""

    unit: str
    value: float
    deviation: float
    material: float


@dataclass(frozen=True)
class Entry:
    """What one set of runs says of a robot: a state that was accepted, or a day beside it."""

    robot: str
    at: float
    """[s since the epoch] when it was recorded."""
    numbers: dict[Key, Number]
    runs: dict[str, str]
    """SHA-256 by the name of the run."""
    families: list[str] = field(default_factory=list)
    """Kinds of motion."""
    sources: list[str] = field(default_factory=list)
    channels: list[dict[str, Any]] = field(default_factory=list)
    """Noise floor, materiality and discrepancy of what is compared."""
    notes: list[str] = field(default_factory=list)
    """What was left out of the runs, and why."""
    build: str = ""
    note: str = ""
    """Of whoever accepted it."""
    robot_yaml: str = ""
    """Of an accepted state: its robot file."""
    diagnosed: bool = False
    """The robot is position-controlled: learned from the accepted runs, and every day is a diagnosis against these."""
    delta_N: float | None = None
    delta_m: float | None = None
    finding: dict[str, Any] = field(default_factory=dict)
    """Of a day: whether it is an alarm, what changed, since when, and why."""
    accepted: int | None = None
    id: int = 0

    @property
    def digest(self) -> str:
        return hashlib.sha256("\n".join(sorted(self.runs.values())).encode()).hexdigest()


_COLUMNS = ("robot", "at", "numbers", "accepted", "id")  # of the tables; all else is in `about`


def _about(entry: Entry) -> str:
    about = {key: value for key, value in vars(entry).items() if key not in _COLUMNS}
    if not entry.diagnosed:
        del about["diagnosed"]  # unknown to programs that read format 1
    return json.dumps(about)


def _written(path: str) -> bool:
    """Whether a program has it open to write."""
    return os.path.exists(f"{path}-wal")


class Store:
    """The file; use it as a context. `mode`: 'rwc' makes it where it is missing, 'rw' does not, 'ro' only reads."""

    def __init__(self, path: str, mode: str = "rw") -> None:
        self._path, self._mode = path, mode
        if pathlib.Path(path).is_dir():
            raise StoreError(f"{path}: a folder; give the file of a database in --db")
        if mode != "rwc" and not pathlib.Path(path).exists():
            raise StoreError(
                f"{path}: no such database; tendril gap accept makes it with a robot's first accepted state"
            )
        with self._explained():
            uri = f"{pathlib.Path(path).absolute().as_uri()}?mode={mode}"
            # Whoever may not write beside it reads it as it is between two entries.
            if (
                mode == "ro"
                and not os.access(pathlib.Path(path).absolute().parent, os.W_OK)
                and not _written(path)
            ):
                uri += "&immutable=1"
            self._db = sqlite3.connect(uri, uri=True, timeout=30, isolation_level=None)
        try:
            self._open(mode)
        except BaseException:
            self._db.close()
            raise

    def _open(self, mode: str) -> None:
        with self._explained():
            # A commit is on the disk before it counts, at any loss of power.
            self._db.execute("PRAGMA synchronous=FULL")
            self._db.execute("PRAGMA foreign_keys=ON")
            if mode == "rwc" and self._empty():
                self._db.execute("PRAGMA journal_mode=WAL")
                with self._transaction():
                    if self._empty():  # another program may have been first
                        for statement in SCHEMA.split(";\n"):
                            self._db.execute(statement)
                        self._db.execute(f"PRAGMA application_id={APPLICATION}")
                        self._db.execute(f"PRAGMA user_version={PLAIN}")
            kind, form = (
                self._db.execute(f"PRAGMA {name}").fetchone()[0]
                for name in ("application_id", "user_version")
            )
        if kind != APPLICATION:
            raise StoreError(f"{self._path}: not a database of tendril gap watch; give another --db")
        if not PLAIN <= form <= FORMAT:
            raise StoreError(
                f"{self._path}: of format {form}, where this version reads {PLAIN} and {FORMAT}; "
                "use the version that made it"
            )

    def _empty(self) -> bool:
        return self._db.execute("SELECT name FROM sqlite_master LIMIT 1").fetchone() is None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self._db.close()

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise StoreError(f"{self._path}: {error}; {self._remedy(str(error))}") from None

    def _remedy(self, text: str) -> str:
        if "not a database" in text or "malformed" in text:
            return "give another --db, or a copy of it from before"
        if "UNIQUE" in text:
            return "another program entered the same runs meanwhile: run this again"
        if "unable to open" in text or "readonly" in text or self._mode == "ro":
            return "check that the file and its folder are there and that this user may use them"
        cause = "another program writes to it" if "locked" in text else "make room on its disk"
        return f"nothing of this entry was kept, what was there before is; {cause}: run this again"

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):  # SQLite may have rolled back itself
                self._db.execute("ROLLBACK")
            raise

    def require_writable(self) -> None:
        """Raises before the work what would otherwise be found after it."""
        with self._explained(), self._transaction():
            pass

    def add(self, entry: Entry) -> Entry:
        """Keeps it; the same with its number."""
        with self._explained(), self._transaction():
            made = self._db.execute(
                "INSERT INTO entries (robot, accepted, at, digest, about) VALUES (?, ?, ?, ?, ?)",
                (entry.robot, entry.accepted, entry.at, entry.digest, _about(entry)),
            )
            assert made.lastrowid is not None
            if entry.diagnosed:
                self._db.execute(f"PRAGMA user_version={FORMAT}")
            self._db.executemany(
                "INSERT INTO numbers VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                [
                    (made.lastrowid, k.effect, k.where, k.name, n.unit, n.value, n.deviation, n.material)
                    for k, n in entry.numbers.items()
                ],
            )
        return replace(entry, id=made.lastrowid)

    def conclude(self, entry: Entry) -> None:
        """Keeps what a diagnosis added to the finding of an entry that is there."""
        with self._explained(), self._transaction():
            self._db.execute("UPDATE entries SET about = ? WHERE id = ?", (_about(entry), entry.id))

    def robots(self) -> list[str]:
        """Names of the robots that it has, sorted."""
        with self._explained():
            return [row[0] for row in self._db.execute("SELECT DISTINCT robot FROM entries ORDER BY robot")]

    def accepted(self, robot: str) -> list[Entry]:
        """The accepted states of a robot, the newest last."""
        return self._entries("robot = ? AND accepted IS NULL ORDER BY id", robot)

    def days(self, accepted: Entry) -> list[Entry]:
        """The days beside an accepted state, by time."""
        return self._entries("accepted = ? ORDER BY at, id", accepted.id)

    def _entries(self, where: str, value: object) -> list[Entry]:
        with self._explained():
            self._db.execute("BEGIN")  # entries and numbers of one moment
            try:
                rows = self._db.execute(
                    f"SELECT id, robot, accepted, at, about FROM entries WHERE {where}", (value,)
                )
                return [self._entry(*row) for row in rows.fetchall()]
            finally:
                self._db.execute("ROLLBACK")

    def _entry(self, id: int, robot: str, accepted: int | None, at: float, about: str) -> Entry:
        rows = self._db.execute(
            "SELECT effect, place, name, unit, value, deviation, material FROM numbers WHERE entry = ?", (id,)
        )
        numbers = {Key(*row[:3]): Number(*row[3:]) for row in rows}
        return Entry(robot=robot, at=at, numbers=numbers, accepted=accepted, id=id, **json.loads(about))
