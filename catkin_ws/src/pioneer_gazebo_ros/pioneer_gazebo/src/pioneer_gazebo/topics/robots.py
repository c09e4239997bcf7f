"""Manages the robots in the world and their topics."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import rospy

from pioneer_gazebo.error import SimulatorError
from pioneer_gazebo.ros.topic import TransformTopic
from pioneer_gazebo.sensors.tiny_renderer import TinyRenderer
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.timeline import Budget, Timeline
from pioneer_gazebo.topics import sensor_topics as sensors
from pioneer_gazebo.topics.drive_topics import drive_topics, joint_topics, planar_topics
from pioneer_gazebo.topics.port import Context, Port
from pioneer_gazebo.topics.sensor_topics import driver_topics
from pioneer_gazebo.world import robot as kinds
from pioneer_gazebo.world.mesh import triangles_of_mesh
from pioneer_gazebo.world.model import Model
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import Robot, RosControl
from pioneer_gazebo.world.ros_control import controlled
from pioneer_node.nodes.entry import parameters_below

TOPICS: dict[type, Callable[[Port, Any], object]] = {
    kinds.DiffDrive: drive_topics,
    kinds.PlanarMove: planar_topics,
    kinds.Imu: sensors.imu_topics,
    kinds.Gps: sensors.gps_topics,
    kinds.LaserSensor: sensors.laser_topics,
    kinds.SonarSensor: sensors.sonar_topics,
    kinds.Camera: sensors.camera_topics,
    kinds.GroundTruth: sensors.truth_topics,
    kinds.Bumper: sensors.bumper_topics,
    kinds.JointStatePublisher: sensors.joint_state_topics,
    kinds.JointControl: joint_topics,
    kinds.MimicJoint: lambda port, config: None,
    kinds.BaseDriver: driver_topics,
}
"""Maps device types to the functions that start their topics."""


Owner = TypeVar("Owner", Robot, Model)


def with_controllers(owner: Owner, namespace: str = "") -> Owner:
    """Returns a robot with its ros_control plugin replaced by the controllers configured in the plugin's namespace.

    Raises:
        DescriptionError: a controller's parameter is invalid.
    """
    plugin = next((device for device in owner.devices if isinstance(device, RosControl)), None)
    if plugin is None:
        return owner
    own = plugin.namespace
    base = f"/{namespace or owner.namespace if own is None else own}"
    devices, notes = controlled(owner, parameters_below(base))
    for line in notes:
        rospy.logwarn("%s, parameters of %s: %s", owner.name, base, line)
    return replace(owner, devices=devices)


class Robots:
    """Spawns and deletes robots together with their topics: those of their devices (`TOPICS`), and collision counts.

    Used from the simulation's thread; callbacks of the robots' subscribers only store a command.
    """

    def __init__(
        self, simulation: Simulation, timeline: Timeline, transforms: TransformTopic
    ) -> None:
        self._simulation = simulation
        self._ports: dict[str, Port] = {}
        self._drawing: TinyRenderer | None = None
        budget = Budget(timeline.pacer)
        self._context = Context(
            simulation, timeline.schedule, transforms, timeline.present, self._renderer, budget
        )

    def __len__(self) -> int:
        """Returns the number of robots."""
        return len(self._ports)

    def _renderer(self) -> TinyRenderer:
        """Returns the renderer for cameras, created on first use."""
        if self._drawing is None:
            self._drawing = TinyRenderer(triangles_of_mesh)
        return self._drawing

    def spawn(self, name: str, namespace: str, robot: Robot, pose: Pose) -> None:
        """Spawns a robot and starts its topics.

        Raises:
            SimulatorError: it cannot be spawned; nothing remains of it.
        """
        for line in robot.warnings:
            rospy.logwarn("%s: %s", name, line)
        robot = with_controllers(robot, namespace)
        entity = self._simulation.add_robot(name, namespace or robot.namespace, robot, pose)
        moved = math.dist(entity.initial.position[:2], pose.position[:2])
        if moved > 0:
            x, y, _ = entity.initial.position
            rospy.logwarn(
                "%s: its pose overlaps something; it is moved by %.2f m to (%.2f, %.2f)",
                name,
                moved,
                x,
                y,
            )
        try:
            self._start(entity)
        except SimulatorError:
            self._simulation.remove(name)
            raise

    def add_model(self, model: Model, namespace: str) -> None:
        """Adds a model, with topics if it has sensors or plugins.

        Raises:
            SimulatorError: it cannot be added; nothing remains of it.
        """
        self._simulation.add_model(with_controllers(model, namespace), namespace)
        try:
            self.start_topics()
        except SimulatorError:
            self._simulation.remove(model.name)
            raise

    def start_topics(self) -> None:
        """Starts the topics of models with sensors or plugins that have none yet, such as those of a world file.

        Raises:
            RateError: a rate does not divide the tick rate.
        """
        for entity in self._simulation.entities():
            if entity.robot is not None and entity.name not in self._ports:
                self._start(entity)

    def _start(self, entity: Entity) -> None:
        assert entity.robot is not None, "only a robot has topics"
        port = Port(self._context, entity)
        try:
            for device in entity.robot.devices:
                TOPICS[type(device)](port.within(device.namespace), device)
        except Exception:
            port.close()
            raise
        port.publish_collisions()
        self._ports[entity.name] = port

    def delete(self, name: str) -> None:
        """Removes a model and its topics.

        Raises:
            ModelError: there is no model of that name.
        """
        port = self._ports.pop(name, None)
        if port is not None:
            port.close()
        self._simulation.remove(name)

    def reset(self) -> None:
        """Resets all topics that depend on time."""
        for port in self._ports.values():
            port.reset()

    def remove_lost(self) -> None:
        """Removes models that have left the world's bounds or whose state is not finite."""
        for name in self._simulation.lost():
            rospy.logerr(
                "model %s has left the world or its state is not finite: it is removed", name
            )
            self.delete(name)

    def publish_collisions(self) -> None:
        """Publishes the collision counts of all robots that started to touch something."""
        for entity in self._simulation.collided():
            if entity.name in self._ports:
                self._ports[entity.name].publish_collisions()

    def close(self) -> None:
        """Frees the renderer."""
        if self._drawing is not None:
            self._drawing.close()
