"""A demo in lockstep: simulated time decides when waypoints are sent and when the run ends (docs/lockstep.md)."""

import threading
from functools import partial
from pathlib import Path

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import String

from pioneer_demo.core.fleet import Fleet
from pioneer_fleet.conversions import pose_from_message
from pioneer_node.nodes.lockstep import RINGS, WITHHELD, Member

SENT_AT = 3.0
"""When waypoints are sent [s of simulated time]: robots have found themselves in the map by then."""
_EXACT = 1.0e-6
"""What a sum of times may be off [s]."""
_POSES, _COMMANDS = "ground_truth.csv", "commands.csv"
_HEADS = {_POSES: "seconds,robot,x,y,yaw", _COMMANDS: "seconds,robot,linear,angular"}


class Course:
    """The ring of one member, the observer, that holds simulated time wherever a run decides something.

    Publishes: ``/lockstep/rings``, ``/lockstep/withheld`` (std_msgs/String).

    Subscribes: what the observer does, each robot's ``base_pose_ground_truth`` and ``pioneer/cmd_vel``.

    Threads: `_step` runs in the member's, and waits there for the main thread at ``SENT_AT`` and where `release` said.
    """

    def __init__(self, name: str, fleet: Fleet, lock: threading.Lock) -> None:
        """Makes the process a member: before the observer has its topics."""
        #: ended: set once all waypoints are dealt with, or the limit is reached; time stands still from then on
        #: stands: set while time stands for the main thread; `release` has it continue
        self.stands, self.ended = threading.Event(), threading.Event()
        self._fleet, self._lock = fleet, lock
        self._released = threading.Event()
        self._limit, self._stop, self._begun = float("inf"), SENT_AT, False
        self._rings = {name, *(robot.name for robot in fleet.robots)}
        self._withheld = set[str]()
        self._rows: dict[str, list[str]] = {name: [] for name in _HEADS}
        self._member = Member(name, [name], name)
        self._member.exchange.install()
        self._rings_topic = rospy.Publisher(RINGS, String, queue_size=10)
        self._withheld_topic = rospy.Publisher(WITHHELD, String, queue_size=10)

    def start(self) -> None:
        """Takes part from now on."""
        for robot in self._fleet.robots:
            rospy.Subscriber(f"/{robot.name}/base_pose_ground_truth", Odometry, partial(self._on_pose, robot.name))
            rospy.Subscriber(f"/{robot.name}/pioneer/cmd_vel", Twist, partial(self._on_command, robot.name))
        self._member.start(self._step)

    def release(self, limit: float, stop: float) -> None:
        """Has time continue until ``stop`` at most, and for good until ``limit`` [both s of simulated time]."""
        self._limit, self._stop, self._begun = limit, stop, True
        self.stands.clear()
        self._released.set()

    def take_part(self, robot: str, part: bool) -> None:
        """Has a robot's ring leave at the end of the period in which time stands, or has time wait for it again."""
        (self._rings.add if part else self._rings.discard)(robot)
        self._rings_topic.publish(" ".join(sorted(self._rings)))

    def withhold(self, name: str, withheld: bool) -> None:
        """Has tokens carry no messages of a topic, or none from and to a robot's ring, from the next period on."""
        (self._withheld.add if withheld else self._withheld.discard)(name)
        self._withheld_topic.publish(" ".join(sorted(self._withheld)))

    def write(self, folder: Path) -> list[Path]:
        """Writes where the robots were and what they were commanded; returns the paths."""
        for name, rows in self._rows.items():
            (folder / name).write_text("\n".join([_HEADS[name], *rows, ""]))
        return [folder / name for name in self._rows]

    def _step(self) -> None:
        with self._lock:
            now = self._fleet.simulator.time
            over = self._fleet.finished or now > self._limit
        if over and self._begun:
            self.ended.set()
            threading.Event().wait()  # until the process ends: the token stays here
        elif now >= self._stop - _EXACT:
            self._released.clear()
            self.stands.set()
            self._released.wait()

    def _on_pose(self, robot: str, message: Odometry) -> None:
        pose = pose_from_message(message.pose.pose)
        self._add(_POSES, message.header.stamp, robot, pose.x, pose.y, pose.yaw)

    def _on_command(self, robot: str, message: Twist) -> None:
        self._add(_COMMANDS, rospy.Time.now(), robot, message.linear.x, message.angular.z)

    def _add(self, name: str, stamp: rospy.Time, robot: str, *values: float) -> None:
        self._rows[name].append(f"{stamp.to_sec():.3f},{robot},{','.join(map(repr, values))}")
