"""A tendon robot in PyElastica: a Cosserat rod, fixed at its base, with weights and tendons as its loads, stepped in
time to rest.

Only where it rests counts. So its inertia is not the robot's but as much as each node and element needs for a step of
time of one, and its damping follows the slowest mode that still moves. Each disk sits on the middle of an element,
which has a rotation; the first element lies around the base and the last around the last disk, and every joint between
elements lies in the middle of the piece of rod that it stands for, so that the error falls with the square of the
pieces.

PyElastica's rod keeps its volume: pressed together by one per cent it bends with three per cent more effort, which the
other plant's does not. It shears, too."""

import math

import elastica
import numpy as np
from numba import njit

from tests.foreign import draw, tendons

PIECES = 4  # of rod between two disks
SHEAR = 27 / 28  # PyElastica's share of a round section that carries shear
MARGIN = 1.5  # of inertia over what the step of time needs at the straight robot
BATCH = 50  # steps between two looks at how far it is from rest
RAMP = 4  # batches in which the tendons go from one posture to the next
MOST = 4000  # batches
STILL = 2e-7  # m: the way left to rest of every node, if all of it is in the slowest mode that moves


class Simulator(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping):
    pass


def straight(robot, pieces):
    """PyElastica's rod with this robot's stiffness; of each element which share lies below the place where a disk would
    sit, and the mass that is there."""
    rows = draw.pieces(robot, pieces)
    h = np.array([row[0] for row in rows])
    bending, torsion, axial = (
        np.array([row[1][k] for row in rows]) for k in ("bending_Nm2", "torsion_Nm2", "axial_N")
    )
    below, above = np.append(h[0], h), np.append(h, h[-1])
    length, middle = (below + above) / 2, np.append(0, np.cumsum(h))
    z = np.append(middle - below / 2, middle[-1] + above[-1] / 2)
    rod = elastica.CosseratRod.straight_rod(
        len(length),
        np.array([0, 0, z[0]]),
        np.array([0.0, 0, 1]),
        np.array([1.0, 0, 0]),
        z[-1] - z[0],
        robot["rod_radius_m"],
        1000.0,  # of inertia alone, which give_inertia replaces
        youngs_modulus=robot["sections"][0]["youngs_modulus_Pa"],
        position=np.vstack([np.zeros((2, len(z))), z]),
    )
    # Half of the first element is no rod. A force on the middle of the last one strains it by half as much as the half
    # below would be: so it is made half as stiff.
    give = np.append(0, h / axial) + np.append(h / axial, h[-1] / axial[-1] * 3)
    stretch = 2 * length / give
    rod.shear_matrix[:] = np.einsum("ik,ij->ijk", [SHEAR / 2 * stretch, SHEAR / 2 * stretch, stretch], np.eye(3))
    # A joint yields as the piece of rod around it does, also where pieces of two lengths meet.
    rod.bend_matrix[:] = np.einsum("ik,ij->ijk", [bending, bending, torsion], np.eye(3)) * rod.rest_voronoi_lengths / h
    return rod, below / (below + above), np.array([0, *(row[2] for row in rows)])


def give_inertia(rod, robot):
    """To nodes and elements, by Gershgorin's bound of their stiffness: a step of time of one is stable."""
    along = np.pad(rod.shear_matrix[2, 2] / rod.rest_lengths, 1)
    bend = np.pad(rod.bend_matrix[0, 0] / rod.rest_voronoi_lengths, 1)
    count = sum(len(s["holes"]) for s in robot["sections"])
    lever = robot["sections"][0]["holes"][0][1]
    tendon = robot["tendon_stiffness_Npm"] * count
    rod.mass[:] = MARGIN / 4 * (2 * (along[1:] + along[:-1]) + tendon)
    shear = 2 * rod.shear_matrix[0, 0] * rod.rest_lengths
    turning = MARGIN / 4 * (2 * shear + 2 * (bend[1:] + bend[:-1]) + tendon * lever**2)
    rod.mass_second_moment_of_inertia[:] = np.einsum("k,ij->ijk", turning, np.eye(3))
    rod.inv_mass_second_moment_of_inertia[:] = np.einsum("k,ij->ijk", 1 / turning, np.eye(3))


@njit
def pull_tendons(p, Q, holes, last, stiffness, rest, force, moment):
    """Adds the tendons' wrenches on the disks, as tendons.wrenches has them; Q turns into a disk's frame."""
    arm, along, f = np.empty_like(p), np.empty_like(p), np.empty(3)
    for j in range(len(last)):
        length = 0.0
        for d in range(last[j] + 1):
            square = 0.0
            for i in range(3):
                arm[d, i] = Q[d, 0, i] * holes[j, 0] + Q[d, 1, i] * holes[j, 1]
                along[d, i] = p[d, i] + arm[d, i] - (p[d - 1, i] + arm[d - 1, i] if d else holes[j, i])
                square += along[d, i] ** 2
            norm = math.sqrt(square)
            length += norm
            for i in range(3):
                along[d, i] /= norm
        tension = max(0.0, stiffness * (length - rest[j]))
        for d in range(last[j] + 1):
            for i in range(3):
                f[i] = tension * ((along[d + 1, i] if d < last[j] else 0.0) - along[d, i])
                force[d, i] += f[i]
            for i in range(3):
                moment[d, i] += arm[d, i - 2] * f[i - 1] - arm[d, i - 1] * f[i - 2]


@njit
def load(x, directors, disks, share, weight, holes, last, stiffness, rest, forces, torques):
    """Adds to nodes and elements the weights, and the tendons' wrenches at the disks."""
    p, Q = np.empty((len(disks), 3)), np.empty((len(disks), 3, 3))
    force, moment = np.zeros_like(p), np.zeros_like(p)
    for d, k in enumerate(disks):
        for i in range(3):
            p[d, i] = (1 - share[k]) * x[i, k] + share[k] * x[i, k + 1]
            for n in range(3):
                Q[d, i, n] = directors[i, n, k]
    pull_tendons(p, Q, holes, last, stiffness, rest, force, moment)
    for k in range(len(share)):
        for i in range(3):
            forces[i, k] += (1 - share[k]) * weight[k, i]
            forces[i, k + 1] += share[k] * weight[k, i]
    for d, k in enumerate(disks):
        for i in range(3):
            forces[i, k] += (1 - share[k]) * force[d, i]
            forces[i, k + 1] += share[k] * force[d, i]
            for n in range(3):
                torques[i, k] += Q[d, i, n] * moment[d, n]


class Loads(elastica.NoForces):
    def __init__(self, what):
        super().__init__()
        self.what = what

    def apply_forces(self, system, time=0.0):
        x, Q = system.position_collection, system.director_collection
        load(x, Q, *self.what, system.external_forces, system.external_torques)


@njit
def damp(v, omega, a, m, before, sums, rate):
    """Slows all velocities by twice the rate, critical for a mode of that rate; adds to Rayleigh's quotient of the
    motion: how much the forces on the nodes fall along their way, over their inertia."""
    nodes = v.shape[1]
    keep = math.exp(-2 * rate)
    for i in range(3):
        for k in range(nodes):
            sums[0] -= m[k] * v[i, k] * (a[i, k] - before[i, k])
            sums[1] += m[k] * v[i, k] ** 2
            before[i, k] = a[i, k]
            v[i, k] *= keep
        for k in range(nodes - 1):
            omega[i, k] *= keep


class Damper(elastica.DamperBase):
    def __init__(self, motion, **kwargs):
        super().__init__(**kwargs)
        self.motion = motion

    def dampen_rates(self, system, time):
        damp(
            system.velocity_collection,
            system.omega_collection,
            system.acceleration_collection,
            system.mass,
            self.motion["before"],
            self.motion["sums"],
            self.motion["rate"],
        )


class Rod:
    def __init__(self, robot, pieces=PIECES):
        self.robot, self.pull, self.time = robot, None, 0.0
        self.rod, self.share, mass = straight(robot, pieces)
        give_inertia(self.rod, robot)
        self.disks = pieces * np.arange(1, sum(s["disks"] for s in robot["sections"]) + 1)
        self.rest = np.zeros(len(robot["home_m"]))  # lengths of the tendons
        self.motion = dict(before=np.zeros_like(self.rod.velocity_collection), sums=np.zeros(2), rate=0.1)
        holes = np.array([(*hole, 0.0) for hole, _ in tendons.routes(robot)])
        last = np.array([disk for _, disk in tendons.routes(robot)])
        weight = np.outer(mass, robot["gravity_mps2"])
        loads = (self.disks, self.share, weight, holes, last, robot["tendon_stiffness_Npm"], self.rest)
        self.simulator, self.stepper = Simulator(), elastica.PositionVerlet()
        self.simulator.append(self.rod)
        self.simulator.constrain(self.rod).using(
            elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        self.simulator.add_forcing_to(self.rod).using(Loads, loads)
        self.simulator.dampen(self.rod).using(Damper, self.motion)
        self.simulator.finalize()

    def run(self, steps):
        """Steps in time, then the rate of what moved in them becomes the damping."""
        for _ in range(steps):
            self.time = self.stepper.step(self.simulator, self.time, 1.0)
        over, under = self.motion["sums"]
        if over > 0:
            self.motion["rate"] = min(0.5, max(1e-5, math.sqrt(over / under)))
        self.motion["sums"][:] = 0

    def way_left(self):
        """To rest, of the node that has the farthest, by velocity or by force."""
        rate = self.motion["rate"]
        v, a = self.rod.velocity_collection[:, 1:], self.rod.acceleration_collection[:, 1:]
        return max(np.abs(v).max() / rate, np.abs(a).max() / rate**2)

    def settle(self, pull):
        """At rest with these pulls of the tendons, from where it is."""
        start = pull if self.pull is None else self.pull
        for n in range(MOST):
            now = start + min(1.0, (n + 1) / RAMP) * (pull - start)
            self.rest[:] = tendons.rest_lengths(self.robot, now)
            self.run(BATCH)
            if n > RAMP and self.way_left() < STILL:
                self.pull = pull
                return
        raise ArithmeticError("does not come to rest")

    def seen(self):
        """Positions of the disks."""
        x, f = self.rod.position_collection, self.share[self.disks]
        return ((1 - f) * x[:, self.disks] + f * x[:, self.disks + 1]).T

    def postures(self, angles):
        """Positions of the disks, postures x disks x 3 [m], at these angles of the motors."""
        out = []
        for pull in draw.pulls(self.robot, angles):
            self.settle(pull)
            out.append(self.seen())
        return np.array(out)


def postures(robot, angles):
    """Positions of the disks, postures x disks x 3 [m], at these angles of the motors."""
    return Rod(robot).postures(angles)
