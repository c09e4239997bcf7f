"""The tutorial's Listings 1 to 3: clients that know nothing of this gateway get the results the tutorial describes."""

import subprocess
import sys
from pathlib import Path

import pytest

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

CLIENT = Path(__file__).parent.parent / "node" / "tutorial_client.py"


def run(site, *argv: str) -> tuple[int, str]:
    """Runs one listing at a site; returns the service's result and error message."""
    command = [sys.executable, str(CLIENT), *argv]
    done = subprocess.run(
        command, env=site.master.environment, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    result, _, message = done.stdout.strip().rpartition("\n")[2].partition(" ")
    return int(result), message


def test_the_tutorials_listings_connect_and_report_existing_rules(fleet) -> None:
    fleet.start_hub()
    base, robot = (
        fleet.site("Hub_Gateway").start().connected(),
        fleet.site("aadi1_gateway").start().connected(),
    )
    base.talk("/clock2")
    robot.talk("/pioneer1/goal")
    clock = robot.hear("/clock2")
    rviz, other = base.hear("/pioneer1/goal", "rviz"), base.hear("/pioneer1/goal", "other")

    assert run(base, "advertise", "clock2") == (0, "")
    assert run(robot, "pull", "clock2") == (0, "")
    assert run(base, "flip", "pioneer1", "goal", "rviz", "aadi1") == (0, "")
    clock.first_after(0.0)
    rviz.first_after(0.0)
    assert other.times() == [], "the flip is for the node that it names"

    for site, argv, code in (
        (base, ("advertise", "clock2"), 31),
        (robot, ("pull", "clock2"), 41),
        (base, ("flip", "pioneer1", "goal", "rviz", "aadi1"), 22),
    ):
        result, message = run(site, *argv)
        assert (result, "already" in message) == (code, True), message
    states = base.states()
    assert states.keys() == {"advertise /clock2", "flip /pioneer1/goal"}
    assert states["advertise /clock2"] == "active"
    assert states["flip /pioneer1/goal"].startswith(
        "active: only for /rviz; here it is also subscribed by /other,"
    )
    assert robot.states() == {"pull /clock2": "active"}
