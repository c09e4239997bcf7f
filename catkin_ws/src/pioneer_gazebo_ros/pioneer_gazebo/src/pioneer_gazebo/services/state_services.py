"""The services and topics of gazebo_ros for models, links and joints: states, properties, forces."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import rospy
from gazebo_msgs import srv
from gazebo_msgs.msg import LinkState, LinkStates, ModelState, ModelStates
from std_msgs.msg import Header

from pioneer_gazebo.error import ModelError, SimulatorError
from pioneer_gazebo.physics.engine import Velocity
from pioneer_gazebo.ros import messages
from pioneer_gazebo.ros.mailbox import serve
from pioneer_gazebo.ros.topic import Topic
from pioneer_gazebo.simulation import state
from pioneer_gazebo.simulation.actor import Effort, Wrench
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE, nanoseconds
from pioneer_gazebo.timeline import Timeline
from pioneer_gazebo.world import joint as kinds
from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.pose import Pose

_TYPES = {
    kinds.REVOLUTE: srv.GetJointPropertiesResponse.REVOLUTE,
    kinds.CONTINUOUS: srv.GetJointPropertiesResponse.CONTINUOUS,
    kinds.PRISMATIC: srv.GetJointPropertiesResponse.PRISMATIC,
}


class StateServices:
    """Reads and sets the states of models, links and joints, and applies wrenches to links.

    Subscribes: ``/gazebo/set_model_state``, ``/gazebo/set_link_state``.

    Publishes: ``/gazebo/model_states``, ``/gazebo/link_states``.

    On error: an invalid message is logged in one line and ignored.
    """

    def __init__(self, timeline: Timeline, rate: float) -> None:
        """Starts the services, and the topics at ``rate`` [Hz]."""
        self._mailbox, self._simulation = timeline.mailbox, timeline.simulation
        self._sequence: dict[tuple[str, str], int] = {}
        for what, kind, things in (
            ("model", ModelStates, self._models),
            ("link", LinkStates, self._links),
        ):
            topic = Topic(f"/gazebo/{what}_states", kind, timeline.schedule.review)
            publish = partial(self._publish, topic, kind, things)
            timeline.schedule.add(
                f"/gazebo/{what}_states", rate, publish, lambda topic=topic: topic.wanted
            )
        rospy.Subscriber(
            "/gazebo/set_model_state", ModelState, self._set, "model_name", queue_size=10
        )
        rospy.Subscriber("/gazebo/set_link_state", LinkState, self._set, "link_name", queue_size=10)
        for name, service, handler in (
            ("get_world_properties", srv.GetWorldProperties, self._world),
            ("get_model_properties", srv.GetModelProperties, self._model_properties),
            ("get_model_state", srv.GetModelState, self._model_state),
            ("set_model_state", srv.SetModelState, self._set_model_state),
            ("set_model_configuration", srv.SetModelConfiguration, self._set_joints),
            ("get_link_state", srv.GetLinkState, self._link_state),
            ("set_link_state", srv.SetLinkState, self._set_link_state),
            ("get_link_properties", srv.GetLinkProperties, self._link_properties),
            ("get_joint_properties", srv.GetJointProperties, self._joint_properties),
            ("apply_body_wrench", srv.ApplyBodyWrench, self._push),
            ("clear_body_wrenches", srv.BodyRequest, self._clear),
            ("apply_joint_effort", srv.ApplyJointEffort, self._apply_effort),
            ("clear_joint_forces", srv.JointRequest, self._clear_efforts),
            ("clear_joint_efforts", srv.JointRequest, self._clear_efforts),
        ):
            serve(name, service, handler, self._mailbox)

    def _models(self) -> Iterator[tuple[str, tuple[Pose, Velocity]]]:
        for name in self._simulation.names():
            yield name, state.link_motion(self._simulation, name)

    def _links(self) -> Iterator[tuple[str, tuple[Pose, Velocity]]]:
        for name in self._simulation.names():
            for link in state.links_of(self._simulation, name):
                yield f"{name}::{link}", state.link_motion(self._simulation, name, link)

    def _publish(
        self, topic: Topic, kind: type, things: Callable[[], Iterator[Any]], tick: int
    ) -> None:
        del tick  # these messages have no time stamp
        message: Any = kind()
        for name, (pose, velocity) in things():
            message.name.append(name)
            message.pose.append(messages.message_from_pose(pose))
            message.twist.append(messages.message_from_velocity(velocity))
        topic.send(messages.frame_of(message))

    def _set(self, message: ModelState | LinkState, field: str) -> None:
        self._mailbox.post(lambda: self._follow(getattr(message, field), message))

    def _follow(self, name: str, message: ModelState | LinkState) -> None:
        try:
            self._place(name, message)
        except (SimulatorError, ValueError) as error:
            rospy.logerr_throttle(1.0, f"state of {name} not set: {error}")

    def _place(self, name: str, wanted: ModelState | LinkState, is_link: bool = False) -> None:
        pose, velocity = (
            messages.pose_from_message(wanted.pose),
            messages.velocity_from_message(wanted.twist),
        )
        state.place(
            self._simulation,
            _checked(name) if is_link else name,
            pose,
            velocity,
            wanted.reference_frame,
        )

    def _world(self, _: srv.GetWorldPropertiesRequest) -> srv.GetWorldPropertiesResponse:
        time = self._simulation.tick / TICK_RATE
        return srv.GetWorldPropertiesResponse(sim_time=time, model_names=self._simulation.names())

    def _model_properties(
        self, request: srv.GetModelPropertiesRequest
    ) -> srv.GetModelPropertiesResponse:
        name = request.model_name
        links = state.links_of(self._simulation, name)
        response = srv.GetModelPropertiesResponse(
            canonical_body_name=links[0] if links else "", body_names=links
        )
        standing = self._simulation.standing.get(name)
        if standing is not None:
            response.is_static = True
            response.geom_names = [one.name for link in standing.links for one in link.collisions]
        else:
            parts = self._simulation.entity(name).body.parts
            geometry = [touch.collision.name for part in parts for touch in part.touches]
            response.geom_names = list(dict.fromkeys(geometry))
            response.joint_names = [part.joint.name for part in parts if part.joint is not None]
        return response

    def _model_state(self, request: srv.GetModelStateRequest) -> srv.GetModelStateResponse:
        key = (request.model_name, request.relative_entity_name)
        if not request.model_name:
            raise ModelError("no model is named")
        pose, velocity = state.relative(self._simulation, *key)
        self._sequence[key] = self._sequence.get(key, 0) + 1
        stamp = messages.time_of(nanoseconds(self._simulation.tick))
        return srv.GetModelStateResponse(
            header=Header(self._sequence[key], stamp, request.relative_entity_name),
            pose=messages.message_from_pose(pose),
            twist=messages.message_from_velocity(velocity),
        )

    def _set_model_state(self, request: srv.SetModelStateRequest) -> str:
        name = request.model_state.model_name
        self._place(name, request.model_state)
        return f"state of {name} set"

    def _set_joints(self, request: srv.SetModelConfigurationRequest) -> str:
        if len(request.joint_names) != len(request.joint_positions):
            raise ValueError(
                f"{len(request.joint_names)} joints and {len(request.joint_positions)} positions"
            )
        entity = self._simulation.entity(request.model_name)
        for name, position in zip(request.joint_names, request.joint_positions, strict=True):
            try:
                self._simulation.set_joint(entity, name, position)
            except KeyError:
                raise ModelError(f"model {entity.name} has no movable joint {name}") from None
        return "joints set"

    def _moving(self, name: str) -> tuple[Entity, int]:
        """Returns entity and part of ``model::link``."""
        model, link = state.split_name(self._simulation, _checked(name))
        entity = self._simulation.entity(model)
        return entity, state.part_of(entity, link)[0]

    def _link_state(self, request: srv.GetLinkStateRequest) -> srv.GetLinkStateResponse:
        pose, velocity = state.relative(
            self._simulation, _checked(request.link_name), request.reference_frame
        )
        message = LinkState(
            request.link_name,
            messages.message_from_pose(pose),
            messages.message_from_velocity(velocity),
            request.reference_frame,
        )
        return srv.GetLinkStateResponse(link_state=message)

    def _set_link_state(self, request: srv.SetLinkStateRequest) -> str:
        name = request.link_state.link_name
        self._place(name, request.link_state, is_link=True)
        return f"state of {name} set; its whole model moved along"

    def _link_properties(
        self, request: srv.GetLinkPropertiesRequest
    ) -> srv.GetLinkPropertiesResponse:
        entity, part = self._moving(request.link_name)
        rigid = entity.body.parts[part]
        inertia = rigid.inertia
        return srv.GetLinkPropertiesResponse(
            com=messages.message_from_pose(inertia.pose),
            gravity_mode=True,
            mass=rigid.mass,
            ixx=inertia.ixx,
            iyy=inertia.iyy,
            izz=inertia.izz,
            status_message="values are for all links merged by fixed joints",
        )

    def _joint_properties(
        self, request: srv.GetJointPropertiesRequest
    ) -> srv.GetJointPropertiesResponse:
        entity, part, joint = self._find_joint(request.joint_name)
        [(position, rate)] = self._simulation.joints(entity, [part])
        return srv.GetJointPropertiesResponse(
            type=_TYPES[joint.kind],
            damping=[joint.damping],
            position=[position],
            rate=[rate],
        )

    def _find_joint(self, name: str) -> tuple[Entity, int, Joint]:
        """Finds ``model::joint`` or, like Gazebo, ``joint`` in the first model that has it."""
        model, _, rest = name.rpartition("::")
        for entity in self._simulation.entities():
            if model and entity.name != model:
                continue
            for index, part in enumerate(entity.body.parts):
                if part.joint is not None and part.joint.name == rest:
                    return entity, index, part.joint
        raise ModelError(f"no model has a movable joint {name}")

    def _push(self, request: srv.ApplyBodyWrenchRequest) -> str:
        entity, part = self._moving(request.body_name)
        force, torque = state.wrench(
            self._simulation,
            request.body_name,
            request.reference_frame,
            messages.vector_from_message(request.reference_point),
            messages.vector_from_message(request.wrench.force),
            messages.vector_from_message(request.wrench.torque),
        )
        first, last = self._time_of(request)
        self._simulation.push(Wrench(entity, part, force, torque, None, first, last))
        return "wrench applied"

    def _time_of(
        self, request: srv.ApplyBodyWrenchRequest | srv.ApplyJointEffortRequest
    ) -> tuple[float, float]:
        """Returns the ticks at which a push begins and ends."""
        first = max(self._simulation.tick, request.start_time.to_sec() * TICK_RATE)
        duration = request.duration.to_sec()
        return first, math.inf if duration < 0 else first + duration * TICK_RATE

    def _clear(self, request: srv.BodyRequestRequest) -> None:
        entity, part = self._moving(request.body_name)
        self._simulation.clear_pushes(Wrench, entity, part)

    def _apply_effort(self, request: srv.ApplyJointEffortRequest) -> str:
        entity, part, _ = self._find_joint(request.joint_name)
        first, last = self._time_of(request)
        self._simulation.push(Effort(entity, part, request.effort, first, last))
        return "effort applied"

    def _clear_efforts(self, request: srv.JointRequestRequest) -> None:
        entity, part, _ = self._find_joint(request.joint_name)
        self._simulation.clear_pushes(Effort, entity, part)


def _checked(name: str) -> str:
    """Returns a link's name; raises ModelError if it does not have the form ``model::link``."""
    if not name.partition("::")[2]:
        raise ModelError(f"{name!r} does not name a link as model::link")
    return name
