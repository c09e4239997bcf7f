"""The map server: serves a map from disk on a latched topic and by service."""

from pathlib import Path

import rospy
from nav_msgs.msg import MapMetaData
from nav_msgs.srv import LoadMapRequest, LoadMapResponse

from nav_bundle.base.error import MapError, NavigationError
from nav_bundle.maps.conversions import (
    GetMapArray,
    GetMapArrayResponse,
    GridMessage,
    LoadMapArray,
    LoadMapArrayResponse,
    message_from_grid,
)
from nav_bundle.maps.map_file import (
    MapFileMissingError,
    MapImageError,
    MapMetadataError,
    read_map,
)
from pioneer_node.core.frame import stripped
from pioneer_node.nodes import entry

_RESULTS = {
    MapFileMissingError: LoadMapResponse.RESULT_MAP_DOES_NOT_EXIST,
    MapImageError: LoadMapResponse.RESULT_INVALID_MAP_DATA,
    MapMetadataError: LoadMapResponse.RESULT_INVALID_MAP_METADATA,
}


class MapServerNode:
    """Serves the map named on the command line.

    Publishes: ``map`` (nav_msgs/OccupancyGrid, latched), ``map_metadata`` (nav_msgs/MapMetaData, latched).

    Services: ``static_map`` (nav_msgs/GetMap); ``change_map`` (nav_msgs/LoadMap): switches to another file.

    Parameters: ``~frame_id`` ("map").

    On error: an invalid map file ends the node with one line; ``change_map`` returns an error and keeps the old map.
    """

    def __init__(self) -> None:
        arguments = rospy.myargv()[1:]
        if len(arguments) != 1:
            raise NavigationError(f"usage: map_server MAP.yaml (got {len(arguments)} arguments)")
        self._frame = stripped(str(rospy.get_param("~frame_id", "map")))
        self._map_publisher = rospy.Publisher("map", GridMessage, queue_size=1, latch=True)
        self._metadata_publisher = rospy.Publisher(
            "map_metadata", MapMetaData, queue_size=1, latch=True
        )
        self._map = self._load(Path(arguments[0]))
        self._publish()
        rospy.Service("static_map", GetMapArray, lambda _: GetMapArrayResponse(self._map))
        rospy.Service("change_map", LoadMapArray, self._change)

    def _load(self, path: Path) -> GridMessage:
        grid = read_map(path)
        rospy.loginfo("map %s: %d x %d cells of %g m", path, grid.cols, grid.rows, grid.resolution)
        return message_from_grid(grid, self._frame, rospy.Time.now())

    def _publish(self) -> None:
        self._metadata_publisher.publish(self._map.info)
        self._map_publisher.publish(self._map)

    def _change(self, request: LoadMapRequest) -> LoadMapArrayResponse:
        # A URL of a local file, or a plain path.
        path = Path(request.map_url.removeprefix("file://"))
        try:
            self._map = self._load(path)
            self._publish()
        except MapError as error:
            rospy.logerr("%s", error)
            result = _RESULTS.get(type(error), LoadMapResponse.RESULT_UNDEFINED_FAILURE)
            return LoadMapArrayResponse(GridMessage(), result)
        return LoadMapArrayResponse(self._map, LoadMapResponse.RESULT_SUCCESS)


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("map_server", MapServerNode, expected=(NavigationError,))
