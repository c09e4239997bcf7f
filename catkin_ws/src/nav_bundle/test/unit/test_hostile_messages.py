"""Random standard messages are used or refused by name: none ends a node, and no kernel sees what it cannot take."""

import math

import numpy as np
import pytest
from drawn_room import CHAMBER, enlarged
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan, PointCloud2, PointField

from nav_bundle.base.conversions import scan_from_message
from nav_bundle.base.error import NavigationError
from nav_bundle.base.pose import LARGEST, Pose
from nav_bundle.base.transform import Transform, fault_of
from nav_bundle.control.conversions import velocity_from_odometry
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.conversions import points_from_cloud, points_from_scan
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.localisation.config import AmclConfig
from nav_bundle.localisation.localisation import Localisation
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.mapping.slam import Slam
from nav_bundle.maps.conversions import grid_from_message

ROUNDS = 150
FLOATS = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.1,
    5.0,
    1e-38,
    -1e-30,
    1e4,
    1e5,
    -1e6,
    3e38,
    -3e38,
    math.inf,
    -math.inf,
    math.nan,
]
MODELS = ["likelihood_field", "likelihood_field_prob", "beam"]


def some(generator):
    """Returns a float that a message can hold: usual, extreme, or none at all."""
    return (
        float(generator.choice(FLOATS))
        if generator.random() < 0.5
        else float(generator.normal(0.0, 3.0))
    )


def scan_of(generator):
    """Returns a scan of which each field is usual or anything."""
    count = int(generator.choice([0, 1, 2, 60, 180]))
    usual = {
        "angle_min": -math.pi,
        "angle_increment": math.tau / 180,
        "range_min": 0.1,
        "range_max": 6.0,
    }
    scan = LaserScan(ranges=generator.uniform(0.1, 6.0, count))
    for name, value in usual.items():
        setattr(
            scan, name, value if generator.random() < 0.7 else float(np.float32(some(generator)))
        )
    for index in range(count):
        if generator.random() < 0.2:
            scan.ranges[index] = some(generator)
    return scan


def coordinate(generator):
    return float(generator.choice([0.0, 1.0, -5.0, 1e3, 5e5, 1e7, LARGEST, -LARGEST]))


def pose_of(generator, share):
    if generator.random() < share:
        return Pose(coordinate(generator), coordinate(generator), some_angle(generator))
    return Pose(*generator.uniform(-1.0, 1.0, 3).tolist())


def some_angle(generator):
    return float(generator.uniform(-math.pi, math.pi))


@pytest.mark.parametrize("model", MODELS)
def test_no_scan_ends_localisation_or_spoils_its_particles(model):
    generator = np.random.default_rng(12)
    config = AmclConfig(
        laser_model_type=model, min_particles=20, max_particles=60, laser_max_range=-1.0
    )
    localisation = Localisation(config, generator)
    localisation.set_map(enlarged(CHAMBER, 16))
    localisation.set_pose(Pose(1.5, 1.5), np.eye(3) * 0.1)
    odom = Pose()
    used = 0
    with np.errstate(all="ignore"):
        for _ in range(ROUNDS):
            odom = odom.compose(pose_of(generator, 0.02))
            try:
                localisation.advance(odom, scan_from_message(scan_of(generator), Transform()))
            except NavigationError:
                continue
            used += 1
            assert np.isfinite(localisation.particles).all()
    assert used > ROUNDS / 4


def test_no_scan_ends_mapping():
    generator = np.random.default_rng(13)
    used = 0
    for _ in range(6):
        slam = Slam(
            GmappingConfig(particles=2, linearUpdate=0.0, xmin=-5.0, ymin=-5.0, xmax=5.0, ymax=5.0),
            generator,
        )
        odom = pose_of(generator, 0.5)
        for step in range(8):
            odom = odom.compose(pose_of(generator, 0.1))
            try:
                used += slam.observe(
                    odom, scan_from_message(scan_of(generator), Transform()), float(step)
                )
            except NavigationError:
                continue
            assert np.isfinite(slam.poses).all()
            assert slam.grid().cells.size < 4.1e8
    assert used > 6


def test_a_scan_without_a_limit_of_range_is_mapped_by_its_returns():
    slam = Slam(GmappingConfig(particles=2), np.random.default_rng(1))
    scan = LaserScan(
        angle_min=-1.0, angle_increment=0.1, range_max=math.inf, ranges=[2.0, math.inf, 3.0]
    )
    assert slam.observe(Pose(), scan_from_message(scan, Transform()), 0.0)
    assert slam.maps.tiles < 100


@pytest.mark.parametrize("longest", [0.0, -1.0])
def test_a_scan_without_a_positive_range_is_refused(longest):
    with pytest.raises(NavigationError, match="range_max must be positive"):
        scan_from_message(LaserScan(ranges=[1.0], range_max=longest), Transform())


def cloud_of(generator):
    points = generator.normal(0.0, 2.0, (20, 3))
    for _ in range(10):
        points[generator.integers(20), generator.integers(3)] = generator.choice(
            [*FLOATS, 1e200, -1e308, 1e308]
        )
    fields = [
        PointField(name, 8 * number, PointField.FLOAT64, 1) for number, name in enumerate("xyz")
    ]
    return PointCloud2(None, 1, 20, fields, False, 24, 480, points.astype("<f8").tobytes(), False)


def test_no_scan_or_cloud_ends_a_costmap():
    generator = np.random.default_rng(14)
    parameters = {
        "rolling_window": True,
        "width": 3.0,
        "height": 3.0,
        "observation_sources": "laser",
        "laser": {"topic": "base_scan", "marking": True, "clearing": True},
    }
    costmap = Costmap(costmap_config_from_parameters(parameters, "test"))
    source = costmap.config.layers[0].sources[0]
    for _ in range(ROUNDS):
        pose = pose_of(generator, 0.2)
        try:
            points = points_from_scan(scan_of(generator), bool(generator.integers(2)))
        except NavigationError:
            points = points_from_cloud(cloud_of(generator))
        assert np.isfinite(points).all()
        place = np.ascontiguousarray(points[:, :2] + (pose.x, pose.y))
        costmap.update(pose, [Observation(source, pose.x, pose.y, place)])


def test_transforms_that_are_larger_than_any_place_on_earth_are_refused():
    generator = np.random.default_rng(15)
    for _ in range(ROUNDS):
        place = tuple(
            generator.choice(
                [0.0, 5e5, LARGEST, 1e9, 1e200, -1e308, math.inf, math.nan], 3
            ).tolist()
        )
        fault = fault_of("odom", "base_link", Transform(place))
        assert bool(fault) == (not all(abs(value) <= LARGEST for value in place))


def test_coordinates_of_a_map_projection_are_accepted():
    message = OccupancyGrid(data=[0])
    message.info.width = message.info.height = message.info.resolution = 1
    message.info.origin.position.x, message.info.origin.position.y = 500_000.0, 5_400_000.0
    message.info.origin.orientation.w = 1.0
    assert grid_from_message(message).origin == Pose(500_000.0, 5_400_000.0)


@pytest.mark.parametrize("resolution", [0.0, -1.0, 1e-30, math.nan])
def test_a_map_without_a_usable_resolution_is_refused(resolution):
    message = OccupancyGrid(data=[0])
    message.info.width = message.info.height = 1
    message.info.resolution = resolution
    with pytest.raises(NavigationError, match="resolution"):
        grid_from_message(message)


def test_a_speed_that_no_robot_has_is_refused():
    message = Odometry()
    message.twist.twist.linear.x = 1e5
    with pytest.raises(NavigationError, match=r"linear\.x"):
        velocity_from_odometry(message)


def test_negative_ranges_are_no_measurements_whatever_the_smallest_range() -> None:
    scan = LaserScan(range_min=-math.inf, range_max=5.0, ranges=[-math.inf, -1.0, 2.0])
    assert len(points_from_scan(scan, False)) == 1
    assert scan_from_message(scan, Transform()).range_min == 0.0


def test_particles_all_over_the_earth_end_nothing() -> None:
    localisation = Localisation(
        AmclConfig(max_particles=100, min_particles=50), np.random.default_rng(1)
    )
    localisation.set_map(enlarged(CHAMBER, 16))
    localisation.set_pose(Pose(), np.diag([1e15, 1e15, 10.0]))
    scan = LaserScan(angle_min=-1.0, angle_increment=0.1, range_max=5.0, ranges=[2.0] * 20)
    assert localisation.advance(Pose(), scan_from_message(scan, Transform())).estimate is not None
