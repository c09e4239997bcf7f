"""Complete demos, run by the demo's own command: success, Ctrl-C at two moments, a node that dies, two in parallel."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import rospkg
from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory

_START_UP, _WHOLE = 120.0, 300.0


def assert_all_gone(demo):
    assert demo.processes() == {}


def test_two_robots_reach_their_waypoints_through_the_gateways_and_are_filmed(start, tmp_path):
    film, recording = tmp_path / "run.mp4", tmp_path / "run.mcap"
    demo = start(
        "--robots", 2, "--waypoints", 1, "--seed", 4, "--video", film, "--record", recording
    )
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
    assert_quiet(demo)
    assert_opens(recording)


def assert_opens(recording):
    """Checks that the MCAP library finds each computer's messages once, under the computer that published them."""
    with recording.open("rb") as file:
        summary = make_reader(file).get_summary()
        counts = {
            one.topic: summary.statistics.channel_message_counts[key]
            for key, one in summary.channels.items()
        }
        decoded = make_reader(file, decoder_factories=[DecoderFactory()])
        *_, scan = next(decoded.iter_decoded_messages(topics=["/base/pioneer1/base_scan"]))
    assert len(scan.ranges) == 180
    assert counts["/base/clock"] > 500
    assert all(counts[f"/aadi{number}/pioneer{number}/amcl_pose"] for number in (1, 2))
    assert not any(topic.endswith("/clock") for topic in counts if topic != "/base/clock"), (
        "not what gateways carry"
    )


def assert_quiet(demo):
    """Checks that neither the screen nor the output of the fleet's processes contains meaningless noise."""
    printed = {path.name: path.read_text() for path in (demo.report / "log").glob("*.log")}
    assert {"hub.log", "simulator.log", "navigation-of-pioneer1.log"} <= set(printed)
    for name, text in {**printed, "the screen": demo.text()}.items():
        for noise in ("SUMMARY", "build time", "trying on", "media_export", "1 robots"):
            assert noise not in text, f"'{noise}' in {name}"


def seconds_of(film):
    command = [
        "ffprobe",
        "-v",
        "error",
        "-show_entries",
        "format=duration",
        "-of",
        "csv=p=0",
        str(film),
    ]
    return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


def interrupted_after(demo, words, timeout, number=signal.SIGINT):
    demo.await_words(words, timeout)
    demo.interrupt(number)


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
    """Returns a world file that is not one of pioneer_gazebo's and has no map."""
    worlds = Path(rospkg.RosPack().get_path("pioneer_gazebo")) / "worlds"
    return Path(shutil.copy(worlds / "closed_maze.world", tmp_path / "my own.world"))


def test_a_demo_in_ones_own_world_wants_its_map_and_one_beside_it_takes_other_ports(
    start, own_world
):
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
    command = [
        sys.executable,
        "-m",
        "pioneer_demo",
        "demo",
        "--robots",
        "0",
        "--report",
        str(tmp_path / "report"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert not Path(tmp_path / "report").exists()
