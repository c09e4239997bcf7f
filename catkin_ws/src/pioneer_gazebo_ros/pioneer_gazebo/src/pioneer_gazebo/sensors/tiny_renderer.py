"""Camera images by pybullet's TinyRenderer: software rendering without a display, in a separate pybullet world.

The physics world has no visuals. This world is created at the first image, so that it costs nothing without cameras.
"""

import math
from collections.abc import Iterable

import numpy as np

from pioneer_gazebo.physics.quiet_pybullet import pybullet
from pioneer_gazebo.sensors.camera import Depth, Picture, vertical_fov
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.world.model import Box, Cylinder, Mesh, Model, Plane, Shape, Sphere, Visual
from pioneer_gazebo.world.pose import Pose, rotated
from pioneer_gazebo.world.robot import Camera
from pioneer_gazebo.world.section import Triangles

LIGHT = (0.5, -0.3, 1.0)
"""Direction of the light source."""

PLANE_THICKNESS = 0.02
SKY = (178, 178, 178)
"""Gazebo's default background colour."""


class TinyRenderer:
    """Renders images with pybullet's software renderer. Used from one thread."""

    def __init__(self, triangles: Triangles) -> None:
        """Opens an empty world; ``triangles`` reads meshes."""
        self._triangles = triangles
        self._client = pybullet.connect(pybullet.DIRECT)
        self._standing: tuple[Model, ...] = ()
        self._walls: list[int] = []
        self._movers: dict[Entity, list[tuple[int, int, Pose]]] = {}

    def close(self) -> None:
        """Frees its resources."""
        pybullet.disconnect(self._client)

    def picture(
        self,
        camera: Camera,
        eye: Pose,
        standing: Iterable[Model],
        moving: Iterable[tuple[Entity, list[Pose]]],
    ) -> tuple[Picture, Depth]:
        """Returns the image and depth seen by ``camera`` from ``eye``, looking along x.

        Args:
            camera: field of view, image size and clip distances.
            eye: pose in the world.
            standing: all static models.
            moving: all other entities, with the pose of each part.
        """
        self._show_standing(tuple(standing))
        self._show_moving(dict(moving))
        ahead = eye.transform((1.0, 0.0, 0.0))
        view = pybullet.computeViewMatrix(
            eye.position, ahead, rotated(eye.rotation, (0.0, 0.0, 1.0))
        )
        opening = math.degrees(vertical_fov(camera))
        lens = pybullet.computeProjectionMatrixFOV(
            opening, camera.width / camera.height, camera.near, camera.far
        )
        _, _, colours, depths, _ = pybullet.getCameraImage(
            camera.width, camera.height, view, lens, lightDirection=LIGHT, shadow=0,
            renderer=pybullet.ER_TINY_RENDERER, flags=pybullet.ER_NO_SEGMENTATION_MASK, physicsClientId=self._client,
        )  # fmt: skip
        size = camera.height, camera.width
        picture = np.array(colours, dtype=np.uint8).reshape(*size, 4)[:, :, :3].copy()
        buffer = np.array(depths, dtype=np.float32).reshape(size)
        picture[buffer >= 1.0] = SKY
        distances = camera.far * camera.near / (camera.far - (camera.far - camera.near) * buffer)
        return picture, np.where(buffer < 1.0, distances, np.inf).astype(np.float32)

    def _show_standing(self, models: tuple[Model, ...]) -> None:
        if models == self._standing:
            return
        for body in self._walls:
            pybullet.removeBody(body, physicsClientId=self._client)
        self._walls = [
            self._made(visual, model.pose.compose(link.pose).compose(visual.pose))
            for model in models
            for link in model.links
            for visual in link.visuals
        ]
        self._standing = models

    def _show_moving(self, poses: dict[Entity, list[Pose]]) -> None:
        for entity in [one for one in self._movers if one not in poses]:
            for body, _, _ in self._movers.pop(entity):
                pybullet.removeBody(body, physicsClientId=self._client)
        for entity, parts in poses.items():
            if entity not in self._movers:
                self._movers[entity] = [
                    (self._made(visual, visual.pose), number, visual.pose)
                    for number, part in enumerate(entity.body.parts)
                    for visual in part.visuals
                ]
            for body, number, at in self._movers[entity]:
                placed = parts[number].compose(at)
                pybullet.resetBasePositionAndOrientation(
                    body, placed.position, placed.rotation, physicsClientId=self._client
                )

    def _made(self, visual: Visual, pose: Pose) -> int:
        shape = self._shape(visual.shape, visual.colour)
        return pybullet.createMultiBody(
            baseMass=0.0, baseVisualShapeIndex=shape, basePosition=pose.position, baseOrientation=pose.rotation,
            physicsClientId=self._client,
        )  # fmt: skip

    def _shape(self, shape: Shape, colour: tuple[float, float, float, float]) -> int:
        look = {
            "rgbaColor": colour,
            "specularColor": (0.0, 0.0, 0.0),
            "physicsClientId": self._client,
        }
        match shape:
            case Box(size=size):
                x, y, z = size
                return pybullet.createVisualShape(
                    pybullet.GEOM_BOX, halfExtents=(x / 2, y / 2, z / 2), **look
                )
            case Sphere(radius=radius):
                return pybullet.createVisualShape(pybullet.GEOM_SPHERE, radius=radius, **look)
            case Cylinder(radius=radius, length=length):
                return pybullet.createVisualShape(
                    pybullet.GEOM_CYLINDER, radius=radius, length=length, **look
                )
            case Plane(size=extent):
                x, y = extent
                return pybullet.createVisualShape(
                    pybullet.GEOM_BOX, halfExtents=(x / 2, y / 2, PLANE_THICKNESS / 2),
                    visualFramePosition=(0.0, 0.0, -PLANE_THICKNESS / 2), **look,
                )  # fmt: skip
            case Mesh():
                corners, index = np.unique(
                    self._triangles(shape).reshape(-1, 3), axis=0, return_inverse=True
                )
                return pybullet.createVisualShape(
                    pybullet.GEOM_MESH,
                    vertices=corners.tolist(),
                    indices=index.ravel().tolist(),
                    **look,
                )
