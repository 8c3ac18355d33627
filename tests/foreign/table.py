"""What a laboratory has of a position-controlled robot: a table of motor angles and marker positions before and after,
the map of its columns, and a robot file of which it knows some numbers to a few per cent and others not at all.

What is written wrongly, and by how much, is drawn here; the robot itself is not changed by it."""

import csv
import math

import numpy as np
import yaml

from tests.foreign import draw

COUNTS = 4096  # of an encoder, a turn of the spool
UNKNOWN = math.log(2)  # numbers that nobody knows are in the file within a factor of two


def rotation(vector):
    """Matrix of a rotation vector."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def rotation_vector(R):
    """Of a rotation by less than half a turn."""
    angle = math.acos(min(1.0, max(-1.0, (np.trace(R) - 1) / 2)))
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return axis * (0.5 if angle < 1e-9 else angle / (2 * math.sin(angle)))


def laboratory(robot, rng):
    """Where its tracker stands, what it believes of that, its markers and their noise. `frame` as the column map says
    it."""
    length = sum(s["length_m"] for s in robot["sections"])
    frame = str(rng.choice(["given", "fit"]))
    turned, shifted = (0.01, 0.004) if frame == "given" else (0.15, 0.08)  # rad, and of the length
    ends = list(np.cumsum([s["disks"] for s in robot["sections"]]))
    others = [d for d in range(1, ends[-1]) if d not in ends]
    more = sorted(rng.permutation(others)[: int(rng.integers(0, 3))]) if others else []
    return dict(
        frame=frame,
        noise_m=draw.log_uniform(rng, 1e-4, 5e-4),
        disks=sorted(int(d) for d in {*ends, *more}),
        turn_rad=list(rng.uniform(-1.2, 1.2, 3)),
        shift_m=list(rng.uniform(-1, 1, 3)),
        turn_error_rad=list(rng.normal(0, turned, 3)),
        shift_error_m=list(rng.normal(0, shifted * length, 3)),
        robot_file=robot_file(robot, rng),
    )


def write_runs(path, lab, angles, disks_m, rng):
    """A row a second: angles of the motors in degrees as encoders count them, markers in millimetres in the tracker's
    frame."""
    seen = disks_m[:, [d - 1 for d in lab["disks"]]] @ rotation(lab["turn_rad"]).T + np.array(lab["shift_m"])
    seen = seen + rng.normal(0, lab["noise_m"], seen.shape)
    counted = np.round(np.degrees(angles) / 360 * COUNTS) * 360 / COUNTS
    with open(path, "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(
            ["t", *(f"m{j + 1}" for j in range(angles.shape[1])), *(f"{a}{d}" for d in lab["disks"] for a in "xyz")]
        )
        for row, (motors, markers) in enumerate(zip(counted, seen)):
            out.writerow([row, *(f"{x:.4f}" for x in motors), *(f"{1e3 * x:.3f}" for x in markers.ravel())])


def column_map(robot, lab):
    """From the tracker's frame to the base's, as far as the laboratory knows it; motors by tendon, a pair's twice."""
    motors = draw.motors_of(robot)
    R = rotation(lab["turn_error_rad"]) @ rotation(lab["turn_rad"]).T
    offset = np.array(lab["shift_error_m"]) - R @ np.array(lab["shift_m"])
    named = {d: [f"{a}{d}" for a in "xyz"] for d in lab["disks"]}
    tip = named.pop(lab["disks"][-1])
    columns = dict(
        motor_position=dict(
            names=[f"m{m + 1}" for m, _ in motors], sign=[s for _, s in motors], unit="deg", at="spool"
        ),
        tip=dict(names=tip, unit="mm"),
    )
    if named:
        columns["disks"] = {"unit": "mm", **named}
    return dict(
        time=dict(column="t", unit="s"),
        runs=dict(family="postures", load_cell="none"),
        columns=columns,
        frame=dict(
            rotation_rad=[float(x) for x in rotation_vector(R)],
            offset_m=[float(x) for x in offset],
            origin=lab["frame"],
        ),
    )


def angle(rad):
    """Within half a turn."""
    return float((rad + math.pi) % (2 * math.pi) - math.pi)


def known(value, percent, rng):
    """A number of the file that is off by about what it says of itself."""
    off = percent / 100 * float(np.clip(rng.normal(), -1.5, 1.5))
    return dict(value=float(value * math.exp(off)), within=f"{percent} %")


def unknown(value, rng):
    return dict(value=float(value * math.exp(rng.uniform(-UNKNOWN, UNKNOWN))), within="unknown")


def robot_file(robot, rng):
    """As the laboratory would write it: each number with what it believes of its error, and off by about that much."""
    loose = int(rng.choice([20, 30, 40, 50]))
    sections = [section(robot, k, loose, rng) for k in range(len(robot["sections"]))]
    gravity = [float(x) for x in draw.GRAVITY[robot["mount"]]]
    spool, tendon = known(robot["spool_radius_m"], 3, rng), unknown(robot["tendon_stiffness_Npm"], rng)
    return dict(
        name="foreign",
        body=dict(gravity_W_mps2=gravity, sections=sections),
        limits=limits(robot, rng),
        actuation=actuation(spool, tendon),
    )


def section(robot, k, loose, rng):
    s, rod = robot["sections"][k], draw.rods(robot)[k]
    unit = s["length_m"] / s["disks"] / 2
    return dict(
        units=2 * s["disks"],
        units_per_disk=2,
        strains=["bending", "torsion", "extension"],
        unit_length_m=known(unit, 3, rng),
        unit_mass_kg=known(rod["mass_kgpm"] * unit, loose, rng),
        disk_mass_kg=known(robot["disk_mass_kg"], loose, rng),
        disk_diameter_m=float(2.3 * s["holes"][0][1]),
        youngs_modulus_Pa=unknown(s["youngs_modulus_Pa"], rng),
        torsional_stiffness_Nm2=unknown(rod["torsion_Nm2"], rng),
        axial_stiffness_N=unknown(rod["axial_N"], rng),
        core_radius_m=float(robot["rod_radius_m"]),
        bending_damping_Nms=1e-3,
        tendons=[hole(at, lever, rng) for at, lever in s["holes"]],
    )


def hole(at, lever, rng):
    written = angle(at + np.clip(rng.normal(0, 0.03), -0.05, 0.05))
    return dict(angle_rad=dict(value=written, within=0.03), radius_m=known(lever, 3, rng))


def limits(robot, rng):
    """The least tension is the laboratory's guess of that at home."""
    home = robot["home_m"][0] * robot["tendon_stiffness_Npm"] * math.exp(rng.uniform(-UNKNOWN, UNKNOWN))
    most = max(60.0, 20 * home)
    return dict(
        min_tension_N=float(home), max_tension_base_N=float(most), max_tension_motor_N=float(most), max_bending_rad=2.5
    )


def actuation(spool, tendon):
    """Servos without a reading of torque: only encoder, spool and tendon matter, the rest is within reason."""
    return dict(
        motor=dict(
            torque_constant_NmpA=1.0,
            nominal_current_A=1.0,
            rotor_inertia_kgm2=1e-4,
            coulomb_friction_Nm=0.01,
            coulomb_angle_rad=0.01,
            coulomb_damping_Nms=1e-6,
            viscous_friction_Nms=1e-4,
            torque_lag_s=0.001,
        ),
        drive=dict(
            rated_torque_Nm=1.0, current_limit_A=1.0, encoder_counts_per_turn=COUNTS, actual_torque_noise_permille=1.0
        ),
        gear=dict(ratio=1.0, efficiency=1.0, presliding_yields_rad=[0.005]),
        spool=dict(radius_m=spool),
        tendon=dict(stiffness_Npm=tendon, damping_Nspm=10.0, free_length_m=0.2),
        transmission=dict(pulleys=[], presliding_m=5e-5, low_tension_N=0.05),
        load_cell=dict(place="none"),
        tracker=dict(rate_Hz=1.0, position_noise_m=2e-4, orientation_noise_rad=0.0, delay_s=0.0),
    )


def write_yaml(path, content, title):
    with open(path, "w") as file:
        file.write(f"# {title}\n")
        yaml.safe_dump(content, file, sort_keys=False, default_flow_style=None, width=120)
