"""What a robot with a goal is doing, and why it does not arrive: the same words for people and programs."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum

from nav_bundle.base.pose import Pose
from nav_bundle.costmap.cost import INSCRIBED, UNKNOWN
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.move_base.state_machine import Trigger

Place = tuple[float, float]
"""x, y [m] in the global costmap's frame."""

_WORDS_PERIOD, _FIGURES_PERIOD = 1.0, 5.0
"""Minimum times [s] between two texts of one state: with other words, and with the same words and other figures."""
_FIGURE = re.compile(r"\d+(\.\d+)?")
_AT_ROBOT = 0.8
"""An obstacle within this distance [m] of another robot's position is that robot."""


class Condition(Enum):
    """What a robot is doing. move_base itself reports those up to ``BLOCKED``, and ``FAILED``."""

    STARTING = "starting"
    IDLE = "idle"
    DRIVING = "driving"
    RECOVERING = "recovering"
    BLOCKED = "blocked"
    WAITING = "waiting"
    LOST = "lost"
    HELD = "held"
    MANUAL = "driven by hand"
    FAILED = "failed"
    OFFLINE = "offline"


class Code(IntEnum):
    """Reasons, as numbers for programs."""

    NONE = 0
    WAY_BLOCKED = 1
    GOAL_OCCUPIED = 2
    GOAL_INVALID = 3
    NO_WAY = 4
    NO_VALID_VELOCITY = 5
    NO_PROGRESS = 6
    DOES_NOT_MOVE = 7
    NO_SENSOR_DATA = 8
    TOO_LATE = 9


@dataclass(frozen=True)
class Reason:
    """Why a robot does not arrive.

    Args:
        code: the reason for programs.
        text: the reason for people, without a full stop.
        place: where, if it has a place.
        robot: the other robot, if there is one.
    """

    code: Code = Code.NONE
    text: str = ""
    place: Place | None = None
    robot: str = ""

    def sentence(self) -> str:
        """Returns the text as a sentence; empty without a reason."""
        return f"{self.text[0].upper()}{self.text[1:]}." if self.text else ""


NO_REASON = Reason()
DOES_NOT_MOVE = Reason(Code.DOES_NOT_MOVE, "the robot does not move: wheels slip or it pushes")
NO_SENSOR_DATA = Reason(Code.NO_SENSOR_DATA, "sensor data, odometry or transforms are missing")


def is_due(text: str, shown: str, elapsed: float) -> bool:
    """Returns whether ``text`` may replace the one ``shown`` for ``elapsed`` [s] while the state lasts.

    Faults that take turns in every cycle must not flood a topic, and neither must figures that change. But a fault
    that follows another one is shown soon: a robot may stand for a moment for one reason, and for long for the next.
    """
    if text == shown:
        return False
    same_words = _FIGURE.sub("", text) == _FIGURE.sub("", shown)
    return not 0.0 <= elapsed < (_FIGURES_PERIOD if same_words else _WORDS_PERIOD)


def no_sensor_data(fault: str) -> Reason:
    """Returns the reason for a robot that an input, with ``fault``, does not allow to drive."""
    if not fault:
        return NO_SENSOR_DATA
    return Reason(Code.NO_SENSOR_DATA, f"{NO_SENSOR_DATA.text}: {fault.rstrip('.')}")


def way_blocked(place: Place, robots: Mapping[str, Pose]) -> Reason:
    """Returns the reason for a way that is blocked at ``place``; ``robots`` are the other robots' poses by name."""
    robot = _robot_at(place, robots)
    what = robot or "something that the map does not show"
    return Reason(
        Code.WAY_BLOCKED,
        f"the way is blocked near ({place[0]:.1f}, {place[1]:.1f}) by {what}",
        place,
        robot,
    )


def goal_reason(costmap: Costmap, goal: Pose, robots: Mapping[str, Pose]) -> Reason | None:
    """Returns why the robot cannot stand on ``goal``; None if it can, as far as the costmap shows."""
    place = goal.x, goal.y
    fault = costmap.goal_fault(goal)
    if fault:
        return Reason(Code.GOAL_INVALID, f"{fault[0].lower()}{fault[1:].rstrip('.')}", place)
    cost = costmap.cost_of_cell(*place)
    if cost < INSCRIBED or cost == UNKNOWN:
        return None
    robot = _robot_at(place, robots)
    what = robot or "something that the map does not show"
    return Reason(Code.GOAL_OCCUPIED, f"the goal is occupied by {what}", place, robot)


def failure(
    trigger: Trigger | None, costmap: Costmap, goal: Pose, pose: Pose | None, blocked: Place | None,
    robots: Mapping[str, Pose],
) -> Reason:  # fmt: skip
    """Returns why a goal was given up.

    Args:
        trigger: what made it fail.
        costmap: the global costmap.
        goal: the goal, in the costmap's frame.
        pose: the robot's pose in that frame; None if unknown.
        blocked: where the way was last found blocked; None if it was not.
        robots: other robots' poses by name, in that frame.
    """
    if trigger is Trigger.SENSORS:
        return NO_SENSOR_DATA
    if trigger is Trigger.PUSHING:
        return DOES_NOT_MOVE
    occupied = goal_reason(costmap, goal, robots)
    if occupied is not None:
        return occupied
    if trigger is Trigger.TIME:
        place = (pose.x, pose.y) if pose is not None else None
        return Reason(Code.TOO_LATE, "the time for the goal is over", place)
    if blocked is not None:
        return way_blocked(blocked, robots)
    if trigger is Trigger.PLANNING:
        return Reason(Code.NO_WAY, "no way to the goal is known")
    return without_progress(trigger, pose)


def without_progress(trigger: Trigger | None, pose: Pose | None) -> Reason:
    """Returns the reason for a robot that has a free way and does not make it."""
    code, text = Code.NO_PROGRESS, "the robot makes no progress"
    if trigger is Trigger.CONTROLLING:
        code, text = Code.NO_VALID_VELOCITY, "every movement would touch an obstacle"
    if pose is None:
        return Reason(code, text)
    return Reason(code, f"{text} near ({pose.x:.1f}, {pose.y:.1f})", (pose.x, pose.y))


def _robot_at(place: Place, robots: Mapping[str, Pose]) -> str:
    """Returns the name of the nearest robot that covers ``place``; empty if there is none."""
    near = {name: math.dist(place, (pose.x, pose.y)) for name, pose in robots.items()}
    name = min(near, key=lambda each: near[each], default="")
    return name if name and near[name] < _AT_ROBOT else ""
