"""The services of gazebo_ros that spawn and delete models, and those for time and physics."""

import math
from dataclasses import replace

import rosgraph.names
import rospy
from gazebo_msgs import srv
from gazebo_msgs.msg import ODEPhysics
from geometry_msgs.msg import Vector3
from std_srvs.srv import Empty, EmptyRequest, Trigger, TriggerRequest

from pioneer_gazebo.error import ModelError
from pioneer_gazebo.physics.engine import Physics
from pioneer_gazebo.ros.mailbox import serve
from pioneer_gazebo.ros.messages import pose_from_message, vector_from_message
from pioneer_gazebo.simulation import state
from pioneer_gazebo.simulation.schedule import TICK_RATE, nearest_step
from pioneer_gazebo.timeline import StepError, Timeline
from pioneer_gazebo.topics.robots import Robots
from pioneer_gazebo.world.mesh import prepare
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.resource import model_path
from pioneer_gazebo.world.sdf import world_from_sdf_text
from pioneer_gazebo.world.urdf import robot_from_urdf

LONGEST_STEP = 1.0
"""Maximum physics step [s]."""

STEP_PATIENCE = 30.0
"""Time limit of a step [s of wall time]; only nodes in lockstep can delay one."""

LONGEST_NAMESPACE = 200
"""Maximum length of a namespace [characters]."""


class WorldServices:
    """Spawns and deletes models; pauses, resumes, steps and resets simulated time, and configures physics."""

    def __init__(self, timeline: Timeline, robots: Robots) -> None:
        """Starts the services."""
        self._timeline, self._robots, self._simulation = timeline, robots, timeline.simulation
        self._mailbox = timeline.mailbox
        # Models are read in the service's own thread, so that the simulation keeps running.
        serve("spawn_urdf_model", srv.SpawnModel, self._spawn_urdf)
        serve("spawn_sdf_model", srv.SpawnModel, self._spawn_sdf)
        for name, kind, handler in (
            ("delete_model", srv.DeleteModel, self._delete),
            ("get_physics_properties", srv.GetPhysicsProperties, self._physics),
            ("set_physics_properties", srv.SetPhysicsProperties, self._set_physics),
            ("pause_physics", Empty, lambda _: timeline.pause(True)),
            ("unpause_physics", Empty, lambda _: timeline.pause(False)),
            ("reset_world", Empty, self._reset_world),
            ("reset_simulation", Empty, self._reset_simulation),
        ):
            serve(name, kind, handler, self._mailbox)
        # A step may wait for nodes in lockstep, whose answers come through the mailbox.
        serve("step", Trigger, self._step)

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
        self._mailbox.call(
            lambda: self._robots.add_model(replace(model.moved(pose), name=name), namespace)
        )
        return _spawned(name)

    def _initial_pose(self, request: srv.SpawnModelRequest) -> Pose:
        base, _ = state.motion(self._simulation, request.reference_frame)
        return base.compose(pose_from_message(request.initial_pose))

    def _delete(self, request: srv.DeleteModelRequest) -> str:
        self._robots.delete(request.model_name)
        return f"deleted {request.model_name}"

    def _physics(self, _: srv.GetPhysicsPropertiesRequest) -> srv.GetPhysicsPropertiesResponse:
        physics = self._simulation.physics
        return srv.GetPhysicsPropertiesResponse(
            time_step=physics.step,
            pause=self._timeline.paused,
            max_update_rate=self._timeline.pacer.factor / physics.step,
            gravity=Vector3(*physics.gravity),
            ode_config=ODEPhysics(sor_pgs_iters=physics.iterations, sor_pgs_w=1.0),
            status_message="of ode_config only sor_pgs_iters is used here",
        )

    def _set_physics(self, request: srv.SetPhysicsPropertiesRequest) -> str:
        if not (math.isfinite(request.max_update_rate) and request.max_update_rate >= 0):
            raise ValueError(
                f"max_update_rate must be 0 (as fast as possible) or more, not {request.max_update_rate}"
            )
        if not 0 < request.time_step <= LONGEST_STEP:
            raise ValueError(
                f"time_step must be above 0 and at most {LONGEST_STEP:g} s, not {request.time_step}"
            )
        iterations = request.ode_config.sor_pgs_iters or self._simulation.physics.iterations
        gravity = vector_from_message(request.gravity)
        # Steps are whole numbers of ticks: a step that was read and rounded by a caller must not change.
        step = nearest_step(request.time_step)
        self._simulation.configure(Physics(step, iterations, gravity))
        if abs(step - request.time_step) * TICK_RATE < 1e-3:
            self._timeline.set_factor(request.max_update_rate * step)
            return "physics set"
        # The caller's real-time factor remains what it asked for.
        self._timeline.set_factor(request.max_update_rate * request.time_step)
        return (
            f"physics set; time_step is {step:.6g} s in place of {request.time_step:.6g} s:"
            f" a step is a multiple of 1/{TICK_RATE} s"
        )

    def _reset_world(self, _: EmptyRequest) -> None:
        self._simulation.reset_poses()
        self._timeline.publish_now()

    def _reset_simulation(self, _: EmptyRequest) -> None:
        self._timeline.restart()
        self._robots.reset()
        self._timeline.publish_now()

    def _step(self, _: TriggerRequest) -> str:
        done = self._mailbox.call(self._timeline.request_step)
        try:
            tick = done.result(STEP_PATIENCE)
        except TimeoutError:
            reason = f"the step is not done after {STEP_PATIENCE:g} s: lockstep waits for its nodes"
            self._mailbox.call(lambda: self._timeline.cancel_steps(reason))
            raise StepError(reason) from None
        return f"simulated time is {tick / TICK_RATE:.6f} s"


def _spawned(name: str) -> str:
    rospy.loginfo("spawned %s", name)
    return f"spawned {name}"


def _namespace(request: srv.SpawnModelRequest) -> str:
    """Returns the requested namespace without leading and trailing slashes; empty for none.

    Raises:
        ModelError: it is not a legal ROS name.
    """
    namespace = request.robot_namespace.strip("/")
    if namespace and not (
        len(namespace) <= LONGEST_NAMESPACE and rosgraph.names.is_legal_name(namespace)
    ):
        raise ModelError(
            f"robot_namespace {namespace[:60]!r} ({len(namespace)} characters) is no name in ROS:"
            f" at most {LONGEST_NAMESPACE} letters, digits, _ and /, a letter first"
        )
    return namespace
