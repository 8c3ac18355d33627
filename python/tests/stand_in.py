"""A model of the body in plain numpy, from the equations of docs/explanation/model.md: what the view is drawn from
where the package's own is not built, and what its geometry is compared with."""

import numpy as np


class ConstantCurvature:
    """backbone, disks and tendon_points of one chain of constant-curvature units."""

    def __init__(self, units, unit_length_m, hole_angle_rad, hole_radius_m, tendon_sections=None):
        self.units, self.length_m = units, unit_length_m
        self.holes = [(a, hole_radius_m) for a in hole_angle_rad]
        sections = tendon_sections or [len(units)] * len(self.holes)
        self.last = [sum(units[:s]) for s in sections]

    def _along(self, q, fraction_points):
        """Poses at the base and after each n-th of every unit."""
        pose, found = np.eye(4), [np.eye(4)]
        for u, v in q.reshape(-1, 2):
            start = pose
            for part in np.arange(1, fraction_points + 1) / fraction_points:
                pose = start @ self._arc(part * u, part * v, part * self.length_m)
                found.append(pose)
        return np.array(found)

    @staticmethod
    def _arc(u, v, length):
        theta = np.hypot(u, v)
        c, s = (u / theta, v / theta) if theta > 0 else (1.0, 0.0)
        a, b = np.cos(theta), np.sin(theta)
        pose = np.eye(4)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        pose[:3, :3] = turn @ np.array([[a, 0, b], [0, 1, 0], [-b, 0, a]]) @ turn.T
        k = (1 - a) / theta if theta > 1e-9 else theta / 2
        h = b / theta if theta > 1e-9 else 1.0
        pose[:3, 3] = length * np.array([k * c, k * s, h])
        return pose

    def backbone(self, q, points=100):
        q = np.asarray(q, dtype=float)
        if q.ndim == 2:
            return np.array([self.backbone(row, points) for row in q])
        return self._along(q, (points - 1) // sum(self.units))[:, :3, 3]

    def disks(self, q):
        q = np.asarray(q, dtype=float)
        return np.array([self.disks(row) for row in q]) if q.ndim == 2 else self._along(q, 1)

    def tendon_points(self, q):
        poses = self._along(np.asarray(q, dtype=float), 1)
        lines = np.full((len(self.holes), len(poses), 3), np.nan)
        for line, (angle, radius), last in zip(lines, self.holes, self.last):
            hole = np.array([radius * np.cos(angle), radius * np.sin(angle), 0, 1])
            line[: last + 1] = (poses[: last + 1] @ hole)[:, :3]
        return lines


class Robot:
    """What the view asks of a robot."""

    def __init__(self, yaml, name="robot"):
        from yaml import YAMLError, safe_load

        try:
            text = safe_load(yaml)
            sections = text["body"]["sections"]
            limits = text["limits"]
        except (TypeError, KeyError, YAMLError) as e:
            raise ValueError(f"{name}: not a robot file ({e})") from None
        self.name, self.effects = text["name"], []
        self.section_units = [s["units"] for s in sections]
        self.units = sum(self.section_units)
        self.unit_length = float(sections[0]["unit_length_m"])
        self.length = sum(s["units"] * float(s["unit_length_m"]) for s in sections)
        holes = [(k + 1, t) for k, s in enumerate(sections) for t in s["tendons"]]
        self.tendons = len(holes)
        self.tendon_sections = [k for k, _ in holes]
        self.tendon_angles = [float(t["angle_rad"]) for _, t in holes]
        self.tendon_radii = [float(t["radius_m"]) for _, t in holes]
        self.gravity = text["body"].get("gravity_W_mps2", [0, 0, -9.81])
        self.load_cell = "motor_side"
        self.min_tension = float(limits["min_tension_N"])
        self.max_tension_base = float(limits["max_tension_base_N"])
        self.max_tension_motor = float(limits["max_tension_motor_N"])

    @classmethod
    def load(cls, path):
        with open(path, encoding="utf-8") as file:
            return cls(file.read(), path)

    def with_effects(self, effects):
        import copy

        other = copy.copy(self)
        other.effects = list(effects)
        return other


class Model(ConstantCurvature):
    def __init__(self, robot):
        super().__init__(
            robot.section_units,
            robot.unit_length,
            robot.tendon_angles,
            robot.tendon_radii[0],
            robot.tendon_sections,
        )


class Runs:
    """A data set's robot and runs, read from CSV as the package does."""

    class Run:
        pass

    @classmethod
    def from_folder(cls, folder, robot=None):
        import pathlib

        import yaml

        folder, data = pathlib.Path(folder), cls()
        data.robot = robot or Robot.load(folder / "robot.yaml")
        names = [run["file"] for run in yaml.safe_load((folder / "runs.yaml").read_text())["runs"]]
        data.runs = [cls._read(folder / name, data.robot) for name in names]
        return data

    @classmethod
    def _read(cls, path, robot):
        table = np.genfromtxt(path, delimiter=",", names=True)
        run = cls.Run()
        run.name, run.time_s = path.stem, table["t_s"]
        groups = {
            "tension_N": [f"tension_N_{j + 1}" for j in range(robot.tendons)],
            "tip_m": ["tip_x_m", "tip_y_m", "tip_z_m"],
            "tip_quaternion": ["tip_qw", "tip_qx", "tip_qy", "tip_qz"],
            "bending_rad": [f"{c}s_{k + 1}" for k in range(len(robot.section_units)) for c in "uv"],
        }
        for attribute, columns in groups.items():
            there = all(c in table.dtype.names for c in columns)
            setattr(
                run, attribute, np.stack([table[c] for c in columns], axis=1) if there else np.zeros((0, 0))
            )
        return run


def replay_motion(robot, run, times_s):
    """No simulation: the measured arc, a little more bent where the robot has effects."""
    from tendril.view import geometry, robots, sets

    drawn = robots.drawn(robot)
    rows = np.minimum(np.searchsorted(run.time_s - run.time_s[0], times_s), len(run.time_s) - 1)
    bends = geometry.bending_of_tips(drawn, sets.held(run.time_s, run.tip_m)[rows])
    return np.array([drawn.spread(row) for row in bends]) * (1.02 if robot.effects else 1.1)


def install():
    """Where the package is not built."""
    import sys

    import tendril

    import view_help

    if not hasattr(tendril, "Model"):
        tendril.load_robot, tendril.parse_robot, tendril.Model, tendril.DataSet = (
            Robot.load,
            Robot,
            Model,
            Runs,
        )
        tendril.replay_motion = replay_motion
        tendril.messages = sys.modules["tendril.messages"] = view_help.generated_messages()
