"""Lockstep control of a demo: simulated time decides when waypoints are sent and the run ends (docs/lockstep.md)."""

import threading
from functools import partial
from pathlib import Path

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_msgs.msg import String

from pioneer_demo.observer.fleet import Fleet
from pioneer_fleet.monitor.conversions import pose_from_message
from pioneer_node.nodes.lockstep import RINGS, WITHHELD, Member

SENT_AT = 3.0
"""When waypoints are sent [s of simulated time]; robots are localised by then."""
_EXACT = 1.0e-6
"""Tolerance for sums of times [s]."""
_POSES, _COMMANDS = "ground_truth.csv", "commands.csv"
_HEADS = {_POSES: "seconds,robot,x,y,yaw", _COMMANDS: "seconds,robot,linear,angular"}


class Course:
    """A ring with the observer as its only member; it holds simulated time at the decision points of a run.

    Publishes: ``/lockstep/rings``, ``/lockstep/withheld`` (std_msgs/String).

    Subscribes: the observer's topics, each robot's ``base_pose_ground_truth`` and ``pioneer/cmd_vel``.

    Threads: `_step` runs in the member's thread; it blocks for the main thread at ``SENT_AT`` and at the stops that
    `release` sets.
    """

    def __init__(self, name: str, fleet: Fleet, lock: threading.Lock) -> None:
        """Makes the process a member; call it before the observer creates its topics."""
        #: ended: set once all waypoints are reached or given up, or the limit is reached; time stays stopped then
        #: stands: set while time is stopped for the main thread; `release` resumes it
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
        """Joins the lockstep."""
        for robot in self._fleet.robots:
            rospy.Subscriber(
                f"/{robot.name}/base_pose_ground_truth",
                Odometry,
                partial(self._on_pose, robot.name),
            )
            rospy.Subscriber(
                f"/{robot.name}/pioneer/cmd_vel", Twist, partial(self._on_command, robot.name)
            )
        self._member.start(self._step)

    def release(self, limit: float, stop: float) -> None:
        """Resumes time up to the next ``stop``; the run ends at ``limit`` [both s of simulated time]."""
        self._limit, self._stop, self._begun = limit, stop, True
        self.stands.clear()
        self._released.set()

    def take_part(self, robot: str, part: bool) -> None:
        """Removes a robot's ring from lockstep at the end of the current period, or adds it again."""
        (self._rings.add if part else self._rings.discard)(robot)
        self._rings_topic.publish(" ".join(sorted(self._rings)))

    def withhold(self, name: str, withheld: bool) -> None:
        """Withholds a topic, or all messages from and to a robot's ring, from tokens, starting with the next period."""
        (self._withheld.add if withheld else self._withheld.discard)(name)
        self._withheld_topic.publish(" ".join(sorted(self._withheld)))

    def write(self, folder: Path) -> list[Path]:
        """Writes the robots' true poses and velocity commands; returns the paths."""
        for name, rows in self._rows.items():
            (folder / name).write_text("\n".join([_HEADS[name], *rows, ""]))
        return [folder / name for name in self._rows]

    def _step(self) -> None:
        with self._lock:
            now = self._fleet.simulator.time
            over = self._fleet.finished or now > self._limit
        if over and self._begun:
            self.ended.set()
            threading.Event().wait()  # blocks until the process ends, holding the token
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
