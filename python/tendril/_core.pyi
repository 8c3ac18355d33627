"""
The C++ rooms of Tendril, as the package tendril uses them. Programs import tendril instead.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy
from numpy.typing import NDArray


def version() -> str: ...

def revision() -> str: ...

def await_abandoned() -> None:
    """
    Waits for work that Ctrl-C left behind to end; called when Python ends.
    """

class Robot:
    """
    A robot as its file describes it, in SI units. The base frame is F_0 (world frame W): its origin is the centre of the
    base disk, the straight robot points along +z. Does not change once loaded.
    """

    @property
    def name(self) -> str:
        """Name in the file."""

    @property
    def sections(self) -> int:
        """Number of sections K."""

    @property
    def units(self) -> int:
        """Number of units N, over all sections."""

    @property
    def tendons(self) -> int:
        """Number of tendons M, over all sections."""

    @property
    def section_units(self) -> list[int]:
        """Units of each section, K."""

    @property
    def section_tendons(self) -> list[int]:
        """Tendons that end with each section, K."""

    @property
    def length(self) -> float:
        """Length of the backbone [m]."""

    @property
    def unit_lengths(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C')]:
        """Length of each unit [m], N."""

    @property
    def tendon_angles(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C')]:
        """Angle of each tendon's holes about the disks' z [rad], M."""

    @property
    def tendon_radii(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C')]:
        """Distance of each tendon's holes from the disks' centre [m], M."""

    @property
    def gravity(self) -> Annotated[NDArray[numpy.float64], dict(shape=(3), order='C')]:
        """Gravity in the base frame [m/s^2], 3."""

    @property
    def min_tension(self) -> float:
        """Least tension at the base [N]: limits.min_tension_N."""

    @property
    def max_tension_base(self) -> float:
        """Largest tension at the base [N]: limits.max_tension_base_N."""

    @property
    def max_tension_motor(self) -> float:
        """
        Largest tension at the motor's side of the pulleys [N]: limits.max_tension_motor_N.
        """

    @property
    def max_bending(self) -> float:
        """Largest bend of a section [rad]: limits.max_bending_rad."""

    @property
    def has_actuation(self) -> bool:
        """
        False for a body alone, without motors and drives: good for a model, not to be simulated or diagnosed.
        """

    @property
    def has_tracker(self) -> bool:
        """True where a tracker measures the tip."""

    @property
    def load_cell(self) -> str:
        """Place of the load cells: 'none', 'motor_side' or 'robot_side'."""

    @property
    def effects(self) -> list[str]:
        """
        Effects beyond the nominal model, each as `tendril gap explain` writes them.
        """

    def with_effects(self, effects: Sequence[str]) -> Robot:
        """
        A robot with these effects more, each as a text such as 'backlash where=tendon:2 rad=0.05'. Raises ValueError with
        what is accepted.
        """

    def to_yaml(self) -> str:
        """The resolved file, with every value spelled out."""

    def to_mjcf(self, *, actuators: str | None = None, friction_at: float | None = None, timestep: float | None = None) -> str:
        """
        The robot for MuJoCo, as `tendril model export` writes it. actuators: 'tensions' at the base, or 'motors', the default
        where the robot has them; friction_at: base tension [N] whose losses the constant friction has; timestep [s].
        """

    def to_urdf(self) -> str:
        """
        The kinematic chain with its inertias as URDF; joint angles: `Model.hinge_angles`.
        """

    def __repr__(self) -> str: ...

class Daemon:
    """A daemon's file: bus, controller, channels."""

    @property
    def robot_file(self) -> str:
        """Path of the robot file it names."""

    @property
    def cycle(self) -> float:
        """Time of a control cycle [s]."""

    @property
    def interface(self) -> str:
        """CAN interface, for example 'can0'."""

    @property
    def url(self) -> str:
        """LCM address."""

    @property
    def prefix(self) -> str:
        """Prefix of its LCM channels."""

    @property
    def default_speed(self) -> float:
        """Bending speed of moves that name none [rad/s]."""

    @property
    def max_rate(self) -> float:
        """Largest bending speed of a section [rad/s]."""

    def to_yaml(self) -> str:
        """The resolved file, with every value spelled out."""

    def __repr__(self) -> str: ...

def load_robot(path: str) -> Robot: ...

def parse_robot(yaml: str, name: str) -> Robot: ...

def parse_daemon(yaml: str, name: str) -> Daemon: ...

def load_daemon(path: str) -> Daemon: ...

def capstan_ratio(alpha: float, wrap: float, tension: float, n: float | None, rho: float | None, phi1: float, release: bool, law: str, low_tension: float) -> float: ...

class Model:
    def __init__(self, robot: Robot) -> None: ...

    @property
    def coordinates(self) -> list[str]: ...

    @property
    def disk_count(self) -> int: ...

    def statics(self, tension: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], tip_force: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')] | None) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def frequencies(self, tension: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def forward_dynamics(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], dq: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], tension: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def fk(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def jacobian(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def mass_matrix(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def energy(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], dq: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def backbone(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], points: int) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def hinge_angles(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def disks(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def tendon_points(self, q: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def inverse(self, bending: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], rate: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')] | None, acceleration: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')] | None, min_tension: float, equilibrium: bool) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def inverse_tip(self, tip: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], velocity: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')] | None, acceleration: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')] | None, min_tension: float) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def ik(self, tip: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

    def spread(self, bending: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')]: ...

class Run:
    """
    One measured run with S samples. SI units, pulling positive, motor shaft; NaN: no new value of a slower sensor;
    None: not measured.
    """

    @property
    def name(self) -> str:
        """Name of the run: its file's, without the extension."""

    @property
    def family(self) -> str:
        """Kind of motion: 'triangle', 'circle', ...; 'unknown' where not given."""

    @property
    def repeat_of(self) -> str:
        """Run that this one repeats unchanged, or empty."""

    @property
    def before(self) -> str:
        """Run of the same commands from before the robot changed, or empty."""

    @property
    def sha256(self) -> str:
        """Of the source file; empty for a run that is from none."""

    @property
    def notes(self) -> list[str]:
        """Remarks on the file, one line each."""

    @property
    def warnings(self) -> list[str]:
        """What was dropped or repaired on reading, one line each."""

    @property
    def load_cell(self) -> str:
        """Place of the load cells: 'none', 'motor_side' or 'robot_side'."""

    @property
    def time(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C')]:
        """Time [s], (S,)."""

    @property
    def torque_target(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """Commanded torque at the motor shaft [N m], (S, M)."""

    @property
    def torque_actual(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """Reported torque at the motor shaft [N m], (S, M)."""

    @property
    def motor_position(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """Angle of the motor shaft [rad], (S, M)."""

    @property
    def tension(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """Load cells, on their side of the pulleys [N], (S, M)."""

    @property
    def tip(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """Tip by the tracker, in its frame [m], (S, 3)."""

    @property
    def tip_orientation(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """Orientation of the tip, unit quaternion w, x, y, z, (S, 4)."""

    @property
    def disks(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """
        Centre of every disk in the tracker's frame [m], x, y, z a disk, (S, 3D).
        """

    @property
    def disk_orientations(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """Orientation of every disk, unit quaternion w, x, y, z a disk, (S, 4D)."""

    @property
    def bending(self) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')] | None:
        """us, vs of each section, where the log has it [rad], (S, 2K)."""

    def __repr__(self) -> str: ...

class Set:
    @property
    def name(self) -> str: ...

    @property
    def robot(self) -> Robot: ...

    @property
    def notes(self) -> list[str]: ...

    @property
    def runs(self) -> list[Run]: ...

    def cuts(self) -> str: ...

    def health(self) -> list[str]: ...

    def errors(self) -> list[str]: ...

    def named(self, name: str, folder: str) -> Set: ...

    def with_before(self, before: Set) -> Set: ...

    def write(self, folder: str, overwrite: bool) -> None: ...

def load_set(paths: Sequence[str], robot_file: str, same_robot: bool) -> Set: ...

def import_tables(map: str, tables: Sequence[str], robot: Robot) -> Set: ...

def table_of(run: Run) -> tuple[list[str], Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')]]: ...

def simulate(robot: Robot, effects: Sequence[str], set: str, plan: str | None, daemon: str, seed: int, repeats: int | None, noise: bool, load_cell: str | None, tracker: bool, jobs: int, progress: object | None) -> tuple[Set, list[str]]: ...

def simulate_torques(robot: Robot, effects: Sequence[Sequence[str]], torque_Nm: Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], step_s: float, tolerance: float, jobs: int, progress: object | None) -> tuple[Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='C')], list[str]]: ...

def families() -> list[str]: ...

class Diagnosis:
    def json(self) -> str: ...

    def page(self) -> str: ...

    def summary(self) -> str: ...

    def write(self, folder: str) -> None: ...

    def corrected(self, robot: Robot) -> Robot: ...

class Calibration:
    def json(self) -> str: ...

    def text(self) -> str: ...

    @property
    def robot(self) -> Robot: ...

def calibrate(set: Set, seed: int, threads: int, progress: object | None) -> Calibration: ...

def posture_states(set: Set) -> int | None: ...

least_posture_states: int = 40

def track(set: Set, delta_N: float, delta_m: float, seed: int, threads: int, discrepancy: Mapping[str, float], progress: object | None) -> str: ...

def report_style() -> str: ...

def read_report(file: str) -> Diagnosis: ...

def effect_names() -> list[str]: ...

def diagnose(set: Set, delta_N: float, delta_m: float, seed: int, only: Sequence[str], without: Sequence[str], refits: int, threads: int, next: bool, daemon: str, progress: object | None) -> Diagnosis: ...

class LogMessages:
    """The messages of an LCM log in the order of the file, past damage."""

    def __init__(self, path: str) -> None: ...

    def next(self, most: int) -> list[tuple[str, str, int, bytes]]:
        """
        Channel, type ('' where it is none of this version), stamp [us] and bytes of up to `most` messages; empty at the end.
        """

    @property
    def size(self) -> int:
        """Bytes of the file."""

    @property
    def position(self) -> int:
        """Bytes of it before the last message."""

    def damage(self) -> str:
        """Damaged places by their bytes, in one line; empty: none."""

def message_type(data: bytes) -> str:
    """
    Type of lcm_types that the bytes are exactly one message of; '' where they are none of this version.
    """

def is_channel_of_tendril(channel: str) -> bool:
    """Whether a channel is named as Tendril names its own."""

def replayed_shape(robot: Robot, run: Run, times: Annotated[NDArray[numpy.float64], dict(shape=(None,), order='C')]) -> Annotated[NDArray[numpy.float64], dict(shape=(None, None), order='F')]: ...

def sender() -> int:
    """Sender number of this process's commands."""

class MotionRequest:
    def __init__(self) -> None: ...

    @property
    def kind(self) -> str: ...

    @kind.setter
    def kind(self, arg: str, /) -> None: ...

    @property
    def tips(self) -> list[str]: ...

    @tips.setter
    def tips(self, arg: Sequence[str], /) -> None: ...

    @property
    def bends(self) -> list[str]: ...

    @bends.setter
    def bends(self, arg: Sequence[str], /) -> None: ...

    @property
    def points(self) -> str: ...

    @points.setter
    def points(self, arg: str, /) -> None: ...

    @property
    def nearest(self) -> bool: ...

    @nearest.setter
    def nearest(self, arg: bool, /) -> None: ...

    @property
    def stretch(self) -> float: ...

    @stretch.setter
    def stretch(self, arg: float, /) -> None: ...

    @property
    def speed(self) -> float: ...

    @speed.setter
    def speed(self, arg: float, /) -> None: ...

    @property
    def acceleration(self) -> float: ...

    @acceleration.setter
    def acceleration(self, arg: float, /) -> None: ...

    @property
    def jerk(self) -> float: ...

    @jerk.setter
    def jerk(self, arg: float, /) -> None: ...

class Client:
    def __init__(self, url: str, prefix: str) -> None: ...

    def state(self, max_age: float, timeout: float) -> tuple[int, bytes] | None: ...

    def next(self, after: int, timeout: float) -> tuple[int, bytes] | None: ...

    def events(self) -> list[bytes]: ...

    def statistics(self) -> bytes | None: ...

    def run(self, timeout: float) -> bytes | None: ...

    def nobody_answers(self, within: float) -> str: ...

    def mode(self, request: str, timeout: float, waiting: object | None) -> str: ...

    def tip(self, tip: Sequence[float], velocity: Sequence[float], speed: float, valid_for: float, timeout: float) -> str: ...

    def bending(self, bending: Sequence[float], rate: Sequence[float], speed: float, valid_for: float, timeout: float) -> str: ...

    def tension(self, tension: Sequence[float], valid_for: float, timeout: float) -> str: ...

    def follow(self, request: MotionRequest, robot_file: str, progress: object | None) -> str: ...

    def close(self) -> None: ...

    def leave_to_parent(self) -> None: ...

    @property
    def closed(self) -> bool: ...

    @property
    def url(self) -> str: ...

    @property
    def prefix(self) -> str: ...

def status_text(number: int) -> str:
    """Meaning of a status number."""

def status_remedy(number: int) -> str:
    """What to do about it; empty where nothing is needed."""

def drive_state_text(state: int) -> str:
    """A drive's state (cycle_t.DRIVE_...) in words."""

def drive_error_text(daemon: Daemon, node_id: int, code: int) -> str | None:
    """
    What an emergency code means to the drive at a node of this daemon; None for another node.
    """

def accepted_in(mode: int, command: str) -> bool:
    """
    Whether the daemon's gate accepts 'arm', 'disarm', 'hold', 'clear' or a 'target' in a mode (state_t.MODE_...).
    """
