"""Goals, result table and hall of the simulator bench."""

import pytest

from pioneer_bench.core import hall
from pioneer_bench.core.simulator import SETTINGS, Run, table
from pioneer_gazebo.simulation.standing import distance_to


def run(**changes: float) -> Run:
    values = {
        "robots": 5, "beams": 180, "scan_rate": 10.0, "simulated": 10.0, "wall": 10.0, "cpu": 0.5, "first_step": 0.4,
        "rss": 110.0, "scans": 500, "scans_due": 495, "messages": 550.0, "cost_goal": 0.06,
    }  # fmt: skip
    return Run(**(values | changes))


def test_a_run_within_its_goals_holds_them_all() -> None:
    assert all(holds for _, holds in run().goals().values())
    assert "!" not in table([run()], {})


MISSES = [
    ({"cpu": 0.7}, "cost"),
    ({"rss": 156.0}, "rss"),
    ({"scans": 400}, "scans"),
    ({"first_step": 1.1}, "first_step"),
    ({"factor_goal": 1.0, "wall": 12.0}, "factor"),
]


@pytest.mark.parametrize(("changes", "goal"), MISSES)
def test_what_misses_its_goal_is_marked(changes: dict[str, float], goal: str) -> None:
    missed = run(**changes)
    assert [name for name, (_, holds) in missed.goals().items() if not holds] == [goal]
    assert table([missed], {}).count(" !") == 1


def test_a_peer_stands_beside_with_the_ratio() -> None:
    assert "0.100" in (text := table([run()], {5: 0.1}))
    assert "0.50" in text
    assert "ratio" in text


@pytest.mark.parametrize("name", SETTINGS)
def test_every_setting_has_rates_that_the_simulator_takes(name: str) -> None:
    rates = SETTINGS[name]
    for rate in (rates.scan_rate, rates.odometry_rate, rates.clock_rate):
        assert 600 % rate == 0
    assert not rates.other_rate or 600 % rates.other_rate == 0
    assert set(rates.peers) <= set(rates.robots)
    assert set(rates.goals) <= set(rates.robots)


def test_without_a_cost_goal_none_is_judged_and_flat_out_no_scans_are() -> None:
    assert "cost" not in run(cost_goal=None).goals()
    assert "scans" not in run(asked_factor=0.0, scans=3).goals()


def test_the_hall_has_its_walls_and_depends_on_the_seed_only() -> None:
    assert len(hall.world(1).models) == hall.WALLS
    assert hall.world(1) == hall.world(1) != hall.world(2)


def test_robots_start_clear_of_every_wall() -> None:
    for wall in hall.world(3).collisions():
        for x, y in hall.starts():
            assert distance_to(wall.collision.shape, wall.pose, (x, y, 0.5)) > 0.5
