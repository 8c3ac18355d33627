"""Shares of cases, with how well they are known: gap_table and tests/blind count with it. Knows nothing of what is counted."""


def wilson(k, n, z=1.959964):
    """Share k of n with Wilson's 95 % interval; of no cases, nothing is known."""
    if n == 0:
        return float("nan"), 0.0, 1.0
    p = k / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    return p, max(0.0, middle - half), min(1.0, middle + half)
