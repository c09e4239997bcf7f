"""Scenario files: the shipped ones, and the errors for wrong ones."""

from pathlib import Path

import pytest

from pioneer_demo.error import OptionError
from pioneer_demo.processes.command import Ports, commands, on_computer, written_files
from pioneer_demo.scenario.option import DemoConfig, Machine, demo_config, scenario_config
from pioneer_demo.scenario.scenario import Scenario
from pioneer_demo.scenario.scenario_file import read_scenario, scenario_folder

SHIPPED = sorted(scenario_folder().glob("*.yaml"))
PLACES = {"closed_maze": 15, "small_world": 6, "utm_0": 15, "willow_office": 15}


def config(*arguments: str) -> DemoConfig:
    return scenario_config(arguments, Machine(PLACES, 15, 2, scenario_of=read_scenario))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_scenario_can_be_run_by_its_name(path: Path) -> None:
    said = config(path.stem)
    assert said.robots == len(said.names)
    assert read_scenario(path).about.endswith(".")


def test_ten_scenarios_are_shipped_beside_the_demos_own() -> None:
    assert len(SHIPPED) == 11


def test_the_demo_without_options_is_its_scenario() -> None:
    own, plain = config("demo"), demo_config([], Machine(PLACES, 15, 2))
    assert {**vars(own), "scenario": None, "goals": ()} == vars(plain)


def test_options_replace_what_the_file_says() -> None:
    said = config("rush_hour", "--seed", "7", "--rtf", "0.25")
    assert (said.seed, said.real_time_factor, said.traffic, said.robots) == (7, 0.25, True, 15)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("wrold: utm_0", ":1: unknown field wrold; did you mean world?"),
        ("world: utm_0\nrobots:\n  - gaols: []", ":3: unknown field gaols; did you mean goals?"),
        ("robots:\n  - {}\n  - goals:\n    - [1.0]", ":4: a goal is [x, y] or [x, y, degrees]"),
        ("robots: many", ":1: robots must be int"),
        ("robots: []", ":1: there must be 1 robot"),
        ("robots: [{name: a}, {name: a}]", ":1: two robots are called a"),
        (
            "seed: 1\nfaults:\n  - {at: 3}",
            ":3: a fault has one of kill, freeze, blind, move, door and link, not none",
        ),
        (
            "seed: 1\nfaults:\n  - {link: pioneer1, lasts: 3}",
            ":3: 'link' needs one or more of loss, delay and rate",
        ),
        (
            "faults:\n  - {kill: hub, lasts: 3, loss: 0.1}",
            ":2: 'link' needs one or more of loss, delay and rate",
        ),
        (
            "faults:\n  - link: pioneer1\n    lasts: 3\n    loss: 5",
            ":4: loss must be 0 to 1, not 5",
        ),
        (
            "faults:\n  - {link: pionee2, lasts: 3, rate: 1000}",
            ":2: unknown robot 'pionee2'; did you mean pioneer2?",
        ),
        (
            "faults:\n  - at: 1\n    kill: pionee1\n    lasts: 3",
            ":2: unknown robot 'pionee1'; did you mean pioneer1?",
        ),
        ("faults: [{kill: base station, lasts: 3}]", "unknown robot 'base station'"),
        ("faults:\n  - blind: pioneer1\n    lasts: 0.0", ":3: lasts must be above 0 s"),
        (
            "world: small_world\nrobots:\n  - goals:\n      - [1, 1]\n      - [500, 0]",
            ":5: the goal (500, 0) is outside the map",
        ),
        ("faults:\n  - blind: pioneer1", ":2: lasts is missing: the duration of the fault [s]"),
        ("faults:\n  - {move: pioneer1}", ":2: 'move' needs 'to: [x, y, degrees]'"),
        ("success:\n  reached: 3.0", ":2: reached is a share"),
        (
            "parameters:\n  amcl/min_particles: 100\n  amcl/min_particle: 100",
            ":3: amcl: unknown parameter ~min_particle; did you mean ~min_particles?",
        ),
        (
            "parameters:\n  move_base/local_costmap/inflation_layer/inflation_radiuss: 0.5",
            ":2: move_base/local_costmap/inflation_layer: unknown parameter ~inflation_radiuss",
        ),
        ("parameters:\n  move_base/controller_frequency: 0.0", ":2: move_base: ~controller_freq"),
        ("parameters:\n  /rosout/x: 1", ":2: /rosout/x is not a parameter of a robot's node"),
        ("seed: 1\nnoise: real", ":2: noise must be described or realistic, not 'real'"),
        ("seed: 1\nseed: 2", ":2: field seed is given twice"),
        ("world: [", ":1: invalid YAML"),
        ("&a [*a]", "contains itself"),
        ("- 1", ":1: a scenario must be a mapping"),
        ("world: none.world", "there is no file"),
    ],
)
def test_a_wrong_scenario_is_named_with_file_line_and_reason(
    tmp_path: Path, text: str, told: str
) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(text)
    with pytest.raises(OptionError) as error:
        read_scenario(path)
    assert told in str(error.value)
    assert str(path) in str(error.value)


def test_an_unknown_scenario_suggests_the_nearest() -> None:
    with pytest.raises(OptionError, match="no scenario dorway; did you mean doorway"):
        read_scenario(Path("dorway"))


def test_robots_parameters_and_programs_become_files_and_commands(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(
        "robots: [{pose: {x: 1, y: 2, a: 0}}]\n"
        "parameters: {amcl/min_particles: 800, /gazebo/odometry_error: 0.02}\n"
        "programs: ['rosrun p n __ns:={robot}']\n"
    )
    said = config(str(path), "--report", str(tmp_path / "out"))
    files = written_files(said)
    assert files["fleet.yaml"]["robots"][0]["pose"] == {"x": 1.0, "y": 2.0, "a": 0.0}
    assert files["robot_parameters.yaml"] == {"amcl/min_particles": 800}
    assert files["simulator_parameters.yaml"] == {"/gazebo/odometry_error": 0.02}
    started = {one.name: one for one in commands(said, Ports(1, 2, 3, (4,)))}
    assert started["program 1 of pioneer1"].argv[-4:] == ("rosrun", "p", "n", "__ns:=pioneer1")
    assert (
        f"parameters:={tmp_path}/out/log/robot_parameters.yaml"
        in started["navigation of pioneer1"].argv
    )
    assert set(on_computer(said, "pioneer1")) < set(started)


def test_a_robot_whose_link_has_faults_has_a_network_of_its_own_in_wall_time(
    tmp_path: Path,
) -> None:
    assert config("lossy_network").linked == ("pioneer2",)
    with pytest.raises(OptionError, match="--lockstep: lossy_network has faults of links"):
        config("lossy_network", "--lockstep")
    with pytest.raises(OptionError, match="--record: the robots' masters cannot be reached"):
        config("lossy_network", "--record", str(tmp_path / "run.bag"))


def test_realistic_noise_is_asked_of_the_simulator(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("noise: realistic")
    started = {one.name: one for one in commands(config(str(path)), Ports(1, 2, 3, (4, 5)))}
    assert "noise:=realistic" in started["simulator"].argv


def test_a_scenario_may_ask_for_lockstep(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("world: small_world\nlockstep: true\n")
    assert config(str(path)).lockstep
    assert not config("demo").lockstep


def test_rounds_repeat_a_robots_goals() -> None:
    path = next(path for path in SHIPPED if path.stem == "patrol")
    first, _ = read_scenario(path).goals
    assert (len(first), first[:5]) == (15, first[5:10])
    assert Scenario(robots=2).goals == ((), ())
