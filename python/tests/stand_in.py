"""Data sets and replays in plain numpy, until the package has its own."""

import pathlib

import numpy as np

import tendril


class Runs:
    """A data set's robot and runs, read from CSV."""

    class Run:
        pass

    @classmethod
    def from_folder(cls, folder, *, robot=None):
        import yaml

        folder, data = pathlib.Path(folder), cls()
        data.robot = robot or tendril.load_robot(folder / "robot.yaml")
        names = [run["file"] for run in yaml.safe_load((folder / "runs.yaml").read_text())["runs"]]
        data.runs = [cls._read(folder / name, data.robot) for name in names]
        return data

    @classmethod
    def _read(cls, path, robot):
        table = np.genfromtxt(path, delimiter=",", names=True)
        run = cls.Run()
        run.name, run.time = path.stem, table["t_s"]
        groups = {
            "tension": [f"tension_N_{j + 1}" for j in range(robot.tendons)],
            "tip": ["tip_x_m", "tip_y_m", "tip_z_m"],
            "tip_orientation": ["tip_qw", "tip_qx", "tip_qy", "tip_qz"],
            "bending": [f"{c}s_{k + 1}" for k in range(robot.sections) for c in "uv"],
        }
        for attribute, columns in groups.items():
            there = all(c in table.dtype.names for c in columns)
            values = np.stack([table[c] for c in columns], axis=1) if there else None
            setattr(run, attribute, values)
        return run


def replayed_shape(robot, run, times_s):
    """No simulation: the measured arc, a little more bent where the robot has effects."""
    from tendril.view import geometry, robots, sets

    drawn = robots.drawn(robot)
    rows = np.minimum(np.searchsorted(run.time, times_s), len(run.time) - 1)
    bends = geometry.bending_of_tips(drawn, sets.held(run.time, run.tip)[rows])
    return np.array([drawn.spread(row) for row in bends]) * (1.02 if robot.effects else 1.1)


def install():
    """Where the package has none."""
    if not hasattr(tendril, "DataSet"):
        tendril.DataSet, tendril._core.replayed_shape = Runs, replayed_shape
