"""``robot_state_publishers ROBOT …``: the robot_state_publisher of each robot, all in one process.

Each is a node of its own, ``/ROBOT/robot_state_publisher``, and publishes what ROS's node of that name publishes: the
frames of the joints in ``/ROBOT/joint_states`` on ``/tf``, those that do not move on ``/tf_static``, prefixed with
``tf_prefix``. Fifteen of ROS's look at a simulated clock a thousand times a second each, and ask the master for
``tf_prefix`` three times for every message. Not in it: mimic joints, ``use_tf_static`` and ``ignore_timestamp``.

Parameters, looked for from each node's name upwards: ``robot_description`` (URDF), ``tf_prefix``; of the node itself
``~publish_frequency`` (50 Hz).
"""

import logging
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import rosgraph
from roscpp.msg import Logger
from roscpp.srv import GetLoggers, GetLoggersResponse, SetLoggerLevel, SetLoggerLevelRequest, SetLoggerLevelResponse
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from pioneer_description.conversions import MalformedMessageError, joint_positions
from pioneer_description.core.joint_frames import JointFrames
from pioneer_gazebo.adapters.urdf import robot_from_urdf
from pioneer_gazebo.conversions import TransformTemplate, frame_of, transforms_frame
from pioneer_gazebo.core.error import DescriptionError
from pioneer_gazebo.core.joint import Joint
from pioneer_node.adapters.end_request import EndRequest
from tcpros.adapters.node import Node
from tcpros.adapters.node_context import NodeContext
from tcpros.adapters.reactor import Reactor

NAME = "robot_state_publisher"
FREQUENCY = 50.0
"""Messages a second about a joint where nothing else is asked for [Hz]."""
FAREWELL = 3.0
"""For so long the nodes may take themselves back from the master [s]."""

_logger = logging.getLogger(NAME)
_LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
_SEVERITIES = {10: Log.DEBUG, 20: Log.INFO, 30: Log.WARN, 40: Log.ERROR, 50: Log.FATAL}


class StatePublisher:
    """One robot's node. Everything happens in the reactor's thread.

    Args:
        context: what the nodes share.
        robot: its name and namespace.
        frames: its joints.
        prefix: of the frames' names; "" for none.
        shut_down: see `Node`.
    """

    def __init__(
        self, context: NodeContext, robot: str, frames: JointFrames, prefix: str, shut_down: Callable[[str], object]
    ) -> None:
        self.node = Node(context, f"/{robot}/{NAME}", shut_down)
        self.rosout = self.node.publish("/rosout", Log, latching=True)
        self._frames = frames
        self._malformed = False
        self._templates = {name: _template(joint, prefix) for name, joint in frames.moving.items()}
        self._transforms = self.node.publish("/tf", TFMessage)
        fixed = self.node.publish("/tf_static", TFMessage, latching=True)
        fixed.send(transforms_frame([_template(joint, prefix).fill(0, joint.pose) for joint in frames.fixed]))
        self.node.subscribe(f"/{robot}/joint_states", JointState, self._on_joint_states)
        self.node.serve(f"{self.node.name}/get_loggers", GetLoggers, _loggers)
        self.node.serve(f"{self.node.name}/set_logger_level", SetLoggerLevel, _set_level)

    def _on_joint_states(self, message: memoryview) -> None:
        try:
            state = joint_positions(message)
        except MalformedMessageError as error:
            if not self._malformed:
                _logger.error("%s leaves out messages on joint_states: %s", self.node.name, error)
            self._malformed = True
            return
        if due := self._frames.due(state.time, state.names):
            at = dict(zip(state.names, state.positions, strict=True))
            filled = [self._templates[name].fill(state.time, self._frames.pose(name, at[name])) for name in due]
            self._transforms.send(transforms_frame(filled))


def _template(joint: Joint, prefix: str) -> TransformTemplate:
    parent, child = (f"{prefix}/{link}" if prefix else link for link in (joint.parent, joint.child))
    return TransformTemplate(parent, child)


def _loggers(_request: bytes) -> bytes:
    level = next(word for word, number in _LEVELS.items() if number >= _logger.getEffectiveLevel())
    return bytes(frame_of(GetLoggersResponse([Logger("ros", level)])))


def _set_level(request: bytes) -> bytes:
    wanted = SetLoggerLevelRequest().deserialize(request).level.lower()
    _logger.setLevel(_LEVELS.get(wanted, _logger.level))
    return bytes(frame_of(SetLoggerLevelResponse()))


class _Rosout(logging.Handler):
    """Sends log lines to ``/rosout`` as a node's."""

    def __init__(self, reactor: Reactor, publisher: StatePublisher) -> None:
        super().__init__()
        self._reactor, self._publisher = reactor, publisher

    def emit(self, record: logging.LogRecord) -> None:
        """Sends a line."""
        message = Log(
            level=_SEVERITIES.get(record.levelno, Log.INFO),
            name=self._publisher.node.name,
            msg=record.getMessage(),
            file=record.filename,
            function=record.funcName,
            line=record.lineno,
        )
        self._reactor.call(partial(self._publisher.rosout.send, bytes(frame_of(message))))


class Publishers:
    """All nodes of the process."""

    def __init__(self, context: NodeContext, ending: EndRequest) -> None:
        self._context, self._ending = context, ending
        self._running: dict[str, StatePublisher] = {}
        self._all_closed = threading.Event()

    def add(self, robot: str, frames: JointFrames, prefix: str) -> None:
        """Starts a robot's node."""
        publisher = StatePublisher(self._context, robot, frames, prefix, partial(self._shut_down, robot))
        if not self._running:
            _logger.addHandler(_Rosout(self._context.reactor, publisher))
        self._running[robot] = publisher

    def close(self) -> None:
        """Takes all nodes back from the master; from another thread. Waits for that, though not for long."""
        self._context.reactor.call(self._close_all)
        if not self._all_closed.wait(FAREWELL):
            _logger.warning("the master does not answer: it may still show nodes that have ended")

    def _close_all(self) -> None:
        if not self._running:
            self._all_closed.set()
        for robot in tuple(self._running):
            self._close(robot)

    def _shut_down(self, robot: str, reason: str) -> None:
        if robot in self._running:
            _logger.info("/%s/%s ends: %s", robot, NAME, reason)
            self._close(robot)

    def _close(self, robot: str) -> None:
        def done() -> None:
            if self._running.pop(robot, None) is not None and not self._running:
                self._all_closed.set()
                self._ending.set()

        self._running[robot].node.close(done)


@cache
def _joints(description: str) -> tuple[Joint, ...]:
    return robot_from_urdf(description).joints


def _described(master: rosgraph.Master, robot: str) -> tuple[JointFrames, str]:
    """Returns a robot's joints and the prefix of its frames. Raises DescriptionError, rosgraph.MasterError."""

    def found(name: str, default: Any) -> Any:
        try:
            return master.getParam(master.searchParam(name))
        except rosgraph.MasterError:  # no namespace from the node's upwards has it
            return default

    description = found("robot_description", None)
    if not description:
        raise DescriptionError(f"there is no parameter robot_description in /{robot} or above")
    own = f"/{robot}/{NAME}/publish_frequency"
    frequency = float(master.getParam(own)) if master.hasParam(own) else FREQUENCY
    frames = JointFrames(_joints(str(description)), int(1e9 / max(frequency, 1.0)))
    return frames, str(found("tf_prefix", "")).strip("/")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the nodes until they are asked to end; returns the exit status."""
    robots = [word.strip("/") for word in rosgraph.myargv(list(argv) if argv is not None else sys.argv)[1:]]
    if not robots or {"-h", "--help"} & set(robots):
        sys.stdout.write("usage: robot_state_publishers ROBOT [ROBOT …], each the namespace of a robot\n")
        return 0 if robots else 2
    logging.basicConfig(stream=sys.stderr, format="[%(levelname)s] %(message)s", level=logging.INFO)
    ending = EndRequest()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    reactor = Reactor(_logger)
    host, bind = rosgraph.network.get_host_name(), rosgraph.network.get_bind_address()
    publishers = Publishers(NodeContext(reactor, rosgraph.get_master_uri(), host, bind, _logger), ending)
    started = 0
    for robot in dict.fromkeys(robots):
        try:
            frames, prefix = _described(rosgraph.Master(f"/{robot}/{NAME}"), robot)
        except (DescriptionError, ValueError, TypeError, rosgraph.MasterError, OSError) as error:
            _logger.error("%s has no robot_state_publisher: %s", robot, error)
            continue
        started += 1
        reactor.call(partial(publishers.add, robot, frames, prefix))
    if not started:
        return 1
    reactor.start()
    ending.wait()
    publishers.close()
    reactor.stop()
    return 0
