"""New files that appear under their names when all of them are complete, or not at all."""

from __future__ import annotations

import contextlib
import os
import pathlib
import signal
from collections.abc import Iterator, Sequence


class ExportError(Exception):
    """One line for the user: what is wrong, where, the remedy."""


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals wait: between a file's making and the note that it is there, none may come."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class NewFiles:
    """Each is written beside its place as NAME.part. `inputs`: what is read, and never replaced."""

    def __init__(self, overwrite: bool, inputs: Sequence[str | None] = ()):
        self._overwrite = overwrite
        self._inputs = [pathlib.Path(path) for path in inputs if path and pathlib.Path(path).exists()]
        self._parts: dict[pathlib.Path, pathlib.Path] = {}
        self._made: list[pathlib.Path] = []  # folders
        self.kept = False

    @property
    def paths(self) -> list[pathlib.Path]:
        return list(self._parts.values())

    def require_free(self, path: pathlib.Path) -> None:
        """ExportError where a file would be lost that may not be."""
        if path.is_dir():
            raise ExportError(f"{path} is a folder; name a file")
        if path.exists() and not path.is_file():
            raise ExportError(f"{path} is no file that can be replaced; name another")
        if path.exists() and any(path.samefile(given) for given in self._inputs):
            raise ExportError(f"{path} is what is read; name another place")
        if not self._overwrite and path.exists():
            raise ExportError(f"{path} exists; name another place, or replace it with --overwrite")

    def add(self, path: pathlib.Path) -> pathlib.Path:
        """Where to write what will be `path`."""
        self.require_free(path)
        part = path.with_name(f"{path.name}.part")
        try:
            with uninterrupted():
                part.open("xb").close()
                self._parts[part] = path
        except FileExistsError:
            raise ExportError(f"{part} exists and would be lost; move it, or name another place") from None
        except OSError as e:
            remedy = "name a place in an existing folder that you may write to"
            raise ExportError(f"{path} cannot be written ({e.strerror}); {remedy}") from None
        return part

    def make_folder(self, folder: pathlib.Path) -> None:
        """With its parents; taken away again where nothing comes into it."""
        missing = [p for p in (folder, *folder.parents) if not p.exists()]
        self._made += reversed(missing)  # what could not be made is not there to be taken away
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as e:
            raise ExportError(f"{folder}: no folder can be made there ({e.strerror}); name another") from None
        if not self._overwrite and any(folder.iterdir()):
            raise ExportError(
                f"{folder} is not empty; name another folder, or replace its files with --overwrite"
            )

    def keep(self) -> None:
        """Gives all their names."""
        for part in self._parts:
            with part.open("rb") as written:
                os.fsync(written.fileno())
        with uninterrupted():
            for part, path in self._parts.items():
                os.replace(part, path)
            self.kept = True

    def remove(self) -> None:
        for part in self._parts:
            part.unlink(missing_ok=True)
        for folder in reversed(self._made):
            with contextlib.suppress(OSError):
                folder.rmdir()


@contextlib.contextmanager
def new_files(overwrite: bool, inputs: Sequence[str | None]) -> Iterator[NewFiles]:
    """Kept when the block ends; removed where it raises, as on Ctrl-C."""
    files = NewFiles(overwrite, inputs)
    try:
        yield files
        files.keep()
    except BaseException as e:
        if not files.kept:
            files.remove()
        elif isinstance(e, KeyboardInterrupt):
            raise KeyboardInterrupt(*e.args, "all is written") from None
        raise
