"""An observation source is current only while its messages reach the costmap; the reason is named if they do not."""

from collections import deque

import numpy as np
import pytest
from sensor_msgs.msg import LaserScan

from nav_bundle.base.error import ObservationError
from nav_bundle.base.transform import DisconnectedError, ExtrapolationError
from nav_bundle.costmap.config import SourceConfig
from nav_bundle.costmap.conversions import points_from_scan
from nav_bundle.costmap.layer import Observation
from nav_bundle.costmap.source import Arrival, Limits, Source

RATE, TOLERANCE, PERIOD, SCAN_PERIOD, STEP = 0.4, 0.5, 0.2, 0.1, 0.05
LIMITS = Limits(update_period=PERIOD, tolerance=TOLERANCE)
CONFIG = SourceConfig("base_scan", expected_update_rate=RATE)
KINDS = {
    "ahead": "its newest",
    "far ahead": "its newest",
    "past": "its oldest",
    "a minute old": "its oldest",
    "old": "in the past",
    "unknown frame": "no transform",
    "broken": "do not parse",
    "empty": "measurement",
    "silent": "has not been updated",
}
OFFSETS = {"ahead": 0.4, "far ahead": 0.6, "past": -11.0, "a minute old": -60.0, "old": -5.0}


class Robot:
    """A source, its topic and the transforms of a robot; ``kind`` is the fault of the messages, empty for none."""

    def __init__(self, config: SourceConfig = CONFIG) -> None:
        self.source: Source[str] = Source(config)
        self.kept: deque[Arrival[str]] = deque(maxlen=50)
        self.now, self.kind, self.lag = 100.0, "", 0.0
        self.received: float | None = None
        self._arrival_due = self._update_due = 100.0
        self._count = 0

    def place(self, arrival: Arrival[str]) -> Observation:
        newest = self.now - self.lag
        if arrival.message == "unknown frame":
            raise DisconnectedError("no transform of 'moon' has arrived")
        if arrival.message == "empty":
            points_from_scan(LaserScan(ranges=[float("nan")] * 3, range_max=5.0), False)
        if arrival.stamp > newest + 1e-9:
            raise ExtrapolationError(
                f"transform requested at {arrival.stamp}; its newest is at {newest}", True
            )
        if 0.0 < arrival.stamp < newest - 10.0:
            raise ExtrapolationError(
                f"transform requested at {arrival.stamp}; its oldest is at {newest - 10}", False
            )
        return Observation(self.source.config, 0.0, 0.0, np.empty((0, 2)))

    def step(self) -> str:
        self.now += STEP
        if self.now >= self._arrival_due and self.kind != "silent":
            self._arrival_due = self.now + SCAN_PERIOD - 1e-9
            self.received = self.now
            self._count += 1
            if self.kind != "broken":  # a topic leaves out what does not parse
                stamp = self.now + OFFSETS.get(self.kind, 0.0)
                self.kept.append(Arrival(self._count, self.now, stamp, self.kind))
        if self.now >= self._update_due:
            self._update_due = self.now + PERIOD - 1e-9
            self.source.update(reversed(self.kept), self.place, self.now)
        return self.fault()

    def fault(self) -> str:
        return self.source.fault(self.received, self.now, LIMITS)

    def run(self, duration: float) -> list[str]:
        return [self.step() for _ in range(round(duration / STEP))]


@pytest.mark.parametrize("kind", KINDS)
def test_a_source_whose_messages_are_not_used_is_outdated_in_time_and_the_reason_is_named(kind):
    robot = Robot()
    assert not any(robot.run(1.0)[1:])
    robot.kind = kind
    faults = robot.run(RATE + 2 * PERIOD + SCAN_PERIOD)
    assert KINDS[kind] in faults[-1]
    assert all(robot.run(1.0))
    robot.kind = ""
    assert not any(robot.run(2.0)[round((RATE + PERIOD + SCAN_PERIOD) / STEP) :])


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_wrong_with_the_messages_is_named_when_the_costmap_is_no_longer_updated(kind):
    """Without scans amcl gives no transform, and without that the costmap is not updated."""
    robot = Robot()
    robot.run(1.0)
    robot.kind = kind
    robot.run(RATE + 2 * PERIOD + SCAN_PERIOD)
    robot.now += 2.0
    if kind != "silent":
        robot.received = robot.now
    assert KINDS[kind] in robot.source.own_fault(robot.received, robot.now, TOLERANCE)


@pytest.mark.parametrize("lag", [0.0, 0.3, TOLERANCE])
def test_nothing_is_wrong_with_messages_that_wait_for_a_late_transform(lag):
    """The costmap is not updated any more once transforms are later than its tolerance."""
    robot = Robot()
    robot.run(1.0)
    robot.lag = lag
    robot.run(1.0)
    robot.now += 2.0
    robot.received = robot.now
    assert robot.source.own_fault(robot.received, robot.now, TOLERANCE) == ""


def test_a_source_is_current_exactly_as_long_as_recent_messages_are_in_the_costmap():
    generator = np.random.default_rng(33)
    for _ in range(100):
        robot = Robot()
        since = robot.now
        for _ in range(20):
            robot.kind = str(generator.choice(["", "", *KINDS]))
            since = robot.now
            for _ in range(int(generator.integers(1, 60))):
                fault = robot.step()
                lasts = robot.now - since
                if lasts > RATE + 2 * PERIOD + SCAN_PERIOD:
                    assert bool(fault) == bool(robot.kind), (robot.kind, fault)
                if not fault:
                    newest = robot.source.buffer.newest
                    assert robot.now - newest <= RATE + TOLERANCE + PERIOD + 1e-6


def test_scans_wait_for_transforms_that_are_late():
    robot = Robot()
    robot.lag = 0.25
    assert not any(robot.run(5.0)[round(2 * PERIOD / STEP) + round(robot.lag / STEP) :])
    robot.lag = 0.6
    faults = robot.run(2.0)
    assert "its newest" in faults[-1]


def test_a_stamp_of_zero_means_the_newest_transform():
    source: Source[str] = Source(CONFIG)
    stamps = []

    def place(arrival: Arrival[str]) -> Observation:
        stamps.append(arrival.stamp)
        return Observation(CONFIG, 0.0, 0.0, np.empty((0, 2)))

    source.update([Arrival(1, 5.0, 0.0, "")], place, 5.0)
    assert stamps == [0.0]
    assert source.fault(5.0, 5.1, LIMITS) == ""
    assert source.buffer.newest == 5.0


def test_a_costmap_that_is_no_longer_updated_is_outdated():
    robot = Robot()
    robot.run(1.0)
    robot.now += RATE + PERIOD + SCAN_PERIOD
    robot.received = robot.now
    assert "has not been updated" in robot.fault()
    because = robot.source.fault(robot.received, robot.now, LIMITS, "no transform of the map")
    assert because == "The costmap cannot be updated: no transform of the map"


def test_a_source_without_an_expected_rate_is_always_current():
    robot = Robot(SourceConfig("base_scan"))
    robot.kind = "unknown frame"
    assert not any(robot.run(2.0))
    assert "no transform" in robot.source.refusal


def test_a_persistent_source_keeps_each_new_message_once_in_order():
    config = SourceConfig("base_scan", observation_persistence=1.0)
    robot = Robot(config)
    robot.run(2.0)
    stamps = [stamp for stamp, _ in robot.source.buffer._kept]
    assert stamps == sorted(set(stamps))
    assert len(robot.source.buffer.current(robot.now)) == pytest.approx(10, abs=2)


@pytest.mark.parametrize("ranges", [[], [np.nan] * 4, [-np.inf, np.nan]])
def test_a_scan_without_a_measurement_is_refused(ranges):
    with pytest.raises(ObservationError, match="measurement"):
        points_from_scan(LaserScan(ranges=ranges, angle_increment=0.1, range_max=5.0), True)


def test_a_scan_of_an_empty_place_is_a_measurement():
    scan = LaserScan(ranges=[np.inf] * 4, angle_increment=0.1, range_max=5.0)
    assert len(points_from_scan(scan, False)) == 0
