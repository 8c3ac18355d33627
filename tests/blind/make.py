# Writes a data set of the foreign rig with something planted in it, and the truth apart from it.
# Run as: python -m tests.blind.make --effect NAME[:where] --sigma S --seed N --out DIR --truth FILE
import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
import yaml

from tests.blind import effects, lagrange_plant as lp, programs, sensors
from tests.blind.seal import Wrong, digest

ROOT = Path(__file__).resolve().parents[2]
SCATTER_NM = 3e-6  # 1.5 % of the motors' Coulomb friction, below 2 Hz: what makes identical runs differ
# rms of one sample with the nominal sensors: the cell's noise and step, the tracker, one count of the encoder, the torque
SENSORS = dict(tension=np.hypot(5e-3, 5e-3 / np.sqrt(12)), motor=2 * np.pi / 2048 / np.sqrt(12), tip=5e-5, turn=5e-4,
             actual=7.056e-6 * np.hypot(0.3, 1 / np.sqrt(12)))


def where_indices(effect, where, p):
    m, n = len(p["t"]), len(p["u"])
    count = dict(tendon=m, unit=n, robot=n)[effect.scope]
    if where in ("all", ""):
        return list(range(m if effect.scope == "tendon" else n))
    what, _, number = where.partition(":")
    if what != effect.scope or not number.isdigit() or not 1 <= int(number) <= count or effect.scope == "robot":
        raise Wrong(f"{effect.name}: where '{where}'; accepted are all" +
                    (f" and {effect.scope}:1..{count}" if effect.scope != "robot" else ""))
    return [int(number) - 1]


def planted(robot, items, seed, nuisance=0.0):
    """Plant, sensors' faults and truth of a list of (name, where, amount); nuisance: rms of the log by which the
    lengths are off over which friction turns round."""
    p = lp.nominal(robot)
    if nuisance:
        rng = np.random.default_rng([seed, 78])
        for name in ("presliding", "coulomb_angle", "gear_y1", "gear_y2"):
            p["t"][:, lp.T[name]] *= np.exp(nuisance * rng.standard_normal())
    faults, truth = {}, []
    for k, (name, where, amount) in enumerate(items):
        e = effects.LIST[name]
        p.pop("truth_extra", None)
        e.plant(p, faults, where_indices(e, where, p), amount, np.random.default_rng([seed, 77, k]))
        truth.append(dict(effect=name, where=where, kind=e.kind, cut=e.cut, amount=amount, law=e.law, near=e.near,
                          parameters={**e.truth(amount), **{k2: float(v) for k2, v in p.get("truth_extra", {}).items()}}))
    return p, faults, truth


def coloured(rng, S, width, hz):
    """S x width of unit variance, first order below hz, silent in the still half second and faded in after it."""
    from scipy.signal import lfilter
    a = np.exp(-2 * np.pi * hz * 1e-3)
    w = rng.standard_normal((S + 2000, width))
    f = lfilter([np.sqrt(1 - a * a)], [1, -a], w, axis=0)[2000:]
    return f * np.clip((np.arange(S) - 500) / 500, 0, 1)[:, None]


def disturbance(p, S, scatter_Nm, seed):
    """What no two runs have in common: torque of brushes and gears, and what is planted as gusts."""
    m = len(p["t"])
    f = np.zeros((S, 3 + m))
    f[:, 3:] = scatter_Nm * coloured(np.random.default_rng([*seed, 0]), S, m, 2.0)
    if p.get("gust_N"):
        f[:, :3] = p["gust_N"] * coloured(np.random.default_rng([*seed, 1]), S, 3, 0.7)
    return f


# What the MuJoCo plant has a law for; sensors' faults come on top of either plant.
MUJOCO = set("torque_constant gear_efficiency motor_viscous capstan_alpha capstan_n wrap_angle presliding tendon_stiffness "
             "bending_stiffness unit_stiffness bending_damping hole_radius hole_angle torsion unit_length unit_mass "
             "precurvature tip_payload base_tilt torque_saturation free_chain".split())


def outputs(robot, p, faults, targets, load_cell, sub=10, scatter_Nm=0.0, seed=(0,), plant="lagrange"):
    force = disturbance(p, len(targets), scatter_Nm, seed)
    if plant == "mujoco":
        from tests.blind import mujoco_plant
        o = mujoco_plant.simulate(p, targets, force[:, 3:], tied=not p.get("free_chain"))
    else:
        o = lp.simulate(p, targets, force, sub=sub)
    return sensors.ideal(o, targets, faults, load_cell)


def difference(a, b, floor=None):
    """rms over each channel's floor, by channel; the worst tendon or axis. Without a floor: over the sensors' noise."""
    f = floor or SENSORS
    out = {}
    for key in ("tension", "motor", "actual"):
        out[key] = float(np.sqrt(np.mean((a[key] - b[key]) ** 2, 0)).max() / f[key])
    k = slice(0, None, 10)
    out["tip"] = float(np.sqrt(np.mean((a["tip"][k] - b["tip"][k]) ** 2, 0)).max() / f["tip"])
    D = np.einsum("sij,skj->sik", a["R"][k], b["R"][k])
    turn = 0.5 * np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], 1)
    out["turn"] = float(np.sqrt(np.mean(turn ** 2, 0)).max() / f["turn"])
    return out


def pooled(pairs, floor=None):
    total = {}
    for a, b in pairs:
        for key, v in difference(a, b, floor).items():
            total[key] = total.get(key, 0.0) + v * v / len(pairs)
    return {key: float(np.sqrt(v)) for key, v in total.items()}


def size_of(robot, name, where, amount, seed, short, load_cell):
    """sigma of a planted effect on the short runs, the channel that sees most of it, and all channels."""
    targets, reference, floor = short
    p, faults, _ = planted(robot, [(name, where, amount)], seed)
    total = pooled([(outputs(robot, p, faults, t, load_cell, 8, seed=(1, k)), r)
                    for k, (t, r) in enumerate(zip(targets, reference))], floor)
    best = max(total, key=total.get)
    return total[best] if np.isfinite(total[best]) else np.inf, best, total


def size_of_chain(robot, families, load_cell):
    """sigma of MuJoCo's untied chain against its tied one, and the channel."""
    targets, _, floor = short_runs(robot, families, load_cell)
    plants = [planted(robot, items, 0)[0] for items in ([("free_chain", "all", 1.0)], [])]
    total = pooled([[outputs(robot, p, {}, t, load_cell, 8, plant="mujoco") for p in plants] for t in targets], floor)
    best = max(total, key=total.get)
    return total[best], best


def small_nuisance(robot, seed, load_cell, most_sigma=0.1, most=0.2):
    """(nuisance, sigma): off by a fifth, or by so much less that no channel changes by more than most_sigma floors."""
    nuisance, size = most, nuisance_size(robot, seed, load_cell, most)
    while size > most_sigma:
        nuisance *= 0.9 * most_sigma / size
        size = nuisance_size(robot, seed, load_cell, nuisance)
    return nuisance, size


def nuisance_size(robot, seed, load_cell, nuisance):
    """sigma of micro-constants that are off, in the channel that sees most of it."""
    targets, reference, floor = short_runs(robot, ["triangle", "steps"], load_cell)
    p, _, _ = planted(robot, [], seed, nuisance)
    return max(pooled([(outputs(robot, p, {}, t, load_cell, 8, seed=(1, k)), r)
                       for k, (t, r) in enumerate(zip(targets, reference))], floor).values())


_short = {}


def short_runs(robot, families, load_cell):
    """Targets that show an effect, what the nominal rig does with them, and the floor: the sensors' noise and half the
    mean square by which two identical runs differ."""
    key = (robot["name"], tuple(families), load_cell)
    if key not in _short:
        c = programs.Controller(robot)
        rng = np.random.default_rng(4711)
        targets = [programs.program(f, c, rng)[:10000 if f != "hold" else 16000] for f in families]
        p = lp.nominal(robot)
        reference = [outputs(robot, p, {}, t, load_cell, 8) for t in targets]
        again = [outputs(robot, p, {}, t, load_cell, 8, SCATTER_NM, (9, k)) for k, t in enumerate(targets)]
        scatter = pooled(list(zip(again, reference)))  # both runs scatter: the difference of one from none is half
        _short[key] = targets, reference, {k: SENSORS[k] * float(np.hypot(1, scatter[k])) for k in SENSORS}
    return _short[key]


def amount_for(robot, name, where, sigma, seed, sign, load_cell="motor_side"):
    """The amount whose rms change in the most affected channel is sigma floors, on short runs that show it."""
    e = effects.LIST[name]
    if name == "free_chain":  # untied or not: there is but one amount, and one plant
        return (e.typical, *size_of_chain(robot, e.families[:1], load_cell))
    short = short_runs(robot, e.families, load_cell)
    bound = e.high if sign > 0 else -e.low
    if bound <= 0:
        sign, bound = -sign, e.low * -1 if sign > 0 else e.high
    hi, lo = np.log(bound), np.log(bound) - 18
    x = np.log(min(abs(e.typical), bound))
    nearest = np.inf
    for _ in range(12):
        amount = sign * float(np.exp(x))
        size, channel, _ = size_of(robot, name, where, amount, seed, short, load_cell)
        off = abs(np.log(max(size, 1e-9) / sigma))
        if off < nearest:
            nearest, found = off, (amount, size, channel)
        if off < 0.05:
            break
        if size > sigma:
            hi = min(hi, x)
        else:
            lo = max(lo, x)
        if lo >= np.log(bound) - 1e-6:
            break                       # not even the bound makes it so large
        step = x + np.clip(np.log(sigma / max(size, 1e-6)), -3, 3)
        x = step if lo < step < hi else 0.5 * (lo + hi) if hi - lo < 6 else (np.log(bound) if step >= hi else x - 3)
    return found


def make_set(out, truth_path, robot_name, items, seed, families, repeats=1, load_cell="motor_side", tracker=True,
             colour=0.0, lost=0.0, jitter=3e-6, strength=1.0, scatter_Nm=SCATTER_NM, extra_truth=None,
             plant="lagrange", nuisance=0.0):
    robot_file = ROOT / "config" / "robots" / f"{robot_name}.yaml"
    robot = yaml.safe_load(robot_file.read_text())
    for name, _, _ in items:
        if plant == "mujoco" and name not in MUJOCO and effects.LIST[name].cut != "C6":
            raise Wrong(f"--effect {name}: the MuJoCo plant has no law for it; take --plant lagrange")
        if plant != "mujoco" and name == "free_chain":
            raise Wrong("--effect free_chain: only the MuJoCo plant has a chain to untie; take --plant mujoco")
    p, faults, truth = planted(robot, items, seed, nuisance)
    faults.update(colour=colour, lost=lost, jitter_s=jitter)
    c = programs.Controller(robot)
    rng = np.random.default_rng([seed, 1])
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    runs = []
    for k, family in enumerate(families):
        targets = programs.program(family, c, rng, strength)
        signals = outputs(robot, p, faults, targets, load_cell, 10, scatter_Nm, (seed, 5, k), plant)
        if not np.all(np.isfinite(signals["tip"])):
            raise RuntimeError(f"{family}: the simulation left the finite numbers; take a smaller amount")
        first = f"{family}_{k + 1}.csv"
        for r in range(1 + (repeats if k == 0 else 0)):
            name = first if r == 0 else f"{family}_{k + 1}_again{r}.csv"
            if r and (scatter_Nm or p.get("gust_N")):
                signals = outputs(robot, p, faults, targets, load_cell, 10, scatter_Nm, (seed, 6, k, r), plant)
            rows = sensors.sample(robot, signals, faults, [seed, 2, k, r])
            sensors.write_run(out / name, rows, tracker, load_cell != "none")
            runs.append((name, family, None if r == 0 else first, rows))
    sensors.write_set(out, robot_file, runs, load_cell)
    answer = dict(seed=seed, robot=robot_name, plant=plant, truth=truth, load_cell=load_cell, tracker=tracker, families=list(families),
                  colour=colour, lost=lost, jitter_s=jitter, scatter_Nm=scatter_Nm, nuisance=nuisance, strength=strength,
                  sha256_of_data=digest(out), **(extra_truth or {}))
    if truth_path:
        Path(truth_path).parent.mkdir(parents=True, exist_ok=True)
        Path(truth_path).write_text(json.dumps(answer, indent=1) + "\n")
    return answer


def arguments():
    a = argparse.ArgumentParser(prog="python -m tests.blind.make", description=__doc__)
    a.add_argument("--effect", action="append", default=[], metavar="NAME[:where]",
                   help="none: an exact null; twice: a pair. where is all, tendon:j or unit:i")
    a.add_argument("--sigma", action="append", type=float, default=[], help="size in the floors of the most affected channel")
    a.add_argument("--amount", action="append", type=float, default=[], help="size itself, instead of --sigma")
    a.add_argument("--sign", type=int, default=1, choices=(-1, 1))
    a.add_argument("--seed", type=int, required=True)
    a.add_argument("--robot", default="rig_90mm")
    a.add_argument("--families", nargs="+", default=programs.USUAL, choices=programs.FAMILIES)
    a.add_argument("--plant", default="lagrange", choices=("lagrange", "mujoco"))
    a.add_argument("--repeats", type=int, default=1)
    a.add_argument("--load-cell", default="motor_side", choices=("motor_side", "robot_side", "none"))
    a.add_argument("--no-tracker", action="store_true")
    a.add_argument("--weak", action="store_true", help="too little excitation to tell causes apart")
    a.add_argument("--nuisance", type=float, default=0.0, help="rms fraction by which the micro-constants are off")
    a.add_argument("--scatter", type=float, default=SCATTER_NM, help="rms torque that differs from run to run, N m")
    a.add_argument("--colour", type=float, default=0.0, help="pole of the noise of cell and tracker, 0 white")
    a.add_argument("--lost", type=float, default=0.0, help="share of tracker frames lost (a tenth of it of rows)")
    a.add_argument("--jitter", type=float, default=3e-6, help="rms of time stamps, s")
    a.add_argument("--out", required=True)
    a.add_argument("--truth", help="file for the truth, outside --out")
    a.add_argument("--list", action="store_true", help="print what can be planted and leave")
    return a


def main():
    if "--list" in sys.argv:
        for e in effects.LIST.values():
            print(f"{e.name:22s} {e.kind:9s} {e.scope:7s} {e.cut}  typical {e.typical:g}  {e.law}")
        return 0
    o = arguments().parse_args()
    if o.truth and Path(o.out).resolve() in Path(o.truth).resolve().parents:
        raise Wrong("--truth lies inside --out, where the diagnosis reads: give a file elsewhere")
    robot = yaml.safe_load((ROOT / "config" / "robots" / f"{o.robot}.yaml").read_text())
    items, sizes = [], []
    for k, text in enumerate(o.effect):
        name, _, where = text.partition(":")
        if name == "none":
            continue
        if name not in effects.LIST:
            raise Wrong(f"--effect {name}: unknown; see --list")
        where = where or "all"
        if k < len(o.amount):
            items.append((name, where, o.amount[k]))
        elif k < len(o.sigma):
            amount, size, channel = amount_for(robot, name, where, o.sigma[k], o.seed, o.sign, o.load_cell)
            items.append((name, where, amount))
            sizes.append(dict(wanted_sigma=o.sigma[k], sigma=size, channel=channel))
        else:
            raise Wrong(f"--effect {name}: give --sigma or --amount for it")
    begin = time.time()
    families = ["weak", "weak"] if o.weak else o.families
    answer = make_set(o.out, o.truth, o.robot, items, o.seed, families, o.repeats, o.load_cell, not o.no_tracker, o.colour,
                      o.lost, o.jitter, scatter_Nm=o.scatter, extra_truth=dict(sizes=sizes), plant=o.plant, nuisance=o.nuisance)
    print(f"{o.out}: {len(families)} runs, planted {[(t['effect'], t['where'], t['amount']) for t in answer['truth']]}, "
          f"{time.time() - begin:.1f} s")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Wrong as error:
        print(f"make: {error}", file=sys.stderr)
        sys.exit(2)
    except (RuntimeError, OSError) as error:
        print(f"make: {error}", file=sys.stderr)
        sys.exit(1)
