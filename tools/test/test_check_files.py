"""``./pioneer check`` says of files what the nodes' own readers say, with lines."""

import json
from pathlib import Path

import pytest

import check_files
from check_files import Report, check

WORLD = """<sdf version="1.6"><world name="w">
<model name="box"><link name="l"><collision name="c">
<geometry><box><size>1 1 1</size></box></geometry>
</collision></link></model>
<road name="r"/>
<model name="bad"><link name="l"><collision name="c">
<geometry><box><size>1 one 1</size></box></geometry>
</collision></link></model>
</world></sdf>
"""


def checked(folder: Path, name: str, text: str) -> Report:
    """Returns the report of a file with this text."""
    path = folder / name
    path.write_text(text)
    [report] = check([path])
    return report


def test_a_misspelt_parameter_is_named_with_its_line_and_the_nearest_name(tmp_path: Path) -> None:
    text = "local_costmap:\n  width: 4.0\n  plugins:\n  - {name: inflation, type: 'costmap_2d::InflationLayer'}\n"
    report = checked(tmp_path, "nav.yaml", f"{text}  inflation:\n    inflation_radiuss: 0.3\n")
    assert not report.refused
    [note] = report.warnings
    assert note.line == 6
    assert "did you mean ~inflation_radius?" in note.text


@pytest.mark.parametrize(
    "text", ["a: 2020-13-45\n", "TrajectoryPlannerROS:\n  max_vel_x: rad(1/0)\n"]
)
def test_a_value_that_yaml_cannot_read_is_refused_without_a_traceback(
    tmp_path: Path, text: str
) -> None:
    assert checked(tmp_path, "nav.yaml", text).refused


def test_of_several_documents_the_last_one_counts(tmp_path: Path) -> None:
    text = "local_costmap:\n  width: 4.0\n---\nlocal_costmap:\n  resolution: -0.05\n"
    [note] = checked(tmp_path, "nav.yaml", text).refused
    assert note.line == 5


def test_a_refused_value_is_named_with_its_line(tmp_path: Path) -> None:
    report = checked(tmp_path, "nav.yaml", "local_costmap:\n  width: 4.0\n  resolution: -0.05\n")
    assert [(note.line, "resolution must be positive" in note.text) for note in report.refused] == [
        (3, True)
    ]


def test_a_planner_that_is_missing_is_named_with_its_line(tmp_path: Path) -> None:
    text = "controller_frequency: 5.0\nbase_local_planner: teb_local_planner/TebLocalPlannerROS\n"
    [note] = checked(tmp_path, "nav.yaml", text).refused
    assert note.line == 2


def test_files_of_one_robot_are_read_together(tmp_path: Path) -> None:
    """The sources' parameters and their list are in different files, as in many packages."""
    common, local = tmp_path / "common.yaml", tmp_path / "local.yaml"
    common.write_text(
        "obstacle_range: 2.5\nobservation_sources: scan\nscan: {topic: scan, data_typ: LaserScan}\n"
    )
    local.write_text("local_costmap:\n  rolling_window: true\n  wdth: 3.0\n")
    reports = check([common, local])
    assert [[note.line for note in report.warnings] for report in reports] == [[3, 3], [3]]


def test_parameters_of_amcl_are_recognised_by_their_names(tmp_path: Path) -> None:
    report = checked(tmp_path, "amcl.yaml", "min_particles: 100\nlaser_z_hitt: 0.5\n")
    assert report.taken == "2 for amcl"
    assert [note.line for note in report.warnings] == [2]


def test_angles_in_degrees_are_read_as_rosparam_reads_them(tmp_path: Path) -> None:
    report = checked(tmp_path, "amcl.yaml", "min_particles: 100\nupdate_min_a: deg(30)\n")
    assert not report.refused
    assert not report.warnings


def test_a_name_given_twice_is_a_warning(tmp_path: Path) -> None:
    report = checked(tmp_path, "amcl.yaml", "min_particles: 100\nmin_particles: 200\n")
    assert [note.text for note in report.warnings] == [
        "min_particles is given again on line 2, which counts"
    ]


def test_a_world_tells_what_is_left_out_with_lines(tmp_path: Path) -> None:
    report = checked(tmp_path, "my.world", WORLD)
    assert (report.kind, report.taken) == ("world", "w: 2 models")
    assert 7 in [note.line for note in report.warnings]
    assert any("<road>" in note.text for note in report.warnings)


def test_a_robot_without_a_root_is_refused(tmp_path: Path) -> None:
    report = checked(tmp_path, "robot.urdf", '<robot name="r">\n</robot>\n')
    assert [note.line for note in report.refused] == [1]


def test_a_map_tells_the_line_of_a_wrong_field(tmp_path: Path) -> None:
    text = "image: m.pgm\nresolution: 0.05\norigin: [0.0, 0.0, .nan]\n"
    assert [note.line for note in checked(tmp_path, "m.yaml", text).refused] == [3]


def test_a_map_without_its_image_is_refused(tmp_path: Path) -> None:
    text = "image: m.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\n"
    [note] = checked(tmp_path, "m.yaml", text).refused
    assert "does not exist" in note.text


def test_a_scenario_tells_the_line_of_an_unknown_field(tmp_path: Path) -> None:
    report = checked(tmp_path, "s.yaml", "world: blank\nrobots: 2\nwaypoint: 3\n")
    assert [(note.line, "waypoints" in note.text) for note in report.refused] == [(3, True)]


def test_a_fleet_file_tells_what_is_wrong_in_the_files_that_it_names(tmp_path: Path) -> None:
    (tmp_path / "rover.yaml").write_text("local_costmap:\n  widht: 3.0\n")
    report = checked(tmp_path, "fleet.yaml", "robots:\n- {name: rover, navigation: rover.yaml}\n")
    assert report.taken == "1 robots"
    [note] = report.warnings
    assert f"{tmp_path}/rover.yaml:2: " in note.text


@pytest.mark.parametrize("text", ["", "- 1\n", "a: {\n", "colour: red\n", "\x00"])
def test_a_file_that_is_nothing_known_is_refused(tmp_path: Path, text: str) -> None:
    assert checked(tmp_path, "odd.yaml", text).refused


def test_a_missing_file_and_bytes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "odd.world").write_bytes(bytes(range(256)))
    assert all(
        report.refused
        for report in check([tmp_path / "none.yaml", tmp_path / "odd.world", tmp_path])
    )


def test_the_exit_status_tells_refusals_and_with_strict_warnings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, warned = tmp_path / "good.yaml", tmp_path / "warned.yaml"
    good.write_text("min_particles: 100\n")
    warned.write_text("min_particles: 100\nmax_partcles: 100\n")
    assert check_files.main([str(good), "--strict"]) == 0
    assert check_files.main([str(warned)]) == 0
    assert check_files.main([str(warned), "--strict"]) == 1
    assert check_files.main([str(tmp_path / "none.yaml")]) == 1
    capsys.readouterr()
    check_files.main([str(warned), "--json"])
    [report] = json.loads(capsys.readouterr().out)
    assert report["warnings"][0]["line"] == 2
