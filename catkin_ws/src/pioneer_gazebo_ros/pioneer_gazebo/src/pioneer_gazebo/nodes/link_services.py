"""The services of gazebo_ros for links, joints, and forces on links."""

import math

from gazebo_msgs import srv
from gazebo_msgs.msg import LinkState

from pioneer_gazebo import conversions
from pioneer_gazebo.core import joint as kinds
from pioneer_gazebo.core import state
from pioneer_gazebo.core.entity import Entity
from pioneer_gazebo.core.error import ModelError
from pioneer_gazebo.core.joint import Joint
from pioneer_gazebo.core.pose import Pose, rotated
from pioneer_gazebo.core.schedule import TICK_RATE
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.core.wrench import Wrench
from pioneer_gazebo.nodes.mailbox import Mailbox
from pioneer_gazebo.nodes.service import serve

_TYPES = {
    kinds.REVOLUTE: srv.GetJointPropertiesResponse.REVOLUTE,
    kinds.CONTINUOUS: srv.GetJointPropertiesResponse.CONTINUOUS,
    kinds.PRISMATIC: srv.GetJointPropertiesResponse.PRISMATIC,
}


class LinkServices:
    """Reads and sets link states, and applies wrenches to links."""

    def __init__(self, mailbox: Mailbox, simulation: Simulation) -> None:
        """Starts the services."""
        self._simulation = simulation
        serve("get_link_state", srv.GetLinkState, self._state, mailbox)
        serve("set_link_state", srv.SetLinkState, self._set_state, mailbox)
        serve("get_link_properties", srv.GetLinkProperties, self._properties, mailbox)
        serve("get_joint_properties", srv.GetJointProperties, self._joint, mailbox)
        serve("apply_body_wrench", srv.ApplyBodyWrench, self._push, mailbox)
        serve("clear_body_wrenches", srv.BodyRequest, self._clear, mailbox)

    def _moving(self, name: str) -> tuple[Entity, int, Pose]:
        """Returns entity, part and pose in the part of ``model::link``."""
        model, link = state.split_name(_checked(name))
        entity = self._simulation.entity(model)
        return (entity, *state.part_of(entity, link))

    def _state(self, request: srv.GetLinkStateRequest) -> srv.GetLinkStateResponse:
        pose, velocity = state.relative(self._simulation, _checked(request.link_name), request.reference_frame)
        message = LinkState(
            request.link_name,
            conversions.message_from_pose(pose),
            conversions.message_from_velocity(velocity),
            request.reference_frame,
        )
        return srv.GetLinkStateResponse(link_state=message)

    def _set_state(self, request: srv.SetLinkStateRequest) -> str:
        wanted = request.link_state
        pose, velocity = conversions.pose_from_message(wanted.pose), conversions.velocity_from_message(wanted.twist)
        state.place(self._simulation, _checked(wanted.link_name), pose, velocity, wanted.reference_frame)
        return f"state of {wanted.link_name} set; its whole model moved along"

    def _properties(self, request: srv.GetLinkPropertiesRequest) -> srv.GetLinkPropertiesResponse:
        entity, part, _ = self._moving(request.link_name)
        rigid = entity.body.parts[part]
        inertia = rigid.inertia
        return srv.GetLinkPropertiesResponse(
            com=conversions.message_from_pose(inertia.pose),
            gravity_mode=True,
            mass=rigid.mass,
            ixx=inertia.ixx,
            iyy=inertia.iyy,
            izz=inertia.izz,
            status_message="values are for all links merged by fixed joints",
        )

    def _joint(self, request: srv.GetJointPropertiesRequest) -> srv.GetJointPropertiesResponse:
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
        entity, part, _ = self._moving(request.body_name)
        base, _ = state.motion(self._simulation, request.reference_frame)
        force = rotated(base.rotation, conversions.vector_from_message(request.wrench.force))
        torque = rotated(base.rotation, conversions.vector_from_message(request.wrench.torque))
        point = base.transform(conversions.vector_from_message(request.reference_point))
        if request.reference_frame in state.WORLD_NAMES and point == (0.0, 0.0, 0.0):
            point = state.motion(self._simulation, request.body_name)[0].position
        first = max(self._simulation.tick, round(request.start_time.to_sec() * TICK_RATE))
        duration = request.duration.to_sec()
        last = math.inf if duration < 0 else first + duration * TICK_RATE
        self._simulation.push(Wrench(entity, part, force, torque, point, first, last))
        return "wrench applied"

    def _clear(self, request: srv.BodyRequestRequest) -> None:
        entity, part, _ = self._moving(request.body_name)
        self._simulation.clear_pushes(entity, part)


def _checked(name: str) -> str:
    """Returns a link's name; raises ModelError if it does not have the form ``model::link``."""
    if not name.partition("::")[2]:
        raise ModelError(f"{name!r} does not name a link as model::link")
    return name
