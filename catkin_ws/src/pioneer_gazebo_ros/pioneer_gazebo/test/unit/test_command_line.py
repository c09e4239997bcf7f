import shlex
import shutil
from pathlib import Path

import pytest

from pioneer_gazebo.commands import world_to_map
from pioneer_gazebo.fleet import run_navigation, run_simulation
from pioneer_gazebo.fleet.argument import ArgumentError
from pioneer_gazebo.fleet.fleet import (
    FleetError,
    InitialPose,
    initial_pose,
    robot_names,
    robot_of_host,
)
from pioneer_gazebo.fleet.run_simulation import SimulationOptions
from pioneer_gazebo.fleet.session import SessionError
from pioneer_gazebo.world.resource import world_path


def test_environment_gives_defaults_and_arguments_win():
    options = run_simulation.options_from(["robots:=3"], {"ROBOTS": "7", "WORLD": "closed_maze"})
    assert (options.robots, options.world_name) == (3, "closed_maze")
    assert run_simulation.options_from([], {"REAL_TIME_FACTOR": "0.5"}).real_time_factor == 0.5
    assert run_simulation.options_from([], {}) == SimulationOptions("utm_0", 15)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["robots"], "not of the form name:=value"),
        (["robot:=3"], "did you mean robots"),
        (["robots:=many"], "robots must be a whole number, not 'many'"),
        (["real_time_factor:=fast"], "must be a number"),
        (["gateway:=perhaps"], "must be true or false"),
        (["map_name:=utm_0", "map_file:=my.yaml"], "map_name and map_file are two maps: give one"),
    ],
)
def test_bad_argument_is_refused(words, message):
    with pytest.raises(ArgumentError, match=message):
        run_simulation.options_from(words, {})


def test_lockstep_stands_in_the_place_of_a_real_time_factor():
    for options in (
        run_simulation.options_from(["real_time_factor:=lockstep", "lockstep_rings:=a b"], {}),
        run_simulation.options_from(["lockstep_rings:=a b"], {"REAL_TIME_FACTOR": "lockstep"}),
    ):
        files = run_simulation.launch_files(
            options, Path("w.world"), Path("w.yaml"), run_simulation.fleet_robots(options)
        )
        assert files[0][2]["real_time_factor"] == "lockstep"
        assert files[0][2]["lockstep_rings"] == "a b"
    assert (
        run_navigation.options_from(
            ["robot_name:=a"], {"REAL_TIME_FACTOR": "lockstep"}, "x"
        ).real_time_factor
        == "lockstep"
    )


def test_robots_name_comes_from_argument_then_environment_then_host():
    words, environ = ["robot_name:=pioneer9"], {"ROBOT_NAME": "pioneer4"}
    assert run_navigation.options_from(words, environ, "aadi3").robot_name == "pioneer9"
    assert run_navigation.options_from([], environ, "aadi3").robot_name == "pioneer4"
    assert run_navigation.options_from([], {}, "aadi3.local").robot_name == "pioneer3"
    with pytest.raises(ArgumentError, match="host laptop is not named aadiX"):
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
    with pytest.raises(
        FleetError, match="f has no initial pose for pioneer3; it has pioneer1, pioneer2"
    ):
        initial_pose(poses, "pioneer3", "f")
    with pytest.raises(FleetError, match="pioneer2 needs numbers x, y, a"):
        initial_pose(poses, "pioneer2", "f")


def test_fifteen_robots_have_their_launch_files():
    options = SimulationOptions()
    robots = run_simulation.fleet_robots(options)
    assert len(run_simulation.fleet_poses(options, "utm_0", robots)) == 15
    files = run_simulation.launch_files(options, Path("utm_0.world"), Path("utm_0.yaml"), robots)
    assert len(files) == 2 + 15 + 2
    (states,) = (
        arguments for _, file, arguments in files if file == "robot_state_publishers.launch"
    )
    assert states["robots"].split() == [robot.name for robot in robots]
    assert all(
        arguments["state_publisher"] == "false" for _, file, arguments in files if "generic" in file
    )
    assert files[0][2]["paused"] == "true"


def test_a_fleet_file_gives_each_robot_its_description_pose_and_laser(tmp_path: Path):
    (tmp_path / "rover.urdf").write_text("<robot/>")
    fleet = tmp_path / "fleet.yaml"
    fleet.write_text(
        "robots: [{}, {name: rover, description: rover.urdf, laser: scan, pose: {x: 1, y: 2, a: 0}}, {}]"
    )
    options = run_simulation.options_from([f"fleet:={fleet}"], {})
    robots = run_simulation.fleet_robots(options)
    poses = run_simulation.fleet_poses(options, "utm_0", robots)
    assert list(poses) == ["pioneer1", "rover", "pioneer3"]
    assert poses["rover"] == InitialPose(1.0, 2.0, 0.0)
    assert poses["pioneer3"] == InitialPose(5.0, 1.0, 0.0)
    files = run_simulation.launch_files(options, Path("utm_0.world"), Path("utm_0.yaml"), robots)
    own = {
        arguments["name"]: arguments.get("description")
        for _, file, arguments in files
        if "generic" in file
    }
    assert own == {"pioneer1": None, "rover": str(tmp_path / "rover.urdf"), "pioneer3": None}

    driven = run_navigation.options_from([f"fleet:={fleet}", "robot_name:=rover"], {}, "laptop")
    robot, number = run_navigation.entry_of(driven)
    (_, start) = run_navigation.launch_files(robot, poses["rover"], "poses.yaml")
    assert (number, start[2]["laser"], start[2]["x"]) == (2, "scan", "1.0")
    with pytest.raises(FleetError, match="has no robot pioneer2; it has pioneer1, rover, pioneer3"):
        run_navigation.entry_of(
            run_navigation.options_from([f"fleet:={fleet}"], {"ROBOT_NAME": "pioneer2"}, "laptop")
        )


@pytest.fixture
def own_world(tmp_path: Path) -> Path:
    """A user's world, which has no map yet."""
    source = world_path("small_world")
    return Path(shutil.copy(source, tmp_path / "my own.world"))


def test_the_map_of_your_own_world_is_beside_it_once_the_command_in_the_error_has_run(
    own_world, capsys
):
    options = run_simulation.options_from([f"world_name:={own_world}"], {})
    with pytest.raises(SessionError) as raised:
        run_simulation.map_file(options, own_world)
    package, tool, *words = shlex.split(
        str(raised.value).partition("(rosrun ")[2].partition(")")[0]
    )
    assert (package, tool) == ("pioneer_gazebo", "world_to_map")
    assert world_to_map.main(words) == 0
    assert f"{own_world.with_suffix('.yaml')}: 260 × 220 cells" in capsys.readouterr().out
    assert run_simulation.map_file(options, own_world) == own_world.with_suffix(".yaml")


def test_the_map_of_a_world_of_the_package_is_the_packages_though_its_path_is_given():
    path = world_path("small_world")
    assert (
        run_simulation.map_file(SimulationOptions(str(path)), path)
        == path.parents[1] / "map" / "small_world.yaml"
    )


def test_a_map_by_name_or_path_wins_over_the_worlds(own_world):
    path = world_path("utm_0")
    named = run_simulation.map_file(SimulationOptions(map_name="blank"), path)
    assert named == path.parents[1] / "map" / "blank.yaml"
    assert run_simulation.map_file(SimulationOptions(map_file=str(named)), own_world) == named


@pytest.mark.parametrize(
    ("word", "message"),
    [
        (
            "map_name:=mars",
            "there is no map 'mars' in /.*/pioneer_gazebo/map; map_file:=PATH takes one from elsewhere",
        ),
        ("map_file:=/mars.yaml", "map_file: there is no file /mars.yaml"),
    ],
)
def test_a_map_that_does_not_exist_is_named(word, message):
    with pytest.raises(SessionError, match=message):
        run_simulation.map_file(run_simulation.options_from([word], {}), world_path("utm_0"))


def test_nodes_get_whole_paths_of_files_given_from_here(own_world, monkeypatch):
    monkeypatch.chdir(own_world.parent)
    world_to_map.main([own_world.name])
    options = SimulationOptions(own_world.name, map_file="my own.yaml")
    world, *_, grid = run_simulation.launch_files(
        options, own_world, run_simulation.map_file(options, own_world), []
    )
    assert world[2]["world_name"] == str(own_world)
    assert grid[2] == {"map_file": str(own_world.with_suffix(".yaml"))}


def test_world_to_map_says_in_one_line_that_it_cannot_write(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert world_to_map.main(["blank", "-o", str(tmp_path / "file" / "blank")]) == 1
    line = capsys.readouterr().err
    assert line.startswith(f"world_to_map: cannot write {tmp_path / 'file'}")
    assert line.endswith("-o PATH writes elsewhere\n")


def test_world_to_map_writes_a_map_of_the_size_asked_for(tmp_path, capsys):
    target = tmp_path / "deep" / "blank"
    words = [
        "blank",
        "-o",
        str(target),
        "--extent",
        "-100",
        "-100",
        "200",
        "200",
        "--outside",
        "free",
    ]
    assert world_to_map.main(words) == 0
    assert "4000 × 4000 cells" in capsys.readouterr().out
    assert Path(f"{target}.pgm").stat().st_size == 4000 * 4000 + len("P5\n4000 4000\n255\n")
    assert "origin: [-100, -100, 0.0]" in Path(f"{target}.yaml").read_text()


def test_world_to_map_of_an_unknown_world_names_those_there_are(capsys):
    assert world_to_map.main(["nowhere"]) == 1
    assert "closed_maze" in capsys.readouterr().err
