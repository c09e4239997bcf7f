"""Ground truth: the true pose and velocity of one link, as reported by ``libgazebo_ros_p3d.so``."""

import numpy as np

from pioneer_gazebo.core.engine import Velocity
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.laser import generator_for
from pioneer_gazebo.core.pose import IDENTITY, Pose, added
from pioneer_gazebo.core.robot import GroundTruth
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.core.state import link_motion


class Truth:
    """Reports one link's pose and velocity, with the offsets and noise of its configuration."""

    def __init__(self, simulation: Simulation, entity: Entity, config: GroundTruth) -> None:
        self._simulation, self._entity, self._config = simulation, entity, config
        self._part, at = entity.body.part_of(config.bodyName)
        self._is_base = self._part == 0 and at == IDENTITY
        self._offset = Pose.from_rpy(*config.xyzOffset, *config.rpyOffset)
        self._noise = generator_for(0, entity.name, config.name)

    def motion(self) -> tuple[Pose, Velocity]:
        """Returns pose and velocity in the world."""
        simulation, entity = self._simulation, self._entity
        if self._is_base:
            pose, velocity = simulation.pose(entity), simulation.velocity(entity)
        else:
            pose, velocity = link_motion(simulation, entity.name, self._config.bodyName)
        if self._config.gaussianNoise > 0:
            draws: list[float] = (self._noise.standard_normal(6) * np.float64(self._config.gaussianNoise)).tolist()
            x, y, z, roll, pitch, yaw = draws
            velocity = Velocity(added(velocity.linear, (x, y, z)), added(velocity.angular, (roll, pitch, yaw)))
        if self._offset != IDENTITY:
            turned = self._offset.compose(Pose(rotation=pose.rotation)).rotation
            pose = Pose(added(pose.position, self._offset.position), turned)
        return pose, velocity
