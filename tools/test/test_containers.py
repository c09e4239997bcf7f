"""The compose file, the image's sources and the tables: what needs no engine."""

import re
from pathlib import Path

import pytest

from containers.engine import Computer, ContainerError
from containers.image import requirements
from containers.layout import compose_text
from containers.table import status_table

SHIPPED = (Path(__file__).parents[2] / "docker" / "compose.yaml").read_text()


def test_five_robots_are_the_shipped_file() -> None:
    assert compose_text(SHIPPED, 5) == SHIPPED


@pytest.mark.parametrize("robots", [1, 15, 150])
def test_every_robot_has_the_tutorials_name_and_address(robots: int) -> None:
    text = compose_text(SHIPPED, robots)
    found = re.findall(r"^  (aadi\d+):\n(?:    .*\n)*?    hostname: (aadi\d+)\n(?:    .*\n)*?.*\}\.(\d+)$", text, re.M)
    assert found == [(f"aadi{number}", f"aadi{number}", str(100 + number)) for number in range(1, robots + 1)]
    assert text.count("  aadiworkstation:") == text.count("ipv4_address: ${PIONEER_SUBNET:-192.168.2}.100") == 1


@pytest.mark.parametrize("robots", [0, -1, 151])
def test_a_fleet_that_the_addresses_do_not_hold_is_refused(robots: int) -> None:
    with pytest.raises(ContainerError, match="1 to 150"):
        compose_text(SHIPPED, robots)


def test_the_image_takes_no_checks_from_pypi() -> None:
    assert [one.split("==")[0] for one in requirements()] == ["pybullet", "xacro"]


def test_a_computer_that_says_nothing_still_has_its_row() -> None:
    dead = Computer("aadi1", "c", "exited", "", {}, "i")
    heading, row = status_table([dead], {}).splitlines()
    assert row.split() == ["aadi1", "exited", *["-"] * 7]
    assert heading.startswith("COMPUTER  CONTAINER")
