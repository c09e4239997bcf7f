"""A costmap with its topics: the counterpart of Costmap2DROS."""

import threading
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
import rospy
from geometry_msgs.msg import Point32, Polygon, PolygonStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import MapMetaData, OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud, PointCloud2
from std_msgs.msg import Header

from nav_bundle.base.conversions import ScanMessage, message_from_pose
from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import Pose
from nav_bundle.base.scan import Picture
from nav_bundle.base.topics import TransformListener, robot_frame
from nav_bundle.base.transform import TransformError
from nav_bundle.costmap.config import (
    CostmapConfig,
    FleetConfig,
    ObstacleConfig,
    SourceConfig,
    StaticConfig,
)
from nav_bundle.costmap.conversions import (
    GridUpdateMessage,
    points_from_cloud,
    points_from_old_cloud,
    points_from_scan,
)
from nav_bundle.costmap.cost import occupancy_by_cost
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.geometry import EMPTY, Geometry
from nav_bundle.costmap.layer import Observation
from nav_bundle.costmap.source import Arrival, Limits, Source
from nav_bundle.costmap.topics import Newest
from nav_bundle.maps.conversions import GridMessage, grid_from_message, updated_grid
from nav_bundle.maps.grid import Grid
from pioneer_node.core.frame import stripped
from pioneer_node.nodes.standing_warning import StandingWarning

Seen: TypeAlias = "ScanMessage | PointCloud | PointCloud2"
_CLOUDS = {"PointCloud": PointCloud, "PointCloud2": PointCloud2}
"""Classes of the messages of clouds, by ``data_type``."""

_WORLD_FRAME = "map"
_SCANS_KEPT, _CLOUDS_KEPT = 50, 12
"""Number of messages kept while they wait for the transform at their stamp; clouds are large."""


def costmap_frame(frame: str) -> str:
    """Returns the tf name of a costmap's global frame: all robots share ``map``, other frames belong to the robot."""
    return _WORLD_FRAME if stripped(frame) == _WORLD_FRAME else robot_frame(frame)


def _resolvable(map_topic: str) -> str:
    """Returns the name of a map's topic: relative, as frames are, but for ``/map``, which all robots share."""
    return map_topic if map_topic == "/map" else stripped(map_topic)


class CostmapNode:
    """One costmap of move_base, updated by its owner's loop.

    Subscribes: the static layer's map topic (nav_msgs/OccupancyGrid) and, with ``subscribe_to_updates``, that topic's
        ``…_updates`` (map_msgs/OccupancyGridUpdate), each observation source's topic
        (sensor_msgs/LaserScan, PointCloud or PointCloud2).

    Publishes: ``~<name>/costmap`` (nav_msgs/OccupancyGrid), ``~<name>/costmap_updates``
        (map_msgs/OccupancyGridUpdate), ``~<name>/footprint`` (geometry_msgs/PolygonStamped); each only
        while it has subscribers. A new subscriber gets the whole costmap.

    Services: none.

    Parameters: those of ``costmap.config`` under ``~<name>``.

    Threads: subscriber threads store messages; everything else runs in the owner's thread.

    On error: a pose or scan without a valid transform leaves the costmap unchanged and makes it not current, and so
        does a scan that does not parse or holds no measurement.
    """

    def __init__(self, name: str, config: CostmapConfig, listener: TransformListener) -> None:
        self.name = name
        self.costmap = Costmap(config)
        self.frame = costmap_frame(config.global_frame)
        self.base_frame = robot_frame(config.robot_base_frame)
        self._config, self._listener = config, listener
        listener.listen(self.frame, self.base_frame)
        self._new_maps: dict[str, _NewMap] = {}  # by the topic in the parameters
        self._maps: dict[str, _NewMap] = {}  # the newest map of each topic
        self._maps_turn = threading.Lock()
        self._map_frames: dict[str, str] = {}
        self._scans: dict[tuple[str, str], Newest[Seen]] = {}
        self._others: tuple[FleetConfig, ...] = ()
        self._sources: list[_Input] = []
        self._listen_to(config)
        self._subscribe_map()
        self._listener_flag = _NewListener()
        self._outdated = StandingWarning(f"{name}: transforms are up to date again")
        self._unplaced = StandingWarning(f"{name}: the map can be placed again")
        self._grid_publisher = rospy.Publisher(
            f"~{name}/costmap", OccupancyGrid, subscriber_listener=self._listener_flag, queue_size=1
        )
        self._update_publisher = rospy.Publisher(
            f"~{name}/costmap_updates", OccupancyGridUpdate, queue_size=10
        )
        self._footprint_publisher = rospy.Publisher(
            f"~{name}/footprint", PolygonStamped, queue_size=1
        )
        self._pose_fault = ""  # why the last ``pose`` was None
        self._map_fault = ""  # why the map could not be placed at the last update
        self._updated, self._published = -np.inf, -np.inf
        self._changed = EMPTY
        self._shown: Geometry | None = None  # of the last whole costmap published
        self._values = occupancy_by_cost()

    def configure(self, config: CostmapConfig) -> None:
        """Applies another configuration; frames and map topic stay unchanged."""
        if config == self._config:
            return
        self._config = config
        self.costmap.configure(config)
        self._listen_to(config)

    def _listen_to(self, config: CostmapConfig) -> None:
        """Subscribes to the sources of enabled layers and unsubscribes from others; keeps messages received so far."""
        enabled = [layer for layer in config.layers if layer.enabled]
        sources = [
            source
            for layer in enabled
            if isinstance(layer, ObstacleConfig)
            for source in layer.sources
        ]
        self._others = tuple(layer for layer in enabled if isinstance(layer, FleetConfig))
        for layer in self._others:
            for frame in layer.frames():
                self._listener.listen(self.frame, frame)
        wanted = {(source.topic, source.data_type) for source in sources}
        for key in self._scans.keys() - wanted:
            self._scans.pop(key).close()
        for topic, data_type in wanted - self._scans.keys():
            if data_type in _CLOUDS:
                self._scans[topic, data_type] = Newest(topic, _CLOUDS[data_type], _CLOUDS_KEPT)
            else:
                self._scans[topic, data_type] = Newest(topic, ScanMessage, _SCANS_KEPT)
        known = {source.config: source.source for source in self._sources}
        self._sources = []
        for source in dict.fromkeys(sources):
            frame = robot_frame(source.sensor_frame) if source.sensor_frame else ""
            scans = self._scans[source.topic, source.data_type]
            self._sources.append(_Input(source, frame, scans, known.get(source) or Source(source)))

    def _subscribe_map(self) -> None:
        """Subscribes to the map of each static layer, enabled or not; layers may share one."""
        layers = [layer for layer in self._config.layers if isinstance(layer, StaticConfig)]
        for topic in dict.fromkeys(layer.map_topic for layer in layers):
            self._map_frames[topic] = self.frame
            rospy.Subscriber(
                _resolvable(topic), GridMessage, partial(self._on_map, topic), queue_size=1
            )
        for topic in {layer.map_topic for layer in layers if layer.subscribe_to_updates}:
            rospy.Subscriber(
                f"{_resolvable(topic)}_updates",
                OccupancyGridUpdate,
                partial(self._on_map_update, topic),
                queue_size=10,
            )

    def _takes_map(self, topic: str) -> bool:
        """Returns whether any static layer still takes maps from ``topic``."""
        if topic not in self._maps:
            return True
        layers = [layer for layer in self._config.layers if isinstance(layer, StaticConfig)]
        return any(layer.map_topic == topic and not layer.first_map_only for layer in layers)

    def _on_map_update(self, topic: str, message: OccupancyGridUpdate) -> None:
        """Puts a part into the newest map; one that comes before the first map is dropped."""
        with self._maps_turn:
            newest = self._maps.get(topic)
            if newest is None:
                return
            try:
                updated = newest._replace(grid=updated_grid(newest.grid, message))
                self._maps[topic] = self._new_maps[topic] = updated
            except NavigationError as error:
                rospy.logerr("%s_updates: %s", rospy.resolve_name(_resolvable(topic)), error)

    def _on_map(self, topic: str, message: GridMessage) -> None:
        if not self._takes_map(topic):
            return
        try:
            grid = grid_from_message(message)
        except NavigationError as error:
            rospy.logerr("%s: %s", rospy.resolve_name(_resolvable(topic)), error)
            return
        new = _NewMap(grid, costmap_frame(message.header.frame_id or _WORLD_FRAME))
        with self._maps_turn:
            self._maps[topic] = self._new_maps[topic] = new

    def _missing_maps(self) -> list[str]:
        """Returns the topics of the maps that enabled layers still wait for."""
        return [topic for topic in self.costmap.missing_maps() if topic not in self._new_maps]

    @property
    def has_map(self) -> bool:
        """Whether all maps that the costmap needs have arrived."""
        return not self._missing_maps()

    def missing(self, now: float) -> list[str]:
        """Returns descriptions of the inputs that the costmap still waits for."""
        found = [
            f"the map on {rospy.resolve_name(_resolvable(topic))}" for topic in self._missing_maps()
        ]
        if self.pose(now) is None:
            found.append(f"a transform from {self.base_frame} to {self.frame}")
        return found

    def pose(self, now: float) -> Pose | None:
        """Returns the robot's pose in the costmap's frame; None if it is unknown or too old."""
        try:
            newest = self._listener.latest(self.frame, self.base_frame)
            tolerance = self._config.transform_tolerance
            if now - newest > tolerance:
                self._outdated.warn(
                    f"Costmap2DROS transform timeout. Current time: {now:.4f}, global_pose stamp: {newest:.4f}, "
                    f"tolerance: {tolerance:.4f}"
                )
                self._pose_fault = (
                    f"the newest transform from {self.base_frame} to {self.frame} is {now - newest:.2f} s old, "
                    f"more than {tolerance:.2f} s"
                )
                return None
            pose = self._listener.lookup(self.frame, self.base_frame).planar()
        except TransformError as error:
            rospy.logdebug("%s: %s", self.name, error)
            self._pose_fault = str(error)
            return None
        self._outdated.end()
        self._pose_fault = ""
        return pose

    def fault(self, now: float) -> str:
        """Returns why the costmap is not current, and warns of it; empty if every source is used in time.

        Without a pose nothing can be placed: then the missing transform is a reason, and a source is one only if its
        messages are missing or useless by themselves. A robot without scans does not know its pose for long, either.
        Call ``pose`` first.
        """
        first = ""
        for source in self._sources:
            fault = self._fault(source, now)
            if fault:
                source.scans.overdue.warn(fault)
            else:
                source.scans.overdue.end()
            if self._pose_fault:
                tolerance = self._config.transform_tolerance
                fault = source.source.own_fault(source.scans.received, now, tolerance)
            first = first or fault
        if first and self._pose_fault:
            return f"{first.rstrip('.')}; {self._pose_fault}"
        return first or self._pose_fault

    def _fault(self, source: "_Input", now: float) -> str:
        """Returns why a source is not current; empty if it is."""
        limits = Limits(1.0 / self._config.update_frequency, self._config.transform_tolerance)
        return source.source.fault(source.scans.received, now, limits, self._map_fault)

    def update(self, now: float, forced: bool = False) -> bool:
        """Updates and publishes the costmap, each if due; ``forced`` updates in any case.

        Returns whether it was updated.
        """
        while self._new_maps:
            topic, new = self._new_maps.popitem()
            if self.costmap.takes_map(topic):
                self._map_frames[topic] = new.frame
                self.costmap.set_map(new.grid, topic)
        due = (
            now - self._updated >= 1.0 / self._config.update_frequency - 1.0e-6
            or now < self._updated
        )
        if not self.costmap.ready or not (due or forced):
            return False
        pose = self.pose(now)
        map_places = self._map_places()
        if pose is None or map_places is None:
            return False
        self._updated = now
        robots = list(self.other_robots(now).values())
        changed = self.costmap.update(pose, self._observations(now), robots, map_places)
        self._changed = self._changed.joined(changed)
        self._publish(now, pose)
        return True

    def picture(self, now: float) -> Picture | None:
        """Returns the newest observation of the first source that is current and has one; else None.

        None in the map's frame, too: there, a correction by localisation looks like motion that the laser does not see.
        """
        if self.frame == _WORLD_FRAME:
            return None
        for source in self._sources:
            newest = source.source.buffer.last
            if newest is not None and not self._fault(source, now):
                return Picture(
                    Pose(newest.sensor_x, newest.sensor_y, newest.sensor_yaw), newest.points
                )
        return None

    def forget(self) -> None:
        """Drops all sensor data after simulated time has started again."""
        self.forget_times()
        self.costmap.reset()

    def forget_times(self) -> None:
        """Drops all messages after the clock was set back: their age is unknown. Keeps the obstacles."""
        for source in self._sources:
            source.scans.forget()
            source.source.forget()

    def _map_places(self) -> dict[str, Pose] | None:
        """Returns the poses of the maps' frames in the costmap's; None if a rolling window lacks a transform."""
        if not self._config.rolling_window:
            return {}
        places = {}
        try:
            for topic, frame in self._map_frames.items():
                places[topic] = self._listener.lookup(self.frame, frame).planar()
        except TransformError as error:
            self._map_fault = f"the map cannot be placed: {error}"
            self._unplaced.warn(f"{self.name}: {self._map_fault}")
            return None
        self._unplaced.end()
        self._map_fault = ""
        return places

    def other_robots(self, now: float) -> dict[str, Pose]:
        """Returns the poses of the fleet layer's other robots that are known and recent, by name."""
        found = {}
        for layer in self._others:
            for frame in layer.frames():
                if frame == self.base_frame:
                    continue
                try:
                    if now - self._listener.latest(self.frame, frame) <= layer.timeout:
                        found[frame.rpartition("/")[0]] = self._listener.lookup(
                            self.frame, frame
                        ).planar()
                except TransformError as error:
                    rospy.logdebug("%s: no other robot at %s: %s", self.name, frame, error)
        return found

    def _observations(self, now: float) -> list[Observation]:
        """Returns the valid observations of all sources that can be transformed into the costmap's frame."""
        observations = []
        for source in self._sources:
            source.source.update(source.scans.arrivals(), partial(self._placed, source), now)
            refusal = source.source.refusal
            if refusal:
                source.scans.unusable.warn(
                    f"{self.name}: cannot use messages on {source.scans.topic}: {refusal}"
                )
            else:
                source.scans.unusable.end()
            observations.extend(source.source.buffer.current(now))
        return observations

    def _placed(self, source: "_Input", arrival: Arrival[Seen]) -> Observation:
        """Returns the observation of a message; raises TransformError or ObservationError."""
        config = source.config
        scan = arrival.message
        place = self._listener.lookup(
            self.frame, source.frame or scan.header.frame_id, arrival.stamp or None
        )
        if config.data_type == "PointCloud2":
            points = place.apply(points_from_cloud(scan))
        elif config.data_type == "PointCloud":
            points = place.apply(points_from_old_cloud(scan))
        else:
            points = place.apply(points_from_scan(scan, config.inf_is_valid))
        heights = points[:, 2]
        kept = (heights >= config.min_obstacle_height) & (heights <= config.max_obstacle_height)
        sensor_x, sensor_y, sensor_z = place.translation
        return Observation(
            config,
            sensor_x,
            sensor_y,
            np.ascontiguousarray(points[kept, :2]),
            place.planar().yaw,
            sensor_z,
            heights[kept],
        )

    def _publish(self, now: float, pose: Pose) -> None:
        if self._footprint_publisher.get_num_connections():
            self._footprint_publisher.publish(self._footprint(now, pose))
        frequency = self._config.publish_frequency
        if frequency <= 0.0 or (0.0 <= now - self._published < 1.0 / frequency - 1.0e-6):
            return
        self._published = now
        changed, self._changed = self._changed, EMPTY
        if not self._grid_publisher.get_num_connections():
            return
        whole = (
            self._listener_flag.arrived
            or self._config.always_send_full_costmap
            or self._config.rolling_window
        )
        if whole or self._shown != self.costmap.geometry:
            self._listener_flag.arrived = False
            self._shown = replace(self.costmap.geometry)
            self._grid_publisher.publish(self.grid_of(self._values[self.costmap.cells], now))
        elif changed and self._update_publisher.get_num_connections():
            part = self.costmap.cells[changed.slices]
            rows, cols = part.shape
            values = self._values[part].ravel()
            header = Header(0, rospy.Time.from_sec(now), self.frame)
            update = GridUpdateMessage(header, changed.col_0, changed.row_0, cols, rows, values)
            self._update_publisher.publish(update)

    def grid_of(self, values: NDArray[np.int8], now: float) -> GridMessage:
        """Returns ``values`` of this costmap's cells, shape (rows, cols), as a message."""
        stamp, place = rospy.Time.from_sec(now), self.costmap.geometry
        origin = message_from_pose(Pose(place.origin_x, place.origin_y))
        info = MapMetaData(stamp, place.resolution, place.cols, place.rows, origin)
        return GridMessage(Header(0, stamp, self.frame), info, values.ravel())

    def _footprint(self, now: float, pose: Pose) -> PolygonStamped:
        points = [Point32(x, y, 0.0) for x, y in self.costmap.footprint.outline(pose)]
        return PolygonStamped(Header(0, rospy.Time.from_sec(now), self.frame), Polygon(points))


class _NewListener(rospy.SubscribeListener):  # type: ignore[misc]
    """Records that a new subscriber has connected, which needs the whole costmap first."""

    arrived = True

    def peer_subscribe(self, *_: object) -> None:
        """Sets the flag; the owner's loop publishes."""
        self.arrived = True


class _NewMap(NamedTuple):
    """A map that has arrived since the last update."""

    grid: Grid
    frame: str  #: the tf name of its frame


class _Input(NamedTuple):
    """One observation source and its subscription."""

    config: SourceConfig  #: its parameters
    frame: str  #: frame of the sensor; empty: that in the messages
    scans: Newest[Seen]  #: its newest messages
    source: Source[Seen]  #: its observations, and whether it is current
