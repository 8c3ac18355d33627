"""The robot as Foxglove draws it: frames of its disks and its tip, its body coloured by tension. Lengths in metres."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf import (
    Color_pb2,
    CylinderPrimitive_pb2,
    FrameTransform_pb2,
    FrameTransforms_pb2,
    LinePrimitive_pb2,
    Point3_pb2,
    Pose_pb2,
    Quaternion_pb2,
    SceneEntity_pb2,
    SceneEntityDeletion_pb2,
    SceneUpdate_pb2,
    SpherePrimitive_pb2,
    Vector3_pb2,
)
from google.protobuf.timestamp_pb2 import Timestamp

from .._arrays import Array
from ..view import colours
from ..view.frames import DrawnRobot
from ..view.geometry import points_of, quaternions_of
from .protobuf import to_bytes

# In lengths of the robot.
BACKBONE_THICKNESS, TENDON_THICKNESS, TIP_SIZE, DISK_HEIGHT, BASE_HEIGHT = 0.03, 0.012, 0.045, 0.012, 0.05
BASE_PER_DISK = 1.7
NS_PER_S = 1_000_000_000


@dataclasses.dataclass(frozen=True)
class Shape:
    """What is drawn of one moment; NaN: not known."""

    time_ns: int
    bending_rad: Array  # 2K
    tension_N: Array  # M, at the base
    tip_m: Array  # 3, estimated
    orientation: Array  # 4: w, x, y, z of the tip
    reference_tip_m: Array  # 3


def timestamp(time_ns: int) -> Timestamp:
    seconds, nanos = divmod(time_ns, NS_PER_S)
    return Timestamp(seconds=seconds, nanos=nanos)


def colour(rgb: Sequence[int] | Any, alpha: float = 1.0) -> Color_pb2.Color:
    r, g, b = (int(c) / 255 for c in rgb)
    return Color_pb2.Color(r=r, g=g, b=b, a=alpha)


def pose(place: Array, wxyz: Array) -> Pose_pb2.Pose:
    x, y, z = place.tolist()
    return Pose_pb2.Pose(position=Vector3_pb2.Vector3(x=x, y=y, z=z), orientation=quaternion(wxyz))


def quaternion(wxyz: Array) -> Quaternion_pb2.Quaternion:
    w, x, y, z = wxyz.tolist()
    return Quaternion_pb2.Quaternion(w=w, x=x, y=y, z=z)


def line(points: Array, thickness: float, rgb: Any) -> LinePrimitive_pb2.LinePrimitive:
    return LinePrimitive_pb2.LinePrimitive(
        type=LinePrimitive_pb2.LinePrimitive.LINE_STRIP,
        pose=Pose_pb2.Pose(orientation=Quaternion_pb2.Quaternion(w=1.0)),
        thickness=thickness,
        points=[Point3_pb2.Point3(x=x, y=y, z=z) for x, y, z in points.tolist()],
        color=colour(rgb),
    )


class Scene:
    """Of one robot; its frames are named PREFIX/F_0, PREFIX/disk_1, ..., PREFIX/tip."""

    def __init__(self, prefix: str, robot: DrawnRobot):
        self.prefix, self.robot = prefix, robot
        self.base = f"{prefix}/F_0"
        self._hidden = False

    def draw(self, shape: Shape) -> tuple[bytes, bytes] | None:
        """FrameTransforms and SceneUpdate; None where there is nothing to draw and nothing to take away."""
        if not np.isfinite(shape.bending_rad).all():
            if self._hidden:
                return None
            self._hidden = True
            return to_bytes(FrameTransforms_pb2.FrameTransforms()), self._removed(shape)
        self._hidden = False
        points = points_of(self.robot, self.robot.spread(shape.bending_rad))
        turned = quaternions_of(points.disks)
        entity = SceneEntity_pb2.SceneEntity(
            timestamp=timestamp(shape.time_ns), frame_id=self.base, id="robot", frame_locked=True
        )
        self._add_body(entity, points.backbone_m, points.disks[:, :3, 3], turned)
        self._add_tendons(entity, points.tendons_m, shape.tension_N)
        self._add_tips(entity, shape)
        frames = self._frames(shape, points.disks[:, :3, 3], turned)
        return frames, to_bytes(SceneUpdate_pb2.SceneUpdate(entities=[entity]))

    def _removed(self, shape: Shape) -> bytes:
        deletion = SceneEntityDeletion_pb2.SceneEntityDeletion(
            timestamp=timestamp(shape.time_ns),
            type=SceneEntityDeletion_pb2.SceneEntityDeletion.MATCHING_ID,
            id="robot",
        )
        return to_bytes(SceneUpdate_pb2.SceneUpdate(deletions=[deletion]))

    def _frames(self, shape: Shape, disks_m: Array, turned: Array) -> bytes:
        places = [(f"disk_{i}", place, wxyz) for i, (place, wxyz) in enumerate(zip(disks_m, turned), 1)]
        places.append(("tip", shape.tip_m, shape.orientation))
        at = timestamp(shape.time_ns)
        frames = FrameTransforms_pb2.FrameTransforms()
        for name, place, wxyz in places:
            if not (np.isfinite(place).all() and np.isfinite(wxyz).all()):
                continue
            there = pose(place, wxyz)
            frames.transforms.append(
                FrameTransform_pb2.FrameTransform(
                    timestamp=at,
                    parent_frame_id=self.base,
                    child_frame_id=f"{self.prefix}/{name}",
                    translation=there.position,
                    rotation=there.orientation,
                )
            )
        return to_bytes(frames)

    def _add_body(self, entity: Any, backbone_m: Array, disks_m: Array, turned: Array) -> None:
        length, radius = self.robot.length_m, self.robot.disk_radius_m
        thickness = min(BACKBONE_THICKNESS * length, 0.5 * radius)
        entity.lines.append(line(backbone_m, thickness, colours.BACKBONE))
        low = np.array([0.0, 0.0, -0.5 * BASE_HEIGHT * length])
        self._add_cylinder(
            entity, low, np.array([1.0, 0, 0, 0]), BASE_PER_DISK * radius, BASE_HEIGHT, colours.BASE
        )
        for place, wxyz in zip(disks_m, turned):
            self._add_cylinder(entity, place, wxyz, radius, DISK_HEIGHT, colours.DISK)

    def _add_cylinder(
        self, entity: Any, place: Array, wxyz: Array, radius: float, height: float, rgb: tuple[int, int, int]
    ) -> None:
        entity.cylinders.append(
            CylinderPrimitive_pb2.CylinderPrimitive(
                pose=pose(place, wxyz),
                size=Vector3_pb2.Vector3(x=2 * radius, y=2 * radius, z=height * self.robot.length_m),
                bottom_scale=1.0,
                top_scale=1.0,
                color=colour(rgb),
            )
        )

    def _add_tendons(self, entity: Any, tendons_m: list[Array], tension_N: Array) -> None:
        robot = self.robot
        shades = colours.of_tensions(tension_N, robot.least_tension_N, robot.most_tension_N)
        for points, shade in zip(tendons_m, shades):
            entity.lines.append(line(points, TENDON_THICKNESS * robot.length_m, shade))

    def _add_tips(self, entity: Any, shape: Shape) -> None:
        size = TIP_SIZE * self.robot.length_m
        for place, rgb in ((shape.reference_tip_m, colours.REFERENCE), (shape.tip_m, colours.MEASURED)):
            if np.isfinite(place).all():
                entity.spheres.append(
                    SpherePrimitive_pb2.SpherePrimitive(
                        pose=pose(place, np.array([1.0, 0, 0, 0])),
                        size=Vector3_pb2.Vector3(x=size, y=size, z=size),
                        color=colour(rgb, 0.8),
                    )
                )
