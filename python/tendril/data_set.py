"""Measured runs of a robot: from folders, logs and pandas tables, and back."""

from __future__ import annotations

import contextlib
import os
import pathlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from . import _core
from ._core import Robot, Run
from .errors import ConfigError, Error

if TYPE_CHECKING:
    import pandas

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
        names = [os.fspath(path) for path in paths]
        with _robot_file(robot) as file:
            return cls(_core.load_set(names, file, same_robot))

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
                    core = _core.import_tables(os.fspath(map), files, nominal)
                else:
                    _describe(pathlib.Path(folder), nominal, named, runs or {}, fit_frame)
                    core = _core.load_set([folder], "", False)
            except ConfigError:
                raise
            except Error as error:
                raise ValueError(str(error).replace(f"{folder}/", "")) from None
            core = core.named(name, f"{folder}/")
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
        self._core.write(os.fspath(path), overwrite)

    def __len__(self) -> int:
        return len(self._runs)

    def __iter__(self) -> Iterator[Run]:
        return iter(self._runs)

    def __contains__(self, run: object) -> bool:
        return any(own is run or own.name == run for own in self._runs)

    def __getitem__(self, name: str) -> Run:
        for run in self._runs:
            if run.name == name:
                return run
        raise KeyError(f"there is no run {name!r}; there are {', '.join(run.name for run in self._runs)}")

    def __repr__(self) -> str:
        return f"<DataSet {self.name!r}: {len(self)} runs of robot {self.robot.name!r}>"


def as_robot(robot: Robot | Path) -> Robot:
    """A robot, or the one of a file."""
    return robot if isinstance(robot, Robot) else _core.load_robot(os.fspath(robot))


def as_set(robot: Robot | Path, data: Any, same_robot: bool = False) -> DataSet:
    """What a program gives as data, as runs to be compared with `robot`."""
    if isinstance(data, DataSet):
        if as_robot(robot).to_yaml() == data.robot.to_yaml():
            return data
        # Recorded with another file: by way of a folder, whose reading compares the two.
        with tempfile.TemporaryDirectory(prefix="tendril-") as folder:
            place = os.path.join(folder, "set")
            data.to_folder(place)
            again = DataSet.from_folder(place, robot=robot, same_robot=same_robot)
            return DataSet(again._core.named(data.name or "set", f"{folder}/"))
    if isinstance(data, (str, os.PathLike)):
        return DataSet.from_folder(data, robot=robot, same_robot=same_robot)
    if isinstance(data, Sequence) and all(isinstance(item, (str, os.PathLike)) for item in data):
        return DataSet.from_folder(*data, robot=robot, same_robot=same_robot)
    if hasattr(data, "to_csv") or isinstance(data, Mapping):
        return DataSet.from_dataframe(data, robot)
    raise ValueError(f"data is {type(data).__name__}; give a DataSet, paths, or pandas tables")


@contextlib.contextmanager
def _robot_file(robot: Robot | Path | None) -> Iterator[str]:
    if not isinstance(robot, Robot):
        yield "" if robot is None else os.fspath(robot)
        return
    with tempfile.TemporaryDirectory(prefix="tendril-") as folder:
        file = pathlib.Path(folder) / "robot.yaml"
        file.write_text(robot.to_yaml())
        yield str(file)


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        raise ImportError("tables need pandas; install it: pip install pandas (or 'tendril[data]')") from None
    return pandas


def _written(tables: Mapping[str, Any], folder: pathlib.Path) -> list[str]:
    if not tables:
        raise ValueError("no table is given; give a DataFrame, or DataFrames by the name of their run")
    files = []
    for name, table in tables.items():
        if not hasattr(table, "to_csv"):
            raise ValueError(f"table {name!r} is {type(table).__name__}; give a pandas DataFrame")
        if not name or "/" in name or name.startswith("."):
            raise ValueError(f"a run is called {name!r}; accepted: a file name without folder")
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
    if unknown := runs.keys() - tables.keys():
        raise ValueError(f"runs names {', '.join(sorted(unknown))}; there are only {', '.join(tables)}")
    (folder / "robot.yaml").write_text(robot.to_yaml())
    lines = [f"tracker_frame: {'fit' if fit_frame else 'given'}", "runs:"]
    for name in tables:
        lines.append(f"  - file: {_quoted(name + '.csv')}")
        lines += [f"    {key}: {_quoted(str(value))}" for key, value in runs.get(name, {}).items()]
    (folder / "runs.yaml").write_text("\n".join(lines) + "\n")


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
