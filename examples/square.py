#!/usr/bin/env python3
"""Draws a square with the tip: start `tendril sim` in another terminal, then this."""

import numpy as np

import tendril

side, height, per_side = 0.02, 0.0575, 20  # [m], [m above the base], targets a side
corners = side / 2 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]])
square = np.vstack([np.linspace(a, b, per_side, endpoint=False) for a, b in zip(corners, corners[1:])])

with tendril.Client() as client:  # disarms at the end, whatever happens
    client.arm()
    far = 0.0
    for x, y in [*square, (0, 0)]:  # a robot that is disarmed straight leaves no tendon slack
        client.send_tip([x, y, height])
        for state in client:
            if np.linalg.norm(state.bending_desired_rad - state.bending_target_rad) < 1e-3:
                break
        far = max(far, float(np.linalg.norm(state.tip_estimate_W_m[:2] - (x, y))))
print(f"square drawn; largest distance from it: {1e3 * far:.2f} mm")
