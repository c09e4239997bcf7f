"""The command line is checked before anything starts; each error is one clear line."""

from pathlib import Path

import pytest
import yaml

from pioneer_demo.error import OptionError
from pioneer_demo.scenario.option import (
    DemoConfig,
    FleetConfig,
    Machine,
    check_fleet,
    demo_config,
    fleet_config,
    scenario_config,
)
from pioneer_demo.scenario.scenario import Scenario
from pioneer_demo.scenario.world_folder import map_names, place_count, places_by_world

POSES = Path(__file__).parents[3] / "pioneer_gazebo_ros" / "pioneer_description" / "config"

PLACES, ELSEWHERE = {"closed_maze": 15, "small_world": 6}, 10


def names(count):
    return tuple(f"pioneer{number}" for number in range(1, count + 1))


def parsed(*arguments, processors=2):
    return demo_config(arguments, Machine(PLACES, ELSEWHERE, processors))


def test_without_arguments_two_robots_drive_in_the_closed_maze_at_real_time():
    expected = DemoConfig(
        robots=2,
        world="closed_maze",
        waypoints=3,
        report=Path("demo-report"),
        processors=2,
        traffic=True,
    )
    assert parsed() == expected
    assert (expected.real_time_factor, expected.choice) == (1.0, "")


@pytest.mark.parametrize(
    ("robots", "processors", "factor"),
    [
        (2, 1, 1.0),
        (13, 2, 1.0),
        (15, 2, 0.9),
        (14, 2, 0.95),
        (15, 8, 1.0),
        (9, 1, 0.75),
        (4, 0.5, 0.8),
        (15, 0.1, 0.05),
    ],
)
def test_a_fleet_drives_as_fast_as_the_processors_carry_and_no_faster_than_real_time(
    robots, processors, factor
):
    words = ("--robots", str(robots), "--no-traffic")
    assert parsed(*words, processors=processors).real_time_factor == factor


@pytest.mark.parametrize(
    ("robots", "processors", "factor"), [(2, 1, 1.0), (10, 2, 1.0), (13, 2, 0.75), (15, 2, 0.65)]
)
def test_right_of_way_costs_large_fleets_some_of_their_pace(robots, processors, factor):
    assert parsed("--robots", str(robots), processors=processors).real_time_factor == factor


def test_a_chosen_factor_is_logged_and_a_requested_one_is_kept():
    chosen, asked = parsed("--robots", "15"), parsed("--robots", "15", "--rtf", "1")
    plain = parsed("--robots", "15", "--no-traffic")
    assert (
        plain.choice
        == "Real-time factor 0.9: 2 processors sustain no more with 15 robots (--rtf R sets another)"
    )
    assert chosen.choice == (
        "Real-time factor 0.65: 2 processors sustain no more with 15 robots and right of way (--no-traffic: 0.9) "
        "(--rtf R sets another)"
    )
    assert (asked.real_time_factor, asked.choice) == (1.0, "")


def test_every_option_arrives():
    line = "--robots 5 --world small_world --seed 7 --rtf 0 --waypoints 4 --report out --limit 99"
    config = parsed(*line.split(" "))
    assert config == DemoConfig(
        robots=5, world="small_world", seed=7, real_time_factor=0.0, waypoints=4, report=Path("out"), limit=99.0,
        log=Path("out/log"), names=names(5), traffic=True,
    )  # fmt: skip


def test_noise_has_a_name():
    assert parsed().noise == "described"
    assert parsed("--noise", "realistic").noise == "realistic"
    with pytest.raises(OptionError, match="--noise"):
        parsed("--noise", "real")


def test_what_is_recorded_arrives():
    line = "--record run.mcap --record-topics /clock /tf* --record-split 500"
    config = parsed(*line.split(" "))
    assert (config.record, config.record_split) == (Path("run.mcap"), 500)
    assert config.record_topics == ("/clock", "/tf*")


def test_lockstep_excludes_a_real_time_factor():
    assert (parsed("--lockstep").real_time_factor, parsed("--lockstep").choice) == (0.0, "")
    with pytest.raises(OptionError, match="give one of them"):
        parsed("--lockstep", "--rtf", "1")


def test_a_fleet_has_the_options_of_a_demo_but_for_waypoints_and_report():
    machine = Machine(PLACES, ELSEWHERE, 2)
    expected = FleetConfig(
        robots=3, real_time_factor=0.5, log=Path("logs"), names=names(3), traffic=True
    )
    assert fleet_config(["--robots", "3", "--rtf", "0.5", "--log", "logs"], machine) == expected
    with pytest.raises(OptionError, match="--waypoints"):
        fleet_config(["--waypoints", "3"], machine)


def test_any_world_file_may_be_driven_in():
    assert parsed("--world", "mars.world").is_own_world
    assert not parsed("--world", "small_world").is_own_world


def test_a_world_file_goes_by_the_name_of_its_map():
    assert parsed("--world", "/home/me/small_world.world").map_name == "small_world"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--robots", "0"], "--robots must be 1 to 15 in closed_maze, not 0"),
        (["--robots", "16"], "--robots must be 1 to 15 in closed_maze, not 16"),
        (
            ["--robots", "7", "--world", "small_world"],
            "--robots must be 1 to 6 in small_world, not 7",
        ),
        (["--robots", "two"], "--robots: invalid int value: 'two'"),
        (["--world", "mars"], "--world must be one of closed_maze, small_world, or a .world file"),
        (
            ["--world", "/tmp/mars.world", "--robots", "11"],
            "--robots must be 1 to 10 in mars, not 11",
        ),
        (["--rtf", "-1"], "--rtf must be 0"),
        (["--rtf", "nan"], "--rtf must be 0"),
        (["--waypoints", "0"], "--waypoints must be 1 to 50, not 0"),
        (["--seed", "-4"], "--seed must be 0 to"),
        (["--limit", "-4"], "--limit must be 0"),
        (["--record-topics", "/clock"], "--record-topics and --record-split go with --record FILE"),
        (["--record", "a.mcap", "--record-split", "-1"], "--record-split must be 0"),
        (["--fly"], "unrecognized arguments: --fly"),
    ],
)
def test_a_bad_argument_is_one_line_that_names_it(arguments, words):
    with pytest.raises(OptionError) as raised:
        parsed(*arguments)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


def test_only_who_takes_files_takes_the_path_of_a_known_world():
    check_fleet(6, "/home/me/small_world.world", PLACES, ELSEWHERE)
    with pytest.raises(OptionError, match="--world must be one of closed_maze, small_world, not"):
        check_fleet(6, "a/small_world.world", PLACES)


def test_a_world_has_as_many_places_as_its_own_file_of_poses_else_as_the_common_one(tmp_path):
    for name in ("hall", "room"):
        (tmp_path / f"{name}.yaml").touch()
    (tmp_path / "hall.pgm").touch()
    poses = tmp_path / "config"
    poses.mkdir()
    (poses / "pioneer_poses.yaml").write_text(
        "# pioneer0: none\npioneer1: {x: 1}\npioneer2: {x: 2}\n"
    )
    (poses / "pioneer_poses_room.yaml").write_text("pioneer1: {x: 1}\n")
    assert map_names(tmp_path) == ["hall", "room"]
    assert places_by_world(tmp_path, poses) == {"hall": 2, "room": 1}
    assert place_count(poses) == 2


def test_every_shipped_file_of_poses_is_counted_as_yaml_has_it():
    files = sorted(POSES.glob("pioneer_poses*.yaml"))
    assert files
    for path in files:
        world = path.stem.removeprefix("pioneer_poses").removeprefix("_")
        assert place_count(POSES, world) == len(yaml.safe_load(path.read_text())), path


def test_a_fleet_file_gives_number_and_names_of_the_robots():
    machine = Machine(
        PLACES, ELSEWHERE, 2, lambda path: ["pioneer1", "rover"] if path == Path("f.yaml") else []
    )
    config = fleet_config(["--fleet", "f.yaml"], machine)
    assert (config.robots, config.names, config.fleet) == (
        2,
        ("pioneer1", "rover"),
        Path("f.yaml").resolve(),
    )
    with pytest.raises(OptionError, match="give one of them"):
        fleet_config(["--fleet", "f.yaml", "--robots", "2"], machine)


def test_a_fleet_may_have_robots_that_another_navigation_drives_and_a_demo_may_not():
    machine = Machine(
        PLACES, ELSEWHERE, 2, lambda _: ["pioneer1", "rover"], external_of=lambda _: ["rover"]
    )
    assert fleet_config(["--fleet", "f.yaml"], machine).external == ("rover",)
    with pytest.raises(OptionError, match="rover has 'navigation: none'"):
        demo_config(["--fleet", "f.yaml"], machine)


def test_lockstep_is_refused_where_its_patches_are_switched_off():
    machine = Machine(PLACES, ELSEWHERE, 2, lockstep_refusal="lockstep needs what is switched off")
    with pytest.raises(OptionError, match="--lockstep: lockstep needs what is switched off"):
        demo_config(["--lockstep"], machine)
    assert not demo_config([], machine).lockstep


@pytest.mark.parametrize("parse", [demo_config, fleet_config])
@pytest.mark.parametrize(
    ("arguments", "reason", "traffic", "line"),
    [
        ([], "", True, ""),
        ([], "nowhere can a robot turn", False, "Right of way is off: nowhere can a robot turn"),
        (["--robots", "1"], "never asked", False, ""),
        (["--traffic"], "", True, ""),
        (["--traffic", "--robots", "1"], "never asked", True, ""),
        (["--no-traffic"], "", False, ""),
        (["--no-traffic"], "never asked", False, ""),
    ],
)
def test_several_robots_keep_the_right_of_way_unless_they_cannot_or_must_not(
    parse, arguments, reason, traffic, line
):
    machine = Machine(PLACES, ELSEWHERE, 2, traffic_refusal=lambda *_: reason)
    config = parse(arguments, machine)
    assert config.traffic is traffic
    assert config.traffic_line.startswith(line)
    assert bool(config.traffic_line) == bool(line)


def test_right_of_way_that_is_demanded_and_impossible_is_an_error():
    machine = Machine(PLACES, ELSEWHERE, 2, traffic_refusal=lambda *_: "the doors are too narrow")
    with pytest.raises(OptionError, match="--traffic: the doors are too narrow"):
        demo_config(["--traffic"], machine)


@pytest.mark.parametrize("traffic", [False, True])
def test_a_scenario_keeps_the_right_of_way_that_its_file_says(traffic):
    said = Scenario(robots=2, traffic=traffic)
    machine = Machine(
        PLACES, ELSEWHERE, 2, scenario_of=lambda _: said, traffic_refusal=lambda *_: "never asked"
    )
    config = scenario_config(["any"], machine)
    assert (config.traffic, config.traffic_line) == (traffic, "")
