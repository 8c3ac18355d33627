# The rig in MuJoCo: each unit a chain of hinges tied to equal bends (or left free), spatial tendons through the
# disks' holes, motors as joints, MuJoCo's integrator. Pulley, gear and friction laws act as forces between its steps.
import math

import numpy as np
from numba import njit

from tests.blind import lagrange_plant as lp
from tests.blind.lagrange_plant import T, U, cap, clip, dahl

JOINTS = 6        # a unit and direction of bend
STEP_S = 5e-5
LINK = 1 / 16  # inertia of what is between two hinges, in discs; lighter links make the ties soft


def chain(joints):
    """Hinges of a unit from base to end: name, share of the unit's bend, place along its length. Hinges about x lie between
    those about y, whose first and last have half a share: the rotations' order cancels up to the bend's cube over
    joints squared. Each kind is spaced so that the unit's end lies on the arc up to the fourth power of the bend: the mean
    square of the direction's deviation from the chord is the arc's."""
    out = []
    for name, shares in (("u", [0.5] + [1.0] * (joints - 1) + [0.5]), ("v", [1.0] * joints)):
        shares = np.array(shares) / joints
        turned = np.cumsum(shares)[:-1] - 0.5
        spacing = 1 / 6 / (len(turned) / 4 - np.sum(turned ** 2))
        out += [(f"{name}{k}", share, 0.5 + (k - len(turned) / 2) * spacing) for k, share in enumerate(shares)]
    return sorted(out, key=lambda hinge: hinge[2])


def model_xml(p, tied=True, joints=JOINTS, step=STEP_S):
    n, m = len(p["u"]), len(p["t"])
    g = p["g"][:3]
    rows = ['<mujoco><compiler angle="radian" inertiafromgeom="false"/>',
            f'<option timestep="{step}" gravity="{g[0]} {g[1]} {g[2]}" integrator="implicitfast" solver="Newton" '
            f'iterations="30" tolerance="1e-12" jacobian="dense"><flag contact="disable" warmstart="enable"/></option>',
            "<worldbody>"]
    for j in range(m):
        rows.append(f'<body name="rotor{j}" pos="0 0 -1"><joint name="motor{j}" type="hinge" axis="0 0 1"/>'
                    f'<inertial pos="0 0 0" mass="1e-3" diaginertia="{p["t"][j, T["J"]]:.9g} {p["t"][j, T["J"]]:.9g} '
                    f'{p["t"][j, T["J"]]:.9g}"/></body>')
    for j in range(m):
        x, y = p["hole_r"][0, j] * math.cos(p["hole_a"][0, j]), p["hole_r"][0, j] * math.sin(p["hole_a"][0, j])
        rows.append(f'<site name="s0_{j}" pos="{x:.12g} {y:.12g} 0"/>')
    depth = 0
    offset = 0.0
    hinges = chain(joints)
    last = 1 - hinges[-1][2]
    link = LINK * p["u"][:, U["Ixx"]].min()
    for i in range(n):
        u = p["u"][i]
        l = u[U["l"]]
        before = 0.0
        for h, (name, share, place) in enumerate(hinges):
            offset += (place - before) * l
            before = place
            rows.append(f'<body name="b{i}_{h}" pos="0 0 {offset:.12g}">')
            depth += 1
            offset = 0.0
            axis = "0 1 0" if name[0] == "u" else "-1 0 0"
            rows.append(f'<joint name="{name}_{i}" type="hinge" axis="{axis}" stiffness="{u[U["kb"]] / share:.12g}" '
                        f'damping="{u[U["c"]] / share:.12g}" springref="{u[U[name[0] + "0"]] * share:.12g}"/>')
            if h < len(hinges) - 1:
                rows.append(f'<inertial pos="0 0 0" mass="1e-7" diaginertia="{link:.9g} {link:.9g} {1e-3 * link:.9g}"/>')
        end = last * l
        # the discs at both ends of a unit are lighter by half of its links
        links = 0.5 * (len(hinges) - 1) * (1 if i == n - 1 else 2)
        bending = u[U["Ixx"]] - links * link
        rows.append(f'<inertial pos="0 0 {end:.12g}" mass="{u[U["m"]] - links * 1e-7:.12g}" '
                    f'diaginertia="{bending:.9g} {bending:.9g} {min(u[U["Izz"]], 2 * bending):.9g}"/>')
        for j in range(m):
            x = p["hole_r"][i + 1, j] * math.cos(p["hole_a"][i + 1, j])
            y = p["hole_r"][i + 1, j] * math.sin(p["hole_a"][i + 1, j])
            rows.append(f'<site name="s{i + 1}_{j}" pos="{x:.12g} {y:.12g} {end:.12g}"/>')
        if i == n - 1:
            rows.append(f'<site name="tip" pos="0 0 {end:.12g}"/>')
        offset = end
    rows.append("</body>" * depth + "</worldbody><tendon>")
    for j in range(m):
        rows.append(f'<spatial name="t{j}">' + "".join(f'<site site="s{i}_{j}"/>' for i in range(n + 1)) + "</spatial>")
    rows.append("</tendon><actuator>")
    rows += [f'<general name="a{j}" tendon="t{j}" gainprm="1" biastype="none"/>' for j in range(m)]
    rows.append("</actuator>")
    if tied:
        rows.append("<equality>")
        for i in range(n):
            for name, share, _ in hinges:
                first = name[0] + "1"
                if name != first:
                    rows.append(f'<joint joint1="{name}_{i}" joint2="{first}_{i}" polycoef="0 {share * joints:.12g} 0 0 0" '
                                f'solref="{2 * step} 1" solimp="0.9999 0.9999 0.001"/>')
        rows.append("</equality>")
    rows.append("</mujoco>")
    return "\n".join(rows)


@njit(cache=True, error_model="numpy")
def laws(P, th, om, tq, d, dd, mem, x0, obs, effort):
    """Tension at the base and torque at each rotor from the nominal laws; memories move on by one step."""
    m = th.shape[0]
    for j in range(m):
        p = P.t[j]
        s = p[lp.T_r_spool] * th[j] / p[lp.T_ratio]
        sd = p[lp.T_r_spool] * om[j] / p[lp.T_ratio]
        Tm = max(0.0, p[lp.T_k] * (s - d[j] + p[lp.T_e0]) + p[lp.T_c] * (sd - dd[j]))
        x = 0.5 * (s + d[j])
        z = 0.0
        for k in range(4):
            yk = p[lp.T_presliding] * 0.25 * (k + 1)
            mem[j, k] = clip(mem[j, k] + (x - x0[j, 1]), yk)
            z += 0.25 * mem[j, k] / yk
        zg = 0.0
        for k in range(2):
            yk = p[lp.T_gear_y1] if k == 0 else p[lp.T_gear_y2]
            mem[j, 4 + k] = clip(mem[j, 4 + k] + (th[j] - x0[j, 0]), yk)
            zg += 0.5 * mem[j, 4 + k] / yk
        mem[j, 6] = dahl(mem[j, 6], th[j], x0[j, 0], p[lp.T_coulomb_angle])
        x0[j, 0] = th[j]
        x0[j, 1] = x
        zdot = (om[j] - abs(om[j]) * mem[j, 6]) / p[lp.T_coulomb_angle]
        effort[j] = (p[lp.T_kt] * tq[j] - p[lp.T_coulomb] * mem[j, 6] - p[lp.T_coulomb_micro] * zdot
                     - p[lp.T_viscous] * om[j] - Tm * p[lp.T_r_spool] / p[lp.T_ratio] * p[lp.T_eff] ** (-zg))
        obs[0, j] = Tm
        obs[1, j] = (0.5 * (1 + z) * cap(P.cap_val[j], P.cap_axis[j], 1, Tm)
                     + 0.5 * (1 - z) * cap(P.cap_val[j], P.cap_axis[j], 0, Tm))


def simulate(p, targets_Nm, disturb_Nm=None, tied=True, joints=JOINTS, step=STEP_S, dt_row=1e-3):
    """As lagrange_plant.simulate (disturb_Nm: S x M at the rotors), for wrong numbers of the nominal laws and, with tied=False, a free fine chain."""
    import mujoco
    P = lp.build(p)
    n, m = P.u.shape[0], P.t.shape[0]
    S = len(targets_Nm)
    model = mujoco.MjModel.from_xml_string(model_xml(p, tied, joints, step))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rest = data.ten_length.copy()
    tip = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tip")
    hinges = [[(model.joint(f"{name}_{i}").qposadr[0], share) for name, share, _ in chain(joints) if name[0] == c]
              for c in "uv" for i in range(n)]
    tq = np.full(m, 0.3) * P.t[:, T["r_spool"]] / P.t[:, T["ratio"]]
    hold = tq.copy()
    mem, x0, obs, effort = np.zeros((m, 7)), np.zeros((m, 2)), np.zeros((2, m)), np.zeros(m)
    keep = np.exp(-step / P.t[:, T["lag"]])
    out = dict(motor_position=np.zeros((S, m)), torque=np.zeros((S, m)), tension_motor=np.zeros((S, m)),
               tension_base=np.zeros((S, m)), tip=np.zeros((S, 3)), rotation=np.zeros((S, 3, 3)), q=np.zeros((S, 2 * n)),
               spread=np.zeros(S))
    sub = int(round(dt_row / step))
    for r in range(S):
        goal = np.clip(targets_Nm[r - 1] if r >= 1 else hold, -P.t[:, T["limit"]], P.t[:, T["limit"]])
        for s in range(sub):
            # kinematics of the present state belong to data since mj_step1
            mujoco.mj_step1(model, data)
            laws(P, data.qpos[:m], data.qvel[:m], tq, rest - data.ten_length, -data.ten_velocity, mem, x0, obs, effort)
            if s == 0:
                out["motor_position"][r], out["torque"][r] = data.qpos[:m], tq
                out["tension_motor"][r], out["tension_base"][r] = obs[0], obs[1]
                out["tip"][r] = data.site_xpos[tip]
                out["rotation"][r] = data.site_xmat[tip].reshape(3, 3)
                for k, of in enumerate(hinges):
                    out["q"][r, k] = sum(data.qpos[at] for at, _ in of)
                    bends = [data.qpos[at] / share for at, share in of]
                    out["spread"][r] = max(out["spread"][r], max(bends) - min(bends))
            data.ctrl[:] = -obs[1]
            data.qfrc_applied[:m] = effort if disturb_Nm is None else effort + disturb_Nm[r]
            mujoco.mj_step2(model, data)
            tq = goal + (tq - goal) * keep
    return out
