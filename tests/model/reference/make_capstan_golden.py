#!/usr/bin/env python3
"""Writes ../golden/capstan.csv: the improved Capstan equation in the paper's own variables, in 40 digits.

Shares nothing with the C++: T and T' themselves (not their logarithms), Taylor steps of order 30 from
power-series recurrences, no sensitivities, no SUNDIALS. At n = 1 the closed form is used instead.

    cumulative: T'' + (rho/n) K T^((1-n)/n) T' - rho T = 0,   K = ((1+rho)/(alpha rho))^(1/n)
    local:      T'' + rho ((1+rho) T' / (alpha rho))^(1/n) - rho T = 0
    T(0) = T1 cos(phi1),  T'(0) = rho T1 sin(phi1)

Needs mpmath (Debian: python3-mpmath).
"""
import csv
import os
import sys

import mpmath as mp

mp.mp.dps = 40
ORDER = 30


def taylor(T, D, law, n, rho, alpha):
    """Taylor coefficients of T about a point with value T and slope D."""
    factor = ((1 + rho) / (alpha * rho)) ** (1 / n)
    t = [T, D]
    if law == 'cumulative':
        # T'' + rho factor (T^(1/n))' - rho T = 0
        power = [T ** (1 / n)]
        for k in range(ORDER - 1):
            kk = k + 1
            total = mp.mpf(0)
            for j in range(1, kk + 1):
                total += (j / n - (kk - j)) * t[j] * power[kk - j]
            power.append(total / (kk * t[0]))
            t.append((rho * t[k] - rho * factor * (k + 1) * power[k + 1]) / ((k + 1) * (k + 2)))
        return t
    slope = [D]
    power = [D ** (1 / n)]
    for k in range(ORDER - 1):
        if k > 0:
            slope.append((k + 1) * t[k + 1])
            total = mp.mpf(0)
            for j in range(1, k + 1):
                total += (j / n - (k - j)) * slope[j] * power[k - j]
            power.append(total / (k * slope[0]))
        t.append((rho * t[k] - rho * factor * power[k]) / ((k + 1) * (k + 2)))
    return t


def start_local(T, rho, n, alpha, h):
    """The local law has no Taylor series at T' = 0: the first terms of its expansion in powers of h and h^(1/n), over
    an h so small that the next ones, of relative size h^(2/n), do not matter."""
    factor = ((1 + rho) / (alpha * rho)) ** (1 / n)
    c = rho * factor * (rho * T) ** (1 / n) / (1 / n + 1)
    D = rho * T * h + rho * rho * T * h ** 3 / 6 - c * h ** (1 / n + 1)
    V = T + rho * T * h ** 2 / 2 - c * h ** (1 / n + 2) / (1 / n + 2)
    return V, D


def closed_form(T1, rho, alpha, phi1, wrap):
    b = rho * (1 + rho) / (alpha * rho)
    r = mp.sqrt(b * b + 4 * rho)
    l1, l2 = (-b + r) / 2, (-b - r) / 2
    y, d = T1 * mp.cos(phi1), rho * T1 * mp.sin(phi1)
    c1 = (d - l2 * y) / (l1 - l2)
    return c1 * mp.exp(l1 * wrap) + (y - c1) * mp.exp(l2 * wrap)


def solve(T1, law, n, rho, alpha, phi1, wrap):
    if n == 1:
        return closed_form(T1, rho, alpha, phi1, wrap)
    T, D, at = T1 * mp.cos(phi1), rho * T1 * mp.sin(phi1), mp.mpf(0)
    if law == 'local' and D == 0:
        h = mp.mpf(10) ** -9
        T, D = start_local(T, rho, n, alpha, h)
        at = h
    tolerance = mp.mpf(10) ** -28
    while at < wrap:
        t = taylor(T, D, law, n, rho, alpha)
        # Step from the decay of the last two coefficients, relative to T.
        radius = min((tolerance * T / (abs(t[k]) + mp.mpf(10) ** -4000)) ** (mp.mpf(1) / k) for k in (ORDER - 1, ORDER))
        h = min(radius / 2, wrap - at)
        T = mp.polyval(t[::-1], h)
        D = mp.polyval([k * t[k] for k in range(ORDER, 0, -1)], h)
        at += h
    return T


def main():
    out = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'golden', 'capstan.csv')
    cases = []
    pi = '3.141592653589793'
    for law in ('cumulative', 'local'):
        for low in ('1e-9', '1e-4', '0.05', '1', '8'):
            cases.append((law, '0.67', '10', '0.466', '0', pi, low))        # the rig's pulley
        for n, rho, alpha in (('0.67', '1', '0.15'), ('0.67', '10', '0.6'), ('0.67', '1', '0.6'), ('0.9', '10', '0.15'),
                              ('0.5', '5', '0.3'), ('1', '1', '0.15'), ('1', '10', '0.6')):
            for low in ('0.3', '5'):
                cases.append((law, n, rho, alpha, '0', '2', low))
        cases.append((law, '0.67', '10', '0.466', '0.2', pi, '1'))            # entry angle
        cases.append((law, '1', '10', '0.466', '0.2', '1', '1'))
        cases.append((law, '0.67', '10', '0.466', '0', '0.01', '1'))         # hardly any wrap
    with open(out, 'w', newline='') as f:
        w = csv.writer(f, lineterminator='\n')
        w.writerow(['local', 'n', 'rho', 'alpha', 'phi1', 'wrap', 'low', 'high'])
        for law, n, rho, alpha, phi1, wrap, low in cases:
            high = solve(mp.mpf(low), law, mp.mpf(n), mp.mpf(rho), mp.mpf(alpha), mp.mpf(phi1), mp.mpf(wrap))
            w.writerow([int(law == 'local'), n, rho, alpha, phi1, wrap, low, mp.nstr(high, 20)])
            print(law, n, rho, alpha, phi1, wrap, low, mp.nstr(high, 20), file=sys.stderr)


if __name__ == '__main__':
    main()
