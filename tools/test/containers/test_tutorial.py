"""The tutorial's steps, typed as published into shells of idle computers, in several orders."""

from collections.abc import Iterator
from contextlib import ExitStack, closing

import pytest
from shell import Shell
from tested_fleet import PATIENCE, Fleet, fleet

from containers.engine import output
from pioneer_harness.wait import wait_until

BASE = "aadiworkstation"
GATEWAY = "export HOSTNAME; roslaunch pioneer_networking pioneer_gateway.launch"
NAVIGATION = "rosrun pioneer_gazebo run-pioneer-nav-local"
STEPS = {
    "1": (BASE, "rosrun pioneer_networking run-pioneer-hub"),
    "2a": ("aadi1", GATEWAY),
    "2b": ("aadi2", GATEWAY),
    "3": (BASE, "rosrun pioneer_gazebo run-multi-pioneer-gazebo-master"),
    "4a": ("aadi1", NAVIGATION),
    "4b": ("aadi2", NAVIGATION),
    "5": (BASE, "roslaunch pioneer_description multi_pioneer_rviz.launch"),
}
"""Each step is typed into its own shell."""
DOCUMENTED = list(STEPS)
ROSLAUNCHES = ("1", "5")
"""Each of these starts the base station's master if it is not running. A user types the next step only once
this one runs: of two roslaunches that find no master in the same second, the later one gives up
(`run_id … does not match`)."""
LINES = {
    "1": ["hub 'Pioneer Hub' on port 6380", "on hub 'Pioneer Hub'", "as 'Hub_Gateway'"],
    "2a": ["on hub 'Pioneer Hub'", "as 'aadi1_gateway'"],
    "2b": ["on hub 'Pioneer Hub'", "as 'aadi2_gateway'"],
    "3": [
        "starting utm_0 with 2 robots",
        "2 robots stand in utm_0",
        "topics are advertised and flipped",
    ],
    "4a": ["starting the navigation of {a}", "topics are pulled and flipped", "odom received!"],
    "4b": ["starting the navigation of {b}", "topics are pulled and flipped", "odom received!"],
    "5": ["process[rviz-"],
}
"""The lines that a user sees at each step (docs/tutorial.md)."""
HERE = {"pioneer1": "-2.0, -8.0", "pioneer2": "-2.0, 16.0"}
"""Places in front of the robots."""


@pytest.fixture(scope="module")
def idle() -> Iterator[Fleet]:
    """Yields a base station with a screen and the computers of two robots, all of them idle."""
    with fleet("pioneer-tutorial", "10.88.8") as made:
        made.pioneer("up", "--robots", "2", "--idle")
        output(
            "docker",
            "exec",
            "-d",
            made.container(BASE),
            "Xvfb",
            ":1",
            "-screen",
            "0",
            "1024x768x24",
        )
        yield made


@pytest.mark.parametrize(
    ("order", "endings", "held", "robots"),
    [
        pytest.param(
            DOCUMENTED, ["4a", "4b", "5", "3", "2a", "2b", "1"], True, {}, id="as-documented"
        ),
        pytest.param(DOCUMENTED[::-1], DOCUMENTED, False, {}, id="reversed-and-the-hub-ends-first"),
        pytest.param(
            ["3", "4a", "1", "2b", "5", "4b", "2a"],
            ["2a", "1", "4b", "3", "5", "2b", "4a"],
            False,
            {"a": "pioneer2", "b": "pioneer1"},
            id="mixed-with-robots-named-by-hand",
        ),
    ],
)
def test_the_steps_in_any_order(
    idle: Fleet, order: list[str], endings: list[str], held: bool, robots: dict[str, str]
) -> None:
    names = {"a": "pioneer1", "b": "pioneer2", **robots}
    with ExitStack() as stack:
        shells = {
            step: stack.enter_context(closing(Shell(idle.container(STEPS[step][0]))))
            for step in order
        }
        shells["5"].run("export DISPLAY=:1")
        for letter, name in robots.items():
            for step in (f"2{letter}", f"4{letter}"):
                shells[step].run(f"export ROBOT_NAME={name}")
        for step in order:
            shells[step].type(STEPS[step][1])
            if order == DOCUMENTED or step in ROSLAUNCHES:
                shows(shells[step], step, names)
        for step in order:
            shows(shells[step], step, names)
        drive(idle, stack, names["a"], shells["4a"])
        statuses = {step: shells[step].interrupt(held) for step in endings}
        # While the key is held, one more Ctrl-C can arrive at the moment an interpreter exits.
        assert set(statuses.values()) <= ({0, 130} if held else {0}), statuses
    for step, shell in shells.items():
        for trouble in ("Traceback", "core dumped", "Exception"):
            assert trouble not in shell.text, f"{STEPS[step]}:\n{shell.text}"
    for computer in (BASE, "aadi1", "aadi2"):
        left = idle.execute(
            computer, "bash", "-c", "pgrep -af '[c]atkin_ws|[r]os|[r]edis|[r]viz' || true"
        )
        assert not left, f"left on {computer}:\n{left}"


def test_the_fifth_step_says_that_there_is_no_display(idle: Fleet) -> None:
    with closing(Shell(idle.container(BASE))) as shell:
        shell.type(STEPS["5"][1])
        shell.shows("no display here")
        shell.interrupt()
    assert "Qt" not in shell.text


def shows(shell: Shell, step: str, names: dict[str, str]) -> None:
    """Waits for the lines that a step prints once its prerequisites are running."""
    for line in LINES[step]:
        shell.shows(line.format(**names))


def drive(idle: Fleet, stack: ExitStack, robot: str, navigation: Shell) -> None:
    """Sends a robot to a goal as documented, and waits until it arrives."""
    person = stack.enter_context(closing(Shell(idle.container("aadi1"))))
    person.run(
        f"rostopic pub -1 /{robot}/map_goal geometry_msgs/Twist '[{HERE[robot]}, 0.0]' '[0.0, 0.0, 90.0]'"
    )
    navigation.shows("reached waypoint 1")
    # Gateway rules refer to RViz's node by name.
    wait_until(
        lambda: "/rviz" in idle.execute(BASE, "rosnode", "list").split(), "RViz's node", PATIENCE
    )
