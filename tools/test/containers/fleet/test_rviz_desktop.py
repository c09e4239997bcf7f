"""The browser desktop of the running fleet: its page, its access control, and RViz on it."""

import os
import re
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import websocket
import yaml
from PIL import Image
from tested_fleet import PATIENCE, Fleet
from vnc import Screen

from containers.engine import DESKTOP, output
from containers.harness import ROOT
from pioneer_description.core.scene import Mark, View, marks_of, missing
from pioneer_harness.wait import wait_until

CONFIG = ROOT / "catkin_ws/src/pioneer_gazebo_ros/pioneer_description/rviz/multi_pioneer.rviz"


@pytest.fixture(scope="module")
def page(driving: Fleet) -> Iterator[str]:
    """Yields the address that `up --desktop` prints; removes the container at the end. RViz renders on the CPU."""
    said = driving.pioneer("up", "--desktop")
    found = re.search(r"^desktop with RViz: (\S+)$", said, re.M)
    assert found, said
    yield found[1]
    output("docker", "rm", "-f", desktop(driving))


def desktop(fleet: Fleet) -> str:
    """Returns the desktop's container ID."""
    labels = (
        f"label=com.docker.compose.project={fleet.project}",
        f"label=com.docker.compose.service={DESKTOP}",
    )
    return output("docker", "ps", "-aq", "--filter", labels[0], "--filter", labels[1]).strip()


def address_of_screen(page: str) -> str:
    """Returns the WebSocket address of the screen, parsed from the page's address as noVNC does it."""
    where = urllib.parse.urlsplit(page)
    return f"ws://{where.netloc}/{urllib.parse.parse_qs(where.query)['path'][0]}"


def shown() -> list[Mark]:
    """Returns what every window must show, wherever it is: the map and each robot's scan."""
    marks = marks_of(yaml.safe_load(CONFIG.read_text()))
    return [mark for mark in marks if mark.what in {"map", "scan"}]


def test_the_page_in_the_browser_shows_rviz_with_the_scans_of_five_robots(
    page: str, tmp_path: Path
) -> None:
    with urllib.request.urlopen(page, timeout=PATIENCE) as answer:
        assert b"noVNC" in answer.read()
    marks = shown()
    assert [mark.robot for mark in marks] == ["", *(f"pioneer{number}" for number in range(1, 6))]
    with Screen(address_of_screen(page), PATIENCE) as screen:

        def all_seen() -> bool:
            picture = screen.picture()
            Image.fromarray(picture).save(
                os.environ.get("PIONEER_DESKTOP_PICTURE", tmp_path / "desktop.png")
            )
            unseen = missing(picture, View((0, 0), 1), marks, {})
            print("not seen:", *unseen)
            return not unseen

        wait_until(all_seen, "RViz with the map and each robot's scan", PATIENCE)


def test_the_screen_opens_with_the_token_only(page: str) -> None:
    wrong = re.sub("token=.*", "token=guess", address_of_screen(page))
    with pytest.raises(websocket.WebSocketException):
        Screen(wrong, PATIENCE)
