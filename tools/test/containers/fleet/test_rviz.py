"""RViz at the base station of the running fleet shows the map and every robot's model, scan, plans and costmap."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from errand import ROUNDS, WALLS, Errand
from PIL import Image
from tested_fleet import PATIENCE, Fleet

from containers.engine import output


@pytest.fixture
def rounds(driving: Fleet) -> Iterator[None]:
    """Keeps all robots driving their rounds and up to a wall, so that there are plans and costs to show."""
    computers = driving.computers()
    errands = [
        Errand(computers[f"aadi{number}"], (WALLS[number], *ROUNDS[number]) * 4) for number in WALLS
    ]
    yield
    for errand in errands:
        errand.abandon()


def test_rviz_started_last_shows_five_robots_where_they_are(
    driving: Fleet, rounds: None, tmp_path: Path
) -> None:
    # A sixth robot, of another test, may be standing there without an errand.
    shot = (
        "rosrun",
        "pioneer_description",
        "rviz_snapshot",
        "--robots",
        f"{len(WALLS)}",
        "-o",
        "/tmp/rviz.png",
    )
    picture = Path(os.environ.get("PIONEER_RVIZ_PICTURE", tmp_path / "rviz.png"))
    try:
        said = driving.execute("aadiworkstation", *shot, "--timeout", f"{PATIENCE:g}")
    finally:
        # The picture helps to find what is missing.
        output(
            "docker", "cp", f"{driving.container('aadiworkstation')}:/tmp/rviz.png", str(picture)
        )
    # Five displays and a name for each robot, plus the map.
    assert "/tmp/rviz.png: RViz shows all 31 displays" in said
    with Image.open(picture) as image:
        assert image.size == (1500, 1000)
