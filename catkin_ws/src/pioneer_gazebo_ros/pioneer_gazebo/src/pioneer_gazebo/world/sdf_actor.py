"""Reads SDF actors as scripted models. Skins and animations are ignored."""

import itertools

from pioneer_gazebo.world.element import Element
from pioneer_gazebo.world.model import (
    Collision,
    Cylinder,
    Link,
    Model,
    Script,
    Trajectory,
    Visual,
    Waypoint,
)
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.sdf_link import Scope, link_from_sdf

PERSON_RADIUS, PERSON_HEIGHT = 0.25, 1.8
"""The upright cylinder that replaces an actor without collisions of its own [m]."""

HIPS = (0.5, 1.5)
"""Waypoint heights [m] in this range belong to a skin with its origin at the hips: the feet are at height 0."""


def actor_from_sdf(element: Element, scope: Scope) -> Model:
    """Returns the scripted model of an ``<actor>``.

    An actor whose links have collisions keeps them and follows the full rotations of its waypoints; any other actor is
    a person and stays upright.

    Raises:
        DescriptionError: a script has no waypoints, or waypoint times do not increase.
    """
    name, pose = element.attribute("name"), element.placed()
    links = tuple(link_from_sdf(child, child.placed(), scope) for child in element.children("link"))
    script = _script(element)
    if any(link.collisions for link in links):
        return Model(name, pose, links=links, script=script)
    upright = script.mapped(lambda pose: Pose.from_rpy(*pose.position, yaw=pose.yaw))
    return Model(name, upright.pose(0.0), links=(_person(element, upright),), script=upright)


def _script(actor: Element) -> Script:
    element = actor.child("script")
    if element is None:
        return Script((), actor.placed())
    trajectories = tuple(_trajectory(child) for child in element.children("trajectory"))
    home = actor.placed()
    if actor.child("pose") is None and trajectories:
        home = trajectories[0].waypoints[0].pose
    delay = element.number("delay_start", 0.0)
    if delay < 0:
        raise element.needed("delay_start").error(f"must not be below 0, not {delay:g}")
    return Script(
        trajectories, home, element.flag("loop", True), delay, element.flag("auto_start", True)
    )


def _trajectory(element: Element) -> Trajectory:
    waypoints = tuple(_waypoint(child) for child in element.children("waypoint"))
    waypoints = tuple(sorted(waypoints, key=lambda point: point.time))
    if not waypoints:
        raise element.error("has no <waypoint>: only trajectories through waypoints are supported")
    for before, after in itertools.pairwise(waypoints):
        if before.time == after.time:
            raise element.error(f"two waypoints have the time {after.time:g}")
    [tension] = element.numbers(1, element.attribute("tension", "0"), "tension")
    if not 0 <= tension <= 1:
        raise element.error(f"tension must be 0 to 1, not {tension:g}")
    return Trajectory(waypoints, tension)


def _waypoint(element: Element) -> Waypoint:
    time = element.number("time")
    if time < 0:
        raise element.needed("time").error(f"must not be below 0, not {time:g}")
    return Waypoint(time, element.needed("pose").pose())


def _person(actor: Element, script: Script) -> Link:
    skin = actor.child("skin")
    scale = 1.0 if skin is None else skin.positive("scale", 1.0)
    shape = Cylinder(PERSON_RADIUS * scale, PERSON_HEIGHT * scale)
    height = script.pose(0.0).position[2]
    feet = -height if HIPS[0] <= height <= HIPS[1] else 0.0
    pose = Pose((0.0, 0.0, feet + shape.length / 2))
    return Link(
        "link",
        collisions=(Collision("person", pose, shape, friction=0.0),),
        visuals=(Visual("person", pose, shape, (0.2, 0.4, 0.7, 1.0)),),
    )
