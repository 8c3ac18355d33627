"""Draws frames with viser: the bodies, tips with their trails, load cells, base and gravity. Knows nothing of where
frames come from. Lengths are drawn in lengths of the longest robot, because viser's cameras are made for metres.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._arrays import Array
from . import colours
from .frames import DrawnRobot, Frame, Pose
from .geometry import points_of, quaternions_of, rotations_to

BETWEEN_ROBOTS = 1.45  # in lengths of the longest
BAR_WIDTH, BAR_HEIGHT, BAR_STEP = 0.055, 0.5, 0.11
BACKBONE_RADIUS, TENDON_RADIUS, TIP_RADIUS, DISK_HEIGHT = 0.016, 0.0075, 0.022, 0.012
HIDDEN = np.full((1, 3), 1e-6)  # a size that nobody sees
TRAIL_PIECES = 90


Mesh = tuple[Array, NDArray[np.int64]]  # vertices and faces


def tube(sides: int = 12, closed: bool = False) -> Mesh:
    """Vertices and faces of a cylinder of radius 1 from z = 0 to 1. Its ends have vertices of their own: shared ones
    would be shaded as round."""
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(sides)], axis=1)
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = [np.stack([i, j, sides + i], axis=1), np.stack([j, sides + j, sides + i], axis=1)]
    vertices = [ring, ring + [0, 0, 1]]
    if closed:
        vertices += [ring, ring + [0, 0, 1], np.array([[0.0, 0, 0], [0, 0, 1]])]
        low, high, middle = 2 * sides, 3 * sides, np.full(sides, 4 * sides)
        faces += [
            np.stack([low + j, low + i, middle], axis=1),
            np.stack([high + i, high + j, middle + 1], axis=1),
        ]
    return np.concatenate(vertices), np.concatenate(faces)


def turned_back(wxyz: Array, points: Array) -> Array:
    """Points in the frame that this quaternion turns."""
    w, v = wxyz[0], -wxyz[1:]
    back: Array = points + 2 * np.cross(v, np.cross(v, points) + w * points)
    return back


def box() -> Mesh:
    """A box of size 1 that stands on z = 0."""
    vertices = np.array([[x, y, z] for z in (0, 1) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    below, above = [[0, 2, 1], [1, 2, 3]], [[4, 5, 6], [5, 7, 6]]
    sides = [[0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
    return vertices, np.array(below + above + sides)


def ball() -> Mesh:
    """A sphere of radius 1."""
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    return sphere.vertices, sphere.faces


def instances(scene: Any, name: str, mesh: Mesh, n: int, colour: Any, **options: Any) -> Any:
    """n bodies of one mesh, which the browser moves at once; hidden until they are given a size."""
    return scene.add_batched_meshes_simple(
        name,
        *mesh,
        np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        np.zeros((n, 3)),
        batched_scales=np.tile(HIDDEN, (n, 1)),
        batched_colors=np.tile(np.array(colour, dtype=np.uint8), (n, 1)),
        lod="off",
        cast_shadow=False,
        receive_shadow=False,
        **options,
    )


def label(scene: Any, name: str, text: str, place: Array, anchor: str, size: float = 0.8) -> Any:
    return scene.add_label(name, text, position=place, anchor=anchor, font_screen_scale=size)


class Directions:
    """Up against gravity, the side on which the next robot stands, the one on which load cells stand, and the one from
    which one looks."""

    def __init__(self, gravity_W_mps2: Array):
        size = np.linalg.norm(gravity_W_mps2)
        self.up = -gravity_W_mps2 / size if size > 0 else np.array([0.0, 0.0, 1.0])
        if abs(self.up[2]) > 0.9:  # it stands or hangs
            self.viewer = np.array([0.0, -1.0, 0.0])
            self.side = self.aside = np.array([1.0, 0.0, 0.0])
        else:  # it lies
            self.viewer = np.cross(self.up, [0.0, 0.0, 1.0])
            self.viewer /= np.linalg.norm(self.viewer)
            self.side, self.aside = self.up, np.array([0.0, 0.0, 1.0])


class Tubes:
    """Straight pieces from point to point, as instances of one cylinder."""

    def __init__(self, scene: Any, name: str, pieces: int, radius: float, colour: Any):
        self.radius = radius
        self.handle = instances(scene, name, tube(), pieces, colour)

    def move(self, begins: Array, ends: Array) -> None:
        along = ends - begins
        length = np.linalg.norm(along, axis=1)
        self.handle.batched_positions = begins
        self.handle.batched_wxyzs = rotations_to(along)
        self.handle.batched_scales = np.stack([np.full_like(length, self.radius)] * 2 + [length], axis=1)


class Tip:
    """A ball and the trail behind it; neither where the tip is not known."""

    def __init__(self, scene: Any, name: str, radius: float, colour: Any):
        self.radius = radius
        # An instance, not a node of its own: a slow browser would move a node some frames before the body.
        self.ball = instances(scene, f"{name}/ball", ball(), 1, colour)
        points = np.zeros((TRAIL_PIECES, 2, 3))
        self.trail = scene.add_line_segments(
            f"{name}/trail", points, colour, thickness=3, thickness_units="screen"
        )

    def move(self, path: Array) -> None:
        """`path`: the trail's points, the present one last, k x 3; NaN: not known then."""
        known = path[np.isfinite(path).all(axis=1)]
        here = len(path) > 0 and bool(np.isfinite(path[-1]).all())
        self.ball.batched_scales = np.full((1, 3), self.radius) if here else HIDDEN
        if here:
            self.ball.batched_positions = path[-1:]
        if len(known) < 2:
            known = np.zeros((2, 3)) if len(known) == 0 else np.repeat(known, 2, axis=0)
        # As many pieces in every frame: those over are of no length.
        at = np.linspace(0, len(known) - 1, TRAIL_PIECES + 1).round().astype(int)
        self.trail.points = np.stack([known[at][:-1], known[at][1:]], axis=1)


class Body:
    """One robot."""

    def __init__(
        self, scene: Any, name: str, robot: DrawnRobot, scale: float, origin: Array, directions: Directions
    ):
        self.robot, self.scale, self.origin = robot, scale, origin
        straight = points_of(robot, robot.q_at_rest)
        self.holes = [len(line) for line in straight.tendons_m]
        disk = scale * robot.disk_radius_m
        thin, thick = min(TENDON_RADIUS, 0.15 * disk), min(BACKBONE_RADIUS, 0.35 * disk)
        pieces = len(straight.backbone_m) - 1
        self.backbone = Tubes(scene, f"{name}/backbone", pieces, thick, colours.BACKBONE)
        pieces = sum(self.holes) - len(self.holes)
        self.tendons = Tubes(scene, f"{name}/tendons", pieces, thin, colours.NOT_KNOWN)
        self._add_disks(scene, name)
        self.reference = Tip(scene, f"{name}/reference", TIP_RADIUS, colours.REFERENCE)
        self.measured = Tip(scene, f"{name}/measured", 0.9 * TIP_RADIUS, colours.MEASURED)
        self.cells = Cells(scene, f"{name}/load cells", robot, origin, directions)
        self._add_base(scene, name, disk)

    def _add_disks(self, scene: Any, name: str) -> None:
        vertices, faces = tube(28, closed=True)
        radius, n = self.scale * self.robot.disk_radius_m, self.robot.disks
        self.disk_scales = np.tile([radius, radius, DISK_HEIGHT], (n, 1))
        self.disks = instances(scene, f"{name}/disks", (vertices - [0, 0, 0.5], faces), n, colours.DISK)

    def _add_base(self, scene: Any, name: str, disk: float) -> None:
        style = {"color": colours.BASE, "cast_shadow": False, "receive_shadow": False}
        low = self.origin - [0, 0, 0.03]
        scene.add_cylinder(f"{name}/base", radius=1.7 * disk, height=0.06, position=low, **style)
        scene.add_frame(f"{name}/F_0", axes_length=0.16, axes_radius=0.006, position=self.origin)
        if self.robot.title:
            above = self.origin + [0, 0, 1.12]
            label(scene, f"{name}/title", self.robot.title, above, "bottom-center", 1.0)

    def place(self, points_m: Array) -> Array:
        return self.origin + self.scale * points_m

    def draw(self, pose: Pose, reference_path_m: Array, measured_path_m: Array) -> None:
        if np.isfinite(pose.q).all():
            self._draw_shape(pose)
        else:
            self._hide_shape()
        self.reference.move(self.place(reference_path_m))
        self.measured.move(self.place(measured_path_m))
        self.cells.draw(pose.cell_N)

    def _draw_shape(self, pose: Pose) -> None:
        points = points_of(self.robot, pose.q)
        line = self.place(points.backbone_m)
        self.backbone.move(line[:-1], line[1:])
        self.disks.batched_positions = self.place(points.disks[:, :3, 3])
        self.disks.batched_wxyzs = quaternions_of(points.disks)
        self.disks.batched_scales = self.disk_scales
        holes = [self.place(tendon) for tendon in points.tendons_m]
        self.tendons.move(np.concatenate([h[:-1] for h in holes]), np.concatenate([h[1:] for h in holes]))
        colour = colours.of_tensions(pose.tension_N, self.robot.least_tension_N, self.robot.most_tension_N)
        self.tendons.handle.batched_colors = np.repeat(colour, [n - 1 for n in self.holes], axis=0)

    def _hide_shape(self) -> None:
        for handle in (self.backbone.handle, self.disks, self.tendons.handle):
            handle.batched_scales = np.tile(HIDDEN, (len(handle.batched_positions), 1))


class Cells:
    """A bar for each load cell: as high as its reading, in a frame as high as its limit."""

    def __init__(self, scene: Any, name: str, robot: DrawnRobot, origin: Array, directions: Directions):
        self.robot = robot
        n, up = robot.tendons, directions.up
        self.feet = origin - (0.45 + BAR_STEP * np.arange(n)[::-1])[:, None] * directions.aside
        turn = rotations_to(up[None])
        self.bars = instances(scene, f"{name}/bars", box(), n, (0, 0, 0), flat_shading=True)
        self.bars.batched_positions = self.feet
        self.bars.batched_wxyzs = np.tile(turn, (n, 1))
        corners = box()[0] * [1.25 * BAR_WIDTH, 1.25 * BAR_WIDTH, BAR_HEIGHT]
        edges = np.array([[a, b] for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1])
        frames = np.concatenate([corners[edges] + foot for foot in turned_back(turn[0], self.feet)])
        style = {"thickness": 1, "thickness_units": "screen", "wxyz": turn[0]}
        self.others = [scene.add_line_segments(f"{name}/limits", frames, colours.LIMIT, **style)]
        top = self.feet.mean(axis=0) + (BAR_HEIGHT + 0.05) * up
        text = f"load cells, to {robot.most_cell_N:g} N"
        self.others.append(label(scene, f"{name}/limit", text, top, "bottom-center"))
        for j, foot in enumerate(self.feet, 1):
            self.others.append(label(scene, f"{name}/{j}", f"{j}", foot - 0.02 * up, "top-center"))

    def draw(self, cell_N: Array) -> None:
        there = bool(np.isfinite(cell_N).any())
        self.bars.visible = there
        for handle in self.others:
            handle.visible = there
        if not there:
            return
        share = np.clip(np.nan_to_num(cell_N) / self.robot.most_cell_N, 1e-4, 1.3)
        width = np.full_like(share, BAR_WIDTH)
        self.bars.batched_scales = np.stack([width, width, BAR_HEIGHT * share], axis=1)
        self.bars.batched_colors = colours.of_tensions(cell_N, 0.0, self.robot.most_cell_N)


class Drawing:
    """The whole picture on a viser server."""

    def __init__(self, server: Any, robots: tuple[DrawnRobot, ...]):
        self.server = server
        scene = server.scene
        scene.reset()
        directions = Directions(robots[0].gravity_W_mps2)
        longest = max(robot.length_m for robot in robots)
        self.scale = 1 / longest
        scene.set_up_direction(tuple(directions.up))
        # Even light from all sides: reflections of a room would bleach the colours that tell the tensions.
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light", intensity=1.6)
        middle = (len(robots) - 1) / 2
        self.bodies = [
            Body(
                scene,
                f"/{n + 1} {robot.title or robot.name}",
                robot,
                self.scale,
                (n - middle) * BETWEEN_ROBOTS * directions.side,
                directions,
            )
            for n, robot in enumerate(robots)
        ]
        self._add_ground(scene, directions, longest, len(robots))
        self._add_gravity(scene, robots[0].gravity_W_mps2, directions)
        self._aim(directions, len(robots))

    def _add_ground(self, scene: Any, directions: Directions, longest_m: float, robots: int) -> None:
        # The grid's lines: 10 mm for a robot of a hand's length, 100 mm for one of an arm's.
        line_m = 10 ** np.floor(np.log10(longest_m / 2.5))
        stands = directions.side is directions.aside
        low = (-0.06 if stands else -1.1 - BETWEEN_ROBOTS * (robots - 1) / 2) * directions.up
        scene.add_grid(
            "/ground",
            width=BETWEEN_ROBOTS * (robots + 0.6),
            height=3.0,
            cell_size=line_m * self.scale,
            section_size=10 * line_m * self.scale,
            cell_color=(222, 226, 230),
            section_color=(190, 197, 203),
            wxyz=rotations_to(directions.up[None])[0],
            position=low,
            shadow_opacity=0.0,
        )
        self.grid_mm = 1e3 * line_m

    def _add_gravity(self, scene: Any, gravity_W_mps2: Array, directions: Directions) -> None:
        size = np.linalg.norm(gravity_W_mps2)
        if size == 0:
            return
        begin = self.bodies[0].cells.feet[0] - 0.28 * directions.aside + 0.4 * directions.up
        arrow = np.array([[begin, begin - 0.3 * directions.up]])
        shape = {"shaft_radius": 0.008, "head_radius": 0.022, "head_length": 0.06}
        scene.add_arrows("/gravity", arrow, colours.GRAVITY, **shape)
        label(scene, "/g", f"g {size:.2f} m/s²", begin, "bottom-center")

    def _aim(self, directions: Directions, robots: int) -> None:
        # A narrow angle from afar: near the edges of a wide one, what is upright leans.
        middle = np.array([0.0, 0.0, 0.48]) - (0.25 if robots == 1 else 0.3) * directions.aside
        away = 2.9 + 1.75 * (robots - 1)
        camera = self.server.initial_camera
        camera.up = tuple(directions.up)
        camera.look_at = tuple(middle)
        camera.position = tuple(middle + away * directions.viewer + 0.36 * away * directions.up)
        camera.fov = np.radians(30)

    def draw(self, frames: list[Frame]) -> None:
        """The last of these frames, with trails through all of them."""
        with self.server.atomic():
            for n, body in enumerate(self.bodies):
                poses = [frame.poses[n] for frame in frames]
                body.draw(
                    poses[-1],
                    np.array([p.reference_tip_m for p in poses]),
                    np.array([p.measured_tip_m for p in poses]),
                )
