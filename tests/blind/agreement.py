# The same torques into Tendril's plant and the foreign one: rms difference of every channel over its noise floor.
# Run as: python -m tests.blind.agreement PLANT_ROWS_PROGRAM [--robot NAME] [--families ...]
import argparse
import subprocess
import sys

import numpy as np
import yaml

from tests.blind import lagrange_plant as lp, make, programs, sensors


def tendril(program, robot_file, targets):
    text = "\n".join(" ".join("%.12g" % x for x in row) for row in targets) + "\n"
    out = subprocess.run([program, str(robot_file)], input=text, capture_output=True, text=True)
    if out.returncode:
        raise RuntimeError(out.stderr.strip())
    rows = np.array([[float(x) for x in line.split()] for line in out.stdout.splitlines()])
    m = targets.shape[1]
    d = rows[:, :4 * m].reshape(len(rows), m, 4)
    from scipy.spatial.transform import Rotation
    R = Rotation.from_quat(np.roll(rows[:, 4 * m + 3:], -1, 1)).as_matrix()
    return dict(t=np.arange(len(rows)) * 1e-3, target=targets, actual=d[:, :, 0], motor=d[:, :, 1], tension=d[:, :, 2],
                base=d[:, :, 3], tip=rows[:, 4 * m:4 * m + 3], R=R)


def main():
    a = argparse.ArgumentParser(prog="python -m tests.blind.agreement")
    a.add_argument("program")
    a.add_argument("--robot", nargs="+", default=["rig_90mm"])
    a.add_argument("--families", nargs="+", default=programs.USUAL + ["sway"])
    a.add_argument("--seconds", type=float, default=1e9)
    a.add_argument("--seed", type=int, default=3)
    a.add_argument("--sub", type=int, default=20)
    a.add_argument("--limit", type=float, help="fail when any channel differs by more floors than this")
    a.add_argument("--mujoco", action="store_true", help="the MuJoCo plant instead of the Lagrangian one")
    a.add_argument("--save", help="keep both sides of every family here (npz)")
    o = a.parse_args()
    worst = 0.0
    print(f"{'robot':9s} {'family':14s} {'seconds':>7s}   rms difference / floor: tension  motor    tip   turn actual"
          "   max tension difference, N   max tip difference, mm")
    for name in o.robot:
        file = make.ROOT / "config" / "robots" / f"{name}.yaml"
        robot = yaml.safe_load(file.read_text())
        controller = programs.Controller(robot)
        rng = np.random.default_rng(o.seed)
        for family in o.families:
            targets = programs.program(family, controller, rng)[:int(o.seconds * 1000)]
            theirs = tendril(o.program, file, targets)
            if o.mujoco:
                from tests.blind import mujoco_plant
                out = mujoco_plant.simulate(lp.nominal(robot), targets)
            else:
                out = lp.simulate(lp.nominal(robot), targets, sub=o.sub)
            ours = sensors.ideal(out, targets, {})
            d = make.difference(ours, theirs)
            worst = max(worst, max(d.values()))
            print(f"{name:9s} {family:14s} {len(targets) / 1000:7.1f}   {'':24s}{d['tension']:7.3f}{d['motor']:7.3f}"
                  f"{d['tip']:7.3f}{d['turn']:7.3f}{d['actual']:7.3f}   "
                  f"{np.abs(ours['tension'] - theirs['tension']).max():12.5f}   "
                  f"{1e3 * np.abs(ours['tip'] - theirs['tip']).max():12.5f}", flush=True)
            if o.save:
                np.savez(f"{o.save}_{name}_{family}.npz", **{"ours_" + k: v for k, v in ours.items()},
                         **{"theirs_" + k: v for k, v in theirs.items()}, ours_base=out["tension_base"])
    if o.limit is not None and worst > o.limit:
        print(f"the plants differ by {worst:.3g} floors; {o.limit:g} allowed", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
