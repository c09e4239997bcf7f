"""The services of gazebo_ros that spawn and delete models."""

from dataclasses import replace

import rosgraph.names
import rospy
from gazebo_msgs import srv

from pioneer_gazebo.adapters.mesh import prepare
from pioneer_gazebo.adapters.resource import model_path
from pioneer_gazebo.adapters.sdf import world_from_sdf_text
from pioneer_gazebo.adapters.urdf import robot_from_urdf
from pioneer_gazebo.conversions import pose_from_message
from pioneer_gazebo.core import state
from pioneer_gazebo.core.error import ModelError
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.nodes.mailbox import Mailbox
from pioneer_gazebo.nodes.robots import Robots
from pioneer_gazebo.nodes.service import serve

LONGEST_NAMESPACE = 200
"""Maximum length of a namespace [characters]."""


class SpawnServices:
    """``spawn_urdf_model``, ``spawn_sdf_model`` and ``delete_model``."""

    def __init__(self, mailbox: Mailbox, simulation: Simulation, robots: Robots) -> None:
        """Starts the services."""
        self._mailbox, self._simulation, self._robots = mailbox, simulation, robots
        # Models are read in the service's own thread, so that the simulation keeps running.
        serve("spawn_urdf_model", srv.SpawnModel, self._spawn_urdf)
        serve("spawn_sdf_model", srv.SpawnModel, self._spawn_sdf)
        serve("delete_model", srv.DeleteModel, self._delete, mailbox)

    def _spawn_urdf(self, request: srv.SpawnModelRequest) -> str:
        name, namespace = request.model_name, _namespace(request)
        robot = robot_from_urdf(request.model_xml, name)
        prepare(robot.links, robot.static, rospy.loginfo)
        pose = self._mailbox.call(lambda: self._initial_pose(request))
        self._mailbox.call(lambda: self._robots.spawn(name, namespace, robot, pose))
        return _spawned(name)

    def _spawn_sdf(self, request: srv.SpawnModelRequest) -> str:
        name, namespace = request.model_name, _namespace(request)
        world = world_from_sdf_text(request.model_xml, model_path(), name)
        for line in world.warnings:
            rospy.logwarn("%s: %s", name, line)
        if len(world.models) != 1:
            raise ModelError(f"{name}: the SDF has to hold one model, not {len(world.models)}")
        [model] = world.models
        prepare(model.links, model.static, rospy.loginfo)
        pose = self._mailbox.call(lambda: self._initial_pose(request))
        self._mailbox.call(lambda: self._robots.add_model(replace(model.moved(pose), name=name), namespace))
        return _spawned(name)

    def _initial_pose(self, request: srv.SpawnModelRequest) -> Pose:
        base, _ = state.motion(self._simulation, request.reference_frame)
        return base.compose(pose_from_message(request.initial_pose))

    def _delete(self, request: srv.DeleteModelRequest) -> str:
        self._robots.delete(request.model_name)
        return f"deleted {request.model_name}"


def _spawned(name: str) -> str:
    rospy.loginfo("spawned %s", name)
    return f"spawned {name}"


def _namespace(request: srv.SpawnModelRequest) -> str:
    """Returns the requested namespace without leading and trailing slashes; empty for none.

    Raises:
        ModelError: it is not a legal ROS name.
    """
    namespace = request.robot_namespace.strip("/")
    if namespace and not (len(namespace) <= LONGEST_NAMESPACE and rosgraph.names.is_legal_name(namespace)):
        raise ModelError(
            f"robot_namespace {namespace[:60]!r} ({len(namespace)} characters) is no name in ROS:"
            f" at most {LONGEST_NAMESPACE} letters, digits, _ and /, a letter first"
        )
    return namespace
