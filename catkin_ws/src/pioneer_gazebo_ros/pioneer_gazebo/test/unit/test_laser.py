"""The ray caster agrees with the physics engine's rays and with the geometry of rooms."""

import math

import numpy as np
import pybullet
import pytest
from numpy.typing import NDArray

from pioneer_gazebo.laser.laser import Laser, Movers, WallIndex, laser_of_sonar
from pioneer_gazebo.laser.laser_kernel import Fan, Sensor
from pioneer_gazebo.noise import Noise
from pioneer_gazebo.world.model import Box, Cylinder, Mesh, Shape, Sphere
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.robot import LaserSensor, SonarSensor
from pioneer_gazebo.world.section import Section, section_of

HEIGHT = 0.3
REACH = 12.0


def no_mesh(mesh: Mesh) -> NDArray[np.float64]:
    raise AssertionError(f"no mesh is in this test: {mesh}")


def index(*placed: tuple[Shape, Pose]) -> WallIndex:
    return WallIndex(
        Section.joined(section_of(shape, pose, HEIGHT, no_mesh) for shape, pose in placed)
    )


def distances(
    walls: WallIndex, sensor: tuple[float, float, float], count: int = 360
) -> NDArray[np.float64]:
    out = np.empty(count)
    walls.cast(Sensor(*sensor), Fan(-math.pi, math.tau / count, REACH), out)
    return out


def random_shapes(seed: int) -> list[tuple[Shape, Pose]]:
    """Returns upright and tilted boxes, cylinders and spheres."""
    rng = np.random.default_rng(seed)
    placed: list[tuple[Shape, Pose]] = []
    for k in range(60):
        tilt = rng.uniform(-0.6, 0.6, 2) if k % 3 == 0 else (0.0, 0.0)
        pose = Pose.from_rpy(
            *rng.uniform(-9, 9, 2), rng.uniform(0.1, 0.5), *tilt, rng.uniform(-3, 3)
        )
        shape: Shape = Box(tuple(rng.uniform(0.2, 1.5, 3)))
        if k % 4 == 1:
            shape = Cylinder(rng.uniform(0.1, 0.5), rng.uniform(0.3, 1.0))
        if k % 4 == 2:
            shape = Sphere(rng.uniform(0.2, 0.5))
        placed.append((shape, pose))
    return placed


def bullet_body(client: int, shape: Shape, pose: Pose) -> None:
    match shape:
        case Box(size=size):
            made = pybullet.createCollisionShape(
                pybullet.GEOM_BOX, halfExtents=[s / 2 for s in size], physicsClientId=client
            )
        case Cylinder(radius=radius, length=length):
            made = pybullet.createCollisionShape(
                pybullet.GEOM_CYLINDER, radius=radius, height=length, physicsClientId=client
            )
        case Sphere(radius=radius):
            made = pybullet.createCollisionShape(
                pybullet.GEOM_SPHERE, radius=radius, physicsClientId=client
            )
    pybullet.createMultiBody(0, made, -1, pose.position, pose.rotation, physicsClientId=client)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_caster_agrees_with_the_engines_rays(seed: int) -> None:
    placed = random_shapes(seed)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        for shape, pose in placed:
            bullet_body(client, shape, pose)
        walls = index(*placed)
        rng = np.random.default_rng(seed)
        errors = []
        for _ in range(40):
            x, y, yaw = rng.uniform(-8, 8), rng.uniform(-8, 8), rng.uniform(-3, 3)
            ours = distances(walls, (x, y, yaw), 180)
            angles = yaw - math.pi + np.arange(180) * math.tau / 180
            ends = [(x + REACH * math.cos(a), y + REACH * math.sin(a), HEIGHT) for a in angles]
            hits = pybullet.rayTestBatch([(x, y, HEIGHT)] * 180, ends, physicsClientId=client)
            theirs = np.array([hit[2] for hit in hits]) * REACH
            corners = (x - 0.01, y - 0.01, HEIGHT - 0.01), (x + 0.01, y + 0.01, HEIGHT + 0.01)
            # The engine's rays do not hit a shape that they start in.
            if not pybullet.getOverlappingObjects(*corners, physicsClientId=client):
                errors.append(np.abs(ours - theirs))
        error = np.concatenate(errors)
        assert len(error) > 1000
        # A ray that grazes an edge may hit it in one and miss it in the other.
        assert np.mean(error < 0.01) > 0.99
        assert np.median(error) < 0.0005
    finally:
        pybullet.disconnect(client)


def test_distances_in_a_square_room_are_those_of_geometry() -> None:
    walls = index(
        (Box((0.2, 10.2, 1.0)), Pose.from_rpy(5.1, 0, 0.5)),
        (Box((0.2, 10.2, 1.0)), Pose.from_rpy(-5.1, 0, 0.5)),
        (Box((10.2, 0.2, 1.0)), Pose.from_rpy(0, 5.1, 0.5)),
        (Box((10.2, 0.2, 1.0)), Pose.from_rpy(0, -5.1, 0.5)),
    )
    x, y, yaw = 1.25, -2.0, 0.7
    angles = yaw - math.pi + np.arange(360) * math.tau / 360
    with np.errstate(divide="ignore"):
        expected = np.minimum(
            np.where(np.cos(angles) > 0, (5 - x) / np.cos(angles), (-5 - x) / np.cos(angles)),
            np.where(np.sin(angles) > 0, (5 - y) / np.sin(angles), (-5 - y) / np.sin(angles)),
        )
    np.testing.assert_allclose(distances(walls, (x, y, yaw)), expected, atol=1e-9)


def test_what_lies_above_or_below_the_plane_is_not_seen() -> None:
    walls = index(
        (Box((1, 1, 0.2)), Pose.from_rpy(2, 0, 0.1)), (Box((1, 1, 1)), Pose.from_rpy(2, 0, 2))
    )
    assert (distances(walls, (0, 0, 0)) == REACH).all()


def test_a_sensor_outside_the_grid_sees_into_it() -> None:
    walls = index((Box((1, 1, 1)), Pose.from_rpy(0, 0, 0.3)))
    assert distances(walls, (-8.0, 0.0, 0.0))[180] == pytest.approx(7.5)
    assert distances(walls, (-8.0, 0.0, 0.0))[0] == REACH


@pytest.mark.parametrize("first", [-math.pi, -math.pi / 2, 0.0, 2.5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_mover_is_seen_exactly_as_a_wall_at_its_place_is(first: float, sign: float) -> None:
    outline = section_of(Box((0.5, 0.3, 1.0)), Pose.from_rpy(0.1, 0, 0.3), HEIGHT, no_mesh).segments
    movers = Movers([outline, outline])
    rng = np.random.default_rng(4)
    empty = WallIndex(Section.joined([]))
    for _ in range(50):
        pose = Pose.from_rpy(*rng.uniform(-4, 4, 2), 0, 0, 0, rng.uniform(-3, 3))
        sensor = Sensor(*rng.uniform(-1, 1, 2), rng.uniform(-3, 3))
        poses = np.array([[*sensor], [*pose.position[:2], pose.yaw]])
        by_wall, by_mover = np.empty(180), np.empty(180)
        fan = Fan(first, sign * math.tau / 200, REACH)
        index((Box((0.5, 0.3, 1.0)), pose.compose(Pose.from_rpy(0.1, 0, 0.3)))).cast(
            sensor, fan, by_wall
        )
        empty.cast(sensor, fan, by_mover)
        movers.shorten(poses, 0, sensor, fan, by_mover)
        np.testing.assert_allclose(by_mover, by_wall, atol=1e-9)


def test_the_carrier_does_not_see_itself() -> None:
    outline = section_of(Box((0.5, 0.3, 1.0)), Pose.from_rpy(0, 0, 0.3), HEIGHT, no_mesh).segments
    out = np.full(180, REACH)
    Movers([outline]).shorten(
        np.zeros((1, 3)), 0, Sensor(0.0, 0.0, 0.0), Fan(-1.5, 0.01, REACH), out
    )
    assert (out == REACH).all()


def test_noise_has_the_asked_mean_and_deviation_and_depends_on_seed_and_names_only() -> None:
    config = LaserSensor("laser", "link", samples=20_000, noise_mean=0.01, noise_stddev=0.02)
    true = np.full(20_000, 5.0)
    first = Laser(config, Noise(7, "pioneer1", "laser")).measured(true.copy(), 60)
    again = Laser(config, Noise(7, "pioneer1", "laser")).measured(true.copy(), 60)
    assert (first == again).all()
    for noise in (Noise(7, "pioneer2", "laser"), Noise(8, "pioneer1", "laser")):
        assert (first != Laser(config, noise).measured(true.copy(), 60)).all()
    assert np.mean(first - 5.0) == pytest.approx(0.01, abs=4 * 0.02 / math.sqrt(20_000))
    assert np.std(first - 5.0) == pytest.approx(0.02, rel=0.03)


def test_nothing_met_is_plus_infinity_and_too_near_is_minus_infinity() -> None:
    laser = Laser(LaserSensor("laser", "link", samples=3, min_range=0.1, max_range=8.0), Noise(0))
    assert laser.measured(np.array([0.05, 3.0, 8.0]), 0).tolist() == [-math.inf, 3.0, math.inf]


@pytest.mark.parametrize("beams", [1, 2, 5, 15])
def test_a_sonars_noise_is_unbiased_however_many_beams_it_has(beams: int) -> None:
    config = SonarSensor("s", "l", samples=beams, gaussianNoise=0.05)
    sonar = Laser(laser_of_sonar(config), Noise(3, "r", "s"))
    true = np.full(beams, 2.0)
    readings = np.array([sonar.nearest(true, tick) for tick in range(20_000)])
    assert np.mean(readings) == pytest.approx(2.0, abs=4 * 0.05 / math.sqrt(20_000))
    assert np.std(readings) == pytest.approx(0.05, rel=0.03)


def test_a_sonar_reads_its_limits_beyond_them() -> None:
    sonar = Laser(laser_of_sonar(SonarSensor("s", "l", gaussianNoise=0.5)), Noise(0))
    for tick in range(50):
        assert sonar.nearest(np.full(5, 5.0), tick) == 5.0
        assert sonar.nearest(np.full(5, 0.05), tick) == 0.1


@pytest.mark.parametrize(("low", "high"), [(-1.0, 1.0), (-0.3, 0.9), (0.0, 3.0)])
def test_a_laser_with_one_beam_looks_at_the_middle(low: float, high: float) -> None:
    config = LaserSensor("laser", "link", samples=1, min_angle=low, max_angle=high, max_range=30.0)
    laser = Laser(config, Noise(0))
    middle = (low + high) / 2
    assert (laser.first, laser.last, laser.increment) == (middle, middle, 0.0)
    post = Pose.from_rpy(4.0 * math.cos(middle), 4.0 * math.sin(middle), HEIGHT)
    walls = index((Cylinder(0.1, 2.0), post))
    [distance] = laser.distances(walls, Movers([]), np.empty((0, 3)), -1, Sensor(0.0, 0.0, 0.0))
    assert distance == pytest.approx(3.9)


def test_no_beam_passes_between_two_segments_that_share_a_vertex() -> None:
    rng = np.random.default_rng(5)
    passed = 0
    for _ in range(60):
        # A closed polygon about the sensor, with random vertices.
        angles = np.sort(rng.uniform(-math.pi, math.pi, 40))
        radii = rng.uniform(1.0, 9.0, 40)
        corners = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
        shift = rng.uniform(-5.0, 5.0, 2)
        ends = corners + shift
        following = np.roll(ends, -1, axis=0)
        segments = np.column_stack([ends, following - ends])
        walls = WallIndex(Section(segments, np.empty((0, 3))))
        outline = Movers([segments])
        out = np.empty(1)
        for angle, radius in zip(angles, radii, strict=True):
            fan = Fan(float(angle), 0.0, 30.0)
            walls.cast(Sensor(*shift, 0.0), fan, out)
            passed += out[0] > radius + 1e-6
            out[0] = 30.0
            outline.shorten(np.zeros((1, 3)), -1, Sensor(*shift, 0.0), fan, out)
            passed += out[0] > radius + 1e-6
    assert passed == 0


def test_a_beam_along_a_wall_sees_no_nearer_than_its_end() -> None:
    rng = np.random.default_rng(6)
    out = np.empty(1)
    for _ in range(500):
        yaw = rng.uniform(-math.pi, math.pi)
        sensor = Sensor(*rng.uniform(-3.0, 3.0, 2), yaw)
        ahead = np.array([math.cos(yaw), math.sin(yaw)])
        near, length = rng.uniform(0.5, 4.0, 2)
        start = np.array([sensor.x, sensor.y]) + near * ahead
        end = start + length * ahead
        if rng.random() < 0.5:
            start, end = end, start
        segments = np.array([[*start, *(end - start)]])
        WallIndex(Section(segments, np.empty((0, 3)))).cast(sensor, Fan(0.0, 0.0, 30.0), out)
        assert out[0] == 30.0 or near - 1e-6 <= out[0] <= near + length + 1e-6
