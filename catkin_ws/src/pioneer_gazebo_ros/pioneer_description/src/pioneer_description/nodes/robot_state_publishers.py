"""``robot_state_publishers ROBOT …``: the robot_state_publisher of each robot, all in one process.

Each is its own node, ``/ROBOT/robot_state_publisher``, and publishes what ROS's node of that name publishes: the
frames of the joints in ``/ROBOT/joint_states`` on ``/tf`` and those of fixed joints on ``/tf_static``, prefixed with
``tf_prefix``. Fifteen separate ROS nodes would each poll the simulated clock a thousand times a second, and ask the
master for ``tf_prefix`` three times per message. Not supported: mimic joints, ``use_tf_static``, ``ignore_timestamp``.

Parameters, searched from each node's name upwards: ``robot_description`` (URDF), ``tf_prefix``; private:
``~publish_frequency`` (50 Hz).
"""

import sys
from collections.abc import Sequence
from functools import cache, partial

import rosgraph
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from pioneer_description.conversions import MalformedMessageError, joint_positions
from pioneer_description.core.joint_frames import JointFrames
from pioneer_gazebo.error import DescriptionError
from pioneer_gazebo.ros.messages import TransformTemplate, transforms_frame
from pioneer_gazebo.world.joint import Joint
from pioneer_gazebo.world.urdf import robot_from_urdf
from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.adapters.node_process import NodeProcess

NAME = "robot_state_publisher"
FREQUENCY = 50.0
"""Default publish frequency per joint [Hz]."""


class StatePublisher:
    """The robot_state_publisher of one robot.

    Args:
        robot: the robot's name and namespace.
        node: the node to publish with.

    Raises:
        DescriptionError: the robot has no description, or an invalid one.
    """

    def __init__(self, robot: str, node: NodeHandle) -> None:
        self._node = node
        self._frames, prefix = _described(robot, node)
        self._malformed = False
        self._templates = {
            name: _template(joint, prefix) for name, joint in self._frames.moving.items()
        }
        self._transforms = node.advertise("/tf", TFMessage)
        fixed = node.advertise("/tf_static", TFMessage, latch=True)
        fixed.send(
            transforms_frame(
                [_template(joint, prefix).fill(0, joint.pose) for joint in self._frames.fixed]
            )
        )
        node.subscribe_serialised("joint_states", JointState, self._on_joint_states)

    def _on_joint_states(self, message: bytes | memoryview, _sender: str) -> None:
        try:
            state = joint_positions(message)
        except MalformedMessageError as error:
            if not self._malformed:
                self._node.logger.error("left out messages on joint_states: %s", error)
            self._malformed = True
            return
        if due := self._frames.due(state.time, state.names):
            at = dict(zip(state.names, state.positions, strict=True))
            filled = [
                self._templates[name].fill(state.time, self._frames.pose(name, at[name]))
                for name in due
            ]
            self._transforms.send(transforms_frame(filled))


def _template(joint: Joint, prefix: str) -> TransformTemplate:
    parent, child = (f"{prefix}/{link}" if prefix else link for link in (joint.parent, joint.child))
    return TransformTemplate(parent, child)


@cache
def _joints(description: str) -> tuple[Joint, ...]:
    return robot_from_urdf(description).joints


def _described(robot: str, node: NodeHandle) -> tuple[JointFrames, str]:
    """Returns a robot's joints and the prefix of its frames; raises DescriptionError."""
    description = node.found_parameter("robot_description", None)
    if not description:
        raise DescriptionError(f"there is no parameter robot_description in /{robot} or above")
    frequency = float(node.parameter("~publish_frequency", FREQUENCY))
    frames = JointFrames(_joints(str(description)), int(1e9 / max(frequency, 1.0)))
    return frames, str(node.found_parameter("tf_prefix", "")).strip("/")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the nodes until shutdown; returns the exit status."""
    words = list(argv) if argv is not None else sys.argv
    robots = [word.strip("/") for word in rosgraph.myargv(words)[1:]]
    if not robots or {"-h", "--help"} & set(robots):
        sys.stdout.write(
            "usage: robot_state_publishers ROBOT [ROBOT …], each the namespace of a robot\n"
        )
        return 0 if robots else 2
    process = NodeProcess(
        words, (DescriptionError, ValueError, TypeError), wall_time=True, logger="ros"
    )
    made = [
        process.add(f"/{robot}/{NAME}", partial(StatePublisher, robot))
        for robot in dict.fromkeys(robots)
    ]
    if not any(made):
        process.fail()
    return process.run()
