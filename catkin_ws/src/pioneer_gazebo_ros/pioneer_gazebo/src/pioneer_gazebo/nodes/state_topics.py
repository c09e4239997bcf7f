"""``/gazebo``'s own topics: the states of all models and links, and the topics that set them."""

import rospy
from gazebo_msgs.msg import LinkState, LinkStates, ModelState, ModelStates

from pioneer_gazebo import conversions
from pioneer_gazebo.core import state
from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.nodes.timeline import Timeline
from pioneer_gazebo.nodes.topic import Topic


class StateTopics:
    """Publishes ``/gazebo/model_states`` and ``/gazebo/link_states`` and listens to their setters.

    An invalid message is logged in one line and ignored.
    """

    def __init__(self, timeline: Timeline, rate: float) -> None:
        """Publishes at ``rate`` [Hz]."""
        self._mailbox, self._simulation = timeline.mailbox, timeline.simulation
        schedule = timeline.schedule
        self._models = Topic("/gazebo/model_states", ModelStates, schedule.review)
        self._links = Topic("/gazebo/link_states", LinkStates, schedule.review)
        schedule.add("/gazebo/model_states", rate, self._publish_models, lambda: self._models.wanted)
        schedule.add("/gazebo/link_states", rate, self._publish_links, lambda: self._links.wanted)
        rospy.Subscriber("/gazebo/set_model_state", ModelState, self._set_model, queue_size=10)
        rospy.Subscriber("/gazebo/set_link_state", LinkState, self._set_link, queue_size=10)

    def _publish_models(self, tick: int) -> None:
        del tick  # these messages carry no time
        self._models.send(conversions.frame_of(self._model_states()))

    def _publish_links(self, tick: int) -> None:
        del tick
        self._links.send(conversions.frame_of(self._link_states()))

    def _model_states(self) -> ModelStates:
        message = ModelStates()
        for name in self._simulation.names():
            pose, velocity = state.model_motion(self._simulation, name)
            message.name.append(name)
            message.pose.append(conversions.message_from_pose(pose))
            message.twist.append(conversions.message_from_velocity(velocity))
        return message

    def _link_states(self) -> LinkStates:
        message = LinkStates()
        for name in self._simulation.names():
            for link in state.links_of(self._simulation, name):
                pose, velocity = state.link_motion(self._simulation, name, link)
                message.name.append(f"{name}::{link}")
                message.pose.append(conversions.message_from_pose(pose))
                message.twist.append(conversions.message_from_velocity(velocity))
        return message

    def _set_model(self, message: ModelState) -> None:
        self._mailbox.post(lambda: self._follow(message.model_name, message))

    def _set_link(self, message: LinkState) -> None:
        self._mailbox.post(lambda: self._follow(message.link_name, message))

    def _follow(self, name: str, message: ModelState | LinkState) -> None:
        try:
            pose, velocity = (
                conversions.pose_from_message(message.pose),
                conversions.velocity_from_message(message.twist),
            )
            state.place(self._simulation, name, pose, velocity, message.reference_frame)
        except (SimulatorError, ValueError) as error:
            rospy.logerr_throttle(1.0, f"state of {name} not set: {error}")
