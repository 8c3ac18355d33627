# What a sealed set holds: its kind, what is planted, and how it is made and sealed, each by a worker. Knows the plant; never what
# is answered.
import contextlib
import json
import platform
import random
import secrets
import shutil
from importlib import metadata
from pathlib import Path

from tests.blind.seal import Wrong, now, seal_of, sha, write_once

ROOT = Path(__file__).resolve().parents[2]
KINDS = dict(single=0.38, parameter=0.15, null=0.2, nuisance_null=0.05, unlisted=0.08, pair=0.08, weak=0.03, no_tracker=0.03)
JITTERS_S = (3e-6, 2e-5)  # drawn from, and not written down before c13


def kinds_of(count, rng):
    """Kinds for `count` sets: whole parts by the composition, the rest by chance, in random order."""
    names, kinds = list(KINDS), []
    for name in names:
        kinds += [name] * int(KINDS[name] * count)
    while len(kinds) < count:
        kinds.append(rng.choices(names, [KINDS[n] * count % 1 + 1e-9 for n in names])[0])
    rng.shuffle(kinds)
    return kinds


def draw(kind, rng, among=None, chain=True):
    """What to plant: list of (name, where, sigma, sign); what lists name only `among` these; the untied chain with `chain`."""
    from tests.blind import effects
    groups = dict(single=("listed", "scale", "sensor"), parameter=("scale",), unlisted=("unlisted",), pair=("listed", "scale"),
                  weak=("listed", "scale"), no_tracker=("listed", "scale"))
    if kind not in groups:
        return []
    pool = [e for e in effects.LIST.values() if e.kind in groups[kind]]
    if not chain:
        pool = [e for e in pool if e.name != "free_chain"]
    if among and kind != "unlisted":
        pool = [e for e in pool if e.name in among]
    if kind == "no_tracker":
        pool = [e for e in pool if not e.name.startswith("tracker")]
    if len(pool) < (2 if kind == "pair" else 1):
        raise Wrong(f"--effects {','.join(among)}: too few for sets of kind {kind}, which draw {'two' if kind == 'pair' else 'one'}"
                    f" of kind {' or '.join(groups[kind])} (python -m tests.blind.make --list)")

    def one(sigma):
        e = rng.choice(pool)
        pool.remove(e)
        parts = dict(tendon=3, unit=4).get(e.scope)
        alone = parts and e.on_one and (not e.on_all or rng.random() < 0.4)
        where = f"{e.scope}:{rng.randint(1, parts)}" if alone else "all"
        return e.name, where, sigma, rng.choice((-1, 1)) if e.low < 0 else 1

    log_uniform = lambda a, b: a * (b / a) ** rng.random()
    if kind == "pair":
        s = log_uniform(5, 30)
        return [one(s), one(s / log_uniform(1, 5))]
    return [one(log_uniform(3, 30) if kind in ("weak", "no_tracker") else log_uniform(0.1, 30))]


def make_one(how, name, kind):
    """A task: draws, simulates and seals one set; the SHA-256 of its answer. how: folder, vault (absolute paths), effects,
    families, mujoco. What an earlier worker left of it is made anew, except where that had sealed it."""
    import yaml
    from tests.blind import effects, make as generator
    folder, vault, rng = Path(how["folder"]), Path(how["vault"]), random.SystemRandom()
    if (folder / "seals" / f"{name}.json").exists():
        return seal_of(folder, name)["answer_sha256"]
    for leftover in (folder / "sets" / name, folder / "sets" / f"{name}_followup"):
        shutil.rmtree(leftover, ignore_errors=True)
    robot_name = rng.choice(["rig_90mm"] * 4 + ["rig_60mm"])
    robot = yaml.safe_load((ROOT / "config" / "robots" / f"{robot_name}.yaml").read_text())
    cell = rng.choice(["motor_side"] * 4 + ["robot_side"])
    # A robot without a gap is now and then moved too little, or has no tracker: neither tells that something is planted.
    like = rng.choice([kind] * 8 + ["weak", "no_tracker"]) if kind == "null" else kind
    seed = rng.getrandbits(48)
    for _ in range(5):  # again where what was drawn cannot be made
        items, sizes = [], []
        for effect, where, sigma, sign in draw(kind, rng, how["effects"], how["mujoco"] > 0):
            amount, size, channel = generator.amount_for(robot, effect, where, sigma, seed, sign, cell)
            items.append((effect, where, amount))
            sizes.append(dict(wanted_sigma=sigma, sigma=size, channel=channel))
        others = ["cocontraction", "circle", "steps", "multisine", "ladder", "hold"]
        families = ["triangle"] + rng.sample(others, how["families"] - 1)
        # Some of what both plants can do is done by the other one, the untied chain always.
        names = {effect for effect, _, _ in items}
        either = kind != "nuisance_null" and all(n in generator.MUJOCO or effects.LIST[n].cut == "C6" for n in names)
        plant = "mujoco" if "free_chain" in names or (either and rng.random() < how["mujoco"]) else "lagrange"
        nuisance = 0.0
        if kind == "nuisance_null":
            nuisance, size = generator.small_nuisance(robot, seed, cell)
            sizes.append(dict(wanted_sigma=0.0, sigma=size, channel="any"))
        common = dict(robot_name=robot_name, items=items, seed=seed, load_cell=cell, tracker=like != "no_tracker",
                      colour=rng.choice([0, 0, 0.5, 0.9]), lost=rng.choice([0, 0, 0, 0.03]),
                      jitter=rng.choice([JITTERS_S[0], *JITTERS_S]), nuisance=nuisance, plant=plant)
        try:
            extra = {}
            if kind == "weak":
                answer = generator.make_set(folder / "sets" / name, None, families=["weak", "weak"], **common)
                extra = generator.make_set(folder / "sets" / f"{name}_followup", None, families=families, **common)
                extra = dict(followup_sha256=extra["sha256_of_data"])
                answer["followup_families"] = families
            else:
                answer = generator.make_set(folder / "sets" / name, None,
                                            families=["weak", "weak"] if like == "weak" else families, **common)
            break
        except RuntimeError:
            shutil.rmtree(folder / "sets" / name, ignore_errors=True)
    else:
        raise RuntimeError(f"set {name}: five draws could not be simulated")
    answer.update(extra, id=name, set_kind=kind, sizes=sizes, nonce=secrets.token_hex(32), made_by=maker())
    text = json.dumps(answer, indent=1) + "\n"
    path = vault / f"{name}.json"
    path.unlink(missing_ok=True)
    write_once(path, text)
    seal = dict(id=name, answer_sha256=sha(text.encode()), data_sha256=answer["sha256_of_data"], sealed_ns=now(), **extra)
    write_once(folder / "seals" / f"{name}.json", json.dumps(seal) + "\n")
    return seal["answer_sha256"]


def maker():
    """What the last bits of the data depend on."""
    versions = {}
    for package in ("numpy", "numba", "scipy", "mujoco"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[package] = metadata.version(package)
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return dict(versions, processor=line.partition(":")[2].strip())
    return dict(versions, processor=platform.machine())
