"""A client that follows a script step by step, and records every message that the simulator sends.

Usage: scripted_client.py ROBOTS SECONDS RATES OUTPUT, with RATES [Hz] as a JSON object by topic. The simulator is
paused at the start. Commands are sent while time is paused, and count as sent once the simulator has read them. Time
then advances by single steps, and later at its own rate. The client exits when every topic has reached SECONDS.
"""

import json
import socket
import sys
import threading
import xmlrpc.client
from pathlib import Path
from typing import Any

import rosgraph
import rospy
from gazebo_msgs.srv import SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion, Twist
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Empty, Trigger

from pioneer_harness.wait import wait_until

PATIENCE = 40.0
PLACES = {"a": (-1.0, -2.0, 0.0), "b": (0.6, -2.1, 3.1), "c": (-4.5, 3.5, 0.0)}
"""a and b meet; c is far from both."""

SCRIPT = {0: (0.6, 0.3), 31: (0.9, -0.4), 60: (0.0, 1.5)}
"""The commands of every robot, by step; b turns the other way."""

LAST = (0.5, 0.2)
TOPICS = ("base_scan", "odom", "base_pose_ground_truth", "joint_states")
ROOM = 4 * 2**20
"""Receive buffer for the time in which this client is not scheduled [bytes]: the simulator drops the rest."""


class Recorder:
    """Keeps every message of its topics in serialised form."""

    def __init__(self) -> None:
        self.messages: dict[str, list[bytes]] = {}
        self.changed = threading.Condition()
        self._subscribers: list[rospy.Subscriber] = []

    def subscribe(self, topic: str) -> None:
        self.messages[topic] = []
        self._subscribers.append(
            rospy.Subscriber(topic, rospy.AnyMsg, self._keep, callback_args=topic, tcp_nodelay=True)
        )

    def make_room(self) -> None:
        """Enlarges the receive buffer of every connection. All connections must be established by now."""
        for subscriber in self._subscribers:
            for connection in subscriber.impl.connections:
                connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM)

    def _keep(self, message: Any, topic: str) -> None:
        with self.changed:
            self.messages[topic].append(message._buff)
            self.changed.notify_all()

    def wait_for_time(self, seconds: float) -> None:
        def come() -> bool:
            newest = self.messages["/clock"][-1:]
            return bool(newest) and Clock().deserialize(newest[0]).clock.to_sec() >= seconds

        wait_until(come, f"{seconds} s of simulated time", PATIENCE, self.changed)

    def wait_for_all(self, seconds: float, rates: dict[str, float]) -> None:
        """Waits for every topic's messages: each topic has its own connection, and the clock may arrive first."""

        def missing() -> list[str]:
            due = {topic: int(seconds * rates[topic.rpartition("/")[2]]) for topic in self.messages}
            return [
                topic for topic, messages in self.messages.items() if len(messages) < due[topic]
            ]

        wait_until(lambda: not missing(), f"all messages of {seconds} s", PATIENCE, self.changed)


def statistics(kind: int) -> list[Any]:
    """Returns the simulator node's bus statistics: kind 0 for its publications, 1 for its subscriptions."""
    with xmlrpc.client.ServerProxy(rosgraph.Master("/client").lookupNode("/gazebo")) as slave:
        return slave.getBusStats("/client")[2][kind]


def is_heard(topic: str) -> bool:
    return any(name == topic and connections for name, _, connections in statistics(0))


def read_from(topic: str) -> int:
    """Returns how many bytes the simulator has read from this client."""
    return sum(
        connection[1]
        for name, connections in statistics(1)
        if name == topic
        for connection in connections
    )


class Pilot:
    """Sends one robot's commands."""

    def __init__(self, name: str) -> None:
        self._topic = f"/{name}/pioneer/cmd_vel"
        self._sign = -1.0 if name == "b" else 1.0
        self._publisher = rospy.Publisher(self._topic, Twist, queue_size=10)
        wait_until(
            lambda: self._publisher.get_num_connections() > 0,
            f"a listener to {self._topic}",
            PATIENCE,
        )

    def send(self, speed: float, turn: float) -> None:
        """Sends a command twice: once the simulator has read the second one, it has applied the first."""
        command = Twist()
        command.linear.x, command.angular.z = speed, self._sign * turn
        for _ in range(2):
            before = read_from(self._topic)
            self._publisher.publish(command)
            wait_until(
                lambda: read_from(self._topic) > before,  # noqa: B023 - done within the round
                f"{self._topic} to be read",
                PATIENCE,
            )


def spawn(name: str) -> None:
    x, y, yaw = PLACES[name]
    rotation = Quaternion(0.0, 0.0, float(yaw > 3.0), float(yaw < 3.0))
    rospy.set_param(f"/{name}/tf_prefix", name)
    description = rospy.get_param("/robot_description")
    service = rospy.ServiceProxy("/gazebo/spawn_urdf_model", SpawnModel)
    answer = service(name, description, name, Pose(Point(x, y, 0.0), rotation), "")
    if not answer.success:
        raise RuntimeError(answer.status_message)


def main() -> None:
    """Runs the script."""
    robots, seconds, rates, output = (
        sys.argv[1],
        float(sys.argv[2]),
        json.loads(sys.argv[3]),
        sys.argv[4],
    )
    rospy.init_node("client", disable_rostime=True)
    rospy.wait_for_service("/gazebo/step", PATIENCE)
    recorder = Recorder()
    for name in robots:
        spawn(name)
        for topic in TOPICS:
            recorder.subscribe(f"/{name}/{topic}")
    for topic in ("/clock", "/tf"):
        recorder.subscribe(topic)
    for topic in recorder.messages:
        wait_until(
            lambda: is_heard(topic),  # noqa: B023 - done within the round
            f"the simulator to know of {topic}'s listener",
            PATIENCE,
        )
    recorder.make_room()
    pilots = [Pilot(name) for name in robots]
    step = rospy.ServiceProxy("/gazebo/step", Trigger)
    for number in range(75):
        if number in SCRIPT:
            for pilot in pilots:
                pilot.send(*SCRIPT[number])
        step()
    for pilot in pilots:
        pilot.send(*LAST)
    rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
    recorder.wait_for_time(seconds + 0.2)
    rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
    recorder.wait_for_all(seconds, rates)
    recorded = {
        topic: [message.hex() for message in messages]
        for topic, messages in recorder.messages.items()
    }
    Path(output).write_text(json.dumps(recorded))


if __name__ == "__main__":
    main()
