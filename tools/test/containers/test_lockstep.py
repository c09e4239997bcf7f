"""Two robots in containers in lockstep drive the same path twice."""

import json
import re
import subprocess
from pathlib import Path

from tested_fleet import PATIENCE, Fleet, fleet

from containers.layout import compose_text
from containers.state import SHIPPED, project, written_compose

PROJECT, SUBNET = "pioneer-test-lockstep", "10.88.9"
GOALS = {1: (-4.0, 1.5, 0.0), 2: (1.5, 1.3, 3.0)}
"""Goal of each robot. Its client loads it from a file, so that it is known before time starts."""
TRUTH = (
    "until rostopic list >/dev/null 2>&1; do sleep 0.2; done; "
    "exec rostopic echo -p /pioneer{}/base_pose_ground_truth"
)


def test_two_runs_of_a_fleet_of_containers_in_lockstep_are_equal(tmp_path: Path) -> None:
    with fleet(PROJECT, SUBNET) as made:
        made.pioneer("image")
        first, again = drive(made, tmp_path / "first"), drive(made, tmp_path / "again")
    for number in GOALS:
        shared = first[number].keys() & again[number].keys()
        assert len(shared) > 100, "both have been listened to from the start on"
        assert [stamp for stamp in shared if first[number][stamp] != again[number][stamp]] == []
        x = [float(line.split(",")[3]) for line in first[number].values()]
        assert max(x) - min(x) > 0.3, "it has driven"


def drive(made: Fleet, folder: Path) -> dict[int, dict[str, str]]:
    """Starts the fleet and ends it at its goals; returns each robot's true odometry by stamp [ns]."""
    folder.mkdir()
    write_fleet(folder)
    run = project(
        PROJECT, PIONEER_SUBNET=SUBNET, PIONEER_WORLD="small_world", PIONEER_ROBOTS="2",
        PIONEER_REAL_TIME_FACTOR="lockstep",
    )  # fmt: skip
    run.run("up", "-d")
    base = made.container("aadiworkstation")
    echoes = {}
    for number in GOALS:
        with (folder / f"truth{number}").open("w") as output:
            command = ["docker", "exec", base, "bash", "-c", TRUTH.format(number)]
            echoes[number] = subprocess.Popen(command, stdout=output)
    try:
        made.arrived(list(GOALS), dict.fromkeys(GOALS, 1))
        read = {number: (folder / f"truth{number}").read_text() for number in GOALS}
    finally:
        made.pioneer("down")
        for echo in echoes.values():
            echo.wait(PATIENCE)
    return {number: by_stamp(text) for number, text in read.items()}


def by_stamp(text: str) -> dict[str, str]:
    """Returns the complete lines of `rostopic echo -p` by header.stamp, without the columns that depend on arrival."""
    lines = [line.split(",", 2)[2] for line in text[: text.rfind("\n") + 1].splitlines()[1:]]
    return {line.split(",")[0]: line for line in lines}


def write_fleet(folder: Path) -> None:
    """Writes the project's compose file for two robots, each with a file that holds its goal."""
    text = compose_text(SHIPPED.read_text(), len(GOALS))
    for number, (x, y, yaw) in GOALS.items():
        goal = {"x": x, "y": y, "yaw": yaw, "frame": "map"}
        own = folder / f"aadi{number}"
        own.mkdir()
        (own / "queue.json").write_text(json.dumps([goal]))
        block = f"    hostname: aadi{number}\n"
        assert block in text
        text = text.replace(block, f"{block}    volumes: ['{own}:/goals']\n")
    text, count = re.subn(
        "^  WAYPOINT_QUEUE_FILE: .*$", "  WAYPOINT_QUEUE_FILE: /goals/queue.json", text, flags=re.M
    )
    assert count == 1
    file = written_compose(PROJECT)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
