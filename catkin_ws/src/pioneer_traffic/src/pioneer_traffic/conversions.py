"""Conversions between messages and the coordinators' reports."""

import math
from typing import Any

from geometry_msgs.msg import Point
from nav_bundle.msg import NavigationState
from std_msgs.msg import Header

from nav_bundle.base.pose import LARGEST
from pioneer_traffic.event import Condition, Status
from pioneer_traffic.msg import Path as PathMessage
from pioneer_traffic.msg import Plan as PlanMessage
from pioneer_traffic.msg import Report as ReportMessage
from pioneer_traffic.msg import Wait as WaitMessage
from pioneer_traffic.report import Plan, PlanId, Report, Wait

_STATES = {
    Condition.STARTING: NavigationState.STARTING,
    Condition.IDLE: NavigationState.IDLE,
    Condition.DRIVING: NavigationState.DRIVING,
    Condition.BLOCKED: NavigationState.BLOCKED,
    Condition.WAITING: NavigationState.WAITING,
    Condition.HELD: NavigationState.HELD,
    Condition.FAILED: NavigationState.FAILED,
}


def message_from_status(status: Status, stamp: Any) -> NavigationState:
    """Returns what a robot does since ``stamp`` (genpy.Time) as a message."""
    return NavigationState(
        header=Header(0, stamp, "map"),
        state=_STATES[status.condition],
        reason=NavigationState.WAY_BLOCKED if status.robots else NavigationState.NO_REASON,
        place=Point(math.nan, math.nan, 0.0),
        robot=status.robots[0] if status.robots else "",
        since=stamp,
        text=status.text(),
    )


def message_from_report(report: Report, stamp: Any) -> ReportMessage:
    """Returns a report as a message with ``stamp`` (genpy.Time)."""
    return ReportMessage(
        header=Header(0, stamp, "map"),
        robot=report.robot,
        roadmap=report.roadmap,
        position=Point(*report.position, 0.0),
        held=report.held,
        goal=report.goal,
        since=report.since,
        region=report.region,
        out=report.out,
        adopted=report.adopted.number,
        adopted_author=report.adopted.author,
        reached=report.reached,
        ready=report.ready.number,
        ready_author=report.ready.author,
        heard=report.heard,
        plan=_message_from_plan(report.plan) if report.plan else PlanMessage(),
    )


def report_from_message(message: ReportMessage, roadmap: int, places: int) -> Report | None:
    """Returns the report of a message; None if its position or one of its places cannot be.

    The places of a robot with another roadmap than this one, of so many ``places``, are not looked at.
    """
    if not (abs(message.position.x) <= LARGEST and abs(message.position.y) <= LARGEST):
        return None
    if message.roadmap == roadmap and not _has_known_places(message, places):
        return None
    return Report(
        robot=message.robot,
        roadmap=message.roadmap,
        position=(message.position.x, message.position.y),
        held=tuple(message.held),
        goal=message.goal,
        since=message.since,
        region=tuple(message.region),
        out=message.out,
        adopted=PlanId(message.adopted, message.adopted_author),
        reached=message.reached,
        ready=PlanId(message.ready, message.ready_author),
        heard=tuple(message.heard),
        plan=_plan_from_message(message.plan) if message.plan.number else None,
    )


def _has_known_places(message: ReportMessage, places: int) -> bool:
    stops = [*message.held[-1:], *(place for path in message.plan.paths for place in path.places)]
    are_known = all(-1 <= place < places for place in (*stops, message.goal))
    return are_known and all(path.held for path in message.plan.paths)


def _message_from_plan(plan: Plan) -> PlanMessage:
    paths = [
        PathMessage(name, plan.held[name], places, plan.regions.get(name, ()))
        for name, places in plan.paths.items()
    ]
    return PlanMessage(
        plan.id.number, plan.id.author, paths, [WaitMessage(*wait) for wait in plan.waits]
    )


def _plan_from_message(message: PlanMessage) -> Plan:
    return Plan(
        PlanId(message.number, message.author),
        {path.robot: tuple(path.held) for path in message.paths},
        {path.robot: tuple(path.places) for path in message.paths},
        {path.robot: tuple(path.region) for path in message.paths if path.region},
        tuple(Wait(wait.robot, wait.step, wait.other, wait.other_step) for wait in message.waits),
    )
