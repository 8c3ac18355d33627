"""A tendon robot in MuJoCo: a cable of rigid pieces joined by elastic ball joints and slides, disks on it, spatial
tendons through their holes that are springs with a dead band, MuJoCo's own tendon which pulls only.

A ball joint resists bending and twist alike, as a round rod without Poisson's effect does. Each joint lies in the
middle of the piece of rod that it stands for and the order of slide and ball changes from joint to joint, so that the
error falls with the square of the pieces. Equilibria by Newton on MuJoCo's own forces, its energy deciding how far each
step goes."""

import mujoco
import numpy as np

from tests.foreign import draw, tendons

PIECES = 4  # of rod between two disks
DIFFERENCE = 1e-6  # rad or m, of the slopes of forces
STILL = 1e-7  # rad or m: a Newton step that ends the search
LARGEST_SHIFT = 1e6  # of a slope's diagonal, over itself: more makes no slope positive that less did not


def xml(robot, pieces):
    routes = tendons.routes(robot)

    def sites(disk):
        return "".join(
            f'<site name="s{disk}_{j}" pos="{x:.15g} {y:.15g} 0"/>'
            for j, ((x, y), last) in enumerate(routes)
            if disk <= last
        )

    g = " ".join(f"{x:.15g}" for x in robot["gravity_mps2"])
    text = (
        f'<mujoco><compiler angle="radian" inertiafromgeom="false"/><option gravity="{g}">'
        '<flag energy="enable" contact="disable"/>'
        f"</option><worldbody>{sites(-1)}"
    )
    rows = draw.pieces(robot, pieces)
    for n, (h, rod, weight, disk) in enumerate(rows):
        inertia = weight * 1e-4  # of no account at rest
        joints = [
            f'<joint type="slide" axis="0 0 1" stiffness="{rod["axial_N"] / h:.15g}"/>',
            f'<joint type="ball" pos="0 0 {-h / 2:.15g}" stiffness="{rod["bending_Nm2"] / h:.15g}"/>',
        ]
        text += (
            f'<body name="b{n}" pos="0 0 {h:.15g}"><inertial pos="0 0 0" mass="{weight:.15g}" '
            f'diaginertia="{inertia:g} {inertia:g} {inertia:g}"/>'
            + "".join(joints[:: -1 if n % 2 else 1])
            + (sites(disk) if disk is not None else "")
        )
    text += "</body>" * len(rows) + "</worldbody><tendon>"
    for j, (_, last) in enumerate(routes):
        way = "".join(f'<site site="s{d}_{j}"/>' for d in range(-1, last + 1))
        text += (
            f'<spatial name="t{j}" stiffness="{robot["tendon_stiffness_Npm"]:.15g}" springlength="0 1">{way}</spatial>'
        )
    return text + "</tendon></mujoco>"


def positive(slope):
    """A slope with as much added to its diagonal as makes it positive definite, so that Newton's step leads down.
    ArithmeticError where nothing within reason does."""
    if not np.isfinite(slope).all():
        raise ArithmeticError("forces that are no numbers")
    diagonal, more = np.diag(np.abs(slope.diagonal())), 0.0
    while more <= LARGEST_SHIFT:
        try:
            np.linalg.cholesky(slope + more * diagonal)
            return slope + more * diagonal
        except np.linalg.LinAlgError:
            more = max(1e-4, 4 * more)
    raise ArithmeticError("no slope that leads down")


class Cable:
    def __init__(self, robot, pieces=PIECES):
        self.robot = robot
        self.model = mujoco.MjModel.from_xml_string(xml(robot, pieces))
        self.data = mujoco.MjData(self.model)
        rows = draw.pieces(robot, pieces)
        self.disks = [self.model.body(f"b{n}").id for n, row in enumerate(rows) if row[3] is not None]
        self.rest = self.model.qpos0.copy()

    def force(self, q):
        """Generalised force at rest at q: gravity, joints and tendons."""
        self.data.qpos[:] = q
        mujoco.mj_forward(self.model, self.data)
        return self.data.qfrc_smooth.copy()

    def energy(self, q):
        self.force(q)
        return self.data.energy[0]

    def moved(self, q, by):
        out = q.copy()
        mujoco.mj_integratePos(self.model, out, by, 1.0)
        return out

    def slope(self, q, force):
        """Of the potential: how much less force there is where each coordinate has moved."""
        eye = DIFFERENCE * np.eye(self.model.nv)
        slope = -np.stack([self.force(self.moved(q, d)) - force for d in eye], 1) / DIFFERENCE
        return (slope + slope.T) / 2

    def step(self, q, force):
        """Newton's, made shorter until the energy falls; its size, and where it leads."""
        way = np.linalg.solve(positive(self.slope(q, force)), force)
        here, size = self.energy(q), np.abs(way).max()
        share = 0.3 / max(0.3, size)
        while share > 1e-6:
            there = self.moved(q, share * way)
            if size < 1e-4 or self.energy(there) <= here - 1e-4 * share * (way @ force):
                return share * size, there
            share /= 2
        raise ArithmeticError("no way down")

    def settle(self, q, pull, most=60):
        """The equilibrium with these pulls of the tendons, from q."""
        self.model.tendon_lengthspring[:, 1] = tendons.rest_lengths(self.robot, pull)
        for _ in range(most):
            size, q = self.step(q, self.force(q))
            if size < STILL:
                self.force(q)
                return q
        raise ArithmeticError("no equilibrium")

    def from_straight(self, pull):
        """On the branch from the straight robot at home, in steps."""
        home, q = np.array(self.robot["home_m"]), self.rest
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            q = self.settle(q, home + share * (pull - home), 200)
        return q

    def postures(self, angles):
        """Positions of the disks, postures x disks x 3 [m], at these angles of the motors."""
        seen, q = [], None
        for pull in draw.pulls(self.robot, angles):
            try:
                q = self.from_straight(pull) if q is None else self.settle(q, pull)
            except ArithmeticError:
                q = self.from_straight(pull)
            seen.append(self.data.xpos[self.disks].copy())
        return np.array(seen)


def postures(robot, angles):
    """Positions of the disks, postures x disks x 3 [m], at these angles of the motors."""
    return Cable(robot).postures(angles)
