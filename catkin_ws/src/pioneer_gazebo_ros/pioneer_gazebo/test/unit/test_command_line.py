from pathlib import Path

import pytest

from pioneer_gazebo.core.argument import ArgumentError
from pioneer_gazebo.core.fleet import FleetError, InitialPose, initial_pose, robot_names, robot_of_host
from pioneer_gazebo.nodes import run_navigation, run_simulation, world_to_map
from pioneer_gazebo.nodes.run_simulation import SimulationOptions


def test_environment_gives_defaults_and_arguments_win():
    options = run_simulation.options_from(["robots:=3"], {"ROBOTS": "7", "WORLD": "closed_maze"})
    assert (options.robots, options.world_name) == (3, "closed_maze")
    assert run_simulation.options_from([], {}) == SimulationOptions("utm_0", 15)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["robots"], "not of the form name:=value"),
        (["robot:=3"], "did you mean robots"),
        (["robots:=many"], "robots must be a whole number, not 'many'"),
        (["real_time_factor:=fast"], "must be a number"),
        (["gateway:=perhaps"], "must be true or false"),
    ],
)
def test_bad_argument_is_refused(words, message):
    with pytest.raises(ArgumentError, match=message):
        run_simulation.options_from(words, {})


def test_robots_name_comes_from_argument_then_environment_then_host():
    words, environ = ["robot_name:=pioneer9"], {"ROBOT_NAME": "pioneer4"}
    assert run_navigation.options_from(words, environ, "aadi3").robot_name == "pioneer9"
    assert run_navigation.options_from([], environ, "aadi3").robot_name == "pioneer4"
    assert run_navigation.options_from([], {}, "aadi3.local").robot_name == "pioneer3"
    with pytest.raises(ArgumentError, match="host laptop is not called aadiX"):
        run_navigation.options_from([], {}, "laptop")


def test_robot_of_host():
    assert robot_of_host("aadi12") == "pioneer12"
    assert robot_of_host("aadiworkstation") is None


def test_fleet_of_no_robot_is_refused():
    assert robot_names(2) == ("pioneer1", "pioneer2")
    with pytest.raises(FleetError):
        robot_names(0)


def test_initial_pose_that_is_missing_or_broken_is_refused():
    poses = {"pioneer1": {"x": 1, "y": 2, "a": 3}, "pioneer2": {"x": 1}}
    assert initial_pose(poses, "pioneer1", "f") == InitialPose(1.0, 2.0, 3.0)
    with pytest.raises(FleetError, match="f has no initial pose for pioneer3; it has pioneer1, pioneer2"):
        initial_pose(poses, "pioneer3", "f")
    with pytest.raises(FleetError, match="pioneer2 needs numbers x, y, a"):
        initial_pose(poses, "pioneer2", "f")


def test_fifteen_robots_have_their_launch_files():
    options = SimulationOptions()
    poses = run_simulation.fleet_poses(options, "utm_0")
    files = run_simulation.launch_files(options, "utm_0", list(poses))
    assert len(files) == 2 + 15 + 1
    assert files[0][2]["paused"] == "true"


def test_world_to_map_writes_a_map_of_the_size_asked_for(tmp_path, capsys):
    target = tmp_path / "deep" / "blank"
    words = ["blank", "-o", str(target), "--extent", "-100", "-100", "200", "200", "--outside", "free"]
    assert world_to_map.main(words) == 0
    assert "4000 × 4000 cells" in capsys.readouterr().out
    assert Path(f"{target}.pgm").stat().st_size == 4000 * 4000 + len("P5\n4000 4000\n255\n")
    assert "origin: [-100, -100, 0.0]" in Path(f"{target}.yaml").read_text()


def test_world_to_map_of_an_unknown_world_names_those_there_are(capsys):
    assert world_to_map.main(["nowhere"]) == 1
    assert "closed_maze" in capsys.readouterr().err
