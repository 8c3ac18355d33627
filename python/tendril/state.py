"""What a daemon tells about itself: its LCM messages as dataclasses, field by field."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np

from ._arrays import Array
from .messages import state_t

DRIVES_OFF = (state_t.MODE_DISCONNECTED, state_t.MODE_CONFIGURED, state_t.MODE_FAULT)
"""Modes in which no drive pulls."""

FIRST_FAULT = 400
"""Status numbers from here on are faults; 0 is none."""

_Message = TypeVar("_Message")


def mirror(kind: type[_Message], message: Any) -> _Message:
    """The dataclass `kind` with the fields of an LCM message: lists of numbers become arrays."""
    values = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        value = getattr(message, field.name)
        is_list = isinstance(value, (list, tuple))
        values[field.name] = np.array(value) if is_list and "Array" in str(field.type) else value
    return kind(**values)


@dataclasses.dataclass(frozen=True, eq=False)
class State:
    """State of robot and controller in a cycle: the fields of LCM's `state_t`, without the counts.

    Bending is (us, vs) = angle (cos, sin) of each section [rad], (2K,); tendon values are in tendon order, (M,), pull
    positive; positions are in the base frame. NaN: not known.
    """

    utime: int
    """Start of the cycle [us since the epoch]; in simulation: simulated time."""
    cycle: int
    """Number of the cycle since the start of the controller."""
    mode: int
    """`tendril.messages.state_t.MODE_...`"""
    mode_text: str
    """The same in words, such as 'running'."""
    status: int
    """Number of the most severe status of this cycle; 0: ok, 400 and above: fault."""
    status_text: str
    """Its meaning."""
    status_remedy: str
    """Remedy; empty when none is needed."""
    reported: Array
    """Numbers of all statuses of this cycle, the most severe first."""
    commands_accepted: int
    """Commands accepted since start."""
    commands_refused: int
    """Commands refused since start."""
    command_sequence: int
    """Sequence number of the last command seen, as sent."""
    command_status: int
    """Reason of the last command's refusal; 0: accepted."""
    command_status_text: str
    """The same in words, with the remedy."""
    target_tip_W_m: Array
    """Commanded tip [m], (3,); NaN when bending or tensions were commanded."""
    target_distance_m: float
    """Distance from there to the nearest reachable point [m]; 0: reachable."""
    bending_target_rad: Array
    """Target of the motion [rad], (2K,)."""
    bending_desired_rad: Array
    """Present reference within the limits of the trajectory [rad], (2K,)."""
    bending_rate_desired_radps: Array
    """Its rate [rad/s], (2K,)."""
    bending_estimate_rad: Array
    """Bending from tendon displacements and tensions [rad], (2K,)."""
    bending_covariance_rad2: Array
    """Covariance of the estimate by the sensors' noise and resolution [rad^2], row by row, (2K * 2K,)."""
    tip_desired_W_m: Array
    """Tip of the desired bending [m], (3,)."""
    tip_estimate_W_m: Array
    """Tip of the estimated bending [m], (3,)."""
    orientation_estimate_WT: Array
    """Unit quaternion w, x, y, z of the tip frame in the base frame, (4,)."""
    tension_desired_base_N: Array
    """Desired tensions at the robot's base, from the model [N], (M,)."""
    tension_desired_motor_N: Array
    """Desired tensions at the motor side, friction compensated [N], (M,)."""
    tension_measured_N: Array
    """Load cells, on their side of the pulleys [N], (M,)."""
    tension_base_estimate_N: Array
    """Tensions at the robot's base, from the load cells [N], (M,)."""
    displacement_desired_m: Array
    """Tendons pulled in since pretension, desired [m], (M,)."""
    displacement_m: Array
    """The same, measured at the spool [m], (M,)."""
    torque_desired_Nm: Array
    """Desired torques at the motor shaft [N m], (M,)."""
    torque_measured_Nm: Array
    """Torques at the motor shaft from the drives' current [N m], (M,)."""

    @property
    def running(self) -> bool:
        """True where targets are taken."""
        return bool(self.mode == state_t.MODE_RUNNING)

    @property
    def faulted(self) -> bool:
        """True in mode fault: `clear()`, then `arm()`."""
        return bool(self.mode == state_t.MODE_FAULT)

    @property
    def disarmed(self) -> bool:
        """True where the drives are disabled, or about to be."""
        return self.mode in (*DRIVES_OFF, state_t.MODE_SAFE_STOP)


@dataclasses.dataclass(frozen=True)
class Event:
    """A single event for operators: the fields of LCM's `event_t`."""

    utime: int
    """When it happened [us since the epoch]; in simulation: simulated time."""
    status: int
    """Status number; 0: information."""
    status_text: str
    """Meaning of the number."""
    source: str
    """Source, for example 'bus', 'gateway', 'daemon'."""
    text: str
    """One line, with the remedy."""


@dataclasses.dataclass(frozen=True, eq=False)
class Statistics:
    """Timing of the loop, drives and bus, once a second: the fields of LCM's `statistics_t`, without the counts.

    Counts are since the daemon's start.
    """

    utime: int
    """[us since the epoch]"""
    cycles: int
    """Cycles run."""
    deadline_misses: int
    """Whole cycles skipped."""
    bin_below_ns: Array
    """Upper edge of each bin of the histograms, exclusive [ns]."""
    wake_latency_counts: Array
    """Cycles in each bin: wake-up less the grid point."""
    compute_counts: Array
    """Cycles in each bin: the controller's step."""
    round_trip_counts: Array
    """Cycles in each bin: SYNC to the last feedback."""
    wake_latency_ns: Array
    """Median, 99 %, 99.9 %, maximum [ns]."""
    compute_ns: Array
    """Median, 99 %, 99.9 %, maximum [ns]."""
    round_trip_ns: Array
    """Median, 99 %, 99.9 %, maximum [ns]."""
    miss_cycle: Array
    """The late cycles, oldest first."""
    miss_skipped: Array
    """Periods skipped before each."""
    miss_cause: list[str]
    """The part of each cycle that took longest."""
    messages_ignored: int
    """LCM messages that could not be decoded."""
    publish_failed: int
    """LCM messages that could not be sent."""
    last_fault_utime: int
    """[us since the epoch]; 0: none since start."""
    last_fault_status: int
    """Status number."""
    last_fault_text: str
    """Its meaning, with tendon and node where it concerns one."""
    can_sent: int
    """Frames."""
    can_received: int
    """Frames."""
    can_send_refused: int
    """The interface's queue was full."""
    can_receive_dropped: int
    """The reader was too slow."""
    can_error_frames: int
    """Error frames of the interface."""
    can_bus_off: int
    """Times that the interface went off the bus."""
    can_malformed: int
    """From a drive's identifier, with invalid length or contents."""
    can_foreign: int
    """That only the daemon may send, from another sender."""
    bus_load: float
    """Of the bit rate, over the last second, 0 to 1."""
    drive_node_id: Array
    """CANopen node id of each drive, (M,)."""
    drive_state: Array
    """`tendril.messages.cycle_t.DRIVE_...` of each drive, (M,)."""
    drive_statusword: Array
    """Object 0x6041, (M,)."""
    drive_error_code: Array
    """Last emergency code; 0: none, (M,)."""
    drive_serial: Array
    """Object 0x1018:04; 0: not read yet, (M,)."""
    drive_age_cycles: Array
    """Age of the feedback [cycles]; 0: arrived in the last cycle, (M,)."""
    drive_worst_age_cycles: Array
    """The same, the worst over the last second, (M,)."""
    voluntary_switches: int
    """Waits of the real-time thread for anything but the bus: should stay 0."""
    involuntary_switches: int
    """Preemption by a higher priority."""
    minor_faults: int
    """Page faults: should stay 0."""
    major_faults: int
    """Page faults from disk."""
