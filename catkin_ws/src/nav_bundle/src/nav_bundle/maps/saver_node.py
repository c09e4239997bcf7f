"""The map saver: waits for one map and writes it to disk."""

import argparse
import threading
from pathlib import Path

import rospy

from nav_bundle.base.error import NavigationError
from nav_bundle.maps.conversions import GridMessage, grid_from_message
from nav_bundle.maps.map_file import write_map
from pioneer_node.nodes import entry


class MapSaverNode:
    """Writes the first map that arrives, then exits.

    Subscribes: ``map`` (nav_msgs/OccupancyGrid); remap with ``map:=TOPIC``.

    On error: a map that cannot be written or contradictory thresholds end the node with one line.
    """

    def __init__(self, name: Path, occupied: int, free: int) -> None:
        if not 0 <= free < occupied <= 100:
            raise NavigationError(
                f"map_saver needs 0 <= --free < --occ <= 100, not {free} and {occupied}"
            )
        self._name, self._occupied, self._free = name, occupied, free
        self._message: GridMessage | None = None
        self._woken = threading.Event()
        rospy.on_shutdown(self._woken.set)
        self._subscriber = rospy.Subscriber("map", GridMessage, self._store, queue_size=1)

    def _store(self, message: GridMessage) -> None:
        self._message = message
        self._woken.set()

    def spin(self) -> None:
        """Waits for the map, writes it, and returns."""
        rospy.loginfo("waiting for a map on %s", self._subscriber.resolved_name)
        self._woken.wait()
        if self._message is not None:
            files = write_map(
                grid_from_message(self._message), self._name, self._occupied, self._free
            )
            rospy.loginfo("map written to %s and %s", *files)


def main() -> int:
    """Runs the node; returns the exit status."""
    parser = argparse.ArgumentParser(prog="map_saver", description=__doc__)
    parser.add_argument(
        "-f",
        dest="name",
        type=Path,
        default=Path("map"),
        help="path without extension (%(default)s)",
    )
    parser.add_argument(
        "--occ", type=int, default=65, help="least value of an occupied cell (%(default)s)"
    )
    parser.add_argument(
        "--free", type=int, default=25, help="greatest value of a free cell (%(default)s)"
    )
    options = parser.parse_args(rospy.myargv()[1:])
    return entry.run(
        "map_saver",
        lambda: MapSaverNode(options.name, options.occ, options.free),
        expected=(NavigationError,),
    )
