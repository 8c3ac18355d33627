# What the rig's sensors make of the plant's signals: noise, steps of quantisation, clocks; and the files of a data set.
# Knows nothing of what was planted beyond the sensors' own faults, which it is handed.
import shutil
from pathlib import Path

import numpy as np

from tests.blind import lagrange_plant as lp

NOMINAL = dict(cell_gain=1.0, cell_offset_N=0.0, cell_drift_Nps=0.0, cell_cross=0.0, cell_tau_s=0.0,
               encoder_offset_rad=0.0, tracker_rotation_rad=(0.0, 0.0, 0.0), tracker_offset_m=(0.0, 0.0, 0.0),
               tracker_delay_s=0.0, magnetic=0.0, jitter_s=3e-6, lost=0.0, colour=0.0)


def rotation(v):
    v = np.asarray(v, float)
    a = np.linalg.norm(v)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    if a < 1e-12:
        return np.eye(3) + K
    return np.eye(3) + np.sin(a) / a * K + (1 - np.cos(a)) / a ** 2 * K @ K


def quaternion(R):
    """w, x, y, z of many rotations (S x 3 x 3), w >= 0."""
    from scipy.spatial.transform import Rotation
    q = Rotation.from_matrix(R).as_quat()
    q = np.concatenate([q[:, 3:], q[:, :3]], 1)
    return q * np.where(q[:, :1] < 0, -1, 1)


def noise(rng, shape, colour):
    """White of unit variance; `colour` in [0, 1) is a first-order filter's pole, the variance kept."""
    w = rng.standard_normal(shape)
    if colour == 0:
        return w
    from scipy.signal import lfilter
    return lfilter([np.sqrt(1 - colour ** 2)], [1, -colour], w, axis=0)


def ideal(out, targets, faults, load_cell="motor_side"):
    """What perfect sensors with the given faults would show: dict of S x ... arrays."""
    f = dict(NOMINAL, **faults)
    S, m = targets.shape
    t = np.arange(S) * 1e-3

    def per(value):
        return np.broadcast_to(np.asarray(value, float), (m,))

    side = out["tension_motor"] if load_cell == "motor_side" else out["tension_base"]
    cell = side * per(f["cell_gain"]) + per(f["cell_offset_N"]) + per(f["cell_drift_Nps"]) * t[:, None]
    cell = cell + f["cell_cross"] * np.roll(side, -1, 1)
    tip, R = out["tip"], out["rotation"]
    if f["tracker_delay_s"]:
        lag = t - f["tracker_delay_s"]
        tip = np.stack([np.interp(lag, t, tip[:, k]) for k in range(3)], 1)
        k = np.clip(np.round(lag / 1e-3).astype(int), 0, S - 1)
        R = R[k]
    Rt = rotation(f["tracker_rotation_rad"])
    tip = tip @ Rt.T + np.asarray(f["tracker_offset_m"], float)
    R = Rt @ R
    if f["magnetic"]:  # a field bent by iron nearby: displaces by the square of the distance from the coil's centre
        d = tip - np.array([0.03, 0.02, 0.06])
        tip = tip + f["magnetic"] * d * np.linalg.norm(d, axis=1, keepdims=True) / 0.05
    return dict(t=t, target=targets, actual=out["torque"], motor=out["motor_position"] + per(f["encoder_offset_rad"]),
                tension=cell, tip=tip, R=R)


def sample(robot, ideal_signals, faults, seed):
    """Rows as logged: noise, quantisation, clock."""
    f = dict(NOMINAL, **faults)
    rng = np.random.default_rng(seed)
    robot = lp.numbers(robot)
    a = robot["actuation"]
    s = ideal_signals
    S, m = s["target"].shape
    permille = a["drive"]["rated_torque_Nm"] / 1000
    actual = s["actual"] / permille + a["drive"]["actual_torque_noise_permille"] * noise(rng, (S, m), 0)
    count = 2 * np.pi / a["drive"]["encoder_counts_per_turn"]
    step = a["load_cell"]["resolution_V"] / a["load_cell"]["gain_VpN"]
    cell = s["tension"] + a["load_cell"]["noise_N"] * noise(rng, (S, m), f["colour"])
    every = int(round(1000 / a["tracker"]["rate_Hz"]))
    k = np.arange(0, S, every)
    tip = s["tip"][k] + a["tracker"]["position_noise_m"] * noise(rng, (len(k), 3), f["colour"])
    turn = a["tracker"]["orientation_noise_rad"] * noise(rng, (len(k), 3), f["colour"])
    R = np.array([rotation(v) for v in turn]) @ s["R"][k]
    keep = rng.random(len(k)) >= f["lost"]
    return dict(t=s["t"] + f["jitter_s"] * rng.standard_normal(S), target=s["target"], actual=np.round(actual) * permille,
                motor=np.round(s["motor"] / count) * count, tension=np.round(cell / step) * step,
                tip=tip[keep], quat=quaternion(R)[keep], at=k[keep],
                rows=np.flatnonzero(rng.random(S) >= 0.1 * f["lost"]))


def write_run(path, rows, tracker=True, cell=True):
    m = rows["target"].shape[1]
    names = ["t_s"]
    blocks = [["%.7f" % x for x in rows["t"]]]
    columns = [("torque_target_Nm", "target", "%.9f"), ("torque_actual_Nm", "actual", "%.9f"),
               ("motor_position_rad", "motor", "%.7f")]
    if cell:
        columns.append(("tension_N", "tension", "%.4f"))
    for name, key, form in columns:
        for j in range(m):
            names.append(f"{name}_{j + 1}")
            blocks.append([form % x for x in rows[key][:, j]])
    lines = [",".join(r) for r in zip(*blocks)]
    if tracker:
        names += ["tip_x_m", "tip_y_m", "tip_z_m", "tip_qw", "tip_qx", "tip_qy", "tip_qz"]
        tail = dict(zip(rows["at"], ("%.7f,%.7f,%.7f,%.8f,%.8f,%.8f,%.8f" % tuple(np.r_[p, q])
                                     for p, q in zip(rows["tip"], rows["quat"]))))
        lines = [line + "," + tail.get(k, ",,,,,,") for k, line in enumerate(lines)]
    with open(path, "w") as file:
        file.write(",".join(names) + "\n" + "\n".join(lines[k] for k in rows["rows"]) + "\n")


def write_set(folder, robot_file, runs, load_cell):
    """runs: list of (name, family, repeat_of or None, rows)."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(robot_file, folder / "robot.yaml")
    with open(folder / "runs.yaml", "w") as file:
        file.write("runs:\n")
        for name, family, repeat, _ in runs:
            file.write(f"  - {{file: {name}, family: {family}, repeat_of: {repeat or 'none'}, load_cell: {load_cell}}}\n")
