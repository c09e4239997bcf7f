"""Accuracy of the simulated robot: trials without ROS, and rows of their errors beside the bounds.

The bench prints these rows; a test checks them.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pioneer_bench.core.row import Row
from pioneer_gazebo.simulation.entity import Entity
from pioneer_gazebo.simulation.schedule import TICK_RATE
from pioneer_gazebo.simulation.simulation import Simulation
from pioneer_gazebo.world.model import Box, Collision, Cylinder, Link, Model, Plane
from pioneer_gazebo.world.pose import Pose, heading
from pioneer_gazebo.world.robot import Robot

MakeSimulation = Callable[[list[Model]], Simulation]
"""Creates a simulation of these models."""

FULL_SPEED = 1.2
"""The Pioneer's maximum speed [m/s]."""

HEADINGS = (0.0, 0.4, math.pi / 4, 2.5)
"""Start headings of every motion [rad]; the worst result counts."""

PLACE_BOUND, PLACE_BOUND_PER_WAY = 0.005, 0.003
"""Largest position error at the end of a run: a constant [m], plus this fraction of the path length."""

HEADING_BOUND = 0.015
"""Largest heading error at the end of a run [rad]."""


@dataclass(frozen=True, slots=True)
class Leg:
    """A constant command: duration [s], speed [m/s] and turn rate [rad/s]."""

    seconds: float
    speed: float
    turn: float

    @property
    def motion(self) -> Pose:
        """The resulting motion; the ramp at the start is made up for by the one at the end."""
        angle = self.turn * self.seconds
        if self.turn == 0.0:
            return Pose((self.speed * self.seconds, 0.0, 0.0))
        radius = self.speed / self.turn
        return Pose.from_rpy(radius * math.sin(angle), radius * (1.0 - math.cos(angle)), yaw=angle)


_STOP = Leg(1.0, 0.0, 0.0)
_SIDE = (Leg(2.0, 1.0, 0.0), _STOP, Leg(1.6, 0.0, math.pi / 3.2), _STOP)

MOTIONS: dict[str, tuple[Leg, ...]] = {
    "straight, 6 m at 1.2 m/s": (Leg(5.0, FULL_SPEED, 0.0),),
    "back, 2.5 m at 0.5 m/s": (Leg(5.0, -0.5, 0.0),),
    "spin, 10 rad at 2 rad/s": (Leg(5.0, 0.0, 2.0),),
    "arc, 6 m with a radius of 1 m": (Leg(12.0, 0.5, 0.5),),
    "arc, 1.8 m with a radius of 0.3 m": (Leg(6.0, 0.3, -1.0),),
    "square, 2 m a side": _SIDE * 4,
}


def floor() -> Model:
    """Returns the ground."""
    return Model(
        "floor",
        static=True,
        links=(Link("link", collisions=(Collision("collision", Pose(), Plane()),)),),
    )


def standing(name: str, pose: Pose, shape: Box | Cylinder) -> Model:
    """Returns a static model of one shape."""
    return Model(
        name, pose, True, (Link("link", collisions=(Collision("collision", Pose(), shape),)),)
    )


def accuracy_rows(make: MakeSimulation, robot: Robot) -> Iterator[Row]:
    """Yields the rows of all trials."""
    for name, legs in MOTIONS.items():
        yield from motion_rows(make, robot, name, legs)
    yield from wall_rows(make, robot)
    yield from standstill_rows(make, robot)
    yield from laser_rows(make, robot)


def _run(simulation: Simulation, seconds: float) -> None:
    simulation.advance(simulation.tick + round(seconds * TICK_RATE))


def _placed(simulation: Simulation, robot: Robot, pose: Pose) -> Entity:
    entity = simulation.add_robot("robot", "robot", robot, pose)
    _run(simulation, 1.0)
    return entity


def _drive(simulation: Simulation, entity: Entity, leg: Leg) -> None:
    entity.drives[0].command(simulation.moment, leg.speed, leg.turn)
    _run(simulation, leg.seconds)


def _believed(simulation: Simulation, entity: Entity) -> Pose:
    odometry = simulation.odometry(entity.drives[0])
    return Pose.from_rpy(odometry.x, odometry.y, yaw=odometry.yaw)


def _gap(a: Pose, b: Pose) -> tuple[float, float]:
    """Returns distance [m] and heading difference [rad] of two poses in the plane."""
    return math.dist(a.position[:2], b.position[:2]), abs(math.remainder(a.yaw - b.yaw, math.tau))


def motion_rows(
    make: MakeSimulation, robot: Robot, name: str, legs: tuple[Leg, ...]
) -> Iterator[Row]:
    """Yields the errors of the true motion against the command, and of the odometry against the truth."""
    trues, believeds = [], []
    for yaw in HEADINGS:
        simulation = make([])
        entity = _placed(simulation, robot, Pose.from_rpy(yaw=yaw))
        start, begin, commanded = simulation.pose(entity), _believed(simulation, entity), Pose()
        for leg in (*legs, _STOP):
            _drive(simulation, entity, leg)
            commanded = commanded.compose(leg.motion)
        true = start.inverse().compose(simulation.pose(entity))
        trues.append(_gap(commanded, true))
        believeds.append(_gap(begin.inverse().compose(_believed(simulation, entity)), true))
    bound = PLACE_BOUND + PLACE_BOUND_PER_WAY * sum(abs(leg.speed) * leg.seconds for leg in legs)
    for what, gaps in (("truth from command", trues), ("odometry from truth", believeds)):
        yield _worst(f"{name}: {what}", "mm", [1e3 * place for place, _ in gaps], 1e3 * bound)
        yield _worst(
            f"{name}: {what}", "mrad", [1e3 * turned for _, turned in gaps], 1e3 * HEADING_BOUND
        )


def _worst(what: str, unit: str, samples: list[float], bound: float) -> Row:
    return Row(what, unit, (max(samples),), bound)


def wall_rows(make: MakeSimulation, robot: Robot) -> Iterator[Row]:
    """Yields what happens when the robot drives into a wall 10 cm thick at full speed and keeps pushing.

    The depth is bounded by the distance that the robot drives in one step of the engine.
    """
    for name, yaw in (
        ("ahead", 0.0),
        ("at 30°", math.pi / 6),
        ("at 60°", math.pi / 3),
        ("backwards", math.pi),
    ):
        simulation = make([standing("wall", Pose((2.0, 0.0, 0.5)), Box((0.1, 20.0, 1.0)))])
        entity = _placed(simulation, robot, Pose.from_rpy(yaw=yaw))
        height = simulation.pose(entity).position[2]
        entity.drives[0].command(simulation.moment, math.copysign(FULL_SPEED, math.cos(yaw)), 0.0)
        depths, rises, ways = [0.0], [0.0], [0.0]
        for _ in range(300):
            _run(simulation, simulation.physics.step)
            x, _, z = simulation.pose(entity).position
            depths += [contact.depth for contact in simulation.contacts(entity)]
            rises.append(z - height)
            ways.append(x)
        assert entity.collisions.count, "the run was to meet the wall"
        step = FULL_SPEED * simulation.physics.step
        yield _worst(
            f"wall {name} at {FULL_SPEED} m/s: depth in it",
            "mm",
            [1e3 * depth for depth in depths],
            1e3 * step,
        )
        yield _worst(f"wall {name}: rise", "mm", [1e3 * rise for rise in rises], 5.0)
        yield _worst(f"wall {name}: farthest centre, wall at 1.95", "m", ways, 1.95)


def standstill_rows(make: MakeSimulation, robot: Robot) -> Iterator[Row]:
    """Yields the drift of a robot in thirty seconds, beginning two seconds after its stop command."""
    simulation = make([])
    entity = _placed(simulation, robot, Pose())
    _drive(simulation, entity, Leg(5.0, 0.5, 0.5))
    _drive(simulation, entity, Leg(2.0, 0.0, 0.0))
    before = simulation.pose(entity)
    _run(simulation, 30.0)
    place, turned = _gap(before, simulation.pose(entity))
    yield Row("standstill, 30 s: drift", "mm", (1e3 * place,), 1.0)
    yield Row("standstill, 30 s: drift", "mrad", (1e3 * turned,), 1.0)


ROOM = (5.0, 4.0)
"""Half of the room's length and width [m]."""

PILLAR = (2.5, 1.0, 0.4)
"""x, y and radius of the pillar [m]."""


def _room() -> list[Model]:
    (x, y), height = ROOM, Pose((0.0, 0.0, 0.5))
    walls = [((x + 0.1, 0.0), (0.2, 2 * y, 1.0)), ((-x - 0.1, 0.0), (0.2, 2 * y, 1.0))]
    walls += [((0.0, y + 0.1), (2 * x + 0.4, 0.2, 1.0)), ((0.0, -y - 0.1), (2 * x + 0.4, 0.2, 1.0))]
    models = [
        standing(f"wall {k}", Pose((*at, 0.0)).compose(height), Box(size))
        for k, (at, size) in enumerate(walls)
    ]
    return [
        *models,
        standing("pillar", Pose((*PILLAR[:2], 0.0)).compose(height), Cylinder(PILLAR[2], 1.0)),
    ]


MOST_STRAY = 0.5
"""Largest share of beams that are far from their distance [%]: those along the pillar's rim may miss it."""


def expected_ranges(x: float, y: float, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the exact distances [m] from a point in the room along ``angles`` [rad]."""
    dx, dy = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_walls = np.minimum(
            (np.copysign(ROOM[0], dx) - x) / dx, (np.copysign(ROOM[1], dy) - y) / dy
        )
        ahead = (PILLAR[0] - x) * dx + (PILLAR[1] - y) * dy
        beside = (PILLAR[0] - x) ** 2 + (PILLAR[1] - y) ** 2 - ahead**2
        to_pillar = np.where(
            (ahead > 0) & (beside < PILLAR[2] ** 2),
            ahead - np.sqrt(PILLAR[2] ** 2 - beside),
            np.inf,
        )
    return np.minimum(to_walls, to_pillar)


def laser_rows(make: MakeSimulation, robot: Robot) -> Iterator[Row]:
    """Yields the errors of noise-free scans against geometry, and of the noise against its parameters."""
    laser = replace(robot.lasers[0], samples=720, min_angle=-3.1, max_angle=3.1, max_range=12.0)
    silent, noisy = (
        replace(robot, devices=(*robot.drives, replace(laser, noise_stddev=noise)))
        for noise in (0.0, 0.02)
    )
    errors = []
    for x, y, yaw in ((0.0, 0.0, 0.0), (-3.0, 2.0, 0.7), (3.5, -2.5, 2.0), (0.5, 1.5, -2.5)):
        simulation = make(_room())
        ranges, expected = _scan(
            simulation, _placed(simulation, silent, Pose.from_rpy(x, y, yaw=yaw))
        )
        errors.append(np.abs(ranges - expected))
    every = np.concatenate(errors)
    every[~np.isfinite(every)] = laser.max_range
    yield Row("laser, room with a pillar: mean error", "mm", (1e3 * float(every.mean()),), 0.5)
    yield Row(
        "laser, room with a pillar: 99 of 100 beams within",
        "mm",
        (1e3 * float(np.quantile(every, 0.99)),),
        1.0,
    )
    simulation = make(_room())
    entity = _placed(simulation, noisy, Pose())
    scans = []
    for _ in range(100):
        # Two scans at one time have the same noise.
        simulation.advance(simulation.tick + 1)
        ranges, expected = _scan(simulation, entity)
        scans.append(ranges - expected)
    noise = np.concatenate(scans)
    near = np.abs(noise) < 0.2  # false also for beams without a number
    yield Row(
        "laser noise of 20 mm: beams off by more than 0.2 m",
        "%",
        (100.0 * float(1.0 - near.mean()),),
        MOST_STRAY,
    )
    if not near.any():
        return
    noise = noise[near]
    yield Row("laser noise of 20 mm: mean", "mm", (1e3 * abs(float(noise.mean())),), 0.5)
    yield Row(
        "laser noise of 20 mm: deviation off by", "mm", (1e3 * abs(float(noise.std()) - 0.02),), 0.2
    )


def _scan(
    simulation: Simulation, entity: Entity
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ranges of a scan [m], and the exact ones from its laser's position [m]."""
    mounted = entity.lasers[0]
    sensor = simulation.pose(entity).compose(mounted.pose)
    config = mounted.laser.config
    angles = heading(sensor.rotation) + np.linspace(
        config.min_angle, config.max_angle, config.samples
    )
    expected = expected_ranges(*sensor.position[:2], angles)
    return simulation.ranges(entity, mounted).copy(), expected
