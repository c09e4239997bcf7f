"""A costmap node after any sequence of maps, changed parameters, lost inputs and steps of the clock.

It is current only while every enabled source is used, it becomes current again once its inputs are good, and what it
holds and what viewers see are that of its newest inputs.
"""

import io
import math
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from unittest import mock

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Quaternion
from hypothesis import given, settings
from hypothesis import strategies as st
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import MapMetaData, OccupancyGrid
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from nav_bundle.base.pose import Pose
from nav_bundle.base.transform import DisconnectedError, ExtrapolationError, Transform
from nav_bundle.costmap.config import (
    CostmapConfig,
    InflationConfig,
    ObstacleConfig,
    SourceConfig,
    StaticConfig,
)
from nav_bundle.costmap.cost import LETHAL, occupancy_by_cost
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.node import CostmapNode
from nav_bundle.maps.conversions import GridMessage
from nav_bundle.maps.grid import Grid

START = 1.0e5
"""ROS time at the start [s]: the clock may be set back often."""
STEP = 0.05
"""Period of the owner's loop [s]."""
SCAN_PERIOD = 0.1
RATE = 0.4
"""The sources' ``expected_update_rate`` [s]."""
TOLERANCE = 0.5
"""The costmap's ``transform_tolerance`` [s]."""
HISTORY = 10.0
"""Length of the transforms' history [s]."""
UPDATE_PERIOD = 0.2
AHEAD = 0.8
"""What lasers see, ahead of the robot [m]."""
FRONT = SourceConfig("front_scan", expected_update_rate=RATE, clearing=True)
REAR = SourceConfig("rear_scan", expected_update_rate=RATE, clearing=True)
ROLLING = CostmapConfig(
    global_frame="odom",
    rolling_window=True,
    width=4.0,
    height=4.0,
    resolution=0.1,
    publish_frequency=5.0,
    transform_tolerance=TOLERANCE,
    robot_radius=0.2,
    layers=(
        ObstacleConfig(sources=(FRONT,)),
        ObstacleConfig(sources=(REAR,)),
        InflationConfig(inflation_radius=0.3),
    ),
)
MAPPED = replace(
    ROLLING,
    global_frame="map",
    rolling_window=False,
    layers=(
        StaticConfig(map_topic="map"),
        *ROLLING.layers[:2],
        StaticConfig(map_topic="no_go", use_maximum=True),
        InflationConfig(inflation_radius=0.3),
    ),
)


def room(rows: int, cols: int, resolution: float, hole: int) -> Grid:
    """Returns a map of a room with walls around it, and another obstacle."""
    cells = np.zeros((rows, cols), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    cells[hole, hole] = 100
    return Grid(resolution, Pose(), cells)


MAPS = [room(40, 40, 0.1, 5), room(40, 50, 0.1, 33), room(24, 24, 0.2, 20)]
ROBOT = Pose(2.0, 2.0)
"""Where the robot stands: in the middle of all maps."""


class Network:
    """The topics of a node, without a ROS master."""

    def __init__(self) -> None:
        self.now = START
        self.subscribers: dict[str, list[Any]] = {}
        self.published: dict[str, list[Any]] = {}

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Takes the place of rospy's functions that need a master."""
        replacements: dict[str, Any] = {
            "Subscriber": self._subscribe,
            "Publisher": self._advertise,
            "get_time": lambda: self.now,
            "resolve_name": lambda name: f"/{name}",
            "search_param": lambda _: None,
            "logerr": lambda *_: None,
            "logwarn_throttle": lambda *_: None,
        }
        with mock.patch.multiple(rospy, **replacements):
            yield

    def _subscribe(
        self, topic: str, kind: Callable[[], Any], callback: Callable[[Any], None], **_: object
    ) -> Any:
        subscriber = mock.Mock(kind=kind, callback=callback)
        found = self.subscribers.setdefault(topic, [])
        found.append(subscriber)
        subscriber.unregister = lambda: found.remove(subscriber)
        return subscriber

    def _advertise(self, topic: str, *_: object, **__: object) -> Any:
        messages = self.published.setdefault(topic, [])
        return mock.Mock(publish=messages.append, get_num_connections=lambda: 1)

    def send(self, topic: str, message: Any, cut: int = 0) -> None:
        """Brings a message, without its last ``cut`` bytes, to all subscribers."""
        buffer = io.BytesIO()
        message.serialize(buffer)
        data = buffer.getvalue()
        for subscriber in tuple(self.subscribers.get(topic, ())):
            subscriber.callback(subscriber.kind().deserialize(data[: len(data) - cut]))

    def take(self, topic: str) -> list[Any]:
        """Returns the messages published since the last call."""
        found = list(self.published[topic])
        self.published[topic].clear()
        return found


@dataclass
class Tree:
    """The transforms of a robot that stands at ``ROBOT``; ``newest`` is the stamp of the newest ones."""

    newest: float = START
    connected: bool = True

    def listen(self, *_: str) -> None:
        """Does nothing: all transforms are kept."""

    def latest(self, *_: str) -> float:
        """Returns the newest stamp."""
        if not self.connected:
            raise DisconnectedError("no transform")
        return self.newest

    def lookup(self, target: str, source: str, stamp: float | None = None) -> Transform:
        """Returns a transform, as a tf listener does."""
        if not self.connected or source == "nowhere":
            raise DisconnectedError(f"no transform of {source}")
        if stamp is not None and stamp > self.newest + 1e-6:
            raise ExtrapolationError("its newest is older", True)
        if stamp is not None and stamp < self.newest - HISTORY:
            raise ExtrapolationError("its oldest is newer", False)
        if target == source or {target, source} == {"map", "odom"}:
            return Transform()
        yaw = math.pi if source == "rear" else 0.0
        turn = (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
        return Transform((ROBOT.x, ROBOT.y, 0.3), turn)


class Viewer:
    """What RViz shows of a costmap: the last whole grid, and the updates since."""

    def __init__(self) -> None:
        self.values: Any = None

    def take(self, grids: list[Any], updates: list[Any]) -> None:
        """Applies the messages of one step: at most one."""
        for grid in grids:
            self.values = np.array(grid.data).reshape(grid.info.height, grid.info.width).copy()
        for update in updates:
            rows = slice(update.y, update.y + update.height)
            cols = slice(update.x, update.x + update.width)
            part = np.array(update.data).reshape(update.height, update.width)
            assert self.values[rows, cols].shape == part.shape, "an update of another size"
            self.values[rows, cols] = part


@dataclass
class Sensor:
    """A laser: its fault, and the times of what it sent."""

    source: SourceConfig
    frame: str
    index: int  #: of its layer
    kind: str = ""  #: fault of its messages; empty for none
    due: float = START
    good_since: float = (
        math.inf
    )  #: time since when all its messages have been good and its layer enabled
    last_usable: float = (
        -math.inf
    )  #: time of the last message that can be placed, parses, and is not old


STAMPS = {"ahead": 0.4, "far ahead": 60.0, "old": -5.0, "before the history": -60.0}
FAULTS = ["", "", "", "silent", "broken", "nowhere", "NaN", "empty", "bad angles", *STAMPS]


@dataclass
class Chaos:
    """Random events for one node, and what must hold after each step of its owner's loop."""

    seed: int
    network: Network = field(default_factory=Network)
    tree: Tree = field(default_factory=Tree)
    viewer: Viewer = field(default_factory=Viewer)

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.config = self.random.choice([ROLLING, MAPPED])
        indices = [
            index
            for index, layer in enumerate(self.config.layers)
            if isinstance(layer, ObstacleConfig)
        ]
        self.sensors = [Sensor(FRONT, "front", indices[0]), Sensor(REAR, "rear", indices[1])]
        self.node = CostmapNode("costmap", self.config, self.tree)  # type: ignore[arg-type]
        self.maps: dict[str, Grid] = {}
        self.tf_lags = False
        self.good_since = (
            self.network.now
        )  # time since when transforms, clock and owner have been good
        self.updated = -math.inf

    @property
    def place(self) -> str:
        """Where a fault was found."""
        return f"seed {self.seed}, {self.network.now:.2f} s"

    def run(self, steps: int) -> None:
        """Runs with random events, then with good inputs only: it must become current."""
        for _ in range(steps):
            self.change()
            self.step()
        self.recover()
        for _ in range(round((RATE + 3.0 * UPDATE_PERIOD + TOLERANCE) / STEP)):
            self.step()
        assert self.node.fault(self.network.now) == "", f"{self.place}: not current again"
        assert self.node.costmap.ready, self.place

    def recover(self) -> None:
        """Makes all inputs good, and all layers enabled."""
        self.tree.connected = True
        self.tf_lags = False
        for sensor in self.sensors:
            self.set_fault(sensor, "")
        self.configure(
            replace(
                self.config,
                layers=tuple(replace(layer, enabled=True) for layer in self.config.layers),
            )
        )
        if self.config.layers[0] == MAPPED.layers[0]:
            for topic in ("map", "no_go"):
                self.send_map(topic, MAPS[0])

    def change(self) -> None:
        """Changes something at random, or nothing."""
        if self.random.random() > 0.15:
            return
        change = self.random.choice(
            [self.change_sensor] * 4
            + [self.toggle_layer, self.resize, self.change_tf, self.new_map, self.new_map]
            + [self.step_clock, self.clear]
        )
        change()

    def change_sensor(self) -> None:
        """Makes a sensor's messages useless, or good again."""
        self.set_fault(self.random.choice(self.sensors), self.random.choice(FAULTS))

    def set_fault(self, sensor: Sensor, kind: str) -> None:
        """Sets the fault of a sensor's messages."""
        if sensor.kind != kind:
            sensor.good_since = math.inf
        sensor.kind = kind

    def configure(self, config: CostmapConfig) -> None:
        """Applies parameters as dynamic_reconfigure does; a layer that is enabled again needs new messages."""
        for sensor in self.sensors:
            if config.layers[sensor.index] != self.config.layers[sensor.index]:
                sensor.good_since = math.inf
                sensor.last_usable = -math.inf
        self.config = config
        self.node.configure(config)

    def toggle_layer(self) -> None:
        """Disables or enables a layer."""
        index = self.random.randrange(len(self.config.layers))
        layers = list(self.config.layers)
        layers[index] = replace(layers[index], enabled=not layers[index].enabled)
        self.configure(replace(self.config, layers=tuple(layers)))

    def resize(self) -> None:
        """Sets another size; a map's size counts, where there is one."""
        self.configure(replace(self.config, width=float(self.random.choice([3, 4, 6]))))

    def change_tf(self) -> None:
        """Takes the transforms away, makes them lag, or brings them back."""
        self.tree.connected = self.random.random() < 0.6
        self.tf_lags = self.random.random() < 0.3

    def new_map(self) -> None:
        """Sends a map."""
        self.send_map(self.random.choice(["map", "no_go"]), self.random.choice(MAPS))

    def send_map(self, topic: str, grid: Grid) -> None:
        """Sends a map, sometimes after one that cannot be used."""
        stamp = rospy.Time.from_sec(self.network.now)
        rows, cols = grid.cells.shape
        origin = PoseMessage()
        origin.orientation.w = 1.0
        info = MapMetaData(stamp, grid.resolution, cols, rows, origin)
        if self.random.random() < 0.3:
            self.network.send(topic, OccupancyGrid())
        header = Header(0, stamp, "map")
        self.network.send(topic, GridMessage(header, info, grid.cells.ravel()))
        if self.config.layers[0] != ROLLING.layers[0]:
            self.maps[topic] = grid

    def step_clock(self) -> None:
        """Sets the clock back, as move_base notices, or on; or delays the owner's loop."""
        step = self.random.choice([-30.0, -0.5, 0.3, 2.0, 30.0])
        self.network.now += step
        self.tree.newest = min(self.tree.newest, self.network.now)
        self.good_since = math.inf
        for sensor in self.sensors:
            sensor.due = self.network.now
            sensor.good_since = math.inf
        if step < 0.0:
            if step < -1.0:
                self.node.forget()
            else:
                self.node.forget_times()
            self.updated = -math.inf
            for sensor in self.sensors:
                sensor.last_usable = -math.inf

    def clear(self) -> None:
        """Clears the costmap, as the service does."""
        self.node.costmap.reset()
        self.update(forced=True)

    def step(self) -> None:
        """Runs one period: transforms, scans, and the owner's loop."""
        self.network.now += STEP
        now = self.network.now
        if not self.tf_lags:
            self.tree.newest = now
        is_good = self.tree.connected and now - self.tree.newest <= 1e-6
        if not is_good:
            self.good_since = math.inf
        elif math.isinf(self.good_since):
            self.good_since = now
        for sensor in self.sensors:
            self.send_scan(sensor)
        self.update()
        self.check_current()

    def send_scan(self, sensor: Sensor) -> None:
        """Sends a scan, if it is due."""
        now = self.network.now
        if now < sensor.due - 1e-6 or sensor.kind == "silent":
            return
        sensor.due = now + SCAN_PERIOD
        stamp = now + STAMPS.get(sensor.kind, 0.0)
        scan = LaserScan(
            header=Header(0, rospy.Time.from_sec(stamp), sensor.frame),
            angle_min=-0.1,
            angle_max=0.1,
            angle_increment=0.1,
            range_min=0.1,
            range_max=5.0,
            ranges=[AHEAD] * 3,
        )
        if sensor.kind == "nowhere":
            scan.header.frame_id = "nowhere"
        elif sensor.kind == "NaN":
            scan.ranges = [math.nan] * 3
        elif sensor.kind == "empty":
            scan.ranges = []
        elif sensor.kind == "bad angles":
            scan.angle_increment = math.nan
        self.network.send(sensor.source.topic, scan, cut=8 if sensor.kind == "broken" else 0)
        enabled = self.config.layers[sensor.index].enabled
        # A stamp a bit ahead can be used once the transforms have come.
        if sensor.kind in ("", "ahead") and enabled:
            sensor.last_usable = now
        if sensor.kind == "" and enabled:
            sensor.good_since = min(sensor.good_since, now)

    def update(self, forced: bool = False) -> None:
        """Updates the costmap, and checks what it holds and shows."""
        now = self.network.now
        published = self.node._published
        if not self.node.update(now, forced):
            return
        self.updated = now
        costmap = self.node.costmap
        self.viewer.take(
            self.network.take("~costmap/costmap"), self.network.take("~costmap/costmap_updates")
        )
        if self.node._published != published:
            assert np.array_equal(self.viewer.values, occupancy_by_cost()[costmap.cells]), (
                f"{self.place}: viewers see another costmap"
            )
        fresh = Costmap(self.config)
        for topic, grid in self.maps.items():
            fresh.set_map(grid, topic)
        assert fresh.ready, f"{self.place}: updated without a map"
        fresh.update(ROBOT, ())
        assert fresh.geometry == costmap.geometry, self.place
        assert (costmap.cells[fresh.cells == LETHAL] == LETHAL).all(), (
            f"{self.place}: walls of the newest maps are missing"
        )
        for sensor in self.sensors:
            is_enabled = self.config.layers[sensor.index].enabled
            if is_enabled and max(sensor.good_since, self.good_since) <= now:
                ahead = AHEAD if sensor.frame == "front" else -AHEAD
                row = costmap.geometry.row_of(ROBOT.y)
                col = costmap.geometry.col_of(ROBOT.x + ahead)
                assert costmap.cells[row, col] == LETHAL, (
                    f"{self.place}: what {sensor.frame} sees is missing"
                )

    def check_current(self) -> None:
        """Checks that the node is current only if it may be, and if it must be."""
        now = self.network.now
        fault = self.node.fault(now)
        longest = RATE + UPDATE_PERIOD + STEP
        for sensor in self.sensors:
            enabled = self.config.layers[sensor.index].enabled
            subscribers = len(self.network.subscribers.get(sensor.source.topic, ()))
            assert subscribers == int(enabled), f"{self.place}: {subscribers} subscribers"
            if not fault and enabled:
                assert now - sensor.last_usable <= longest, (
                    f"{self.place}: current without usable messages of {sensor.frame}"
                )
                assert now - self.updated <= longest, f"{self.place}: current without an update"
        enabled_sensors = [
            sensor for sensor in self.sensors if self.config.layers[sensor.index].enabled
        ]
        good_since = max([self.good_since, *(sensor.good_since for sensor in enabled_sensors)])
        if now - good_since > longest and self.node.costmap.ready:
            assert not fault, f"{self.place}: {fault}"


def run(seed: int, steps: int) -> None:
    """Drives a node through random events; raises AssertionError with the seed."""
    network = Network()
    with network.installed():
        Chaos(seed, network).run(steps)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**9))
def test_a_costmap_is_current_only_while_its_sources_are_used_whatever_happens(seed: int) -> None:
    run(seed, 300)


@pytest.mark.parametrize("seed", range(10))
def test_a_costmap_is_that_of_its_newest_inputs_after_long_sequences(seed: int) -> None:
    run(seed, 1500)


def fault_without_pose(kind: str, *, connected: bool = True) -> str:
    """Returns the fault of a costmap whose transforms are late or, unless ``connected``, missing.

    Args:
        kind: fault of the first sensor's messages, which begins with that of the transforms.
        connected: whether the transforms are only late.
    """
    network = Network()
    with network.installed():
        chaos = Chaos(1, network)
        chaos.recover()
        for _ in range(20):
            chaos.step()
        chaos.tf_lags = True
        chaos.set_fault(chaos.sensors[0], kind)
        for _ in range(round(2.0 * TOLERANCE / STEP)):
            chaos.step()
        chaos.tree.connected = connected
        assert chaos.node.pose(network.now) is None
        return chaos.node.fault(network.now)


def test_a_costmap_without_the_robots_pose_names_the_transform_and_not_the_scans() -> None:
    """Without a pose no scan is used: move_base's state named now the one, now the other."""
    fault = fault_without_pose("")
    assert "the newest transform from base_link" in fault
    assert "observation buffer" not in fault
    assert fault_without_pose("", connected=False) == "no transform"


@pytest.mark.parametrize(
    ("kind", "words"),
    [("silent", "observation buffer has not been updated"), ("nowhere", "nowhere")],
)
def test_scans_that_are_missing_or_useless_are_named_beside_the_transform(
    kind: str, words: str
) -> None:
    """amcl corrects the pose by scans: without them, the transform of the map becomes old, too."""
    fault = fault_without_pose(kind)
    assert words in fault
    assert fault.index(words) < fault.index("the newest transform from base_link")


def static_node(network: Network, **options: Any) -> CostmapNode:
    """Returns a node with only a static layer, which has its first map."""
    config = replace(
        MAPPED,
        layers=(StaticConfig(map_topic="map", **options),),
    )
    node = CostmapNode("costmap", config, Tree())  # type: ignore[arg-type]
    send_grid(network, MAPS[0])
    node.update(network.now)
    return node


def send_grid(network: Network, grid: Grid) -> None:
    info = MapMetaData(
        rospy.Time(), grid.resolution, grid.cols, grid.rows, PoseMessage(orientation=UPRIGHT)
    )
    network.send("map", GridMessage(Header(), info, grid.cells.reshape(-1)))


UPRIGHT = Quaternion(w=1.0)


def test_a_static_layer_takes_parts_of_the_map_if_it_is_told_to() -> None:
    network = Network()
    with network.installed():
        node = static_node(network, subscribe_to_updates=True)
        assert node.costmap.cells[21, 10] != LETHAL
        network.send("map_updates", OccupancyGridUpdate(Header(), 10, 20, 3, 2, [100] * 6))
        network.send("map_updates", OccupancyGridUpdate(Header(), 39, 20, 3, 2, [100] * 6))
        node.update(network.now, forced=True)
        assert (node.costmap.cells[20:22, 10:13] == LETHAL).all()
        assert node.costmap.cells.shape == MAPS[0].cells.shape


def test_a_static_layer_that_is_not_told_to_has_no_subscriber_of_updates() -> None:
    network = Network()
    with network.installed():
        static_node(network)
        assert "map_updates" not in network.subscribers


@pytest.mark.parametrize("first_only", [True, False])
def test_first_map_only_ignores_later_maps(first_only: bool) -> None:
    network = Network()
    with network.installed():
        node = static_node(network, first_map_only=first_only)
        send_grid(network, MAPS[1])
        node.update(network.now, forced=True)
        expected = MAPS[0] if first_only else MAPS[1]
        assert node.costmap.cells.shape == expected.cells.shape
