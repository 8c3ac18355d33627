"""Elastic tendons that pull and never push, through holes of the disks without friction: what both plants share. A
tendon begins at the base plate, runs straight from disk to disk, and ends at its section's last disk. Disks count from
0, base to tip."""

import numpy as np


def disk_heights(robot):
    """z of each disk of the straight robot [m]."""
    heights, base = [], 0.0
    for s in robot["sections"]:
        heights += [base + s["length_m"] * (d + 1) / s["disks"] for d in range(s["disks"])]
        base += s["length_m"]
    return np.array(heights)


def routes(robot):
    """Of each tendon: position of its hole in a disk, x and y [m], and the number of its last disk."""
    out, last = [], -1
    for s in robot["sections"]:
        last += s["disks"]
        out += [((lever * np.cos(angle), lever * np.sin(angle)), last) for angle, lever in s["holes"]]
    return out


def ways(robot, p, R):
    """Of each tendon the points that it passes, base first; p, R: the disks' positions (D x 3) and rotations (D x 3 x
    3)."""
    out = []
    for (x, y), last in routes(robot):
        hole = np.array([x, y, 0.0])
        out.append(np.vstack([hole, p[: last + 1] + R[: last + 1] @ hole]))
    return out


def length(way):
    return np.linalg.norm(np.diff(way, axis=0), axis=1).sum()


def rest_lengths(robot, pull):
    """Of the tendons' ways along the robot, for the pulls of one posture."""
    heights = disk_heights(robot)
    return np.array([heights[last] for _, last in routes(robot)]) - pull


def tensions(robot, lengths, rest):
    return np.maximum(0.0, robot["tendon_stiffness_Npm"] * (lengths - rest))


def wrenches(robot, p, R, pull):
    """Force on each disk and moment about its centre, D x 3 each, in the base frame."""
    force, moment = np.zeros_like(p), np.zeros_like(p)
    all_ways = ways(robot, p, R)
    tension = tensions(robot, np.array([length(w) for w in all_ways]), rest_lengths(robot, pull))
    for way, T in zip(all_ways, tension):
        along = np.diff(way, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        at_hole = -T * along
        at_hole[:-1] += T * along[1:]
        count = len(at_hole)
        force[:count] += at_hole
        moment[:count] += np.cross(way[1:] - p[:count], at_hole)
    return force, moment
