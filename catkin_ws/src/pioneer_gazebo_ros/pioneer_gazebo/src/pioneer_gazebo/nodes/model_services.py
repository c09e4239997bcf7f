"""The services of gazebo_ros for models and the world's model list."""

from gazebo_msgs import srv
from std_msgs.msg import Header

from pioneer_gazebo import conversions
from pioneer_gazebo.core import state
from pioneer_gazebo.core.error import ModelError
from pioneer_gazebo.core.schedule import TICK_RATE, nanoseconds
from pioneer_gazebo.core.simulation import Simulation
from pioneer_gazebo.nodes.mailbox import Mailbox
from pioneer_gazebo.nodes.service import serve


class ModelServices:
    """Reads and sets model states and properties."""

    def __init__(self, mailbox: Mailbox, simulation: Simulation) -> None:
        """Starts the services."""
        self._simulation = simulation
        self._sequence: dict[tuple[str, str], int] = {}
        serve("get_world_properties", srv.GetWorldProperties, lambda _: self._world(), mailbox)
        serve("get_model_properties", srv.GetModelProperties, self._properties, mailbox)
        serve("get_model_state", srv.GetModelState, self._state, mailbox)
        serve("set_model_state", srv.SetModelState, self._set_state, mailbox)
        serve("set_model_configuration", srv.SetModelConfiguration, self._configuration, mailbox)

    def _world(self) -> srv.GetWorldPropertiesResponse:
        time = self._simulation.tick / TICK_RATE
        return srv.GetWorldPropertiesResponse(sim_time=time, model_names=self._simulation.names())

    def _properties(self, request: srv.GetModelPropertiesRequest) -> srv.GetModelPropertiesResponse:
        name = request.model_name
        links = state.links_of(self._simulation, name)
        response = srv.GetModelPropertiesResponse(canonical_body_name=links[0] if links else "", body_names=links)
        standing = self._simulation.standing(name)
        if standing is not None:
            response.is_static = True
            response.geom_names = [one.name for link in standing.links for one in link.collisions]
        else:
            parts = self._simulation.entity(name).body.parts
            geometry = [touch.collision.name for part in parts for touch in part.touches]
            response.geom_names = list(dict.fromkeys(geometry))
            response.joint_names = [part.joint.name for part in parts if part.joint is not None]
        return response

    def _state(self, request: srv.GetModelStateRequest) -> srv.GetModelStateResponse:
        key = (request.model_name, request.relative_entity_name)
        if not request.model_name:
            raise ModelError("no model is named")
        pose, velocity = state.relative(self._simulation, *key)
        self._sequence[key] = self._sequence.get(key, 0) + 1
        stamp = conversions.time_of(nanoseconds(self._simulation.tick))
        return srv.GetModelStateResponse(
            header=Header(self._sequence[key], stamp, request.relative_entity_name),
            pose=conversions.message_from_pose(pose),
            twist=conversions.message_from_velocity(velocity),
        )

    def _set_state(self, request: srv.SetModelStateRequest) -> str:
        wanted = request.model_state
        pose, velocity = conversions.pose_from_message(wanted.pose), conversions.velocity_from_message(wanted.twist)
        state.place(self._simulation, wanted.model_name, pose, velocity, wanted.reference_frame)
        return f"state of {wanted.model_name} set"

    def _configuration(self, request: srv.SetModelConfigurationRequest) -> str:
        if len(request.joint_names) != len(request.joint_positions):
            raise ValueError(f"{len(request.joint_names)} joints and {len(request.joint_positions)} positions")
        entity = self._simulation.entity(request.model_name)
        for name, position in zip(request.joint_names, request.joint_positions, strict=True):
            try:
                self._simulation.set_joint(entity, name, position)
            except KeyError:
                raise ModelError(f"model {entity.name} has no movable joint {name}") from None
        return "joints set"
