"""The tutorial's steps, typed as published into terminals of idle computers, in several orders."""

from collections.abc import Iterator

import pytest

from containers.harness import Fleet, Terminal, fleet

HUB = "rosrun pioneer_networking run-pioneer-hub"
GATEWAY = "export HOSTNAME; roslaunch pioneer_networking pioneer_gateway.launch"
SIMULATION = "rosrun pioneer_gazebo run-multi-pioneer-gazebo-master"
NAVIGATION = "rosrun pioneer_gazebo run-pioneer-nav-local"
STEPS = {
    "1": ("aadiworkstation", HUB),
    "2a": ("aadi1", GATEWAY),
    "2b": ("aadi2", GATEWAY),
    "3": ("aadiworkstation", SIMULATION),
    "4a": ("aadi1", NAVIGATION),
    "4b": ("aadi2", NAVIGATION),
}
DOCUMENTED = ["1", "2a", "2b", "3", "4a", "4b"]
LINES = {
    "1": ["Pioneer Hub"],
    "2a": ["aadi1_gateway", "Pioneer Hub"],
    "2b": ["aadi2_gateway", "Pioneer Hub"],
    "3": ["2 robots stand in utm_0", "Advertise: [/clock, publisher]", "topics are advertised and flipped"],
    "4a": ["topics are pulled and flipped", "odom received!"],
    "4b": ["topics are pulled and flipped", "odom received!"],
}
"""What a reader sees at each step."""
WAYPOINT = "rostopic pub -1 /pioneer1/map_goal geometry_msgs/Twist '[-2.0, -9.0, 0.0]' '[0.0, 0.0, 90.0]'"


@pytest.fixture(scope="module")
def idle() -> Iterator[Fleet]:
    with fleet("pioneer-tutorial", "10.88.8") as made:
        made.pioneer("up", "--robots", "2", "--idle")
        yield made


@pytest.mark.parametrize(
    ("order", "endings"),
    [
        pytest.param(DOCUMENTED, ["4a", "4b", "3", "2a", "2b", "1"], id="as-documented"),
        pytest.param(DOCUMENTED[::-1], ["1", "3", "2b", "4a", "2a", "4b"], id="reversed-and-the-hub-ends-first"),
        pytest.param(["3", "4a", "1", "2b", "4b", "2a"], ["2a", "1", "4b", "3", "2b", "4a"], id="mixed"),
    ],
)
def test_the_steps_in_any_order(idle: Fleet, order: list[str], endings: list[str]) -> None:
    terminals = {step: Terminal(idle.container(STEPS[step][0]), STEPS[step][1]) for step in order}
    try:
        for step, lines in LINES.items():
            for line in lines:
                terminals[step].wait_for(line)
        publisher = Terminal(idle.container("aadi1"), WAYPOINT)
        terminals["4a"].wait_for("reached waypoint 1 (-2.00, -9.00, 90 deg)")
        assert publisher.end() == 0
    finally:
        for step in endings:
            terminals[step].interrupt()
            terminals[step].end()
    for step, terminal in terminals.items():
        assert "Traceback" not in terminal.text, f"{STEPS[step]}:\n{terminal.text}"
    for computer in ("aadiworkstation", "aadi1", "aadi2"):
        left = idle.execute(computer, "bash", "-c", "pgrep -af '[c]atkin_ws|[r]osmaster|[r]edis' || true")
        assert not left, f"left on {computer}:\n{left}"
