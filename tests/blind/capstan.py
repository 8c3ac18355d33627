# Tension across a guide pulley by the improved Capstan equation, solved with scipy and kept as tables.
# Knows nothing of motors or bodies.
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

GRID = 320
LOG_HIGH = np.log(60.0)


def pull(tension_base_N, wrap_rad, radius_ratio, alpha, exponent, law="cumulative", entry_rad=0.0):
    """Motor-side tension for a robot-side tension while the motor pulls (array in, array out)."""
    T1 = np.atleast_1d(np.asarray(tension_base_N, float))
    rho, n = radius_ratio, exponent
    if law == "classic":
        return T1 * np.exp(alpha * wrap_rad)
    out = np.empty_like(T1)
    c = ((1 + rho) / (alpha * rho)) ** (1 / n)

    def cumulative(_, y):
        return [y[1], rho * y[0] - rho / n * c * max(y[0], 0.0) ** ((1 - n) / n) * y[1]]

    def local(_, y):
        return [y[1], rho * y[0] - rho * c * max(y[1], 0.0) ** (1 / n)]

    for i, t in enumerate(T1):
        y0 = [t * np.cos(entry_rad), rho * t * np.sin(entry_rad)]
        sol = solve_ivp(cumulative if law == "cumulative" else local, (0, wrap_rad), y0, method="LSODA",
                        rtol=1e-10, atol=1e-12)
        out[i] = sol.y[0, -1]
    return out


def tables(pulley, low_N):
    """(forward, inverse): each (x0, dx, values, slopes) of log(ratio) over log(tension), as one (2, GRID, 2)
    array and (2, 2) array of x0, dx. Forward is over robot-side, inverse over motor-side tension."""
    x = np.linspace(np.log(low_N), LOG_HIGH, GRID)
    T = np.exp(x)
    F = pull(T, **pulley)
    spline = CubicSpline(x, np.log(F / T))
    y = np.log(F)
    xi = np.linspace(y[0], LOG_HIGH, GRID)
    # invert log F by Newton on the smooth forward spline
    back = np.interp(xi, y, x)
    for _ in range(60):
        f = back + spline(back) - xi
        back = back - f / (1 + spline(back, 1))
    inverse = CubicSpline(xi, back - xi)
    val = np.zeros((2, GRID, 2))
    axis = np.zeros((2, 2))
    val[0, :, 0], val[0, :, 1] = spline(x), spline(x, 1)
    val[1, :, 0], val[1, :, 1] = inverse(xi), inverse(xi, 1)
    axis[0] = x[0], x[1] - x[0]
    axis[1] = xi[0], xi[1] - xi[0]
    return val, axis
