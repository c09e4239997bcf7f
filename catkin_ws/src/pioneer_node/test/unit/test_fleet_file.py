"""Fleet files: what they may contain, and the errors for wrong ones."""

from pathlib import Path
from typing import Any

import pytest

from pioneer_node.adapters.fleet_file import read_fleet
from pioneer_node.core.fleet_file import FleetFileError, RobotEntry, fleet_from_mapping


def test_a_robot_that_says_nothing_is_the_pioneer_of_its_place() -> None:
    fleet = fleet_from_mapping({"robots": [{}, {"name": "rover", "laser": "scan"}, {}]}, "f")
    assert [robot.name for robot in fleet] == ["pioneer1", "rover", "pioneer3"]
    assert fleet[0] == RobotEntry("pioneer1")
    assert fleet[1].laser == "scan"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ([], "f: must be 'robots:' with a list"),
        ({"robots": []}, "f: must be 'robots:' with a list"),
        ({"robots": [{}], "world": "utm_0"}, "and nothing else"),
        ({"robots": ["rover"]}, "f: robot 1 must be a mapping"),
        ({"robots": [{"lasr": "scan"}]}, "f: robot 1: unknown field lasr; did you mean laser?"),
        ({"robots": [{"name": "my robot"}]}, "f: robot 1: a name has letters, digits and _"),
        ({"robots": [{"name": "a"}, {"name": "a"}]}, "f: two robots are called a"),
        ({"robots": [{"pose": {"x": 1.0}}]}, "f: robot 1: pose must have the numbers x, y and a"),
        ({"robots": [{"laser": 3}]}, "f: robot 1: laser must be str"),
    ],
)
def test_a_wrong_fleet_is_named_with_file_robot_and_reason(content: Any, told: str) -> None:
    with pytest.raises(FleetFileError) as error:
        fleet_from_mapping(content, "f")
    assert told in str(error.value)


def test_files_are_found_beside_the_fleet_file_and_in_packages(tmp_path: Path) -> None:
    (tmp_path / "rover.urdf").write_text("<robot/>")
    fleet = tmp_path / "fleet.yaml"
    fleet.write_text(
        "robots: [{description: rover.urdf, navigation: package://pioneer_2dnav/package.xml}]"
    )
    (robot,) = read_fleet(fleet)
    assert robot.description == str(tmp_path / "rover.urdf")
    assert robot.navigation.endswith("pioneer_2dnav/package.xml")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("robots: [{description: none.urdf}]", "pioneer1: there is no file"),
        ("robots: [{description: 'package://none/a'}]", "pioneer1: there is no package none"),
        ("robots: [", "cannot read the fleet file"),
    ],
)
def test_a_file_that_is_missing_is_named(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "fleet.yaml").write_text(text)
    with pytest.raises(FleetFileError, match=told):
        read_fleet(tmp_path / "fleet.yaml")


def test_a_fleet_file_that_does_not_exist_is_named_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(FleetFileError, match=r"none\.yaml: No such file or directory$"):
        read_fleet(tmp_path / "none.yaml")


def test_the_shipped_fleet_file_can_be_read() -> None:
    import rospkg

    fleet = read_fleet(
        Path(rospkg.RosPack().get_path("pioneer_description")) / "config" / "mixed_fleet.yaml"
    )
    assert [robot.name for robot in fleet] == ["pioneer1", "pioneer2", "rover"]


def test_a_robot_that_another_navigation_drives_needs_no_file(tmp_path: Path) -> None:
    fleet = tmp_path / "fleet.yaml"
    fleet.write_text("robots: [{navigation: none}]")
    (robot,) = read_fleet(fleet)
    assert robot.navigation == "none"
