# The rig as a Lagrangian system in numba: constant-curvature units, straight tendons, and the friction of each part.
# Written from the rig's description alone; planted mechanisms are switched on by nonzero entries of the tables.
# body_dynamics, rates and run are long because each is one compiled loop: numba hands few arrays, not objects, between
# functions, and a split would pass twenty of them.
import math
from collections import namedtuple

import numpy as np
from numba import njit

from tests.blind import capstan

# ---- tables of numbers. Rows: tendons / units; one array for the robot. ----
TENDON = ("k c e0 r_spool growth ratio eff J coulomb coulomb_angle coulomb_micro viscous lag delay limit kt "
          "gear_y1 gear_y2 presliding low_N dc_extra stribeck_Nm stribeck_w cogging_Nm cogging_n cogging_phase "
          "backlash pulley_N creep1 creep_t1 creep2 creep_t2 slack thermal thermal_tau cross ripple ripple_n "
          "fixture_m ecc ecc_n stiffening route_mu sag").split()
UNIT = ("l m Ixx Izz kb c u0 v0 twist hyst hyst_y soft soft_theta visc visc_tau").split()
ROBOT = "gx gy gz fx fy fz base_c axial wall_x wall_y wall_z wall_n wall_k route_y twist_k".split()
T = {name: i for i, name in enumerate(TENDON)}
U = {name: i for i, name in enumerate(UNIT)}
G = {name: i for i, name in enumerate(ROBOT)}
for _n, _i in T.items():
    globals()["T_" + _n] = _i
for _n, _i in U.items():
    globals()["U_" + _n] = _i
for _n, _i in G.items():
    globals()["G_" + _n] = _i

LOW, FAST = 0.15, 40.0  # N, rad/s
PLAYS = 6  # elements of each Prandtl-Ishlinskii operator of the planted laws

Plant = namedtuple("Plant", "t u g hole_x hole_y rest cap_val cap_axis")  # rest: straight lengths of the straight robot


@njit(cache=True, error_model="numpy")
def cap(val, axis, which, tension):
    """Ratio-preserving below the first grid point; which 0: robot side -> motor side, 1: the inverse."""
    if tension <= 0.0:
        return 0.0
    x = math.log(tension)
    s = (x - axis[which, 0]) / axis[which, 1]
    n = val.shape[1]
    if s <= 0.0:
        return tension * math.exp(val[which, 0, 0])
    i = int(s)
    if i > n - 2:
        i = n - 2
        s = min(s, float(n - 1))
    a = s - i
    h = axis[which, 1]
    a2 = a * a
    a3 = a2 * a
    r = ((2 * a3 - 3 * a2 + 1) * val[which, i, 0] + (a3 - 2 * a2 + a) * h * val[which, i, 1]
         + (-2 * a3 + 3 * a2) * val[which, i + 1, 0] + (a3 - a2) * h * val[which, i + 1, 1])
    return tension * math.exp(r)


@njit(cache=True, error_model="numpy", inline="always")
def clip(x, y):
    return min(max(x, -y), y)


@njit(cache=True, error_model="numpy")
def arc(u, v, l, p, R, JL, dpu, dpv):
    """One constant-curvature unit: position, rotation exp(hat(-v, u, 0)), left Jacobian of the rotation vector and
    the derivatives of the position."""
    t2 = u * u + v * v
    if t2 < 1e-4:
        A = 0.5 - t2 / 24 + t2 * t2 / 720          # (1 - cos)/t2
        S = 1 - t2 / 6 + t2 * t2 / 120             # sin/t
        B = 1.0 / 6 - t2 / 120 + t2 * t2 / 5040    # (t - sin)/t3
        Ad = -1.0 / 12 + t2 / 180                  # (1/t) dA/dt
    else:
        t = math.sqrt(t2)
        A = (1 - math.cos(t)) / t2
        S = math.sin(t) / t
        B = (1 - S) / t2
        Ad = (S - 2 * A) / t2
    Sd = B - A  # (1/t) dS/dt = (cos t - S)/t2 = (1 - t2 A - S)/t2
    p[0] = l * A * u
    p[1] = l * A * v
    p[2] = l * S
    dpu[0] = l * (A + Ad * u * u)
    dpu[1] = l * Ad * u * v
    dpu[2] = l * Sd * u
    dpv[0] = l * Ad * u * v
    dpv[1] = l * (A + Ad * v * v)
    dpv[2] = l * Sd * v
    a = -v
    b = u
    # R = I + S hat + A hat^2, hat of (a, b, 0)
    R[0, 0] = 1 - A * b * b
    R[0, 1] = A * a * b
    R[0, 2] = S * b
    R[1, 0] = A * a * b
    R[1, 1] = 1 - A * a * a
    R[1, 2] = -S * a
    R[2, 0] = -S * b
    R[2, 1] = S * a
    R[2, 2] = 1 - A * t2
    JL[0, 0] = 1 - B * b * b
    JL[0, 1] = B * a * b
    JL[0, 2] = A * b
    JL[1, 0] = B * a * b
    JL[1, 1] = 1 - B * a * a
    JL[1, 2] = -A * a
    JL[2, 0] = -A * b
    JL[2, 1] = A * a
    JL[2, 2] = 1 - B * t2


@njit(cache=True, error_model="numpy")
def base_rotation(R, tx, ty):
    a = math.sqrt(tx * tx + ty * ty)
    A = 0.5
    S = 1.0
    if a > 1e-9:
        A = (1 - math.cos(a)) / (a * a)
        S = math.sin(a) / a
    R[0, 0] = 1 - A * ty * ty
    R[0, 1] = A * tx * ty
    R[0, 2] = S * ty
    R[1, 0] = A * tx * ty
    R[1, 1] = 1 - A * tx * tx
    R[1, 2] = -S * tx
    R[2, 0] = -S * ty
    R[2, 1] = S * tx
    R[2, 2] = 1 - A * a * a


@njit(cache=True, error_model="numpy")
def chain(P, q, tx, ty, lengths, twists, pos, rot, pl, Rl, JL, dpu, dpv):
    """Frames 0..N in the world (pos, rot), and each unit's own p, R and derivatives."""
    n = lengths.shape[0]
    base_rotation(rot[0], tx, ty)
    pos[0, :] = 0.0
    for i in range(n):
        arc(q[i], q[n + i], lengths[i], pl[i], Rl[i], JL[i], dpu[i], dpv[i])
        tw = twists[i]
        if tw != 0.0:
            c = math.cos(tw)
            s = math.sin(tw)
            for r in range(3):
                x = Rl[i, r, 0]
                y = Rl[i, r, 1]
                Rl[i, r, 0] = x * c + y * s
                Rl[i, r, 1] = -x * s + y * c
        for r in range(3):
            pos[i + 1, r] = (pos[i, r] + rot[i, r, 0] * pl[i, 0] + rot[i, r, 1] * pl[i, 1] + rot[i, r, 2] * pl[i, 2])
            for c2 in range(3):
                rot[i + 1, r, c2] = (rot[i, r, 0] * Rl[i, 0, c2] + rot[i, r, 1] * Rl[i, 1, c2]
                                     + rot[i, r, 2] * Rl[i, 2, c2])


@njit(cache=True, error_model="numpy")
def straight(P, pl, Rl, JL, dpu, dpv, L, dL):
    """Straight tendon length in each unit L[i, j] and its derivatives dL[i, j, 0:2] by (u_i, v_i)."""
    n = pl.shape[0]
    m = P.t.shape[0]
    for i in range(n):
        for j in range(m):
            hx = P.hole_x[i + 1, j]
            hy = P.hole_y[i + 1, j]
            x = Rl[i, 0, 0] * hx + Rl[i, 0, 1] * hy
            y = Rl[i, 1, 0] * hx + Rl[i, 1, 1] * hy
            z = Rl[i, 2, 0] * hx + Rl[i, 2, 1] * hy
            cx = pl[i, 0] + x - P.hole_x[i, j]
            cy = pl[i, 1] + y - P.hole_y[i, j]
            cz = pl[i, 2] + z
            d = math.sqrt(cx * cx + cy * cy + cz * cz)
            L[i, j] = d
            for k in range(2):
                if k == 0:
                    wx = JL[i, 0, 1]
                    wy = JL[i, 1, 1]
                    wz = JL[i, 2, 1]
                    ex = dpu[i, 0]
                    ey = dpu[i, 1]
                    ez = dpu[i, 2]
                else:
                    wx = -JL[i, 0, 0]
                    wy = -JL[i, 1, 0]
                    wz = -JL[i, 2, 0]
                    ex = dpv[i, 0]
                    ey = dpv[i, 1]
                    ez = dpv[i, 2]
                ex += wy * z - wz * y
                ey += wz * x - wx * z
                ez += wx * y - wy * x
                dL[i, j, k] = (ex * cx + ey * cy + ez * cz) / d


@njit(cache=True, error_model="numpy")
def body_dynamics(P, q, dq, Q, lengths, twists, tx, ty, fx, fy, fz, W, gh, first, ddq):
    """Accelerations of the chain under generalised forces Q (tendons and elasticity) with gravity, a tip force and
    the wall. The mass matrix comes from the Jacobians of the disks; velocity products from the second difference of
    the disks' frames along dq. Returns the Rosenbrock increment (M + gh C)^-1 (force - 2 M first), C the bending
    damping: with gh = 0 and first = 0 the acceleration itself."""
    pos, rot, pl, Rl, JL, dpu, dpv, pa, ra, pb, rb, pl2, Rl2, JL2, dpu2, dpv2, Jp, Jw, M, f, qa, col = W
    n = lengths.shape[0]
    nd = 2 * n
    eps = 1e-4
    for k in range(nd):
        qa[k] = q[k] + eps * dq[k]
    chain(P, qa, tx, ty, lengths, twists, pa, ra, pl2, Rl2, JL2, dpu2, dpv2)
    for k in range(nd):
        qa[k] = q[k] - eps * dq[k]
    chain(P, qa, tx, ty, lengths, twists, pb, rb, pl2, Rl2, JL2, dpu2, dpv2)
    ie2 = 1.0 / (eps * eps)
    for a in range(nd):
        f[a] = Q[a]
        for b in range(a + 1):
            M[a, b] = 0.0
    # angular columns of each unit in the world
    for k in range(n):
        for r in range(3):
            su = 0.0
            sv = 0.0
            pu = 0.0
            pv = 0.0
            for c in range(3):
                su += rot[k, r, c] * JL[k, c, 1]
                sv -= rot[k, r, c] * JL[k, c, 0]
                pu += rot[k, r, c] * dpu[k, c]
                pv += rot[k, r, c] * dpv[k, c]
            Jw[k, r] = su
            Jw[n + k, r] = sv
            Jp[k, r] = pu
            Jp[n + k, r] = pv
    wall = P.g[G_wall_k]
    for i in range(n):
        m = P.u[i, U_m]
        ix = P.u[i, U_Ixx]
        iz = P.u[i, U_Izz]
        # world inertia ix I + (iz - ix) z z'
        zx = rot[i + 1, 0, 2]
        zy = rot[i + 1, 1, 2]
        zz = rot[i + 1, 2, 2]
        # velocity-product accelerations
        ax = (pa[i + 1, 0] - 2 * pos[i + 1, 0] + pb[i + 1, 0]) * ie2
        ay = (pa[i + 1, 1] - 2 * pos[i + 1, 1] + pb[i + 1, 1]) * ie2
        az = (pa[i + 1, 2] - 2 * pos[i + 1, 2] + pb[i + 1, 2]) * ie2
        a21 = 0.0
        a02 = 0.0
        a10 = 0.0
        for c in range(3):
            d0 = (ra[i + 1, 0, c] - 2 * rot[i + 1, 0, c] + rb[i + 1, 0, c]) * ie2
            d1 = (ra[i + 1, 1, c] - 2 * rot[i + 1, 1, c] + rb[i + 1, 1, c]) * ie2
            d2 = (ra[i + 1, 2, c] - 2 * rot[i + 1, 2, c] + rb[i + 1, 2, c]) * ie2
            a21 += d2 * rot[i + 1, 1, c] - d1 * rot[i + 1, 2, c]
            a02 += d0 * rot[i + 1, 2, c] - d2 * rot[i + 1, 0, c]
            a10 += d1 * rot[i + 1, 0, c] - d0 * rot[i + 1, 1, c]
        bx = 0.5 * a21
        by = 0.5 * a02
        bz = 0.5 * a10
        wx = 0.0
        wy = 0.0
        wz = 0.0
        for k in range(i + 1):
            wx += Jw[k, 0] * dq[k] + Jw[n + k, 0] * dq[n + k]
            wy += Jw[k, 1] * dq[k] + Jw[n + k, 1] * dq[n + k]
            wz += Jw[k, 2] * dq[k] + Jw[n + k, 2] * dq[n + k]
        # I w and I b
        d = (iz - ix) * (zx * wx + zy * wy + zz * wz)
        hx = ix * wx + d * zx
        hy = ix * wy + d * zy
        hz = ix * wz + d * zz
        d = (iz - ix) * (zx * bx + zy * by + zz * bz)
        tx_ = -(ix * bx + d * zx) - (wy * hz - wz * hy)
        ty_ = -(ix * by + d * zy) - (wz * hx - wx * hz)
        tz_ = -(ix * bz + d * zz) - (wx * hy - wy * hx)
        Fx = m * (P.g[G_gx] - ax)
        Fy = m * (P.g[G_gy] - ay)
        Fz = m * (P.g[G_gz] - az)
        if i == n - 1:
            Fx += fx
            Fy += fy
            Fz += fz
        if wall > 0.0:
            pen = (P.g[G_wall_x] * pos[i + 1, 0] + P.g[G_wall_y] * pos[i + 1, 1] + P.g[G_wall_z] * pos[i + 1, 2]
                   - P.g[G_wall_n])
            if pen > 0.0:
                vel = 0.0
                for k in range(i + 1):
                    for s in range(2):
                        c = k + s * n
                        rx = pos[i + 1, 0] - pos[k, 0]
                        ry = pos[i + 1, 1] - pos[k, 1]
                        rz = pos[i + 1, 2] - pos[k, 2]
                        # the column of this disk: base point moves with Jp, the rest turns
                        ox = rx - (pos[k + 1, 0] - pos[k, 0])
                        oy = ry - (pos[k + 1, 1] - pos[k, 1])
                        oz = rz - (pos[k + 1, 2] - pos[k, 2])
                        jx = Jp[c, 0] + Jw[c, 1] * oz - Jw[c, 2] * oy
                        jy = Jp[c, 1] + Jw[c, 2] * ox - Jw[c, 0] * oz
                        jz = Jp[c, 2] + Jw[c, 0] * oy - Jw[c, 1] * ox
                        vel += (P.g[G_wall_x] * jx + P.g[G_wall_y] * jy + P.g[G_wall_z] * jz) * dq[c]
                force = wall * math.sqrt(pen) * pen / math.sqrt(1e-3) * (1 + 0.5 * vel)   # Hunt and Crossley
                force = max(force, 0.0)
                Fx -= force * P.g[G_wall_x]
                Fy -= force * P.g[G_wall_y]
                Fz -= force * P.g[G_wall_z]
        for k in range(i + 1):
            ox = pos[i + 1, 0] - pos[k + 1, 0]
            oy = pos[i + 1, 1] - pos[k + 1, 1]
            oz = pos[i + 1, 2] - pos[k + 1, 2]
            for h in range(2):
                a = k + h * n
                w0 = Jw[a, 0]
                w1 = Jw[a, 1]
                w2 = Jw[a, 2]
                jx = Jp[a, 0] + w1 * oz - w2 * oy
                jy = Jp[a, 1] + w2 * ox - w0 * oz
                jz = Jp[a, 2] + w0 * oy - w1 * ox
                f[a] += jx * Fx + jy * Fy + jz * Fz + w0 * tx_ + w1 * ty_ + w2 * tz_
                d = (iz - ix) * (zx * w0 + zy * w1 + zz * w2)
                col[a, 0] = jx
                col[a, 1] = jy
                col[a, 2] = jz
                col[a, 3] = ix * w0 + d * zx
                col[a, 4] = ix * w1 + d * zy
                col[a, 5] = ix * w2 + d * zz
        for k in range(i + 1):
            for h in range(2):
                a = k + h * n
                c0 = m * col[a, 0]
                c1 = m * col[a, 1]
                c2 = m * col[a, 2]
                c3 = col[a, 3]
                c4 = col[a, 4]
                c5 = col[a, 5]
                for g in range(h + 1):
                    for b in range(g * n, g * n + (k + 1 if g == h else i + 1)):
                        M[a, b] += (c0 * col[b, 0] + c1 * col[b, 1] + c2 * col[b, 2] + c3 * Jw[b, 0]
                                    + c4 * Jw[b, 1] + c5 * Jw[b, 2])
    if gh > 0.0:
        for a in range(nd):
            s = 0.0
            for b in range(nd):
                s += (M[a, b] if b <= a else M[b, a]) * first[b]
            f[a] -= 2 * s
        for i in range(n):
            M[i, i] += gh * P.u[i, U_c]
            M[n + i, n + i] += gh * P.u[i, U_c]
    # Cholesky in place
    for a in range(nd):
        for b in range(a + 1):
            s = M[a, b]
            for c in range(b):
                s -= M[a, c] * M[b, c]
            if a == b:
                M[a, a] = math.sqrt(s)
            else:
                M[a, b] = s / M[b, b]
    for a in range(nd):
        s = f[a]
        for c in range(a):
            s -= M[a, c] * ddq[c]
        ddq[a] = s / M[a, a]
    for a in range(nd - 1, -1, -1):
        s = ddq[a]
        for c in range(a + 1, nd):
            s -= M[c, a] * ddq[c]
        ddq[a] = s / M[a, a]


@njit(cache=True, error_model="numpy")
def work(n, m):
    nd = 2 * n
    return (np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)),
            np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3)),
            np.zeros((n + 1, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3)),
            np.zeros((n, 3)), np.zeros((nd, 3)), np.zeros((nd, 3)), np.zeros((nd, nd)), np.zeros(nd), np.zeros(nd),
            np.zeros((nd, 6)))


# Memory of hysteresis: each element keeps its value and the coordinate at the step's begin; within a step it is a
# function of the coordinate, exact while the motion does not turn round.
@njit(cache=True, error_model="numpy", inline="always")
def stop(w, x, x0, y):
    return clip(w + (x - x0), y)


@njit(cache=True, error_model="numpy", inline="always")
def dahl(z, x, x0, length):
    """Bristle of unit saturation after the motion from x0 to x."""
    d = x - x0
    if d >= 0:
        return 1 - (1 - z) * math.exp(-d / length)
    return -1 + (1 + z) * math.exp(d / length)


# State vector: u v du dv (4N), theta omega torque (3M), creep1 creep2 heat (3M), base tilt rotation (2), viscoelastic u v (2N)
@njit(cache=True, error_model="numpy")
def rates(P, y, x0, mem, target, force, W, L, dL, Q, T_unit, gh, first, y_dot, obs, commit):
    """y_dot; obs rows: motor-side tension, base tension, spool displacement s, body displacement d. mem: memories at
    the step's begin, replaced by their values here when `commit`. x0: coordinates at the step's begin (M x 4 + unit)."""
    n = P.u.shape[0]
    m = P.t.shape[0]
    nd = 2 * n
    g = P.g
    pos, rot, pl, Rl, JL, dpu, dpv = W[0], W[1], W[2], W[3], W[4], W[5], W[6]
    q = y[0:nd]
    dq = y[nd:2 * nd]
    th = y[2 * nd:2 * nd + m]
    om = y[2 * nd + m:2 * nd + 2 * m]
    tq = y[2 * nd + 2 * m:2 * nd + 3 * m]
    o = 2 * nd + 3 * m
    mt, mg, mp, mb, mr, mf, mu = mem
    lengths = np.empty(n)
    twists = np.empty(n)
    total = 0.0
    for j in range(m):
        total += obs[1, j]
    for i in range(n):
        lengths[i] = P.u[i, U_l] * (1 - g[G_axial] * total)
        twists[i] = P.u[i, U_twist]
    if g[G_twist_k] != 0.0:  # disks turn under the tendons' skew pull: proportional to u v difference of tensions
        for i in range(n):
            twists[i] += g[G_twist_k] * (q[i] * obs[1, 1 % m] - q[n + i] * obs[1, 0])
    tx = y[o + 3 * m]
    ty = y[o + 3 * m + 1]
    chain(P, q, tx, ty, lengths, twists, pos, rot, pl, Rl, JL, dpu, dpv)
    straight(P, pl, Rl, JL, dpu, dpv, L, dL)
    for a in range(nd):
        Q[a] = 0.0
    for k in range(y_dot.shape[0]):
        y_dot[k] = 0.0
    amps = 0.0
    for j in range(m):
        amps += abs(tq[j])
    for j in range(m):
        p = P.t[j]
        d = 0.0
        dd = 0.0
        for i in range(n):
            d += P.rest[i, j] - L[i, j]
            dd -= dL[i, j, 0] * dq[i] + dL[i, j, 1] * dq[n + i]
        # motor -> spool: nominal is rigid; planted backlash is a distribution of plays
        theta = th[j]
        rate = 1.0
        if p[T_backlash] > 0.0:
            acc = 0.0
            slope = 0.0
            for k in range(PLAYS):
                half = 0.5 * p[T_backlash] * (0.7 + 0.6 * k / (PLAYS - 1))
                b = mb[j, k]
                if theta - b > half:
                    b = theta - half
                    slope += 1.0
                elif theta - b < -half:
                    b = theta + half
                    slope += 1.0
                if commit:
                    mb[j, k] = b
                acc += b
            theta = acc / PLAYS + 0.5 * p[T_backlash]
            rate = slope / PLAYS
        s = p[T_r_spool] * theta / p[T_ratio]
        sd = p[T_r_spool] * om[j] * rate / p[T_ratio]
        arm = p[T_r_spool]
        if p[T_growth] != 0.0:  # radius gained per radian of the spool
            arm += p[T_growth] * theta / p[T_ratio]
            s += 0.5 * p[T_growth] * (theta / p[T_ratio]) ** 2
            sd = arm * om[j] * rate / p[T_ratio]
        if p[T_ecc] != 0.0:
            s += p[T_ecc] * (math.sin(p[T_ecc_n] * theta / p[T_ratio]) )
            sd += p[T_ecc] * math.cos(p[T_ecc_n] * theta / p[T_ratio]) * p[T_ecc_n] * om[j] * rate / p[T_ratio]
        e = s - d + p[T_e0] - y[o + j] - y[o + m + j] - p[T_slack]
        # the tendon and its creep (two Kelvin-Voigt elements in series)
        ed = sd - dd
        if p[T_creep1] > 0.0 or p[T_creep2] > 0.0:
            c1 = (p[T_creep1] * (obs[0, j] - 0.3) - y[o + j]) / p[T_creep_t1]
            c2 = (p[T_creep2] * (obs[0, j] - 0.3) - y[o + m + j]) / p[T_creep_t2]
            y_dot[o + j] = c1
            y_dot[o + m + j] = c2
            ed -= c1 + c2
        if p[T_fixture_m] > 0.0:  # the fixture gives way with play: hysteresis in the tendon's path
            acc = 0.0
            for k in range(PLAYS):
                yk = 1.5 * (k + 1) / PLAYS
                w = stop(mf[j, k], obs[0, j], x0[j, 3], yk)
                if commit:
                    mf[j, k] = w
                acc += w / yk
            e -= p[T_fixture_m] * acc / PLAYS
        k_t = p[T_k]
        if p[T_stiffening] != 0.0 and e > 0:
            k_t = p[T_k] * (1 + p[T_stiffening] * (k_t * e / (1 + k_t * e) - 0.3 / 1.3))
        Tm = max(0.0, k_t * e + p[T_c] * ed)
        # the pulley, four stop operators of the sliding coordinate half way
        x = 0.5 * (s + d)
        z = 0.0
        for k in range(4):
            yk = p[T_presliding] * 0.25 * (k + 1)
            w = stop(mp[j, k], x, x0[j, 1], yk)
            if commit:
                mp[j, k] = w
            z += 0.25 * w / yk
        Tb = (0.5 * (1 + z) * cap(P.cap_val[j], P.cap_axis[j], 1, Tm)
              + 0.5 * (1 - z) * cap(P.cap_val[j], P.cap_axis[j], 0, Tm))
        if p[T_pulley_N] != 0.0:
            zz = dahl(mp[j, 4], x, x0[j, 1], 0.6 * p[T_presliding])
            if commit:
                mp[j, 4] = zz
            Tb = max(0.0, Tb - p[T_pulley_N] * zz * min(1.0, Tm / 0.2))
        if p[T_cross] != 0.0:  # rubbing of this tendon on its neighbour
            jn = (j + 1) % m
            zz = dahl(mp[j, 5], d, x0[j, 2], 3e-5)
            if commit:
                mp[j, 5] = zz
            Tb = max(0.0, Tb - p[T_cross] * zz * obs[1, jn])
        obs[0, j] = Tm
        obs[2, j] = s
        obs[3, j] = d
        # motor friction: Dahl with micro-damping, viscous, and the planted extras
        zeta = dahl(mt[j, 0], th[j], x0[j, 0], p[T_coulomb_angle])
        if commit:
            mt[j, 0] = zeta
        zdot = (om[j] - abs(om[j]) * zeta) / p[T_coulomb_angle]
        fric = p[T_coulomb] * zeta + p[T_coulomb_micro] * zdot + p[T_viscous] * om[j]
        if p[T_dc_extra] != 0.0:  # more (or less) Coulomb friction by Maxwell slip
            acc = 0.0
            for k in range(4):
                yk = (0.002, 0.004, 0.007, 0.012)[k]
                w = stop(mt[j, 1 + k], th[j], x0[j, 0], yk)
                if commit:
                    mt[j, 1 + k] = w
                acc += w / yk
            fric += p[T_dc_extra] * acc * 0.25
        if p[T_stribeck_Nm] != 0.0:  # LuGre bristle whose strength falls with speed
            gw = p[T_stribeck_Nm] * math.exp(-(om[j] / p[T_stribeck_w]) ** 2)
            zz = dahl(mt[j, 5], th[j], x0[j, 0], 0.005)
            if commit:
                mt[j, 5] = zz
            fric += gw * zz + 0.05 * p[T_stribeck_Nm] / 0.005 * 1e-3 * (om[j] - abs(om[j]) * zz)
        if p[T_cogging_Nm] != 0.0:  # notches with a second harmonic
            fric += p[T_cogging_Nm] * (math.sin(p[T_cogging_n] * th[j] + p[T_cogging_phase])
                                       + 0.25 * math.sin(2 * p[T_cogging_n] * th[j] + 1.3 + p[T_cogging_phase]))
        # gear
        z1 = stop(mg[j, 0], th[j], x0[j, 0], p[T_gear_y1])
        z2 = stop(mg[j, 1], th[j], x0[j, 0], p[T_gear_y2])
        if commit:
            mg[j, 0] = z1
            mg[j, 1] = z2
        zg = 0.5 * (z1 / p[T_gear_y1] + z2 / p[T_gear_y2])
        load = Tm * arm / p[T_ratio] * p[T_eff] ** (-zg)
        push = p[T_kt] * tq[j] + force[3 + j]
        if p[T_thermal] != 0.0:
            push *= 1 - y[o + 2 * m + j]
            y_dot[o + 2 * m + j] = (p[T_thermal] * (tq[j] / 3e-3) ** 2 - y[o + 2 * m + j]) / p[T_thermal_tau]
        if p[T_sag] != 0.0:
            push *= 1 - p[T_sag] * amps / 5e-3
        if p[T_ripple] != 0.0:
            push *= 1 + p[T_ripple] * math.sin(p[T_ripple_n] * th[j])
        y_dot[2 * nd + j] = om[j]
        y_dot[2 * nd + m + j] = (push - fric - load) / p[T_J]
        y_dot[2 * nd + 2 * m + j] = (target[j] - tq[j]) / p[T_lag]
        # routing: the tension may fall from disk to disk
        if p[T_route_mu] != 0.0:
            cur = Tb
            for i in range(n):
                # turn between this chord and the one before, at disk i (the base plate first)
                ux = q[i] if i == 0 else 0.5 * (q[i] + q[i - 1])
                vx = q[n + i] if i == 0 else 0.5 * (q[n + i] + q[n + i - 1])
                if i == 0:
                    ux *= 0.5
                    vx *= 0.5
                wrap = math.sqrt(ux * ux + vx * vx)
                move = 0.0
                for k in range(i, n):
                    move += P.rest[k, j] - L[k, j]
                zz = 0.0
                for k in range(3):
                    yk = g[G_route_y] * (0.4, 0.9, 1.7)[k]
                    w = stop(mr[j, i, k], move, mr[j, i, 3], yk)
                    if commit:
                        mr[j, i, k] = w
                    zz += w / yk / 3
                if commit:
                    mr[j, i, 3] = move
                cur = cur * math.exp(-p[T_route_mu] * wrap * zz)
                T_unit[i, j] = cur
        else:
            for i in range(n):
                T_unit[i, j] = Tb
        obs[1, j] = Tb
        if commit:
            x0[j, 0] = th[j]
            x0[j, 1] = x
            x0[j, 2] = d
            x0[j, 3] = Tm
    for j in range(m):
        for i in range(n):
            Q[i] -= T_unit[i, j] * dL[i, j, 0]
            Q[n + i] -= T_unit[i, j] * dL[i, j, 1]
    vo = o + 3 * m + 2
    for i in range(n):
        b = P.u[i]
        ku = b[U_kb]
        if b[U_soft] != 0.0:  # plateau: tangent stiffness falls beyond soft_theta
            th2 = q[i] ** 2 + q[n + i] ** 2
            r = math.sqrt(th2) / b[U_soft_theta]
            ku *= 1 - b[U_soft] * r ** 4 / (1 + r ** 4)
        Q[i] -= ku * (q[i] - b[U_u0]) + b[U_c] * dq[i]
        Q[n + i] -= ku * (q[n + i] - b[U_v0]) + b[U_c] * dq[n + i]
        if b[U_hyst] != 0.0:  # Prandtl-Ishlinskii: stops with yields from an eighth to three times hyst_y
            for s in range(2):
                acc = 0.0
                for k in range(PLAYS):
                    yk = b[U_hyst_y] * (0.125, 0.25, 0.5, 1.0, 1.75, 3.0)[k]
                    w = stop(mu[i, s, k], q[s * n + i], mu[i, s, PLAYS], yk)
                    if commit:
                        mu[i, s, k] = w
                    acc += w / yk
                if commit:
                    mu[i, s, PLAYS] = q[s * n + i]
                Q[s * n + i] -= b[U_hyst] * acc / PLAYS
        if b[U_visc] != 0.0:  # a Maxwell arm: stiffness visc x kb, relaxing
            for s in range(2):
                dev = q[s * n + i] - y[vo + s * n + i]
                Q[s * n + i] -= b[U_visc] * b[U_kb] * dev
                y_dot[vo + s * n + i] = dev / b[U_visc_tau]
    fx = g[G_fx] + force[0]
    fy = g[G_fy] + force[1]
    fz = g[G_fz] + force[2]
    body_dynamics(P, q, dq, Q, lengths, twists, tx, ty, fx, fy, fz, W, gh, first, y_dot[nd:2 * nd])
    if g[G_base_c] > 0.0:  # the base leans with the moment of the first unit, within 20 ms
        y_dot[o + 3 * m] = (-g[G_base_c] * P.u[0, U_kb] * q[n] - y[o + 3 * m]) / 0.02
        y_dot[o + 3 * m + 1] = (g[G_base_c] * P.u[0, U_kb] * q[0] - y[o + 3 * m + 1]) / 0.02
    for k in range(nd):
        y_dot[k] = dq[k]


@njit(cache=True, error_model="numpy")
def run(P, targets, start_torque, force, sub, dt_row, y, x0, mem):
    """targets: S x M, sent at row k, acting at row k + 1. Returns rows at the row times: motor angle, motor torque
    (of the current), motor-side tension, base tension, tip position, tip rotation, and (u, v)."""
    S = targets.shape[0]
    n = P.u.shape[0]
    m = P.t.shape[0]
    nd = 2 * n
    W = work(n, m)
    L = np.zeros((n, m))
    dL = np.zeros((n, m, 2))
    Q = np.zeros(nd)
    TU = np.zeros((n, m))
    obs = np.zeros((4, m))
    ny = y.shape[0]
    k1 = np.zeros(ny)
    k2 = np.zeros(ny)
    none = np.zeros(nd)
    yy = np.zeros(ny)
    tgt = np.zeros(m)
    out_th = np.zeros((S, m))
    out_tq = np.zeros((S, m))
    out_tm = np.zeros((S, m))
    out_tb = np.zeros((S, m))
    out_p = np.zeros((S, 3))
    out_R = np.zeros((S, 3, 3))
    out_q = np.zeros((S, nd))
    for j in range(m):
        obs[0, j] = 0.3
        obs[1, j] = 0.3
    dt = dt_row / sub
    gh = (1 - math.sqrt(0.5)) * dt
    fine = False
    # twice: tensions enter some planted laws with their last value
    rates(P, y, x0, mem, tgt, force[0], W, L, dL, Q, TU, gh, none, k1, obs, False)
    rates(P, y, x0, mem, tgt, force[0], W, L, dL, Q, TU, gh, none, k1, obs, False)
    for r in range(S):
        for j in range(m):
            out_th[r, j] = y[2 * nd + j]
            out_tq[r, j] = y[2 * nd + 2 * m + j]
            out_tm[r, j] = obs[0, j]
            out_tb[r, j] = obs[1, j]
        out_p[r] = W[0][n]
        out_R[r] = W[1][n]
        out_q[r] = y[:nd]
        # the pulley's ratio is steep at low tension, where the body's side of the tendon is stiffest: shorter steps
        fast = False
        for j in range(m):
            if obs[0, j] < LOW or abs(y[2 * nd + m + j]) > FAST:
                fast = True
        if fast != fine:
            fine = fast
            dt = dt_row / sub * (0.5 if fast else 1.0)
            gh = (1 - math.sqrt(0.5)) * dt
            # k1 holds the increment of the step's old length
            rates(P, y, x0, mem, tgt, force[r], W, L, dL, Q, TU, gh, none, k1, obs, False)
        steps = 2 * sub if fine else sub
        for s in range(steps):
            t = (r + s / steps) * dt_row
            for j in range(m):
                # The target sent at row k acts from row k + 1 on, later still by the planted delay; over a step it is the mean
                # of what acts in it, so that a delay of a part of a step is one.
                ago = (t - P.t[j, T_delay]) / dt_row + 1e-9
                k = int(math.floor(ago)) - 1
                w = start_torque[j] if k < 0 else targets[k, j]
                into = ago - math.floor(ago) + 1 / steps - 1  # beyond the next row's beginning, in rows
                if P.t[j, T_delay] > 0 and into > 1e-6:
                    w += into * steps * ((start_torque[j] if k < -1 else targets[min(k + 1, S - 1), j]) - w)
                tgt[j] = clip(w, P.t[j, T_limit])
            f = force[r]
            # Rosenbrock of order 2 (damping of the bending implicit, all else explicit); k1 is left by the last step
            for j in range(m):
                k1[2 * nd + 2 * m + j] = (tgt[j] - y[2 * nd + 2 * m + j]) / P.t[j, T_lag]
            for i in range(ny):
                yy[i] = y[i] + dt * k1[i]
            rates(P, yy, x0, mem, tgt, f, W, L, dL, Q, TU, gh, k1[nd:2 * nd], k2, obs, False)
            for i in range(ny):
                y[i] += 0.5 * dt * (k1[i] + k2[i])
            for i in range(nd, 2 * nd):
                y[i] += dt * k1[i]
            rates(P, y, x0, mem, tgt, f, W, L, dL, Q, TU, gh, none, k1, obs, True)
    return out_th, out_tq, out_tm, out_tb, out_p, out_R, out_q


def numbers(tree):
    """YAML 1.1 reads 2.3e10 as text; make numbers of such leaves."""
    if isinstance(tree, dict):
        return {k: numbers(v) for k, v in tree.items()}
    if isinstance(tree, list):
        return [numbers(v) for v in tree]
    if isinstance(tree, str):
        try:
            return float(tree)
        except ValueError:
            return tree
    return tree


def nominal(robot):
    """Tables from a robot file (parsed YAML) of one section with motors all alike."""
    robot = numbers(robot)
    section = robot["body"]["sections"][0]
    a = robot["actuation"]
    n = section["units"]
    m = len(section["tendons"])
    t = np.zeros((m, len(TENDON)))
    kt = a["motor"]["torque_constant_NmpA"]
    pulley = a["transmission"]["pulleys"][0]
    per = dict(k=a["tendon"]["stiffness_Npm"], c=a["tendon"]["damping_Nspm"],
               e0=robot["limits"]["min_tension_N"] / a["tendon"]["stiffness_Npm"], r_spool=a["spool"]["radius_m"],
               ratio=a["gear"]["ratio"], eff=a["gear"]["efficiency"], J=a["motor"]["rotor_inertia_kgm2"],
               coulomb=a["motor"]["coulomb_friction_Nm"], coulomb_angle=a["motor"]["coulomb_angle_rad"],
               coulomb_micro=a["motor"]["coulomb_damping_Nms"], viscous=a["motor"]["viscous_friction_Nms"],
               lag=a["motor"]["torque_lag_s"], limit=a["drive"]["current_limit_A"] * kt, kt=1.0,
               gear_y1=a["gear"]["presliding_yields_rad"][0], gear_y2=a["gear"]["presliding_yields_rad"][1],
               presliding=a["transmission"]["presliding_m"], low_N=a["transmission"]["low_tension_N"],
               stribeck_w=8.0, cogging_n=12.0, creep_t1=3.0, creep_t2=25.0, thermal_tau=20.0, ripple_n=7.0,
               ecc_n=1.0)
    for key, value in per.items():
        t[:, T[key]] = value
    u = np.zeros((n, len(UNIT)))
    mass = section["unit_mass_kg"]
    d = section["disk_diameter_m"]
    l = section["unit_length_m"]
    EI = section["youngs_modulus_Pa"] * np.pi * section["core_radius_m"] ** 4 / 4
    for key, value in dict(l=l, m=mass, Ixx=mass * d * d / 16, Izz=mass * d * d / 8, kb=EI / l,
                           c=section["bending_damping_Nms"], hyst_y=0.05, soft_theta=0.3, visc_tau=1.0).items():
        u[:, U[key]] = value
    g = np.zeros(len(ROBOT))
    g[:3] = robot["body"]["gravity_W_mps2"]
    g[G["route_y"]] = 2e-5
    hole_r = np.array([[x["radius_m"] for x in section["tendons"]]] * (n + 1))
    hole_a = np.array([[x["angle_rad"] for x in section["tendons"]]] * (n + 1))
    pulleys = [dict(wrap_rad=pulley["wrap_rad"], radius_ratio=pulley["radius_ratio"], alpha=pulley["alpha"],
                    exponent=pulley["exponent"], law=pulley["law"], entry_rad=pulley["entry_angle_rad"])
               for _ in range(m)]
    return dict(t=t, u=u, g=g, hole_r=hole_r, hole_a=hole_a, pulleys=pulleys)


_tables = {}


def build(p):
    val, axis = [], []
    for j, pulley in enumerate(p["pulleys"]):
        key = (tuple(sorted(pulley.items())), p["t"][j, T["low_N"]])
        if key not in _tables:
            _tables[key] = capstan.tables(pulley, p["t"][j, T["low_N"]])
        val.append(_tables[key][0])
        axis.append(_tables[key][1])
    x, y = p["hole_r"] * np.cos(p["hole_a"]), p["hole_r"] * np.sin(p["hole_a"])
    rest = np.sqrt(p["u"][:, U["l"], None] ** 2 + np.diff(x, axis=0) ** 2 + np.diff(y, axis=0) ** 2)
    return Plant(p["t"].copy(), p["u"].copy(), p["g"].copy(), x, y, rest, np.array(val), np.array(axis))


def simulate(p, targets_Nm, force=None, sub=10, dt_row=1e-3):
    """Rows at 1 kHz of the plant under torque targets (S x M); from straight and at rest at pretension. force: S x
    (3 + M), a force at the tip and a torque at each motor's shaft."""
    P = build(p)
    n, m = P.u.shape[0], P.t.shape[0]
    S = len(targets_Nm)
    if force is None:
        force = np.zeros((S, 3 + m))
    y = np.zeros(4 * n + 6 * m + 2 + 2 * n)
    hold = np.full(m, 0.3) * P.t[:, T["r_spool"]] / P.t[:, T["ratio"]]
    y[4 * n + 2 * m:4 * n + 3 * m] = hold
    x0 = np.zeros((m, 4))
    x0[:, 3] = 0.3
    # planted backlash begins with the play taken up in the pulling direction
    plays = -0.5 * P.t[:, T["backlash"], None] * (0.7 + 0.6 * np.arange(PLAYS) / (PLAYS - 1))
    mem = (np.zeros((m, 6)), np.zeros((m, 2)), np.zeros((m, 6)), plays, np.zeros((m, n, 4)),
           np.zeros((m, PLAYS)), np.zeros((n, 2, PLAYS + 1)))
    th, tq, tm, tb, pos, rot, q = run(P, np.ascontiguousarray(targets_Nm), hold, force, sub, dt_row, y, x0, mem)
    return dict(motor_position=th, torque=tq, tension_motor=tm, tension_base=tb, tip=pos, rotation=rot, q=q)
