"""Tendril: operate, model, simulate and diagnose tendon-driven continuum robots.

    import tendril

    robot = tendril.load_robot("config/robots/rig_60mm.yaml")
    model = tendril.Model(robot)
    q = model.statics([1.0, 0.5, 0.5])     # tensions [N] -> bends [rad]
    model.fk(q).position                   # tip [m]

    with tendril.Client() as client:       # a running daemon, or `tendril sim`
        client.arm()
        client.send_bending([0.5, 0.0])

All quantities are in SI units: metres, newtons, radians, seconds. Positions are in the base frame F_0, the straight robot
points along +z.
"""

from __future__ import annotations

import atexit as _atexit
import os as _os

from . import _core
from ._arrays import file_name as _file_name
from ._core import Daemon, Robot, Run
from .calibration import Calibration, calibrate
from .client import Client
from .data_set import DataSet
from .diagnosis import diagnose
from .effects import effects
from .errors import ConfigError, DaemonError, Error, ModelError
from .model import Bending, Inverse, InverseTip, Model, Tip
from .report import Report
from .simulation import Motions, simulate, simulate_torques
from .state import Event, State, Statistics
from .tracking import Tracking, track
from .transmission import Capstan, capstan

__version__: str = _core.version()

_atexit.register(_core.await_abandoned)


def load_robot(path: str | _os.PathLike[str]) -> Robot:
    """Reads a robot file (config/robots/*.yaml). Raises `ConfigError` with file, line and key."""
    return _core.load_robot(_file_name("path", path))


def parse_robot(yaml: str, name: str = "robot") -> Robot:
    """A robot from the text of a robot file; `name` stands for the file in errors."""
    return _core.parse_robot(yaml, name)


def load_daemon(path: str | _os.PathLike[str]) -> Daemon:
    """Reads a daemon file (config/tendrild.yaml). Raises `ConfigError` with file, line and key."""
    return _core.load_daemon(_file_name("path", path))


__all__ = [
    "Bending",
    "Calibration",
    "Capstan",
    "Client",
    "ConfigError",
    "Daemon",
    "DaemonError",
    "DataSet",
    "Error",
    "Event",
    "Inverse",
    "InverseTip",
    "Model",
    "ModelError",
    "Motions",
    "Report",
    "Robot",
    "Run",
    "State",
    "Statistics",
    "Tip",
    "Tracking",
    "calibrate",
    "capstan",
    "diagnose",
    "effects",
    "load_daemon",
    "load_robot",
    "parse_robot",
    "simulate",
    "simulate_torques",
    "track",
]
