"""The simulator as scenarios use it: its clock, and boxes to spawn and delete. Times are simulated seconds."""

import threading
from collections.abc import Callable

import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import DeleteModel, SetModelState, SpawnModel
from rosgraph_msgs.msg import Clock

from nav_bundle.base.conversions import message_from_pose
from nav_bundle.base.pose import Pose
from pioneer_harness.wait import wait_until

START_UP = 120.0
"""Longest wait for nodes and services at the start [s of wall time]."""
WALL_LIMIT = 200.0
BOX = """<?xml version="1.0"?>
<sdf version="1.6"><model name="box"><static>true</static><link name="link"><collision name="collision">
<pose>0 0 0.4 0 0 0</pose><geometry><box><size>{} {} 0.8</size></box></geometry></collision></link></model></sdf>
"""


class World:
    """The simulator. ``changed`` is notified on each clock message."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.time = 0.0
        self._boxes: list[str] = []
        for service in ("spawn_sdf_model", "delete_model", "set_model_state"):
            rospy.wait_for_service(f"/gazebo/{service}", START_UP)
        self._spawn = rospy.ServiceProxy("/gazebo/spawn_sdf_model", SpawnModel)
        self._delete = rospy.ServiceProxy("/gazebo/delete_model", DeleteModel)
        self._set = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)
        rospy.Subscriber("/clock", Clock, self._on_clock, queue_size=1, tcp_nodelay=True)

    def _on_clock(self, message: Clock) -> None:
        with self.changed:
            self.time = message.clock.to_sec()
            self.changed.notify_all()

    def wait(self, condition: Callable[[], object], what: str, limit: float) -> float:
        """Waits up to ``limit`` simulated seconds for ``condition``; returns how long it took."""
        began = self.time

        def ended() -> bool:
            return bool(condition()) or self.time - began > limit

        wait_until(ended, what, WALL_LIMIT, self.changed)
        took = self.time - began
        assert took <= limit, f"{what}: not within {limit:g} simulated seconds"
        rospy.loginfo("%s: %.1f s of %g", what, took, limit)
        return took

    def spawn(self, name: str, across: float, along: float, pose: Pose) -> None:
        """Spawns a box of ``across`` by ``along`` [m] in x and y."""
        answer = self._spawn(name, BOX.format(across, along), "", message_from_pose(pose), "")
        assert answer.success, answer.status_message
        self._boxes.append(name)

    def delete(self, name: str) -> None:
        """Deletes a box from the world."""
        answer = self._delete(name)
        assert answer.success, answer.status_message
        self._boxes.remove(name)

    def clear(self) -> None:
        """Deletes every box."""
        for name in list(self._boxes):
            self.delete(name)

    def put(self, name: str, pose: Pose) -> None:
        """Moves a model to a pose and sets its velocity to zero."""
        state = ModelState(model_name=name, pose=message_from_pose(pose), reference_frame="world")
        answer = self._set(state)
        assert answer.success, answer.status_message
