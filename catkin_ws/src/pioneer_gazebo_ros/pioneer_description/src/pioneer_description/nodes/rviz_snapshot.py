"""``rviz_snapshot``: saves RViz's view of the fleet as PNG, without a screen; fails unless all displays are visible."""
# ruff: noqa: T201 - a command prints to standard output

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

from pioneer_description.adapters.hidden_rviz import RvizError, hidden_rviz, save
from pioneer_description.core.fleet_view import fleet_config
from pioneer_description.core.scene import (
    Mark,
    SceneError,
    alone,
    marks_of,
    missing,
    size_of,
    view_of,
)
from pioneer_description.nodes.fleet_watch import LOOK_EVERY, REPORT_EVERY, FleetWatch

TEMPLATE = Path(rospkg.RosPack().get_path("pioneer_description")) / "rviz" / "multi_pioneer.rviz"


def main(argv: Sequence[str] | None = None) -> int:
    """Parses the command line and takes the picture; returns the exit status: 0 if everything was visible."""
    options = _options(rospy.myargv(sys.argv)[1:] if argv is None else argv)
    try:
        template = read_config(options.config)
        view_of(template)
        _check_master()
        rospy.init_node("rviz_snapshot", anonymous=True, disable_signals=True, disable_rostime=True)
        watch = FleetWatch()
        wanted = names_of(options.robots)
        if lacking := watch.wait(wanted, time.monotonic() + options.timeout, _say):
            raise RvizError(f"timed out after {options.timeout:g} s waiting for {lacking}")
        robots = watch.robots(wanted)
        _say(f"robots in the world: {', '.join(robot.name for robot in robots)}")
        config = fleet_config(template, robots, watch.bounds, size_of(template))
        watch.name_robots(robots, view_of(config).scale)
        return _take(config, watch, options)
    except (RvizError, SceneError, OSError) as error:
        print(f"rviz_snapshot: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        rospy.signal_shutdown("done")


def _options(words: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "rviz_snapshot",
        description="Takes a picture of what RViz shows of the fleet, without a screen.",
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("rviz.png"), help="default: %(default)s"
    )
    parser.add_argument(
        "--config",
        type=Path,
        default=TEMPLATE,
        help="RViz configuration whose groups are the robots'",
    )
    parser.add_argument("--robots", default="", metavar="N|NAMES",
        help="pioneer1 … N, or these space-separated names, must be seen (default: the fleet's)")  # fmt: skip
    parser.add_argument(
        "--timeout", type=float, default=60.0, metavar="S", help="default: %(default)s s"
    )
    return parser.parse_args(words)


def names_of(robots: str) -> list[str]:
    """Returns the robot names given by ``N`` or ``NAME NAME …``; none for an empty text."""
    return (
        [f"pioneer{number}" for number in range(1, int(robots) + 1)]
        if robots.isdigit()
        else robots.split()
    )


def read_config(path: Path) -> dict[str, Any]:
    """Returns an RViz configuration.

    Raises:
        SceneError: the file is not an RViz configuration.
        OSError: it cannot be read.
    """
    try:
        config = yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise SceneError(f"{path} is not valid YAML: {' '.join(str(error).split())}") from None
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
        return  # no RViz is running, or it died without unregistering
    raise RvizError(
        f"an RViz runs at {uri} already ({running}), and the fleet's rules serve only one: close it first"
    )


def _reasons(unseen: Sequence[Mark]) -> list[str]:
    """Returns why marks may be missing: topics of the configuration without a publisher."""
    published = {name for name, _ in rospy.get_published_topics()}
    silent = [mark.topic for mark in unseen if mark.topic and mark.topic not in published]
    if not silent:
        return ["all their topics are published here; is the robot driving, and in the view?"]
    return [
        f"there is no publisher of {', '.join(silent)} on this master; is step 4 running for that robot? "
        "'rosrun rocon_gateway rules' shows the state of the flips"
    ]


def _take(config: Mapping[str, Any], watch: FleetWatch, options: argparse.Namespace) -> int:
    """Takes pictures until each mark was seen once, and keeps the picture with most of them.

    One picture may not show all: a robot in the open has no costs around it, and one that has just arrived has no plan.
    """
    view, marks = view_of(config), marks_of(config)
    unseen, fewest, told = marks, len(marks) + 1, list[Mark]()
    with hidden_rviz(alone(config), size_of(config)) as rviz_picture:
        started = said = time.monotonic()
        while unseen and time.monotonic() < started + options.timeout:
            picture = rviz_picture()
            lacking = missing(picture, view, marks, watch.positions())
            unseen = [mark for mark in unseen if mark in lacking]
            if len(lacking) < fewest:
                fewest = len(lacking)
                save(picture, options.output)
            if unseen and unseen != told and time.monotonic() > said + REPORT_EVERY:
                said, told = time.monotonic(), unseen
                _say(f"waiting for {_words(unseen[:6])}{' …' if unseen[6:] else ''}")
            rospy.rostime.wallsleep(LOOK_EVERY)  # RViz does not signal when it has drawn
    if unseen:
        print(
            f"rviz_snapshot: not seen in RViz within {options.timeout:g} s: {_words(unseen)}",
            file=sys.stderr,
        )
        for reason in _reasons(unseen):
            print(f"rviz_snapshot: {reason}", file=sys.stderr)
        return 1
    print(f"{options.output}: RViz shows all {len(marks)} displays")
    return 0


def _say(text: str) -> None:
    print(f"rviz_snapshot: {text}", flush=True)


def _words(marks: Sequence[Mark]) -> str:
    return ", ".join(map(str, marks))
