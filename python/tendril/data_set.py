"""Measured runs of a robot: from folders, logs and pandas tables, and back."""

from __future__ import annotations

import contextlib
import os
import pathlib
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from . import _core
from ._arrays import file_name, flag, text
from ._core import Robot, Run
from .errors import ConfigError, Error, install

if TYPE_CHECKING:
    import pandas

_NAME = re.compile(r"[^/.\s]([^/]{0,98}[^/\s])?")  # of a run, and so of its file
Path = str | os.PathLike[str]


class DataSet:
    """Measured runs and the nominal robot that they are compared with. Never changes.

    Made by `DataSet.from_folder`, `from_log`, `from_dataframe` or `tendril.simulate`. Iteration yields its runs;
    `data["circle"]` is the run of that name.
    """

    def __init__(self, core: _core.Set) -> None:
        self._core = core
        self._runs: list[Run] = core.runs

    @classmethod
    def from_folder(cls, *paths: Path, robot: Robot | Path | None = None, same_robot: bool = False) -> DataSet:
        """Reads folders (robot.yaml, runs.yaml, CSV), CSV files and LCM logs, in any mixture, as one set.

        Args:
            paths: folders and files.
            robot: nominal robot or its file; None: the folder's robot.yaml, or the log's own.
            same_robot: the runs are of that robot although their own robot file differs.
        """
        names = [file_name("a path", path) for path in paths]
        with _robot_file(robot) as file:
            return cls(_core.load_set(names, file, flag("same_robot", same_robot)))

    @classmethod
    def from_log(cls, *paths: Path, robot: Robot | Path | None = None, same_robot: bool = False) -> DataSet:
        """Reads LCM logs of a daemon, `tendril sim --log` or `tendril demo`: one run from each arming to its disarming.

        Args: as of `from_folder`.
        """
        return cls.from_folder(*paths, robot=robot, same_robot=same_robot)

    @classmethod
    def from_dataframe(
        cls,
        tables: pandas.DataFrame | Mapping[str, pandas.DataFrame],
        robot: Robot | Path,
        *,
        name: str = "tables",
        runs: Mapping[str, Mapping[str, Any]] | None = None,
        fit_frame: bool = False,
        map: Path | None = None,
    ) -> DataSet:
        """Runs from pandas tables, read as the CSV files of a folder are, with the same checks.

        Args:
            tables: one table, or tables by the name of their run. Columns: `t_s` [s] and any of `torque_target_Nm_j`,
                `torque_actual_Nm_j`, `motor_position_rad_j`, `tension_N_j` (j = 1..M), `tip_x_m`, `tip_y_m`, `tip_z_m`,
                `tip_qw`, `tip_qx`, `tip_qy`, `tip_qz` (docs: Reference, Data set). NaN: no new value.
            robot: nominal robot or its file.
            name: of the set.
            runs: keys of runs.yaml by the name of a run, such as
                `{"a": {"family": "circle", "repeat_of": "b", "load_cell": "robot_side", "motor_zero": "at_rest"}}`.
            fit_frame: the pose of the tracker's frame is unknown, and is fitted.
            map: column map of `tendril gap import`, for tables with other columns and units. It decides on runs and
                families; `runs` and `fit_frame` do not apply.

        Raises:
            ValueError: a table that cannot be used, with its name and what is missing.
        """
        nominal = as_robot(robot)
        named = tables if isinstance(tables, Mapping) else {"run": tables}
        with tempfile.TemporaryDirectory(prefix="tendril-") as folder:
            files = _written(named, pathlib.Path(folder))
            try:
                if map is not None:
                    core = _core.import_tables(file_name("map", map), files, nominal)
                else:
                    _describe(pathlib.Path(folder), nominal, named, runs or {}, fit_frame)
                    core = _core.load_set([folder], "", False)
            except ConfigError:
                raise
            except Error as error:
                raise ValueError(_of_tables(str(error), folder)) from None
            core = core.named(text("name", name), f"{folder}/")
        # In a folder these are remarks; whoever gives a table and its keys wants them used.
        unused = [note for note in core.notes if note.startswith(("left out", "runs.yaml"))]
        if unused:
            raise ValueError("; ".join(unused))
        return cls(core)

    @property
    def name(self) -> str:
        """Name of the set: its folder's."""
        return self._core.name

    @property
    def robot(self) -> Robot:
        """The nominal robot."""
        return self._core.robot

    @property
    def runs(self) -> list[Run]:
        """The runs, in order."""
        return list(self._runs)

    @property
    def notes(self) -> list[str]:
        """Remarks on the set, such as files that could not be read, one line each."""
        return self._core.notes

    def cuts(self) -> str:
        """Which places of the chain can be compared with these channels, in one line."""
        return self._core.cuts()

    def health(self) -> list[str]:
        """What a check of the data finds, worst first, one line each."""
        return self._core.health()

    def with_before(self, before: DataSet) -> DataSet:
        """The set with each run paired with its run from before the robot changed: the change is diagnosed."""
        return DataSet(self._core.with_before(before._core))

    def to_pandas(self) -> dict[str, pandas.DataFrame]:
        """Each run as a table with the canonical columns, by its name; numbers are exact."""
        pandas = _pandas()
        tables = {}
        for run in self._runs:
            names, values = _core.table_of(run)
            tables[run.name] = pandas.DataFrame(values, columns=names)
        return tables

    def to_folder(self, path: Path, overwrite: bool = False) -> None:
        """Writes robot.yaml, runs.yaml and one CSV a run, as `tendril gap` reads them.

        Args:
            overwrite: replace a data set that is there; other files of the folder are left alone.
        """
        self._core.write(file_name("path", path), flag("overwrite", overwrite))

    def __contains__(self, run: object) -> bool:
        return any(run is own or run == own.name for own in self._runs)

    def __len__(self) -> int:
        return len(self._runs)

    def __iter__(self) -> Iterator[Run]:
        return iter(self._runs)

    def __getitem__(self, name: str) -> Run:
        for run in self._runs:
            if run.name == name:
                return run
        raise KeyError(f"there is no run {name!r}; there are {', '.join(run.name for run in self._runs)}")

    def __repr__(self) -> str:
        return f"<DataSet {self.name!r}: {len(self)} runs of robot {self.robot.name!r}>"


def as_robot(robot: Robot | Path) -> Robot:
    """A robot, or the one of a file."""
    return robot if isinstance(robot, Robot) else _core.load_robot(file_name("robot", robot))


def as_set(robot: Robot | Path, data: Any, same_robot: bool = False) -> DataSet:
    """What a program gives as data, as runs to be compared with `robot`."""
    if isinstance(data, DataSet):
        if as_robot(robot).to_yaml() == data.robot.to_yaml():
            return data
        # Recorded with another file: by way of a folder, whose reading compares the two.
        with tempfile.TemporaryDirectory(prefix="tendril-") as folder:
            place = os.path.join(folder, "set")
            data.to_folder(place)
            with _said_without(f"{folder}/", ""):
                again = DataSet.from_folder(place, robot=robot, same_robot=same_robot)
            return DataSet(again._core.named(data.name or "set", f"{folder}/"))
    if isinstance(data, (str, os.PathLike)):
        return DataSet.from_folder(data, robot=robot, same_robot=same_robot)
    if isinstance(data, Sequence) and all(isinstance(item, (str, os.PathLike)) for item in data):
        return DataSet.from_folder(*data, robot=robot, same_robot=same_robot)
    if hasattr(data, "to_csv") or isinstance(data, Mapping):
        return DataSet.from_dataframe(data, robot)
    raise ValueError(f"data is {type(data).__name__}; give a DataSet, paths, or pandas tables")


def checked_set(robot: Robot | Path, data: Any, same_robot: bool, before: Any = None) -> DataSet:
    """The same for a function of the package, at whose caller what makes the data doubtful is warned of. `before`: runs
    from before a change, or None."""
    runs = as_set(robot, data, same_robot)
    if before is not None:
        runs = runs.with_before(as_set(robot, before, same_robot))
    for line in runs._core.errors():
        warnings.warn(line, stacklevel=3)
    return runs


@contextlib.contextmanager
def _robot_file(robot: Robot | Path | None) -> Iterator[str]:
    if not isinstance(robot, Robot):
        yield "" if robot is None else file_name("robot", robot)
        return
    with tempfile.TemporaryDirectory(prefix="tendril-") as folder:
        file = pathlib.Path(folder) / "robot.yaml"
        file.write_text(robot.to_yaml())
        with _said_without(str(file), f"the robot {robot.name!r}"):
            yield str(file)


@contextlib.contextmanager
def _said_without(place: str, instead: str) -> Iterator[None]:
    """Errors name what the caller gave, and not where it was put to be read."""
    try:
        yield
    except Error as error:
        raise type(error)(str(error).replace(place, instead)) from None


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        raise ImportError(f"tables need pandas; install it: {install('data')}") from None
    return pandas


def _written(tables: Mapping[str, Any], folder: pathlib.Path) -> list[str]:
    if not tables:
        raise ValueError("no table is given; give a DataFrame, or DataFrames by the name of their run")
    files = []
    for name, table in tables.items():
        if not hasattr(table, "to_csv"):
            raise ValueError(f"table {name!r} is {type(table).__name__}; give a pandas DataFrame")
        if not isinstance(name, str) or not _NAME.fullmatch(name) or not name.isprintable():
            raise ValueError(f"a run is called {name!r}; accepted: 1 to 100 printable characters, as of a file's name")
        file = folder / f"{name}.csv"
        table.to_csv(file, index=False)
        files.append(str(file))
    return files


def _describe(
    folder: pathlib.Path,
    robot: Robot,
    tables: Mapping[str, Any],
    runs: Mapping[str, Mapping[str, Any]],
    fit_frame: bool,
) -> None:
    """robot.yaml and runs.yaml beside the tables."""
    if not isinstance(runs, Mapping) or not all(isinstance(keys, Mapping) for keys in runs.values()):
        raise ValueError(f"runs is {runs!r}; give keys of runs.yaml by the name of a run, {{'run': {{'family': 'circle'}}}}")
    if unknown := runs.keys() - tables.keys():
        raise ValueError(f"runs names {', '.join(sorted(map(str, unknown)))}; there are only {', '.join(tables)}")
    (folder / "robot.yaml").write_text(robot.to_yaml())
    lines = [f"tracker_frame: {'fit' if fit_frame else 'given'}", "runs:"]
    for name in tables:
        lines.append(f"  - file: {_quoted(name + '.csv')}")
        lines += [f"    {key}: {_quoted(str(value))}" for key, value in runs.get(name, {}).items() if value is not None]
    (folder / "runs.yaml").write_text("\n".join(lines) + "\n")


def _of_tables(error: str, folder: str) -> str:
    """What is wrong with tables, in one line and without the folder that they were read from."""
    lines = [line.strip() for line in error.replace(f"{folder}/", "").split("\n")]
    if len(lines) > 1 and lines[0].startswith(f"{folder}: no usable run"):
        del lines[0]
    return "; ".join(line.removeprefix("left out: ") for line in lines).replace(folder, "the tables")


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
