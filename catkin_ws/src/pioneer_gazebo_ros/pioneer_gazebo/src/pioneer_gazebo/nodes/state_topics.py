"""Topics of ``/gazebo``: states of all models and links, and the topics that set them."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import rospy
from gazebo_msgs.msg import LinkState, LinkStates, ModelState, ModelStates

from pioneer_gazebo import conversions
from pioneer_gazebo.core import state
from pioneer_gazebo.core.engine import Velocity
from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.core.pose import Pose
from pioneer_gazebo.nodes.timeline import Timeline
from pioneer_gazebo.nodes.topic import Topic


class StateTopics:
    """Publishes ``/gazebo/model_states`` and ``/gazebo/link_states``, and subscribes to their setters.

    An invalid message is logged in one line and ignored.
    """

    def __init__(self, timeline: Timeline, rate: float) -> None:
        """Publishes at ``rate`` [Hz]."""
        self._mailbox, self._simulation = timeline.mailbox, timeline.simulation
        for what, kind, things in (("model", ModelStates, self._models), ("link", LinkStates, self._links)):
            topic = Topic(f"/gazebo/{what}_states", kind, timeline.schedule.review)
            publish = partial(self._publish, topic, kind, things)
            timeline.schedule.add(f"/gazebo/{what}_states", rate, publish, lambda topic=topic: topic.wanted)
        rospy.Subscriber("/gazebo/set_model_state", ModelState, self._set, "model_name", queue_size=10)
        rospy.Subscriber("/gazebo/set_link_state", LinkState, self._set, "link_name", queue_size=10)

    def _models(self) -> Iterator[tuple[str, tuple[Pose, Velocity]]]:
        for name in self._simulation.names():
            yield name, state.model_motion(self._simulation, name)

    def _links(self) -> Iterator[tuple[str, tuple[Pose, Velocity]]]:
        for name in self._simulation.names():
            for link in state.links_of(self._simulation, name):
                yield f"{name}::{link}", state.link_motion(self._simulation, name, link)

    def _publish(self, topic: Topic, kind: type, things: Callable[[], Iterator[Any]], tick: int) -> None:
        del tick  # these messages have no time stamp
        message: Any = kind()
        for name, (pose, velocity) in things():
            message.name.append(name)
            message.pose.append(conversions.message_from_pose(pose))
            message.twist.append(conversions.message_from_velocity(velocity))
        topic.send(conversions.frame_of(message))

    def _set(self, message: ModelState | LinkState, field: str) -> None:
        self._mailbox.post(lambda: self._follow(getattr(message, field), message))

    def _follow(self, name: str, message: ModelState | LinkState) -> None:
        try:
            pose, velocity = (
                conversions.pose_from_message(message.pose),
                conversions.velocity_from_message(message.twist),
            )
            state.place(self._simulation, name, pose, velocity, message.reference_frame)
        except (SimulatorError, ValueError) as error:
            rospy.logerr_throttle(1.0, f"state of {name} not set: {error}")
