"""Computes what a real Pioneer's driver reports about its base from the simulated robot's state."""

import math

from pioneer_gazebo.core.battery import Wheel
from pioneer_gazebo.core.bumper import pressed
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.pose import Vector
from pioneer_gazebo.core.simulation import Simulation


def wheels_of(simulation: Simulation, entity: Entity) -> list[Wheel]:
    """Returns effort, rate and radius of each driven wheel."""
    wheels = []
    for driven in entity.drives:
        radius = driven.drive.config.wheelDiameter / 2
        states = simulation.joints(entity, driven.parts)
        efforts = simulation.efforts(entity, driven.parts)
        wheels += [Wheel(effort, rate, radius) for (_, rate), effort in zip(states, efforts, strict=True)]
    return wheels


def pressed_bumpers(simulation: Simulation, entity: Entity) -> tuple[list[bool], list[bool]]:
    """Returns which segments of the front and rear bumper are pressed."""
    back = simulation.pose(entity).inverse()
    points = [back.transform(one.position) for one in simulation.contacts(entity) if one.force > 0]
    return pressed(math.atan2(y, x) for x, y, _ in points)


def sonar_points(simulation: Simulation, entity: Entity) -> list[Vector]:
    """Returns each sonar reading as a point on the sonar's axis, in the base frame [m]."""
    back = simulation.pose(entity).inverse()
    points = []
    for mounted in entity.sonars:
        sensor = simulation.link_pose(entity, mounted.device.link).compose(mounted.device.pose)
        reading = (simulation.distance(entity, mounted), 0.0, 0.0)
        points.append(back.compose(sensor).transform(reading))
    return points
