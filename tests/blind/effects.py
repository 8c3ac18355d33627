# What can be planted in the foreign plant: wrong numbers, mechanisms with laws of their own, mechanisms that no list
# names, and faults of the sensors. Each has one amount; 0 is the nominal rig.
from dataclasses import dataclass, field
from typing import Callable

import numpy as np

from tests.blind.lagrange_plant import G, T, U


@dataclass
class Planted:
    name: str
    kind: str                  # scale, listed, unlisted, sensor
    scope: str                 # robot, tendon, unit
    cut: str                   # where it shows first with a motor-side cell
    typical: float             # a plainly visible amount
    low: float                 # the largest amount down (0: one-sided) and up
    high: float
    plant: Callable            # (p, faults, which: list of indices, amount, rng)
    truth: Callable            # amount -> parameters by their registry names
    law: str
    on_one: bool = False       # also on one tendon or unit alone
    on_all: bool = True
    families: list = field(default_factory=lambda: ["triangle", "multisine"])
    near: str = ""             # of an unlisted one: what of the library it turns into where it changes little


LIST = {}


def add(name, kind, scope, cut, typical, low, high, plant, truth, law, **more):
    LIST[name] = Planted(name, kind, scope, cut, typical, low, high, plant, truth, law, **more)


def tendon_column(column, factor=False):
    def plant(p, faults, which, a, rng):
        for j in which:
            p["t"][j, T[column]] = p["t"][j, T[column]] * (1 + a) if factor else p["t"][j, T[column]] + a
    return plant


def unit_column(*columns):
    def plant(p, faults, which, a, rng):
        for i in which:
            for c in columns:
                p["u"][i, U[c]] *= 1 + a
    return plant


def scale(a):
    return {"scale": 1 + a}


def scaled(name, scope, cut, typical, low, high, plant, **more):
    add(name, "scale", scope, cut, typical, low, high, plant, scale, "the nominal law with another number", **more)


def pulley(key, factor=True):
    def plant(p, faults, which, a, rng):
        for j in which:
            p["pulleys"][j][key] = p["pulleys"][j][key] * (1 + a) if factor else p["pulleys"][j][key] + a
    return plant


def extra_coulomb(p, faults, which, a, rng):
    for j in which:
        p["t"][j, T["dc_extra"]] = a * p["t"][j, T["coulomb"]]


def stiffer_tendon(p, faults, which, a, rng):
    for j in which:
        p["t"][j, T["k"]] *= 1 + a
        p["t"][j, T["e0"]] /= 1 + a  # displacement stays zero at pretension


scaled("torque_constant", "tendon", "C2", 0.05, -0.3, 0.3, tendon_column("kt", True), on_one=True)
scaled("gear_efficiency", "tendon", "C2", -0.05, -0.25, 0.15, tendon_column("eff", True), on_one=True)
add("motor_coulomb", "scale", "tendon", "C2", 0.5, -0.7, 3.0, extra_coulomb, scale, "the change as four Maxwell-slip elements",
    on_one=True)
scaled("motor_viscous", "tendon", "C2", 3.0, 0, 40.0, tendon_column("viscous", True), families=["ladder", "steps"])
scaled("capstan_alpha", "tendon", "C4", 0.2, -0.5, 0.6, pulley("alpha"), on_one=True)
scaled("capstan_n", "tendon", "C4", 0.08, -0.2, 0.3, pulley("exponent"), on_one=True)
scaled("presliding", "tendon", "C4", 0.6, -0.7, 4.0, tendon_column("presliding", True))
scaled("tendon_stiffness", "tendon", "C3", -0.2, -0.6, 0.8, stiffer_tendon, on_one=True)
scaled("bending_stiffness", "robot", "C4", -0.1, -0.3, 0.4, unit_column("kb"))
scaled("unit_stiffness", "unit", "C4", -0.15, -0.5, 0.8, unit_column("kb"), on_one=True, on_all=False)
scaled("bending_damping", "robot", "C5", 0.5, -0.8, 4.0, unit_column("c"), families=["multisine", "steps"])


def hole_radius(p, faults, which, a, rng):
    p["hole_r"][:, which] *= 1 + a


scaled("hole_radius", "tendon", "C4", 0.05, -0.2, 0.2, hole_radius, on_one=True)


def unit_length(p, faults, which, a, rng):
    for i in which:
        p["u"][i, U["l"]] *= 1 + a
        p["u"][i, U["kb"]] /= 1 + a


scaled("unit_length", "robot", "C4", 0.03, -0.1, 0.1, unit_length)
scaled("unit_mass", "robot", "C4", 0.3, -0.6, 1.5, unit_column("m", "Ixx", "Izz"))


# -- mechanisms of the usual list --
def saturation(p, faults, which, a, rng):
    for j in which:
        p["t"][j, T["limit"]] -= a


def lag(p, faults, which, a, rng):
    for j in which:
        p["t"][j, T["lag"]] += a


def wrap(p, faults, which, a, rng):
    for j in which:
        p["pulleys"][j]["wrap_rad"] += a


def creep(p, faults, which, a, rng):
    for j in which:
        k = p["t"][j, T["k"]]
        p["t"][j, T["creep1"]] = 0.45 * a / k
        p["t"][j, T["creep2"]] = 0.55 * a / k
        p["t"][j, T["creep_t1"]], p["t"][j, T["creep_t2"]] = 2.0, 14.0


def precurvature(p, faults, which, a, rng):
    b = rng.uniform(0, 2 * np.pi)
    p["truth_extra"] = {"u_rad": a * np.cos(b), "v_rad": a * np.sin(b)}
    for i in which:
        p["u"][i, U["u0"]], p["u"][i, U["v0"]] = a * np.cos(b), a * np.sin(b)


def hysteresis(p, faults, which, a, rng):
    for i in which:
        p["u"][i, U["hyst"]] = a


def soft(p, faults, which, a, rng):
    for i in which:
        p["u"][i, U["soft"]] = a
        p["u"][i, U["soft_theta"]] = 0.3


def routing(p, faults, which, a, rng):
    for j in which:
        p["t"][j, T["route_mu"]] = a


def hole_angle(p, faults, which, a, rng):
    p["hole_a"][:, which] += a


def payload(p, faults, which, a, rng):
    p["u"][-1, U["m"]] += a


def tip_force(p, faults, which, a, rng):
    b = rng.uniform(0, 2 * np.pi)
    f = a * np.array([np.cos(b), np.sin(b), 0.3]) / np.hypot(1, 0.3)
    p["truth_extra"] = dict(zip(("x_N", "y_N", "z_N"), f))
    p["g"][[G["fx"], G["fy"], G["fz"]]] += f


def base_tilt(p, faults, which, a, rng):
    """The robot leans in the laboratory; the tracker's frame leans with its base, so gravity turns the other way."""
    from tests.blind.sensors import rotation
    b = rng.uniform(0, 2 * np.pi)
    tilt = a * np.array([np.cos(b), np.sin(b), 0.0])
    p["truth_extra"] = {"x_rad": tilt[0], "y_rad": tilt[1]}
    p["g"][:3] = rotation(tilt).T @ p["g"][:3]


def contact(p, faults, which, a, rng):
    b = rng.uniform(0, 2 * np.pi)
    p["truth_extra"] = {"gap_m": 0.010, "angle_rad": float(np.angle(np.exp(1j * b)))}
    p["g"][[G["wall_x"], G["wall_y"], G["wall_z"]]] = np.cos(b), np.sin(b), 0.0
    p["g"][G["wall_n"]] = 0.010
    p["g"][G["wall_k"]] = a


def torsion(p, faults, which, a, rng):
    s = np.concatenate([[0], np.cumsum(p["u"][:, U["l"]])])
    p["hole_a"] += (a * s * (0.5 + 0.75 * s / s[-1]))[:, None]  # more of it near the tip


def stribeck(p, faults, which, a, rng):
    for j in which:
        p["t"][j, T["stribeck_Nm"]], p["t"][j, T["stribeck_w"]] = a, 6.0


def cogging(p, faults, which, a, rng):
    for j in which:
        p["t"][j, T["cogging_Nm"]] = a
        p["t"][j, T["cogging_n"]] = 12
        p["t"][j, T["cogging_phase"]] = rng.uniform(0, 2 * np.pi)


add("stribeck", "listed", "tendon", "C2", 1.0e-4, 0, 6e-4, stribeck, lambda a: {"torque_Nm": a},
    "LuGre bristle whose strength falls as a Gauss of speed, 6 rad/s", families=["triangle", "ladder"], on_one=True)
add("cogging", "listed", "tendon", "C2", 5e-5, 0, 5e-4, cogging, lambda a: {"amplitude_Nm": a},
    "12 notches a turn with a second harmonic of a quarter", on_one=True)
add("torque_loop_lag", "listed", "tendon", "C1", 2e-3, 0, 1.5e-2, lag, lambda a: {"s": a}, "first order, slower",
    families=["multisine", "steps"])
add("command_delay", "listed", "tendon", "C1", 3e-3, 0, 2e-2, tendon_column("delay"), lambda a: {"s": a}, "pure delay",
    families=["multisine", "steps"])
add("torque_saturation", "listed", "tendon", "C1", 6e-3, 0, 6.4e-3, saturation, lambda a: {"deficit_Nm": a},
    "current limited earlier", families=["steps", "triangle"], on_one=True)
add("wrap_angle", "listed", "tendon", "C4", 0.3, -0.8, 0.8, wrap, lambda a: {"extra_rad": a}, "nominal law, other wrap",
    on_one=True)
add("pulley_coulomb", "listed", "tendon", "C4", 0.08, 0, 0.6, tendon_column("pulley_N"), lambda a: {"N": a},
    "Dahl bristle over 0.03 mm, the load not entering", on_one=True)
add("tendon_creep", "listed", "tendon", "C3", 0.15, 0, 1.5, creep, lambda a: {"fraction": a},
    "two Kelvin-Voigt elements in series with the tendon, 2 s and 14 s", families=["hold", "triangle"])
add("backlash", "listed", "tendon", "C3", 0.1, 0, 1.5, tendon_column("backlash"), lambda a: {"rad": a},
    "six plays in parallel, 0.7 to 1.3 times the width", on_one=True)
add("slack", "listed", "tendon", "C3", 4e-5, 0, 2e-3, tendon_column("slack"), lambda a: {"m": a},
    "longer tendon of one motor", on_one=True, on_all=False)
add("spool_growth", "listed", "tendon", "C3", 1e-4, 0, 1e-3, tendon_column("growth"), lambda a: {"m_per_rad": a},
    "spool radius grows in proportion to what is wound")
add("precurvature", "listed", "robot", "C4", 0.03, 0, 0.2, precurvature, lambda a: {}, "bent at rest, all units alike")
add("backbone_hysteresis", "listed", "robot", "C4", 1.0e-3, 0, 6e-3, hysteresis, lambda a: {"moment_Nm": a},
    "Prandtl-Ishlinskii, six stops from 6 to 150 mrad")
add("superelastic", "listed", "robot", "C4", 0.2, 0, 0.8, soft, lambda a: {"softening": a},
    "stiffness falls to a plateau around 0.3 rad a unit, no loop", families=["triangle", "steps"])
add("routing_friction", "listed", "tendon", "C4", 0.1, 0, 0.8, routing, lambda a: {"mu": a},
    "wrap at each disk from the chords' turn, three Maxwell-slip elements")
add("hole_angle", "listed", "tendon", "C4", 0.05, -0.3, 0.3, hole_angle, lambda a: {"rad": a}, "holes of one tendon off",
    on_one=True, on_all=False)
add("tip_payload", "listed", "robot", "C4", 2e-3, 0, 2e-2, payload, lambda a: {"mass_kg": a}, "point mass at the tip disk")
add("tip_force", "listed", "robot", "C4", 0.02, 0, 0.2, tip_force, lambda a: {}, "constant force")
add("base_tilt", "listed", "robot", "C4", 0.1, 0, 0.6, base_tilt, lambda a: {}, "gravity leans in the base frame")
add("contact", "listed", "robot", "C4", 300.0, 0, 6000.0, contact, lambda a: {"stiffness_Npm": a},
    "Hunt and Crossley wall 10 mm beside the axis", families=["triangle", "steps"])
add("torsion", "listed", "robot", "C4", 2.0, -12, 12, torsion, lambda a: {"rad_per_m": a}, "holes turn along the backbone, faster near the tip")


# -- mechanisms that no list names --
def column(name, target="t", **others):
    def plant(p, faults, which, a, rng):
        table, index = (p["t"], T) if target == "t" else (p["u"], U)
        for j in which:
            table[j, index[name]] = a
            for key, value in others.items():
                table[j, index[key]] = value
    return plant


def robot_number(name, **others):
    def plant(p, faults, which, a, rng):
        p["g"][G[name]] = a
        for key, value in others.items():
            p["g"][G[key]] = value
    return plant


def add_unlisted(name, scope, cut, typical, high, plant, law, **more):
    add(name, "unlisted", scope, cut, typical, 0, high, plant, lambda a: {"amount": a}, law, **more)


add_unlisted("crossing_friction", "tendon", "C4", 0.05, 0.5, column("cross"),
             "each tendon rubs on its neighbour: friction in proportion to the neighbour's tension", near="routing_friction")
add_unlisted("hot_motor", "tendon", "C2", 0.1, 0.6, column("thermal", thermal_tau=12.0),
             "torque constant falls with heat from current squared, 12 s", families=["hold", "triangle"], near="torque_constant")
add_unlisted("disk_twist", "robot", "C4", 0.02, 0.3, robot_number("twist_k"),
             "disks turn about the backbone under skew tension")
add_unlisted("load_ripple", "tendon", "C2", 0.05, 0.5, column("ripple", ripple_n=7.0),
             "torque ripple of 7 a turn in proportion to the torque", near="cogging")
add_unlisted("fixture_hysteresis", "tendon", "C3", 1e-5, 1.5e-4, column("fixture_m"),
             "the fixture gives way with a hysteresis of tension")
add_unlisted("eccentric_spool", "tendon", "C3", 1e-4, 1.5e-3, column("ecc", ecc_n=1.0), "the spool runs out of true", near="spool_growth")
add_unlisted("supply_sag", "tendon", "C2", 0.05, 0.5, column("sag"),
             "all motors weaken with the sum of their currents", near="torque_constant")
add_unlisted("axial_compression", "robot", "C4", 0.005, 0.04, robot_number("axial"),
             "units shorten under the sum of tensions", near="unit_length")
add_unlisted("loose_base", "robot", "C4", 0.5, 8.0, robot_number("base_c"), "the base plate leans under the moment of the first unit", near="base_tilt")
add_unlisted("stiffening_tendon", "tendon", "C3", 0.2, 3.0, column("stiffening"), "tendon stiffness grows with tension", near="tendon_stiffness")
add_unlisted("backbone_relaxation", "robot", "C4", 0.1, 1.0, column("visc", "u", visc_tau=1.2),
             "a Maxwell arm beside the backbone, 1.2 s", families=["hold", "triangle"], near="bending_damping")


def gusts(p, faults, which, a, rng):
    p["gust_N"] = a


add_unlisted("gusts", "robot", "C5", 0.01, 0.15, gusts, "coloured force at the tip, 0.7 Hz", near="tip_force")


def free(p, faults, which, a, rng):
    p["free_chain"] = True


add_unlisted("free_chain", "robot", "C4", 1.0, 1.0, free,
             "MuJoCo only: the joints within a unit are not tied, the backbone bends as tendons and weight have it")


def sensor(name, scope, typical, low, high, key, value, truth, law, kind="sensor", cut="C6", **more):
    def plant(p, faults, which, a, rng):
        faults[key] = value(a, which, p["t"].shape[0], rng, p)
    add(name, kind, scope, cut, typical, low, high, plant, truth, law, **more)


def on(which, m, a, base=0.0):
    out = np.full(m, base)
    out[which] += a
    return out.tolist()


def direction(key_names):
    def value(a, which, m, rng, p):
        d = rng.standard_normal(3)
        d *= a / np.linalg.norm(d)
        p["truth_extra"] = dict(zip(key_names, d.tolist()))
        return d.tolist()
    return value


sensor("cell_gain", "tendon", 0.05, -0.3, 0.3, "cell_gain", lambda a, w, m, r, p: on(w, m, a, 1.0), scale, "gain", on_one=True)
sensor("cell_offset", "tendon", 0.05, -1.0, 1.0, "cell_offset_N", lambda a, w, m, r, p: on(w, m, a), lambda a: {"N": a},
       "offset", on_one=True)
sensor("cell_drift", "tendon", 0.004, -0.05, 0.05, "cell_drift_Nps", lambda a, w, m, r, p: on(w, m, a),
       lambda a: {"N_per_s": a}, "linear in time", on_one=True, families=["hold"])
sensor("encoder_offset", "tendon", 0.02, -1.0, 1.0, "encoder_offset_rad", lambda a, w, m, r, p: on(w, m, a),
       lambda a: {"rad": a}, "offset", on_one=True)
sensor("tracker_rotation", "robot", 0.01, 0, 0.2, "tracker_rotation_rad", direction(("x_rad", "y_rad", "z_rad")),
       lambda a: {}, "frame turned")
sensor("tracker_offset", "robot", 2e-4, 0, 5e-3, "tracker_offset_m", direction(("x_m", "y_m", "z_m")), lambda a: {},
       "frame moved")
sensor("tracker_delay", "robot", 0.01, 0, 0.06, "tracker_delay_s", lambda a, w, m, r, p: a, lambda a: {"s": a}, "delay",
       families=["multisine", "steps"])
sensor("cell_crosstalk", "robot", 0.02, -0.2, 0.2, "cell_cross", lambda a, w, m, r, p: a, lambda a: {"amount": a},
       "each cell sees a part of its neighbour's tension", kind="unlisted", near="cell_gain")
sensor("bent_field", "robot", 0.02, 0, 0.3, "magnetic", lambda a, w, m, r, p: a, lambda a: {"amount": a},
       "the tracker's field is bent: error by the square of the distance", kind="unlisted", near="tracker_rotation")
