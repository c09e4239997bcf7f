"""The services of gazebo_ros on the whole world: spawning, deleting, physics, time."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import rosgraph.names
import rospy
from gazebo_msgs import srv
from gazebo_msgs.msg import ODEPhysics
from geometry_msgs.msg import Vector3
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger, TriggerRequest, TriggerResponse

from pioneer_gazebo.adapters.resource import model_path
from pioneer_gazebo.adapters.sdf import world_from_sdf_text
from pioneer_gazebo.adapters.urdf import robot_from_urdf
from pioneer_gazebo.conversions import pose_from_message, vector_from_message
from pioneer_gazebo.core.engine import Physics
from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.core.schedule import TICK_RATE
from pioneer_gazebo.core.simulation import ModelError
from pioneer_gazebo.nodes import state
from pioneer_gazebo.nodes.link_services import LinkServices
from pioneer_gazebo.nodes.model_services import ModelServices
from pioneer_gazebo.nodes.service import refusal, serve

if TYPE_CHECKING:
    from pioneer_gazebo.nodes.gazebo import GazeboNode

LONGEST_NAMESPACE = 200
"""Characters."""


class Services:
    """Spawns, deletes, pauses, resets, and sets physics; `ModelServices` and `LinkServices` are started with it."""

    def __init__(self, node: "GazeboNode") -> None:
        """Starts all services."""
        self._node, self._simulation = node, node.simulation
        rospy.Service("/gazebo/spawn_urdf_model", srv.SpawnModel, self._spawn_urdf)
        rospy.Service("/gazebo/spawn_sdf_model", srv.SpawnModel, self._spawn_sdf)
        serve(node, "delete_model", srv.DeleteModel, self._delete)
        serve(node, "get_physics_properties", srv.GetPhysicsProperties, self._physics)
        serve(node, "set_physics_properties", srv.SetPhysicsProperties, self._set_physics)
        serve(node, "pause_physics", Empty, self._pause)
        serve(node, "unpause_physics", Empty, self._unpause)
        serve(node, "reset_world", Empty, self._reset_world)
        serve(node, "reset_simulation", Empty, self._reset_simulation)
        serve(node, "step", Trigger, self._step)
        ModelServices(node)
        LinkServices(node)

    def _spawn_urdf(self, request: srv.SpawnModelRequest) -> srv.SpawnModelResponse:
        """Reads the robot in the service's own thread, so that the simulation goes on meanwhile."""
        name = request.model_name
        try:
            robot = robot_from_urdf(request.model_xml, name)
            pose = self._node.mailbox.call(lambda: self._initial_pose(request))
            namespace = _namespace(request)
            self._node.mailbox.call(lambda: self._node.spawn_robot(name, namespace, robot, pose))
        except (SimulatorError, ValueError) as error:
            return refusal("spawn_urdf_model", srv.SpawnModel, str(error))
        return self._spawned(name)

    def _spawn_sdf(self, request: srv.SpawnModelRequest) -> srv.SpawnModelResponse:
        name = request.model_name
        try:
            namespace = _namespace(request)
            world = world_from_sdf_text(request.model_xml, model_path(), name)
            for line in world.warnings:
                rospy.logwarn("%s: %s", name, line)
            models = world.models
            if len(models) != 1:
                raise ModelError(f"{name}: the SDF has to hold one model, not {len(models)}")
            pose = self._node.mailbox.call(lambda: self._initial_pose(request))
            model = replace(models[0].moved(pose), name=name)
            self._node.mailbox.call(lambda: self._simulation.add_model(model, namespace))
        except (SimulatorError, ValueError) as error:
            return refusal("spawn_sdf_model", srv.SpawnModel, str(error))
        return self._spawned(name)

    def _initial_pose(self, request: srv.SpawnModelRequest) -> Pose:
        base, _ = state.motion(self._simulation, request.reference_frame)
        return base.compose(pose_from_message(request.initial_pose))

    def _spawned(self, name: str) -> srv.SpawnModelResponse:
        rospy.loginfo("spawned %s", name)
        return srv.SpawnModelResponse(True, f"spawned {name}")

    def _delete(self, request: srv.DeleteModelRequest) -> srv.DeleteModelResponse:
        self._node.delete(request.model_name)
        return srv.DeleteModelResponse(True, f"deleted {request.model_name}")

    def _physics(self, request: srv.GetPhysicsPropertiesRequest) -> srv.GetPhysicsPropertiesResponse:
        del request
        physics = self._simulation.physics
        return srv.GetPhysicsPropertiesResponse(
            time_step=physics.step,
            pause=self._node.paused,
            max_update_rate=self._node.pacer.factor / physics.step,
            gravity=Vector3(*physics.gravity),
            ode_config=ODEPhysics(sor_pgs_iters=physics.iterations, sor_pgs_w=1.0),
            success=True,
            status_message="of ode_config only sor_pgs_iters has a meaning here",
        )

    def _set_physics(self, request: srv.SetPhysicsPropertiesRequest) -> srv.SetPhysicsPropertiesResponse:
        if not (math.isfinite(request.max_update_rate) and request.max_update_rate >= 0):
            raise ValueError(f"max_update_rate must be 0 (as fast as possible) or more, not {request.max_update_rate}")
        if not (math.isfinite(request.time_step) and request.time_step > 0):
            raise ValueError(f"time_step must be above 0, not {request.time_step}")
        iterations = request.ode_config.sor_pgs_iters or self._simulation.physics.iterations
        gravity = vector_from_message(request.gravity)
        # Steps are whole ticks: a step that the caller read and rounded must come out as the same one.
        ticks = round(request.time_step * TICK_RATE)
        step = ticks / TICK_RATE if abs(ticks - request.time_step * TICK_RATE) < 1e-3 and ticks else request.time_step
        self._simulation.configure(Physics(step, iterations, gravity))
        self._node.pacer.factor = request.max_update_rate * step
        self._node.pacer.restart()
        return srv.SetPhysicsPropertiesResponse(True, "physics set")

    def _pause(self, request: EmptyRequest) -> EmptyResponse:
        del request
        self._node.pause(True)
        return EmptyResponse()

    def _unpause(self, request: EmptyRequest) -> EmptyResponse:
        del request
        self._node.pause(False)
        return EmptyResponse()

    def _reset_world(self, request: EmptyRequest) -> EmptyResponse:
        del request
        self._node.reset(time=False)
        return EmptyResponse()

    def _reset_simulation(self, request: EmptyRequest) -> EmptyResponse:
        del request
        self._node.reset(time=True)
        return EmptyResponse()

    def _step(self, request: TriggerRequest) -> TriggerResponse:
        del request
        if not self._node.paused:
            raise ModelError("step works while physics is paused (pause_physics)")
        self._node.step()
        return TriggerResponse(True, f"simulated time is {self._simulation.tick / TICK_RATE:.6f} s")


def _namespace(request: srv.SpawnModelRequest) -> str:
    """Returns the namespace a request asks for, without slashes at the ends; empty for none.

    Raises:
        ModelError: it is no name that ROS allows.
    """
    namespace = request.robot_namespace.strip("/")
    if namespace and not (len(namespace) <= LONGEST_NAMESPACE and rosgraph.names.is_legal_name(namespace)):
        raise ModelError(
            f"robot_namespace {namespace[:60]!r} ({len(namespace)} characters) is no name in ROS:"
            f" at most {LONGEST_NAMESPACE} letters, digits, _ and /, a letter first"
        )
    return namespace
