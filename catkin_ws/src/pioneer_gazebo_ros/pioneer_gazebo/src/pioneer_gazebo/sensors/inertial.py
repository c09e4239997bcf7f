"""Simulates sensors of a link's motion: ground truth, inertial unit, satellite receiver."""

import math

from pioneer_gazebo.physics.engine import Velocity
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.simulation.state import (
    WORLD_NAMES,
    link_motion,
    links_of,
    seen_from,
)
from pioneer_gazebo.world.pose import (
    IDENTITY,
    Pose,
    Quaternion,
    Vector,
    added,
    conjugate,
    opposite,
    rotated,
)
from pioneer_gazebo.world.robot import Gps, GroundTruth, Imu

EARTH = 6_378_137.0
FLATTENING = 1 / 298.257223563
"""WGS 84: equatorial radius [m] and flattening."""


class InertialUnit:
    """Measures a link's orientation, angular rates and acceleration in its own axes; at rest it reports -gravity."""

    def __init__(self, simulation: Simulation, entity: Entity, config: Imu) -> None:
        self._simulation, self._entity, self._config = simulation, entity, config
        self._noise = simulation.noise(entity, config)
        self._offset = Pose.from_rpy(0.0, 0.0, 0.0, *config.rpyOffset)
        if config.initialOrientationAsReference:
            pose, _ = link_motion(simulation, entity.name, config.bodyName)
            self._reference = Pose(rotation=conjugate(pose.rotation))
        else:
            self._reference = IDENTITY

    def measure(self) -> tuple[Quaternion, Vector, Vector]:
        """Returns rotation, rates [rad/s], and the acceleration during the physics step [m/s²].

        The rotation is in the world, or since the start with ``initialOrientationAsReference``. Rates and acceleration
        are in the link's axes.
        """
        simulation, config = self._simulation, self._config
        pose, velocity = link_motion(simulation, self._entity.name, config.bodyName)
        acceleration = simulation.acceleration(self._entity, config.bodyName)
        felt = added(acceleration, opposite(simulation.physics.gravity))
        back = conjugate(pose.rotation)
        rates, felt = rotated(back, velocity.angular), rotated(back, felt)
        if config.gaussianNoise > 0:
            normals = self._noise.at(simulation.tick).standard_normal(6)
            draws: list[float] = (normals * config.gaussianNoise).tolist()
            rates, felt = (
                added(rates, (draws[0], draws[1], draws[2])),
                added(felt, (draws[3], draws[4], draws[5])),
            )
        return self._orientation(pose), rates, felt

    def _orientation(self, pose: Pose) -> Quaternion:
        if self._offset == IDENTITY and self._reference == IDENTITY:
            return pose.rotation
        since_start = self._reference.compose(Pose(rotation=pose.rotation))
        return self._offset.compose(since_start).rotation


class Receiver:
    """Computes a link's geodetic position, using the tangent plane at the world's origin."""

    def __init__(self, simulation: Simulation, entity: Entity, config: Gps) -> None:
        self._simulation, self._entity, self._config = simulation, entity, config
        latitude, heading = (
            math.radians(config.referenceLatitude),
            math.radians(config.referenceHeading),
        )
        square = 1.0 / (1.0 - (2 * FLATTENING - FLATTENING**2) * math.sin(latitude) ** 2)
        east = EARTH * math.sqrt(square)
        self._north_radius = east * (1.0 - (2 * FLATTENING - FLATTENING**2)) * square
        self._east_radius = east * math.cos(latitude)
        self._heading = math.cos(heading), math.sin(heading)

    def measure(self) -> tuple[tuple[float, float, float], Vector]:
        """Returns latitude, longitude [deg], altitude [m], and the velocity to north, west, up [m/s]."""
        pose, velocity = link_motion(self._simulation, self._entity.name, self._config.bodyName)
        config = self._config
        north, west = self._turned(pose.position)
        latitude = config.referenceLatitude + math.degrees(north / self._north_radius)
        longitude = config.referenceLongitude - math.degrees(west / self._east_radius)
        altitude = config.referenceAltitude + pose.position[2]
        return (latitude, longitude, altitude), (*self._turned(velocity.linear), velocity.linear[2])

    def _turned(self, vector: Vector) -> tuple[float, float]:
        """Returns a vector's components to north and west."""
        c, s = self._heading
        return c * vector[0] + s * vector[1], -s * vector[0] + c * vector[1]


class Truth:
    """Reports one link's pose and velocity, with the offsets and noise of its configuration.

    Attributes:
        reference: the link that they are relative to; None for the world.
    """

    def __init__(self, simulation: Simulation, entity: Entity, config: GroundTruth) -> None:
        self._simulation, self._entity, self._config = simulation, entity, config
        frame = config.frameName.lstrip("/")
        is_link = frame not in WORLD_NAMES and frame in links_of(simulation, entity.name)
        self.reference = frame if is_link else None
        self._part, at = entity.body.part_of(config.bodyName)
        self._is_base = self._part == 0 and at == IDENTITY
        self._offset = Pose.from_rpy(*config.xyzOffset, *config.rpyOffset)
        self._noise = simulation.noise(entity, config)

    def motion(self) -> tuple[Pose, Velocity]:
        """Returns pose and velocity in the world, or relative to `reference` and in its axes."""
        simulation, entity = self._simulation, self._entity
        if self._is_base:
            pose, velocity = simulation.pose(entity), simulation.velocity(entity)
        else:
            pose, velocity = link_motion(simulation, entity.name, self._config.bodyName)
        if self.reference is not None:
            pose, velocity = seen_from(
                pose, velocity, *link_motion(simulation, entity.name, self.reference)
            )
        if self._config.gaussianNoise > 0:
            normals = self._noise.at(simulation.tick).standard_normal(6)
            draws: list[float] = (normals * self._config.gaussianNoise).tolist()
            x, y, z, roll, pitch, yaw = draws
            velocity = Velocity(
                added(velocity.linear, (x, y, z)), added(velocity.angular, (roll, pitch, yaw))
            )
        if self._offset != IDENTITY:
            turned = self._offset.compose(Pose(rotation=pose.rotation)).rotation
            pose = Pose(added(pose.position, self._offset.position), turned)
        return pose, velocity
