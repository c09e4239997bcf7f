"""Injects faults at simulated times: killed computers, bad links, frozen gateways, missing scans, doors, moves."""

import heapq
import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial

import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import DeleteModel, SetModelState, SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion

from pioneer_demo.error import FaultError
from pioneer_demo.observer.track import RobotTrack
from pioneer_demo.processes.command import (
    HUB_COMMAND,
    HUB_GATEWAY_COMMAND,
    gateway_name,
    master_uri,
    on_computer,
)
from pioneer_demo.run.fleet_run import FleetRun
from pioneer_demo.scenario.link import Condition
from pioneer_demo.scenario.option import DemoConfig
from pioneer_demo.scenario.scenario import BASE, HUB, Fault

_RESEND = 5.0
"""Interval at which a restarted robot without waypoints is sent its waypoints again [s of simulated time]."""
_EXACT = 1.0e-6
"""Tolerance for sums of times [s]."""
_DOOR = """<sdf version="1.6"><model name="{name}"><static>true</static><link name="link">
<collision name="collision"><geometry><box><size>{length} 0.1 1.0</size></box></geometry></collision>
<visual name="visual"><geometry><box><size>{length} 0.1 1.0</size></box></geometry></visual>
</link></model></sdf>"""


class FaultRunner:
    """Injects and ends the faults of a scenario. Use it from the command's main thread.

    In lockstep, simulated time is stopped meanwhile, and the simulator withholds messages that a network would lose.

    Services called: ``/gazebo/spawn_sdf_model``, ``/gazebo/delete_model``, ``/gazebo/set_model_state``.
    """

    def __init__(self, config: DemoConfig, run: FleetRun) -> None:
        self._config, self._run = config, run
        self._numbers = itertools.count()
        #: heap of actions: when they are due [s of simulated time since the start], number, announcement, function
        self._steps = list[tuple[float, int, str, Callable[[], None]]]()
        self._frozen = set[str]()
        self._now, self._hub_runs = 0.0, True
        self._restarted = dict[str, float]()
        for fault in config.faults:
            for turn in range(fault.times):
                self._plan(fault, fault.at + turn * fault.every)

    @property
    def next(self) -> float:
        """Time of the next action [s of simulated time since the start]."""
        if self._restarted:
            return -math.inf
        return self._steps[0][0] if self._steps else math.inf

    def advance(self, time: float) -> None:
        """Executes all actions due at a simulated time since the start [s].

        Raises:
            FaultError: the simulator refuses an action.
        """
        self._now = time
        while self._steps and self._steps[0][0] <= time + _EXACT:
            *_, text, action = heapq.heappop(self._steps)
            if text:
                self._run.display.say(f"{time:.1f} s: {text}")
            action()
        for name, asked in list(self._restarted.items()):
            self._resend(name, asked, time)

    def close(self) -> None:
        """Resumes frozen gateways so that they can exit."""
        for name in self._frozen:
            self._run.processes.freeze(name, False)

    def _plan(self, fault: Fault, time: float) -> None:
        begin, end = self._actions(fault)
        self._schedule(time, begin, str(fault))
        if end is not None:
            self._schedule(time + fault.lasts, end, f"over: {fault}")

    def _schedule(self, time: float, action: Callable[[], None], text: str = "") -> None:
        heapq.heappush(self._steps, (time, next(self._numbers), text, action))

    def _actions(self, fault: Fault) -> tuple[Callable[[], None], Callable[[], None] | None]:
        """Returns the actions that begin and end a fault."""
        if fault.kill:
            names = [HUB_COMMAND] if fault.kill == HUB else on_computer(self._config, fault.kill)
            return lambda: self._kill(fault.kill, names), lambda: self._restart(fault.kill, names)
        if fault.freeze and self._run.course is not None:
            robots = self._config.names if fault.freeze == BASE else [fault.freeze]
            return lambda: self._withhold(robots, True), lambda: self._withhold(robots, False)
        if fault.freeze:
            gateway = (
                HUB_GATEWAY_COMMAND
                if fault.freeze == BASE
                else gateway_name(self._number(fault.freeze))
            )
            return lambda: self._freeze(gateway, True), lambda: self._freeze(gateway, False)
        if fault.blind:
            return lambda: self._flip_scans(fault.blind, True), lambda: self._flip_scans(
                fault.blind, False
            )
        if fault.link:
            networks = self._run.processes.networks
            return lambda: networks.set(fault.link, fault.condition), lambda: networks.set(
                fault.link, Condition()
            )
        if fault.move:
            return lambda: self._move(fault.move, fault.to), None
        name = f"door_{next(self._numbers)}"
        return lambda: self._close_door(name, fault.door), lambda: _ask(
            "delete_model", DeleteModel, name
        )

    def _number(self, robot: str) -> int:
        return self._config.names.index(robot) + 1

    def _withhold(self, names: Sequence[str], withheld: bool) -> None:
        assert self._run.course is not None, "only in lockstep"
        for name in names:
            self._run.course.withhold(name, withheld)

    def _kill(self, whom: str, names: Sequence[str]) -> None:
        self._hub_runs &= whom != HUB
        if self._run.course is None or whom == HUB:
            self._run.processes.kill(names)
        else:
            self._run.course.take_part(whom, False)
            self._schedule(
                self._now + 2 * _EXACT, partial(self._run.processes.kill, names)
            )  # in the next period

    def _restart(self, whom: str, names: Sequence[str]) -> None:
        if self._run.course is not None and not (self._hub_runs or whom == HUB):
            # Time stays stopped until it finds the hub.
            self._schedule(self._now + 2 * _EXACT, partial(self._restart, whom, names))
            return
        self._run.processes.restart(names)
        self._hub_runs |= whom == HUB
        if whom != HUB:
            if self._run.course is not None:
                self._run.course.take_part(whom, True)
            with self._run.lock:
                self._track(whom).monitor.queue = None
            self._restarted[whom] = -math.inf

    def _resend(self, name: str, asked: float, time: float) -> None:
        """Sends a restarted robot its remaining waypoints until it reports that it has received them."""
        with self._run.lock:
            robot = self._track(name)
            received = robot.queue.received if robot.queue else -1
            left = [visit.leg.goal for visit in robot.visits if visit.reached is None]
        if received > 0 or not left:
            del self._restarted[name]
        elif received == 0 and time - asked >= _RESEND and self._run.seen.can_be_sent(robot):
            for goal in left:
                self._run.seen.send(robot, goal)
            self._restarted[name] = time

    def _track(self, name: str) -> RobotTrack:
        return self._run.fleet.robots[self._number(name) - 1]

    def _freeze(self, gateway: str, frozen: bool) -> None:
        (self._frozen.add if frozen else self._frozen.discard)(gateway)
        self._run.processes.freeze(gateway, frozen)

    def _flip_scans(self, robot: str, cancel: bool) -> None:
        """Cancels the flip of a robot's scans to its computer, or requests it again."""
        laser = next((one.laser for one in self._config.entries if one.name == robot), "base_scan")
        if self._run.course is not None:
            self._withhold([f"/{robot}/{laser}"], cancel)
            return
        port = self._run.processes.ports.robot_masters[self._number(robot) - 1]
        argv = ["rosrun", "rocon_flip", "flip_remote_subscriber.py", robot, laser, ""]
        environment = {
            "ROS_IP": "127.0.0.1",
            "ROS_MASTER_URI": master_uri(port),
            "ROBOT_NAME": robot,
        }
        self._run.processes.run(
            f"flip of {robot}'s scans", [*argv, *(["--cancel"] if cancel else [])], environment
        )

    def _move(self, robot: str, to: Sequence[float]) -> None:
        with self._run.lock:
            self._track(robot).move((to[0], to[1]))
        state = ModelState(model_name=robot, pose=_pose(*to), reference_frame="world")
        _ask("set_model_state", SetModelState, state)

    def _close_door(self, name: str, door: Sequence[float]) -> None:
        x, y, direction, length = door
        text = _DOOR.format(name=name, length=length)
        _ask("spawn_sdf_model", SpawnModel, name, text, "", _pose(x, y, direction, 0.5), "world")


def _pose(x: float, y: float, degrees: float, z: float = 0.0) -> Pose:
    half = math.radians(degrees) / 2.0
    return Pose(Point(x, y, z), Quaternion(0.0, 0.0, math.sin(half), math.cos(half)))


def _ask(service: str, kind: type, *request: object) -> None:
    """Calls a service of the simulator.

    Raises:
        FaultError: the simulator refuses or does not answer.
    """
    try:
        answer = rospy.ServiceProxy(f"/gazebo/{service}", kind)(*request)
    except (rospy.ServiceException, rospy.ROSException, OSError) as error:
        raise FaultError(f"/gazebo/{service} did not answer: {error}") from None
    if not answer.success:
        raise FaultError(f"/gazebo/{service} refused: {answer.status_message}")
