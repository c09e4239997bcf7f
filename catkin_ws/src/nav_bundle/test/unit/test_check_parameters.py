"""Unknown names and refused values of navigation parameters are found before a node runs."""

import pytest

from nav_bundle.check_parameters import faults, shipped_parameters


def test_right_parameters_and_those_of_other_nodes_have_no_fault() -> None:
    right = {
        "amcl/max_particles": 100,
        "move_base/base_local_planner": "dwa_local_planner/DWAPlannerROS",
        "move_base/DWAPlannerROS/max_vel_x": 0.3,
        "move_base/local_costmap": {"inflation_radius": 0.4},
        "slam_gmapping/particles": 5,
        "controller/gain": 1.0,
    }
    assert faults(right) == []


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("move_base/planer_frequency", 1.0, "did you mean ~planner_frequency?"),
        ("move_base/local_costmap/inflation_radios", 1.0, "unknown parameter ~inflation_radios"),
        ("move_base/TrajectoryPlannerROS/max_vel_xx", 1.0, "did you mean ~max_vel_x?"),
        ("amcl/laser_z_hitt", 0.5, "did you mean ~laser_z_hit?"),
        ("amcl/laser_z_hit", "much", "must be"),
        ("slam_gmapping/particle", 3, "did you mean ~particles?"),
        (
            "move_base/base_local_planner",
            "teb_local_planner/TebLocalPlannerROS",
            "is not available",
        ),
    ],
)
def test_a_wrong_name_or_value_is_found(
    name: str, value: object, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    (fault,) = faults({name: value})
    assert words in fault
    assert not caplog.text


def test_the_shipped_files_have_no_fault_and_a_value_is_judged_beside_them() -> None:
    shipped = shipped_parameters()
    assert shipped["move_base/TrajectoryPlannerROS/max_vel_x"] == 1.0
    assert faults(shipped) == []
    # Noetic's default of max_vel_x is 0.5.
    assert faults({**shipped, "move_base/TrajectoryPlannerROS/min_vel_x": 0.6}) == []
    assert faults({**shipped, "move_base/TrajectoryPlannerROS/min_vel_x": 1.6})
