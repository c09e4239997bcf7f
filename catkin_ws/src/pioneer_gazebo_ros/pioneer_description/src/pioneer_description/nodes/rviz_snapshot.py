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
from pioneer_description.core.scene import Mark, Point, SceneError, View, alone, marks_of, missing, size_of, view_of
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
        marks = [mark for mark in marks_of(config) if _number(mark.robot) <= options.robots]
        _check_master()
        rospy.init_node("rviz_snapshot", anonymous=True, disable_signals=True, disable_rostime=True)
        return _take(config, view, marks, options)
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
    parser.add_argument("--robots", type=int, default=5, metavar="N", help="pioneer1 … N must be seen (default 5)")
    parser.add_argument("--timeout", type=float, default=60.0, metavar="S", help="default: %(default)s s")
    return parser.parse_args(words)


def _number(robot: str) -> int:
    digits = robot[len(robot.rstrip("0123456789")) :]
    return int(digits or 0)


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
        return  # there is none, or it has died without a word
    raise RvizError(f"an RViz runs at {uri} already ({running}), and the fleet's rules serve only one: close it first")


def _take(config: Mapping[str, Any], view: View, marks: list[Mark], options: argparse.Namespace) -> int:
    """Looks until each mark was seen once, and keeps the picture that had most of them.

    Not all in one: a robot in the open has no costs around it, and one that has just arrived no plan.
    """
    robots = Robots()
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
        return 1
    print(f"{options.output}: RViz shows all {len(marks)} displays")
    return 0


def _words(marks: Sequence[Mark]) -> str:
    return ", ".join(map(str, marks))
