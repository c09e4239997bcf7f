"""How often a driving robot plans, with the real planners: not more often because a plan fails."""

import numpy as np
import pytest
from drawn_room import enlarged

from nav_bundle.base.pose import Pose
from nav_bundle.base.velocity import Velocity
from nav_bundle.costmap.costmap import Costmap
from nav_bundle.costmap.layer import Observation
from nav_bundle.move_base.config import setup_from_parameters
from nav_bundle.move_base.navigator import Navigator, Sight
from nav_bundle.move_base.state_machine import Phase

ROOM = ["##########", *["#........#"] * 4, "##########"]
START, GOAL = Pose(8.0, 3.0, 3.14), Pose(2.0, 3.0, 3.14)
BESIDE = (6.0, 4.5)
PERIOD = 0.05
FREQUENCY = 2.0
LASER = {"topic": "base_scan", "marking": True, "obstacle_range": 10.0}
SHARED = {"robot_radius": 0.25, "inflation_radius": 0.3, "static_map": True}


def box_around(place: tuple[float, float], side: float) -> np.ndarray:
    """Returns points, shape (n, 2) [m], of a box without a door around a place."""
    along = np.arange(-0.5, 0.5, 0.02)
    edge = np.full(len(along), 0.5)
    sides = ((along, edge), (along, -edge), (edge, along), (-edge, along))
    return side * np.concatenate([np.column_stack(pair) for pair in sides]) + np.array(place)


class Drive:
    """A navigator that drives through an empty room; counts its searches."""

    def __init__(self) -> None:
        parameters = {
            "planner_frequency": FREQUENCY,
            "global_costmap": {**SHARED, "observation_sources": "laser", "laser": LASER},
            "local_costmap": {**SHARED, "global_frame": "map"},
        }
        setup = setup_from_parameters(parameters, "test")
        self.costmaps = [Costmap(setup.global_costmap), Costmap(setup.local_costmap)]
        for costmap in self.costmaps:
            costmap.set_map(enlarged(ROOM, 20))
            costmap.update(START, [])
        self.navigator = Navigator(setup, *self.costmaps, lambda: None)
        self.pose, self.velocity, self.now = START, Velocity(), 100.0
        self.searches = self.failures = 0
        search = self.navigator.planner.search

        def counted(*arguments: object) -> object:
            self.searches += 1
            return search(*arguments)  # type: ignore[arg-type]

        self.navigator.planner.search = counted  # type: ignore[method-assign, assignment]
        self.navigator.begin(GOAL, self.pose, self.now)

    def see(self, points: np.ndarray) -> None:
        """Lets the laser see ``points``."""
        source = self.navigator._setup.global_costmap.layers[1].sources[0]  # type: ignore[union-attr]
        seen = Observation(source, self.pose.x, self.pose.y, points)
        self.costmaps[0].update(self.pose, [seen])

    def cycle(self) -> None:
        """Runs one cycle of 50 ms."""
        self.now += PERIOD
        self.navigator.look_around(self.pose, self.now)
        sight = Sight(self.pose, self.pose, Pose(), self.velocity, current=True)
        cycle = self.navigator.cycle(sight, self.now)
        self.failures += any("plan" in text.lower() for text in cycle.warnings)
        self.velocity = cycle.command or Velocity()
        step = Pose(PERIOD * self.velocity.x, 0.0, PERIOD * self.velocity.turn)
        self.pose = self.pose.compose(step)


@pytest.mark.parametrize("closed", [False, True])
def test_plans_that_fail_beside_an_unmapped_obstacle_come_no_faster(closed: bool) -> None:
    """They used to repeat at 19.5 Hz: each failure made the next plan due at once."""
    drive = Drive()
    while drive.navigator.phase is not Phase.CONTROLLING:
        drive.cycle()
    if closed:
        drive.see(np.concatenate([box_around((GOAL.x, GOAL.y), 0.8), box_around(BESIDE, 0.4)]))
        assert len(drive.costmaps[0].unmapped(drive.pose, 3.0))
    drive.searches = drive.failures = 0
    begin, cycles = drive.now, 0
    while drive.navigator.phase is Phase.CONTROLLING and drive.now < begin + 4.0:
        drive.cycle()
        cycles += 1
    assert drive.now > begin + 2.0, "the robot did not drive"
    assert (drive.failures > 0) == closed
    longest = FREQUENCY * (drive.now - begin) + 2
    assert drive.searches <= longest, f"{drive.searches} searches in {drive.now - begin:.1f} s"
