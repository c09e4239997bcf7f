"""Executes commands from pages: waypoints, initial poses, stops, boxes, simulator control."""

import itertools
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import rospy
from actionlib_msgs.msg import GoalID
from gazebo_msgs.srv import GetModelState, SpawnModel
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from std_msgs.msg import Empty as EmptyMessage
from std_msgs.msg import Float64
from std_srvs.srv import Empty, Trigger

from pioneer_fleet.geometry import Pose
from pioneer_fleet.monitor.conversions import pose_from_message
from pioneer_node.nodes.kept_parameter import KeptParameter
from pioneer_web.command.command import Command, CommandError
from pioneer_web.command.patrol import FEWEST, Patrol
from pioneer_web.command.recording import Recording
from pioneer_web.state import conversions
from pioneer_web.state.robot import Robot

ZERO_EVERY = 0.05
"""Interval between zero velocity commands to a held robot [s]."""
HELD = "~held"
"""Parameter with the names of held robots: they are held again by a node that takes the place of one that died."""
PATIENCE = 2.0
"""Time-out for the simulator's services [s]."""
_SERVICES = {
    "pause": ("/gazebo/pause_physics", Empty),
    "resume": ("/gazebo/unpause_physics", Empty),
    "step": ("/gazebo/step", Trigger),
    "reset": ("/gazebo/reset_world", Empty),
}
_VARIANCE = (0.25, 0.25, 0.07)
"""Variance of an initial pose in x, y [m²] and yaw [rad²], as in RViz's tool."""
_BOX = """<sdf version="1.6"><model name="box"><link name="link"><inertial><mass>20</mass></inertial>
<collision name="c"><geometry><box><size>0.5 0.5 0.6</size></box></geometry></collision>
<visual name="v"><geometry><box><size>0.5 0.5 0.6</size></box></geometry></visual></link></model></sdf>"""


class Commander:
    """Executes commands by publishing the same topics as RViz's tools and ``ESTOP``.

    Publishes for each robot: map_goal_pose, initialpose, map_goal_client/cancel and move_base/cancel, which gateways
    forward to the robot's computer; pioneer/cmd_vel, to the simulator on this master: zero while the robot is held.
    Also /replay/seek.
    Calls: services of /gazebo.
    Subscribes for each patrolling robot: map_goal_client/queue.

    Threads: one publishes zeros while a robot is held; one subscribes to held robots' commands; rospy's override every
    motion command with a zero at once.
    """

    def __init__(
        self, recording: Recording, refusal: Callable[[Pose | None, Pose], str] = lambda *_: ""
    ) -> None:
        """Asks ``refusal`` why a robot at a pose cannot go to another one; it returns nothing if it can."""
        self._robots: dict[str, Robot] = {}
        self._refusal = refusal
        self.recording = recording
        self._patrols: dict[str, Patrol] = {}
        self._actions: dict[str, Callable[..., str]] = {
            "drive": self._drive,
            "locate": self._locate,
            "cancel": self._cancel,
            "stop": self._stop,
            "release": self._release,
            "spawn": self._spawn,
            "simulate": self._simulate,
            "patrol": self._patrol,
            "record": self._record,
            "seek": self._seek,
        }
        self._seeks = rospy.Publisher("/replay/seek", Float64, queue_size=1)
        self._kept = KeptParameter(HELD, [])
        before = self._kept.value
        self._held_before = frozenset(map(str, before if isinstance(before, list) else []))
        self._due: dict[str, list[Pose]] = {}
        self._replacing = threading.Lock()
        self._boxes = itertools.count(1)
        self._changed = threading.Condition()
        self._publishers: dict[str, dict[str, rospy.Publisher]] = {}
        self._guards: dict[str, rospy.Subscriber] = {}
        self._registering = ThreadPoolExecutor(1, "guards")
        threading.Thread(target=self._hold, name="hold", daemon=True).start()

    def add(self, robots: Sequence[Robot]) -> None:
        """Adds robots that can be commanded."""
        self._publishers |= {robot.name: _advertise(robot.name) for robot in robots}
        for robot in robots:
            robot.held = robot.name in self._held_before
        self._robots = self._robots | {robot.name: robot for robot in robots}
        # Afterwards: a stop in another thread keeps those that are in either.
        self._held_before = self._held_before - {robot.name for robot in robots}
        if any(robot.held for robot in robots):
            with self._changed:
                self._changed.notify()
            self._registering.submit(self._update_guards)

    def do(self, command: Command) -> str:
        """Executes a command; returns a message for the user.

        Raises:
            CommandError: the command cannot be executed.
        """
        return self._actions[command.do](**command.arguments)

    def on_queue(self, robot: Robot) -> None:
        """Sends replacement waypoints once the robot's previous waypoints are cancelled."""
        with self._replacing:
            for place in [] if robot.goals else self._due.pop(robot.name, []):
                self._publish(robot.name, "map_goal_pose", conversions.goal_from_pose(place))

    def _publish(self, robot: str, topic: str, message: Any) -> None:
        self._publishers[robot][topic].publish(message)

    def _locate(self, robot: str, pose: Pose) -> str:
        self._publish(robot, "initialpose", _initial(pose))
        return f"{robot} is at ({pose.x:z.2f}, {pose.y:z.2f})"

    def _cancel(self, robots: Sequence[str]) -> str:
        for name in robots:
            self._end_patrol(name)
            self._drop_waypoints(name)
        return f"waypoints of {', '.join(robots)} dropped"

    def _simulate(self, action: str) -> str:
        name, kind = _SERVICES[action]
        answer = _call(name, kind)
        if kind is Trigger and not answer.success:
            raise CommandError(f"simulator: {answer.message}")
        return f"simulator: {action}" + (self._localise_all() if action == "reset" else "")

    def _localise_all(self) -> str:
        """Tells all robots' localisation where the simulator has put them; returns words on that."""
        lost = []
        for name in self._robots:
            state = _call("/gazebo/get_model_state", GetModelState, model_name=name)
            if state.success:
                self._drop_waypoints(name)
                self._publish(name, "initialpose", _initial(pose_from_message(state.pose)))
            else:
                lost.append(name)
        said = ", robots localised where they started"
        return f"{said} but {', '.join(lost)}, which the simulator does not have" if lost else said

    def _record(self, on: bool) -> str:
        return self.recording.start() if on else self.recording.stop()

    def _seek(self, at: float) -> str:
        self._seeks.publish(at)
        return f"replay from {at:.0f} s on"

    def _drive(self, places: Mapping[str, Pose], append: bool) -> str:
        held = [name for name in places if self._robots[name].held]
        if held:
            raise CommandError(f"{', '.join(held)}: stopped; release first")
        for name, place in places.items():
            if reason := self._refusal(self._robots[name].place, place):
                raise CommandError(
                    f"{name} cannot go to ({place.x:z.2f}, {place.y:z.2f}): {reason}"
                )
        for name, place in places.items():
            if self._publishers[name]["map_goal_pose"].get_num_connections() == 0:
                raise CommandError(f"{name} cannot be reached: its gateway does not take waypoints")
            with self._replacing:
                self._send(name, place, append)
        return ", ".join(
            f"{name} to ({place.x:z.2f}, {place.y:z.2f})" for name, place in places.items()
        )

    def _patrol(self, robots: Sequence[str], on: bool) -> str:
        if not on:
            for name in robots:
                self._end_patrol(name)
            return f"{', '.join(robots)} end with the waypoints that are left"
        for name in robots:
            if len(self._robots[name].goals) < FEWEST:
                raise CommandError(f"{name} has no {FEWEST} waypoints to repeat: append some first")
        for name in robots:
            self._end_patrol(name)
            self._robots[name].patrols = True
            self._patrols[name] = Patrol(
                name,
                self._robots[name].goals,
                lambda place, name=name: self._publish(
                    name, "map_goal_pose", conversions.goal_from_pose(place)
                ),
                lambda name=name: self._end_patrol(name),
            )
        return f"{', '.join(robots)} repeat their waypoints"

    def _end_patrol(self, name: str) -> None:
        self._robots[name].patrols = False
        if patrol := self._patrols.pop(name, None):
            patrol.end()

    def _send(self, name: str, place: Pose, append: bool) -> None:
        self._end_patrol(name)
        if append and name in self._due:
            self._due[name].append(place)
        elif append or not self._robots[name].goals:
            self._due.pop(name, None)
            self._publish(name, "map_goal_pose", conversions.goal_from_pose(place))
        else:
            self._due[name] = [place]
            self._drop_waypoints(name)

    def _drop_waypoints(self, robot: str) -> None:
        self._publish(robot, "map_goal_client/cancel", EmptyMessage())

    def _stop(self, robots: Sequence[str]) -> str:
        # Send the zeros to all robots first: only they determine the stopping distance.
        for name in robots:
            self._publish(name, "pioneer/cmd_vel", Twist())
        for name in robots:
            self._due.pop(name, None)
            self._end_patrol(name)
            self._robots[name].held = True
            self._drop_waypoints(name)
            self._publish(name, "move_base/cancel", GoalID())
        self._keep_held()
        with self._changed:
            self._changed.notify()
        # The master may answer late, and the next stop must not wait for it.
        self._registering.submit(self._update_guards)
        return f"{', '.join(robots)} stopped and held"

    def _keep_held(self) -> None:
        """Keeps which robots are held, also those that were and have not come back yet."""
        held = {name for name, robot in self._robots.items() if robot.held}
        self._kept.keep(sorted(held | self._held_before))

    def _update_guards(self) -> None:
        """Subscribes to held robots' commands, and ends the subscriptions of the others."""
        for name, robot in self._robots.items():
            if robot.held and name not in self._guards:
                topic = f"/{name}/pioneer/cmd_vel"
                self._guards[name] = rospy.Subscriber(
                    topic, Twist, self._on_command, name, queue_size=1
                )
            elif not robot.held and name in self._guards:
                self._guards.pop(name).unregister()

    def _release(self, robots: Sequence[str]) -> str:
        for name in robots:
            self._robots[name].held = False
        self._keep_held()
        self._registering.submit(self._update_guards)
        return f"{', '.join(robots)} released"

    def _on_command(self, message: Twist, robot: str) -> None:
        if message != Twist() and self._robots[robot].held:
            self._publish(robot, "pioneer/cmd_vel", Twist())

    def _hold(self) -> None:
        while not rospy.is_shutdown():
            held = [name for name, robot in self._robots.items() if robot.held]
            for name in held:
                self._publish(name, "pioneer/cmd_vel", Twist())
            with self._changed:
                self._changed.wait(ZERO_EVERY if held else None)

    def _spawn(self, x: float, y: float) -> str:
        name = f"box_{next(self._boxes)}"
        pose = conversions.message_from_pose(Pose(x, y))
        pose.position.z = 0.3
        fields = {
            "model_name": name,
            "model_xml": _BOX,
            "initial_pose": pose,
            "reference_frame": "world",
        }
        answer = _call("/gazebo/spawn_sdf_model", SpawnModel, **fields)
        if not answer.success:
            raise CommandError(f"{name}: {answer.status_message}")
        return f"{name} stands at ({x:.2f}, {y:.2f})"


def _advertise(name: str) -> dict[str, rospy.Publisher]:
    kinds: dict[str, Any] = {
        "map_goal_pose": PoseStamped,
        "initialpose": PoseWithCovarianceStamped,
        "map_goal_client/cancel": EmptyMessage,
        "move_base/cancel": GoalID,
        "pioneer/cmd_vel": Twist,
    }
    return {
        topic: rospy.Publisher(f"/{name}/{topic}", kind, queue_size=10, tcp_nodelay=True)
        for topic, kind in kinds.items()
    }


def _initial(pose: Pose) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped()
    message.header.frame_id = "map"
    message.pose.pose = conversions.message_from_pose(pose)
    covariance = [0.0] * 36
    covariance[0], covariance[7], covariance[35] = _VARIANCE
    message.pose.covariance = covariance
    return message


def _call(name: str, kind: Any, **fields: Any) -> Any:
    try:
        rospy.wait_for_service(name, PATIENCE)
        return rospy.ServiceProxy(name, kind)(**fields)
    except (rospy.ServiceException, rospy.ROSException) as error:
        raise CommandError(f"the simulator does not answer: {error}") from None
