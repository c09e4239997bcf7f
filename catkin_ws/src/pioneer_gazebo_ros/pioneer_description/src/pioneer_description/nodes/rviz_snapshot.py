"""``rviz_snapshot``: what RViz shows of the fleet, as a PNG, with no screen; fails unless all of it is there."""
# ruff: noqa: T201 - a command talks to people on standard output

import argparse
import sys
import time
import xmlrpc.client
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import rosgraph
import rospkg
import rospy
import yaml
from gazebo_msgs.msg import ModelStates

from pioneer_description.adapters.hidden_rviz import HiddenRviz, RvizError, save
from pioneer_description.core.scene import (
    Mark,
    Point,
    SceneError,
    View,
    alone,
    marks_of,
    missing,
    size_of,
    topic_of,
    view_of,
)
from pioneer_harness.error import HarnessError

LOOK_EVERY = 0.5
"""Seconds; a picture costs as much as a frame of RViz."""
REPORT_EVERY = 5.0
"""Seconds between lines that say what is awaited."""


class Robots:
    """Where the robots truly are: RViz must show them there. (tf from the robots comes to the node ``/rviz`` only.)

    Subscribes: ``/gazebo/model_states``.
    Threads: rospy's.
    """

    def __init__(self) -> None:
        self._states = ModelStates()
        self._subscriber = rospy.Subscriber("/gazebo/model_states", ModelStates, self._on_states, queue_size=1)

    def _on_states(self, states: ModelStates) -> None:
        self._states = states

    def positions(self) -> dict[str, Point]:
        """Returns the newest position of each model in the world [m]."""
        states = self._states
        return {name: (pose.position.x, pose.position.y) for name, pose in zip(states.name, states.pose, strict=True)}


def main(argv: Sequence[str] | None = None) -> int:
    """Reads the command line, takes the picture, and returns the exit status: 0 if everything is in it."""
    options = _options(rospy.myargv(sys.argv)[1:] if argv is None else argv)
    try:
        config = _read(options.config)
        view = view_of(config)
        marks = marks_of(config)
        _check_master()
        rospy.init_node("rviz_snapshot", anonymous=True, disable_signals=True, disable_rostime=True)
        robots = Robots()
        wanted = _wanted(robots, {mark.robot for mark in marks} - {""}, options)
        marks = [mark for mark in marks if not mark.robot or mark.robot in wanted]
        return _take(config, view, marks, robots, options)
    except (RvizError, SceneError, HarnessError, OSError) as error:
        print(f"rviz_snapshot: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        rospy.signal_shutdown("done")


def _options(words: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "rviz_snapshot", description="Takes a picture of what RViz shows of the fleet, without a screen."
    )
    default = Path(rospkg.RosPack().get_path("pioneer_description")) / "rviz" / "multi_pioneer.rviz"
    parser.add_argument("-o", "--output", type=Path, default=Path("rviz.png"), help="default: %(default)s")
    parser.add_argument("--config", type=Path, default=default, help="RViz configuration (default: five robots)")
    parser.add_argument("--robots", type=int, metavar="N",
        help="pioneer1 … N must be seen (default: those that stand in the world)")  # fmt: skip
    parser.add_argument("--timeout", type=float, default=60.0, metavar="S", help="default: %(default)s s")
    return parser.parse_args(words)


def _read(path: Path) -> dict[str, Any]:
    try:
        config = yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise SceneError(f"{path} is no YAML: {' '.join(str(error).split())}") from None
    if not isinstance(config, dict):
        raise SceneError(f"{path} is no RViz configuration")
    return config


def _check_master() -> None:
    uri = rosgraph.get_master_uri()
    if not rosgraph.is_master_online():
        raise RvizError(f"no ROS master at {uri}")
    try:
        running = rosgraph.Master("/rviz_snapshot").lookupNode("/rviz")
        with xmlrpc.client.ServerProxy(running) as node:
            node.getPid("/rviz_snapshot")
    except (rosgraph.MasterError, OSError):
        return  # there is none, or it has died silently
    raise RvizError(f"an RViz runs at {uri} already ({running}), and the fleet's rules serve only one: close it first")


def _wanted(robots: Robots, configured: set[str], options: argparse.Namespace) -> set[str]:
    """Returns the robots that must be seen: as many as were asked for, else those of the configuration in the world.

    Raises:
        RvizError: none of them stands in a world.
    """
    if options.robots:
        return {f"pioneer{number}" for number in range(1, options.robots + 1)} & configured
    deadline = time.monotonic() + options.timeout
    found, before = set[str](), set[str]()
    while not found or found != before:  # robots may just be spawned, one after the other
        if time.monotonic() > deadline:
            raise RvizError(_no_robots(robots, configured))
        rospy.rostime.wallsleep(LOOK_EVERY)
        found, before = configured & set(robots.positions()), found
    print(f"rviz_snapshot: robots in the world: {', '.join(sorted(found))}", flush=True)
    return found


def _no_robots(robots: Robots, configured: set[str]) -> str:
    uri, others = rosgraph.get_master_uri(), sorted(robots.positions())
    if others:
        shown = ", ".join(sorted(configured))
        return f"the world has {', '.join(others)}, and the configuration shows other robots: {shown}"
    return f"no simulator publishes /gazebo/model_states at {uri}: start step 3, or set ROS_MASTER_URI to Hub_Gateway's"


def _reasons(unseen: Sequence[Mark], config: Mapping[str, Any]) -> list[str]:
    """Returns why marks may be unseen: topics of the configuration without a publisher here."""
    published = {name for name, _ in rospy.get_published_topics()}
    silent = [topic for mark in unseen if (topic := topic_of(config, mark)) and topic not in published]
    if not silent:
        return ["all their topics are published here; is the robot driving, and in the view?"]
    return [
        f"nobody publishes {', '.join(silent)} here: does step 4 run for that robot? 'rosrun rocon_gateway rules' "
        "shows the state of the flips"
    ]


def _take(config: Mapping[str, Any], view: View, marks: list[Mark], robots: Robots, options: argparse.Namespace) -> int:
    """Looks until each mark was seen once, and keeps the picture that had most of them.

    Not all in one: a robot in the open has no costs around it, and one that has just arrived no plan.
    """
    unseen, fewest = marks, len(marks) + 1
    with HiddenRviz(alone(config), size_of(config)) as rviz:
        started = said = time.monotonic()
        while unseen and time.monotonic() < started + options.timeout:
            picture = rviz.picture()
            lacking = missing(picture, view, marks, robots.positions())
            unseen = [mark for mark in unseen if mark in lacking]
            if len(lacking) < fewest:
                fewest = len(lacking)
                save(picture, options.output)
            if unseen and time.monotonic() > said + REPORT_EVERY:
                said = time.monotonic()
                print(f"rviz_snapshot: waiting for {_words(unseen[:6])}{' …' if unseen[6:] else ''}", flush=True)
            rospy.rostime.wallsleep(LOOK_EVERY)  # RViz tells nobody when it has drawn
    if unseen:
        print(f"rviz_snapshot: not seen in RViz within {options.timeout:g} s: {_words(unseen)}", file=sys.stderr)
        for reason in _reasons(unseen, config):
            print(f"rviz_snapshot: {reason}", file=sys.stderr)
        return 1
    print(f"{options.output}: RViz shows all {len(marks)} displays")
    return 0


def _words(marks: Sequence[Mark]) -> str:
    return ", ".join(map(str, marks))
