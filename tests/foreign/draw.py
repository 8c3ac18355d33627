"""Robots, postures and changes of the foreign campaign, drawn from a seed: dictionaries of plain numbers in SI units,
which both plants read and a sealed answer can hold. Knows neither simulators nor tables.

Lengths of tendons are pulls: what a spool has wound in beyond the straight robot at home."""

import math

import numpy as np

CHANGES = ("tip_payload", "bending_stiffness", "slack")
PLANTS = ("cable", "elastica")
GRAVITY = dict(standing=(0, 0, -9.81), hanging=(0, 0, 9.81), horizontal=(0, -9.81, 0))
LARGEST_BEND_RAD = 1.0  # of a section
LARGEST_PUSH = (
    0.3  # of the tendons at home on a piece of rod between two disks, over the load at which it would buckle alone
)


def kinds_of(sets, plants, rng):
    """(plant, change) of every set: equal numbers of each, in random order."""
    pairs = [(plant, change) for change in CHANGES for plant in plants]
    offset = int(rng.integers(len(pairs)))
    kinds = [pairs[(offset + k) % len(pairs)] for k in range(sets)]
    return [kinds[k] for k in rng.permutation(sets)]


def log_uniform(rng, low, high):
    return float(low * (high / low) ** rng.random())


def robot(rng):
    """Soft rod with disks: weight bends it visibly, neither weight nor tendons buckle it, tendons are mostly taut."""
    length = log_uniform(rng, 0.1, 0.4)
    count = int(rng.integers(1, 3))
    mount = str(rng.choice(list(GRAVITY)))
    share = rng.uniform(0.45, 0.55)
    lengths = [length] if count == 1 else [length * share, length * (1 - share)]
    lever = float(np.clip(min(lengths) * rng.uniform(0.1, 0.17), 0.008, 0.025))
    tendons = str(rng.choice(["3", "4", "pairs"]))
    rod_radius = float(np.clip(lever * rng.uniform(0.35, 0.5), 0.003, 0.01))
    density = rng.uniform(1050, 1250)
    disk_mass = 1500 * math.pi * (1.15 * lever) ** 2 * 0.003 * rng.uniform(0.5, 1.5)  # some millimetres of plastic
    turn = rng.uniform(0, 2 * math.pi)
    r = dict(
        mount=mount,
        tendons=tendons,
        rod_radius_m=rod_radius,
        density_kgpm3=density,
        disk_mass_kg=disk_mass,
        spool_radius_m=rng.uniform(0.008, 0.02),
        tip_payload_kg=0.0,
        sections=[],
    )
    r["gravity_mps2"] = tilted(GRAVITY[mount], rng.normal(0, 0.01, 2))
    pull = rng.uniform(0.5, 0.8)  # of a tendon at home, times its lever, over the moment that bends a section by 1 rad
    for k, its in enumerate(lengths):
        through = (count - k) * (3 if tendons == "3" else 4)
        fewest = math.sqrt(through * pull * its / (math.pi**2 * lever * LARGEST_PUSH))
        disks = int(rng.integers(2, 5))
        disks = min(4, max(disks, math.ceil(fewest)))
        pull = min(pull, pull * (disks / fewest) ** 2)
        r["sections"].append(dict(length_m=its, disks=disks, holes=holes(tendons, turn, k, lever)))
    elastic(r, pull, rng)
    return r


def tilted(gravity, by):
    """A base is never quite level: gravity turned by small angles about two axes across it."""
    g = np.array(gravity, float)
    across = [a for a in np.eye(3) if abs(a @ g) < 1]
    return [float(x) for x in np.linalg.norm(g) * unit(g + sum(b * np.cross(a, g) for a, b in zip(across, by)))]


def unit(v):
    return v / np.linalg.norm(v)


def holes(tendons, turn, section, lever):
    """(angle, radius) of a section's tendons; those of the second lie between those of the first."""
    n = 3 if tendons == "3" else 4
    return [((turn + 2 * math.pi * j / n + section * math.pi / n) % (2 * math.pi), lever) for j in range(n)]


def elastic(r, pull, rng):
    """Stiffness of rod and tendons and the pull at home, relative to the robot's weight and size."""
    length = sum(s["length_m"] for s in r["sections"])
    # Weight length^2 / bending stiffness; a standing rod would buckle at 7.8 without its tendons.
    heavy = log_uniform(rng, *((0.6, 2.0) if r["mount"] == "standing" else (1.0, 4.0)))
    EI = 9.81 * mass(r) * length**2 / heavy
    for s in r["sections"]:
        s["youngs_modulus_Pa"] = EI * rng.uniform(0.85, 1.15) / (math.pi * r["rod_radius_m"] ** 4 / 4)
    section, lever = length / len(r["sections"]), r["sections"][0]["holes"][0][1]
    r["tautness"] = log_uniform(rng, 2, 8)  # stiffness of a tendon at its lever over that of a section
    r["tendon_stiffness_Npm"] = r["tautness"] * EI / (lever**2 * section)
    home = pull * EI / (lever * section) / r["tendon_stiffness_Npm"]
    count = sum(len(s["holes"]) for s in r["sections"])
    r["home_m"] = [float(home + x) for x in rng.normal(0, 0.0003, count)]


def mass(r):
    """Of rod and disks."""
    rod = math.pi * r["rod_radius_m"] ** 2 * r["density_kgpm3"] * sum(s["length_m"] for s in r["sections"])
    return rod + r["disk_mass_kg"] * sum(s["disks"] for s in r["sections"]) + r["tip_payload_kg"]


def motors_of(r):
    """For each tendon its motor, from 0, and the sign by which that winds it in."""
    motors, count = [], 0
    for s in r["sections"]:
        n = len(s["holes"])
        own = n // 2 if r["tendons"] == "pairs" else n
        motors += [(count + j % own, 1 if j < own else -1) for j in range(n)]
        count += own
    return motors


def postures(r, rng, count):
    """count x motors angles of spools [rad]: home, then random bends of every section through the whole range, each
    tendon wound by what these take off its way and by what its stretch takes."""
    motors = motors_of(r)
    angles = np.zeros((count, 1 + max(m for m, _ in motors)))
    for row in angles[1:]:
        bends = [(LARGEST_BEND_RAD * math.sqrt(rng.random()), rng.uniform(0, 2 * math.pi)) for _ in r["sections"]]
        tensed = [0 if r["tendons"] == "pairs" else rng.uniform(-0.2, 0.5) * r["home_m"][0] for _ in r["sections"]]
        tendon = 0
        for k, s in enumerate(r["sections"]):
            stretch = 1 + 2 / len(s["holes"]) / r["tautness"]
            for angle, lever in s["holes"]:
                motor, sign = motors[tendon]
                if sign > 0:
                    pull = sum(
                        b * math.cos(way - angle) * (stretch if i == k else 1)
                        for i, (b, way) in enumerate(bends[: k + 1])
                    )
                    row[motor] = (lever * pull + tensed[k]) / r["spool_radius_m"]
                tendon += 1
    return angles


def change(r, kind, rng):
    """What happens to the robot: effect, place and size as the diagnosis would name them."""
    if kind == "tip_payload":
        return dict(effect=kind, where="all", value=float(mass(r) * rng.uniform(0.1, 0.4)), unit="kg")
    if kind == "bending_stiffness":
        sections = len(r["sections"])
        where = str(rng.choice(["all"] + [f"section:{k + 1}" for k in range(sections) if sections > 1]))
        scale = rng.uniform(0.6, 0.85) if rng.random() < 0.5 else rng.uniform(1.2, 1.6)
        return dict(effect=kind, where=where, value=float(scale), unit="")
    tendon = int(rng.integers(len(r["home_m"])))
    longer = float(np.clip(r["home_m"][tendon] * rng.uniform(0.7, 1.5), 0.001, 0.005))
    return dict(effect="slack", where=f"tendon:{tendon + 1}", value=longer, unit="m")


def changed(r, what):
    """The robot after it."""
    r = dict(r, sections=[dict(s) for s in r["sections"]], home_m=list(r["home_m"]))
    kind, _, number = what["where"].partition(":")
    if what["effect"] == "tip_payload":
        r["tip_payload_kg"] += what["value"]
    elif what["effect"] == "bending_stiffness":
        for k, s in enumerate(r["sections"]):
            if kind == "all" or k + 1 == int(number):
                s["bending_scale"] = what["value"]
    else:
        r["home_m"][int(number) - 1] -= what["value"]
    return r


def rods(r):
    """Of each section: bending, torsional and axial stiffness and mass per length. A change of bending stiffness leaves
    the others: a split sleeve, a wire more along the axis. The rod is round, and without Poisson's effect its shear
    modulus is half of Young's, so that it twists as easily as it bends."""
    out = []
    for s in r["sections"]:
        area, second = math.pi * r["rod_radius_m"] ** 2, math.pi * r["rod_radius_m"] ** 4 / 4
        EI = s["youngs_modulus_Pa"] * second
        out.append(
            dict(
                bending_Nm2=EI * s.get("bending_scale", 1),
                torsion_Nm2=EI,
                axial_N=s["youngs_modulus_Pa"] * area,
                mass_kgpm=r["density_kgpm3"] * area,
            )
        )
    return out


def pieces(r, between):
    """(length, rod, mass at its end, number of the disk there or None) of every piece, base to tip."""
    each, out, disk = rods(r), [], -1
    spans = [
        (s["length_m"] / s["disks"] / between, each[k])
        for k, s in enumerate(r["sections"])
        for _ in range(s["disks"] * between)
    ]
    for n, (h, rod) in enumerate(spans):
        after = spans[n + 1] if n + 1 < len(spans) else (0.0, rod)
        weight = (rod["mass_kgpm"] * h + after[1]["mass_kgpm"] * after[0]) / 2
        ends = (n + 1) % between == 0
        disk += ends
        weight += (r["disk_mass_kg"] if ends else 0) + (r["tip_payload_kg"] if n + 1 == len(spans) else 0)
        out.append((h, rod, weight, disk if ends else None))
    return out


def pulls(r, angles):
    """postures x tendons: how much shorter each tendon is at rest than its way along the straight robot [m]."""
    return np.array(
        [
            [r["home_m"][j] + sign * r["spool_radius_m"] * row[motor] for j, (motor, sign) in enumerate(motors_of(r))]
            for row in angles
        ]
    )
