"""RViz at the base station of the running fleet: every robot's model, scan, plans, costmap, and the map, in pixels."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from errand import ROUNDS, WALLS, Errand
from PIL import Image

from containers.engine import output
from containers.harness import PATIENCE, Fleet


@pytest.fixture
def rounds(driving: Fleet) -> Iterator[None]:
    """All robots drive their rounds and up to a wall meanwhile, so that there are plans and costs to be seen."""
    computers = driving.computers()
    errands = [Errand(computers[f"aadi{number}"], (WALLS[number], *ROUNDS[number]) * 4) for number in WALLS]
    yield
    for errand in errands:
        errand.abandon()


def test_rviz_started_last_shows_five_robots_where_they_are(driving: Fleet, rounds: None, tmp_path: Path) -> None:
    # A sixth robot, of another test, may stand there without an errand.
    shot = ("rosrun", "pioneer_description", "rviz_snapshot", "--robots", f"{len(WALLS)}", "-o", "/tmp/rviz.png")
    picture = Path(os.environ.get("PIONEER_RVIZ_PICTURE", tmp_path / "rviz.png"))
    try:
        said = driving.execute("aadiworkstation", *shot, "--timeout", f"{PATIENCE:g}")
    finally:
        # The picture helps to find what was not seen.
        output("docker", "cp", f"{driving.container('aadiworkstation')}:/tmp/rviz.png", str(picture))
    # Five displays and the name of each robot, and the map.
    assert "/tmp/rviz.png: RViz shows all 31 displays" in said
    with Image.open(picture) as image:
        assert image.size == (1500, 1000)
