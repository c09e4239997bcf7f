"""Whole demos, by the demo's own command: a success, Ctrl-C at two moments, a node that dies, two side by side."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rospkg

from pioneer_harness.proc import arguments, has_variable, process_states
from pioneer_harness.wait import wait_until

_MARK = "PIONEER_DEMO_TEST"
_START_UP, _WHOLE, _CTRL_C = 120.0, 300.0, 5.0
_FOREIGN = {"ROS_NAMESPACE": "/elsewhere", "ROS_HOSTNAME": "no-such-host.invalid", "GATEWAY_NETWORK_INTERFACE": "eth9"}
"""What a user's shell may hold for another fleet: every demo here runs with it."""


class RunningDemo:
    """A demo in a session of its own, with a mark in its environment by which everything it starts can be found."""

    def __init__(self, report, *options):
        self.report = report
        self.mark = str(report)
        self.output = report.with_suffix(".txt")
        environment = {
            **os.environ,
            **_FOREIGN,
            _MARK: self.mark,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        }
        command = [sys.executable, "-m", "pioneer_demo", "--report", str(report), *map(str, options)]
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                command, env=environment, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )

    def text(self):
        return self.output.read_text(errors="replace")

    def processes(self):
        """Returns the command lines of everything alive that carries the mark, by pid."""
        marked = (pid for pid, state in process_states().items() if state.alive and has_variable(pid, _MARK, self.mark))
        return {pid: " ".join(arguments(pid)) for pid in marked}

    def await_words(self, words, timeout):
        def said():
            assert self.process.poll() is None, f"the demo ended too early:\n{self.text()}"
            return words in self.text()

        wait_until(said, f"'{words}' in the demo's output", timeout)

    def end(self):
        for pid in self.processes():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.process.wait()


@pytest.fixture
def start(tmp_path):
    demos = []

    def begin(*options):
        demos.append(RunningDemo(tmp_path / f"report{len(demos)}", *options))
        return demos[-1]

    yield begin
    for demo in demos:
        demo.end()


def assert_all_gone(demo):
    assert demo.processes() == {}


def test_two_robots_reach_their_waypoints_through_the_gateways_and_are_filmed(start, tmp_path):
    film = tmp_path / "run.mp4"
    demo = start("--robots", 2, "--waypoints", 1, "--seed", 4, "--video", film)
    assert demo.process.wait(_WHOLE) == 0, demo.text()
    assert_all_gone(demo)
    numbers = json.loads((demo.report / "report.json").read_text())
    assert numbers["success"]
    assert set(numbers["robots"]) == {"pioneer1", "pioneer2"}
    for robot in numbers["robots"].values():
        assert robot["reached"] == robot["waypoints"] == 1
        assert robot["collisions"] == 0
        assert robot["localisation_error"]["samples"] > 20
        assert robot["localisation_error"]["mean"] <= 0.15
        assert robot["visits"][0]["true_distance"] <= 0.6
        assert robot["path_length"] >= 0.7 * robot["visits"][0]["shortest_way"] - 0.5
    assert {"simulator", "gateways", "amcl", "move_base", "masters"} <= set(numbers["processes"])
    assert numbers["processes"]["masters"]["count"] >= 4
    assert (demo.report / "fleet.png").stat().st_size > 10_000
    assert 0.0 <= seconds_of(film) - numbers["drive"]["simulated_seconds"] < 120.0, (
        "from the robots' first sight to the end"
    )


def seconds_of(film):
    command = ["ffprobe", "-v", "error", "-show_entries", "format=duration", "-of", "csv=p=0", str(film)]
    return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


def interrupted_after(demo, words, timeout, number=signal.SIGINT):
    demo.await_words(words, timeout)
    demo.process.send_signal(number)
    began = time.monotonic()
    assert demo.process.wait(3 * _CTRL_C) == 128 + number, demo.text()
    assert time.monotonic() - began <= _CTRL_C
    assert_all_gone(demo)
    # After SIGHUP the terminal is gone, and nothing may be written to it.
    assert ("every process of this demo has ended" in demo.text()) == (number != signal.SIGHUP)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGQUIT, signal.SIGHUP])
def test_a_signal_during_start_up_leaves_no_process(start, number):
    interrupted_after(start("--robots", 2), "waiting for", 30.0, number)


def test_ctrl_c_while_driving_leaves_no_process(start):
    interrupted_after(start("--robots", 1, "--waypoints", 3), "m to go", _START_UP)


def test_a_move_base_that_dies_is_named_and_ends_the_demo(start):
    demo = start("--robots", 1, "--waypoints", 3)
    demo.await_words("m to go", _START_UP)
    victims = [pid for pid, line in demo.processes().items() if "__name:=move_base" in line]
    assert len(victims) == 1
    os.kill(victims[0], signal.SIGKILL)
    assert demo.process.wait(30.0) == 1, demo.text()
    assert "move_base" in demo.text()
    assert "has died" in demo.text()
    assert_all_gone(demo)
    assert not json.loads((demo.report / "report.json").read_text())["success"]


@pytest.fixture
def own_world(tmp_path):
    """A world that is not pioneer_gazebo's, without a map."""
    worlds = Path(rospkg.RosPack().get_path("pioneer_gazebo")) / "worlds"
    return Path(shutil.copy(worlds / "closed_maze.world", tmp_path / "my own.world"))


def test_a_demo_in_ones_own_world_wants_its_map_and_one_beside_it_takes_other_ports(start, own_world):
    lacking = start("--world", own_world)
    assert lacking.process.wait(60.0) == 2
    (line,) = lacking.text().splitlines()
    draw = line.partition("draw it: ./pioneer run ")[2]
    subprocess.run(shlex.split(draw), check=True, timeout=60, capture_output=True)

    first = start("--world", own_world, "--robots", 1, "--waypoints", 1)
    first.await_words("waiting for", 30.0)
    second = start("--robots", 1)
    interrupted_after(second, "waiting for", 30.0)
    assert first.process.poll() is None
    ports = {demo.text().split("\n")[0] for demo in (first, second)}
    assert len(ports) == 2
    assert first.process.wait(_WHOLE) == 0, first.text()


def test_a_bad_argument_is_one_line_and_starts_nothing(tmp_path):
    command = [sys.executable, "-m", "pioneer_demo", "--robots", "0", "--report", str(tmp_path / "report")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert not Path(tmp_path / "report").exists()
