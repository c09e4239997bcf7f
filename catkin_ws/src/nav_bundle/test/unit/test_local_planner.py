"""The local planners drive a kinematic robot through drawn worlds without touching anything."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from drawn_room import grid_from_text

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import STANDSTILL, Velocity
from nav_bundle.control.clearance import Clearance
from nav_bundle.control.dwa_config import DwaConfig, dwa_config_from_parameters
from nav_bundle.control.dwa_planner import DwaPlanner, DynamicWindow
from nav_bundle.control.dynamic_window_kernel import Nose
from nav_bundle.control.local_planner import Decision, LocalPlannerError, Situation
from nav_bundle.control.rollout import Rollout
from nav_bundle.control.trajectory_config import trajectory_config_from_parameters
from nav_bundle.control.trajectory_kernel import Horizon, Scales
from nav_bundle.control.trajectory_planner import TrajectoryPlanner
from nav_bundle.costmap.config import costmap_config_from_parameters
from nav_bundle.costmap.cost import LETHAL
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.footprint import Footprint
from nav_bundle.costmap.layer import Observation
from nav_bundle.maps.grid import OCCUPIED, Grid
from nav_bundle.move_base.config import Care
from nav_bundle.planning.navfn import MEETING_DISTANCE, NavfnConfig, NavfnPlanner
from nav_bundle.planning.planner import path_between
from pioneer_node.core.parameter import ParameterError

RESOLUTION = 0.05
PERIOD = 0.05
BODY = np.array([[0.20, 0.20], [0.20, -0.20], [-0.30, -0.20], [-0.30, 0.20]])
SENSING = {
    "footprint": BODY.tolist(),
    "observation_sources": "laser",
    "laser": {"topic": "base_scan", "marking": True, "clearing": True},
    "obstacle_range": 2.0,
    "raytrace_range": 3.0,
    "cost_scaling_factor": 5.0,
}
GLOBAL = costmap_config_from_parameters(
    {**SENSING, "static_map": True, "inflation_radius": 1.5}, "global"
)
WINDOW = {
    "rolling_window": True,
    "width": 3.0,
    "height": 3.0,
    "inflation_radius": 2.0,
    "global_frame": "odom",
}
LOCAL = costmap_config_from_parameters({**SENSING, **WINDOW}, "local")
PARAMETERS = {
    "max_vel_x": 1.0,
    "min_vel_x": 0.0,
    "escape_vel": -0.2,
    "xy_goal_tolerance": 0.25,
    "yaw_goal_tolerance": 3.15,
    "holonomic_robot": False,
    "meter_scoring": True,
    "pdist_scale": 0.8,
    "gdist_scale": 1.0,
}


def config_of(**parameters):
    return trajectory_config_from_parameters(
        {**PARAMETERS, **parameters}, "TrajectoryPlannerROS", 1.0 / PERIOD
    )


SHIPPED = Path(__file__).parents[3] / "pioneer_2dnav" / "config" / "dwa_local_planner_params.yaml"
DWA_PARAMETERS = yaml.safe_load(SHIPPED.read_text())["DWAPlannerROS"]


def dwa_config_of(**parameters):
    return dwa_config_from_parameters(
        {**DWA_PARAMETERS, **parameters}, "DWAPlannerROS", 1.0 / PERIOD
    )


def heading_config_of(**parameters):
    return config_of(heading_scoring=True, heading_scoring_timestep=0.8, **parameters)


@pytest.fixture(
    params=[config_of, heading_config_of, dwa_config_of], ids=["rollout", "headings", "dwa"]
)
def configure(request):
    """Returns each local planner's configuration factory in turn; the contract tests below apply to all of them."""
    return request.param


# Minimum distance between the centres of two passing robots [m]. DWA passes closer in a corridor, without contact.
NEAREST = {config_of: 0.6, dwa_config_of: 0.55}


def world_of(rows, scale):
    """Returns the grid of a drawing whose symbols are ``scale`` [m] wide."""
    cells = round(scale / RESOLUTION)
    return grid_from_text(
        ["".join(symbol * cells for symbol in row) for row in rows for _ in range(cells)],
        RESOLUTION,
    )


class World:
    """A drawn map with a robot in it, and optionally another moving body."""

    def __init__(self, grid: Grid, pose: Pose, config=None):
        self.grid, self.pose, self.velocity = grid, pose, Velocity()
        self.local, self.map = Costmap(LOCAL), Costmap(GLOBAL)
        self.map.set_map(grid)
        config = config or config_of()
        kind = DwaPlanner if isinstance(config, DwaConfig) else TrajectoryPlanner
        self.planner = kind(config, RESOLUTION)
        self.other = None
        self.unmapped = np.empty((0, 2))
        self.time = 0.0
        self.way = 0.0

    def solid(self):
        cells = self.grid.cells == OCCUPIED
        if self.other is not None:
            rows, cols = np.mgrid[: cells.shape[0], : cells.shape[1]]
            near = (
                np.hypot(
                    (cols + 0.5) * RESOLUTION - self.other.x,
                    (rows + 0.5) * RESOLUTION - self.other.y,
                )
                < 0.25
            )
            cells = cells | near
        return cells

    def scan(self, beams=180):
        angles = self.pose.yaw + np.arange(beams) * math.tau / beams
        along = np.arange(0.0, 6.0, RESOLUTION / 2)
        x = self.pose.x + np.outer(np.cos(angles), along)
        y = self.pose.y + np.outer(np.sin(angles), along)
        solid = self.solid()
        rows = np.clip((y / RESOLUTION).astype(int), 0, solid.shape[0] - 1)
        cols = np.clip((x / RESOLUTION).astype(int), 0, solid.shape[1] - 1)
        hits = solid[rows, cols]
        beam = np.flatnonzero(hits.any(axis=1))
        first = hits[beam].argmax(axis=1)
        return np.ascontiguousarray(np.stack([x[beam, first], y[beam, first]], axis=1))

    def look(self):
        points = self.scan()
        for costmap in (self.local, self.map):
            source = costmap.config.layers[-2].sources[0]
            costmap.update(self.pose, [Observation(source, self.pose.x, self.pose.y, points)])

    def decide(self):
        fastest = Care().speed(self.unmapped, self.pose)
        return self.planner.decide(Situation(self.local, self.pose, self.velocity, Pose(), fastest))

    def move(self, command):
        forward = np.clip(command.x - self.velocity.x, -2.5 * PERIOD, 2.5 * PERIOD)
        turn = np.clip(command.turn - self.velocity.turn, -3.2 * PERIOD, 3.2 * PERIOD)
        self.velocity = Velocity(
            self.velocity.x + float(forward), 0.0, self.velocity.turn + float(turn)
        )
        x, y = self.pose.apply(self.velocity.x * PERIOD, 0.0)
        self.pose = Pose(x, y, self.pose.yaw + self.velocity.turn * PERIOD)
        self.way += abs(self.velocity.x) * PERIOD
        self.time += PERIOD

    def touches(self):
        outline = Footprint(BODY).outline(self.pose)
        fractions = np.linspace(0.0, 1.0, 12)[:, None, None]
        points = (outline + fractions * (np.roll(outline, -1, axis=0) - outline)).reshape(-1, 2)
        rows, cols = (
            (points[:, 1] / RESOLUTION).astype(int),
            (points[:, 0] / RESOLUTION).astype(int),
        )
        return bool(self.solid()[rows, cols].any())

    def cycles(self, goal, seconds):
        """Drives to the goal, one control cycle (20 Hz) per step; senses at 5 Hz and plans at 0.5 Hz."""
        navfn, planned = NavfnPlanner(NavfnConfig()), -40
        for cycle in range(round(seconds / PERIOD)):
            if cycle % 4 == 0:
                self.look()
                self.unmapped = self.map.unmapped(self.pose, MEETING_DISTANCE)
            if cycle - planned >= (10 if len(self.unmapped) else 40):
                planned = cycle
                self.planner.set_plan(path_between(navfn, self.map, self.pose, goal))
            try:
                decision = self.decide()
            except LocalPlannerError:
                decision, planned = Decision(), -40
            if decision.reached:
                return
            self.move(decision.velocity)
            assert not self.touches(), f"touched something at {self.time:.1f} s, {self.pose}"
            yield
        pytest.fail(f"not at {goal} after {seconds} s but at {self.pose}")

    def drive(self, goal, seconds=60.0):
        for _ in self.cycles(goal, seconds):
            pass


CORRIDOR = ["##########", "#........#", "##########"]
BEND = ["#####....", "....#....", "###.#####", "..#.....#", "..#####.#", "......#.#", "......###"]
HALL = ["#" * 16, *["#" + "." * 14 + "#"] * 6, "#" * 16]
DOORWAY = [
    "#" * 16,
    *["#......##......#"] * 2,
    "#" + "." * 14 + "#",
    *["#......##......#"] * 2,
    "#" * 16,
]


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_it_drives_along_a_corridor_whatever_way_it_faces(configure, heading):
    world = World(world_of(CORRIDOR, 1.6), Pose(2.6, 2.4, heading), configure())
    world.drive(Pose(12.0, 2.4))
    assert world.time < 9.4 / 0.5


def test_it_turns_around_in_a_corridor(configure):
    world = World(world_of(CORRIDOR, 1.6), Pose(2.6, 2.4), configure())
    world.drive(Pose(8.0, 2.4))
    world.drive(Pose(2.6, 2.4))
    assert world.time < 2 * 5.4 / 0.4


def test_it_goes_through_a_doorway(configure):
    world = World(world_of(DOORWAY, 0.8), Pose(1.8, 4.0, 2.0), configure())
    world.drive(Pose(10.8, 1.4))


def test_it_takes_the_corners_of_a_narrow_bend(configure):
    world = World(world_of(BEND, 1.6), Pose(5.6, 8.8, -math.pi / 2), configure())
    world.drive(Pose(12.0, 4.0))


@pytest.mark.parametrize(
    ("drawing", "scale", "first_y", "second_y"),
    [
        (HALL, 0.8, 3.2, 3.2),
        (HALL, 0.8, 3.4, 3.0),
        (HALL, 0.8, 2.8, 3.6),
        (CORRIDOR, 1.6, 2.4, 2.4),
    ],
    ids=["head-on", "on the left", "on the right", "in a corridor of 1.6 m"],
)
@pytest.mark.parametrize("configure", NEAREST, ids=["rollout", "dwa"])
def test_two_robots_pass_each_other(configure, drawing, scale, first_y, second_y):
    grid = world_of(drawing, scale)
    first = World(grid, Pose(2.6, first_y), configure())
    second = World(grid, Pose(11.2, second_y, math.pi), configure())
    drives = [first.cycles(Pose(11.0, first_y), 60.0), second.cycles(Pose(2.8, second_y), 60.0)]
    while drives:
        first.other, second.other = second.pose, first.pose
        drives = [drive for drive in drives if next(drive, "at the goal") is None]
        assert first.pose.distance(second.pose) > NEAREST[configure]
    assert max(first.time, second.time) < 25.0


def test_no_command_leads_into_what_the_costmap_calls_lethal(configure):
    generator = np.random.default_rng(4)
    rows = [
        "".join("#" if generator.random() < 0.06 else "." for _ in range(24)) for _ in range(24)
    ]
    grid = world_of(rows, 0.3)
    for _ in range(60):
        x, y, yaw = (float(value) for value in generator.uniform((1.5, 1.5, -3.0), (5.5, 5.5, 3.0)))
        world = World(grid, Pose(x, y, yaw), configure())
        world.velocity = Velocity(
            float(generator.uniform(0.0, 0.5)), 0.0, float(generator.uniform(-0.5, 0.5))
        )
        world.look()
        gx, gy = generator.uniform(-1.0, 1.0, 2)
        track = np.linspace((x, y, 0.0), (x + gx, y + gy, 0.0), 30)
        world.planner.set_plan(np.ascontiguousarray(track))
        try:
            decision = world.decide()
        except LocalPlannerError:
            continue
        for px, py, pyaw in decision.local_plan.tolist():
            assert world.local.footprint_cost(Pose(px, py, pyaw)) >= 0


def test_a_walled_in_robot_is_reported(configure):
    world = World(world_of(HALL, 0.8), Pose(6.0, 3.2), configure())
    world.look()
    world.local.cells[:, :] = LETHAL
    world.planner.set_plan(np.array([[6.0, 3.2, 0.0], [7.0, 3.2, 0.0]]))
    with pytest.raises(LocalPlannerError, match=r"collision|obstacle"):
        world.decide()


def test_with_a_wall_in_front_it_backs_up():
    world = World(world_of(HALL, 0.8), Pose(6.0, 3.2), config_of(min_vel_x=0.1))
    world.look()
    place = world.local.geometry
    row, col = place.row_of(3.2), place.col_of(6.0)
    world.local.cells[row - 8 : row + 9, col + 5] = LETHAL
    world.local.cells[row - 6, col - 8 : col + 5] = LETHAL
    world.local.cells[row + 6, col - 8 : col + 5] = LETHAL
    world.planner.set_plan(np.array([[6.0, 3.2, 0.0], [7.0, 3.2, 0.0]]))
    assert world.decide().velocity == Velocity(-0.2)


@pytest.mark.parametrize(
    ("gap", "beside", "heading"), [(0.30, 0.4, 0.0), (0.35, 0.25, 0.0), (0.35, 0.4, 0.3)]
)
def test_out_of_a_dead_end_it_takes_another_way(gap, beside, heading):
    """With the goal behind a thin wall, the cheapest trajectory used to lead into the wall again and again."""
    cells = np.zeros((140, 160), np.int8)
    cells[:75, 79:81] = OCCUPIED
    world = World(
        Grid(RESOLUTION, Pose(), cells), Pose(3.95 - gap, 3.75 - beside, heading), config_of()
    )
    world.drive(Pose(6.5, 1.5), 20.0)


def tilted_passage(tilt):
    """Returns a 1.2 m wide passage into a room, rotated against the cells so that its walls are stepped."""
    row, col = np.mgrid[:160, :160]
    x, y = ((index + 0.5) * RESOLUTION - 4.0 for index in (col, row))
    along, across = x * math.cos(tilt) + y * math.sin(tilt), y * math.cos(tilt) - x * math.sin(tilt)
    cells = np.where(((np.abs(across) > 0.6) & (along > -0.5)) | (along > 3.6), OCCUPIED, 0).astype(
        np.int8
    )
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = OCCUPIED
    return Grid(RESOLUTION, Pose(), cells)


@pytest.mark.parametrize(
    ("tilt", "gap", "into"),
    [(0.08, 0.255, 0.1), (0.08, 0.265, 0.2), (0.15, 0.265, 0.2), (0.15, 0.28, 0.2)],
)
def test_a_robot_close_beside_a_wall_gets_away_from_it(tilt, gap, into):
    """It used to back up 10 cm and return to the same place forever, or found no way back that was free for 1.7 s."""
    passage = Pose(4.0, 4.0, tilt)
    world = World(
        tilted_passage(tilt), passage.compose(Pose(2.3, 0.6 - gap, math.pi - into)), config_of()
    )
    world.drive(passage.compose(Pose(-2.5, 0.0)), 60.0)


def test_near_the_goal_it_stops_turns_and_has_reached_it(configure):
    world = World(world_of(HALL, 0.8), Pose(4.0, 3.2), configure(yaw_goal_tolerance=0.1))
    world.velocity = Velocity(0.5)
    world.look()
    world.planner.set_plan(np.array([[4.0, 3.2, 0.0], [4.1, 3.2, 2.0]]))
    assert world.decide().velocity == Velocity(0.5 - 2.5 * PERIOD)
    world.velocity = Velocity()
    assert world.decide().velocity.turn >= 0.16
    world.pose = Pose(4.0, 3.2, 1.95)
    assert world.decide().reached
    assert world.decide().velocity == STANDSTILL


@pytest.mark.parametrize("latch", [True, False])
def test_a_latched_place_needs_not_be_reached_again(configure, latch):
    config = configure(yaw_goal_tolerance=0.1, latch_xy_goal_tolerance=latch)
    world = World(world_of(HALL, 0.8), Pose(4.0, 3.2), config)
    world.look()
    world.planner.set_plan(np.array([[4.0, 3.2, 0.0], [4.2, 3.2, 2.0]]))
    world.decide()
    world.pose = Pose(3.9, 3.2)
    assert (world.decide().velocity.x == 0.0) == latch


ROLLOUT = Rollout(
    Velocity(2.5, 2.5, 3.2),
    Horizon(1.7, 0.025, 0.025),
    Scales(0.04, 0.05, 0.0005),
    Clearance(0.3, 5.0),
)
HEADINGS = Rollout(
    Velocity(2.5, 2.5, 3.2),
    Horizon(1.7, 0.025, 0.025, heading=0.5),
    Scales(0.04, 0.05, 0.0005, heading=0.3),
    Clearance(),
)
WINDOWS = [
    DynamicWindow(
        Velocity(2.5, 2.5, 3.2),
        Horizon(1.7, 0.025, 0.1),
        Scales(0.04, 0.05, 0.01),
        Clearance(0.3, 5.0),
        Nose(0.325, np.empty((0, 0), np.int32), 0.04, 0.05, 0.1),
        accelerating,
    )
    for accelerating in (True, False)
]


@pytest.mark.parametrize(
    "rollout", [ROLLOUT, HEADINGS, *WINDOWS], ids=["rollout", "headings", "dwa accelerating", "dwa"]
)
def test_the_pruned_search_finds_the_winner_of_the_whole_one(rollout):
    generator = np.random.default_rng(5)
    world = World(world_of(BEND, 1.6), Pose(5.6, 8.0, -1.2))
    world.look()
    plan = path_between(NavfnPlanner(NavfnConfig()), world.map, world.pose, Pose(12.0, 4.0))
    for _ in range(20):
        velocity = Velocity(
            float(generator.uniform(0, 0.6)), 0.0, float(generator.uniform(-0.8, 0.8))
        )
        situation = Situation(world.local, world.pose, velocity, Pose())
        is_window = isinstance(rollout, DynamicWindow)
        assert (
            rollout.begin_window(situation, plan, True)
            if is_window
            else rollout.begin(situation, plan)
        )
        samples = np.ascontiguousarray(
            generator.uniform((0.0, 0.0, -1.0), (0.8, 1e-9, 1.0), (200, 3))
        )
        every = rollout.all_of(samples)
        assert rollout.cheapest(samples) == min(every, key=lambda scored: scored.cost, default=None)
        limit = float(np.median([scored.cost for scored in every])) if every else 0.0
        assert rollout.all_of(samples, limit) == [
            scored for scored in every if scored.cost <= limit
        ]
        for scored in every:
            off = np.abs(
                rollout.poses(scored.velocity) - (scored.end.x, scored.end.y, scored.end.yaw)
            ).max(axis=1)
            assert off[slice(None) if rollout is HEADINGS else -1].min() < 1e-9


def test_former_parameter_names_are_understood():
    config = config_of(
        acc_lim_th=1.5, max_rotational_vel=0.7, path_distance_bias=0.4, backup_vel=-0.3
    )
    assert (config.acc_lim_theta, config.max_vel_theta, config.min_vel_theta) == (1.5, 0.7, -0.7)


@pytest.mark.parametrize(
    "wrong",
    [{"simple_attractor": True}, {"y_vels": "fast"}, {"sim_time": 0.0}],
)
def test_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ParameterError):
        config_of(**wrong)


def test_with_heading_scoring_the_sample_that_turns_towards_the_plan_costs_less():
    world = World(world_of(HALL, 0.8), Pose(4.0, 3.2, 0.0))
    world.look()
    plan = np.array([[4.0, 3.2 + 0.05 * step, 0.0] for step in range(25)])
    alone = Rollout(
        Velocity(2.5, 2.5, 3.2),
        Horizon(1.7, 0.025, 0.025, heading=0.5),
        Scales(0.0, 0.0, 0.0, heading=0.3),
        Clearance(),
    )
    assert alone.begin(Situation(world.local, world.pose, STANDSTILL, Pose()), plan)
    turns = (-0.5, 0.0, 0.5)
    costs = [scored.cost for scored in alone.all_of(np.array([[0.0, 0.0, turn] for turn in turns]))]
    # After 0.5 s the robot has turned by almost half of its turn rate; the plan leads 90 degrees to the left.
    expected = [0.3 * (math.pi / 2 - 0.5 * turn) for turn in turns]
    assert costs == pytest.approx(expected, abs=0.04)
