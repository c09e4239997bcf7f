"""Demos in lockstep give identical bytes, whatever the load of machine and links, with and without recording."""

import json
import os
import re
import signal
import subprocess
import sys

from rosbags.highlevel import AnyReader

from pioneer_harness.masters import MasterClient
from pioneer_harness.proc import has_variable, processors
from pioneer_harness.wait import wait_until

_WHOLE = 300.0
_SAME = ("ground_truth.csv", "commands.csv", "report.json")


def test_runs_in_lockstep_are_equal_byte_by_byte_beside_a_busy_machine_and_across_a_lost_link(
    start, tmp_path
):
    recording = tmp_path / "run.bag"

    def run(*options, meanwhile=lambda demo: None):
        words = (
            "--lockstep",
            "--traffic",
            "--robots",
            2,
            "--waypoints",
            2,
            "--world",
            "small_world",
            "--seed",
            4,
        )
        demo = start(*words, *options)
        meanwhile(demo)
        assert demo.process.wait(_WHOLE) == 0, demo.text()
        return {name: (demo.report / name).read_bytes() for name in _SAME}

    alone = run()
    hogs = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(round(processors()) or 1)
    ]
    try:
        beside = run("--record", recording)
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()
    cut = run(meanwhile=cut_link)
    assert [name for name in _SAME if not alone[name] == beside[name] == cut[name]] == []
    assert alone["commands.csv"].count(b"\n") > 100
    assert json.loads(alone["report.json"])["success"]
    assert_opens(recording)


def test_faults_come_in_the_same_period_of_each_run_and_change_the_same_bytes(start, tmp_path):
    scenario = tmp_path / "faults.yaml"
    scenario.write_text(
        "world: small_world\n"
        "lockstep: true\n"
        "robots:\n"
        "  - goals: [[-4.0, 1.5]]\n"
        "  - goals: [[1.5, 1.3]]\n"
        "faults:\n"
        "  - {at: 0.2, move: pioneer2, to: [3.9, 3.5, 180.0]}\n"
        "  - {at: 0.5, kill: pioneer1, lasts: 1}\n"
        "  - {at: 0.7, kill: hub, lasts: 1}\n"
        "  - {at: 1.0, door: [0.0, 0.0, 90.0, 1.0], lasts: 1}\n"
        "  - {at: 2.0, blind: pioneer2, lasts: 1}\n"
        "  - {at: 3.5, freeze: base station, lasts: 1}\n"
    )

    def run():
        demo = start(scenario, command="run-scenario")
        assert demo.process.wait(_WHOLE) == 0, demo.text()
        assert demo.text().count(" s: over: ") == 5
        return {name: (demo.report / name).read_text() for name in _SAME}

    first, again = run(), run()
    assert [name for name in _SAME if first[name] != again[name]] == []
    commands = [line.split(",") for line in first["commands.csv"].splitlines()[1:]]
    driven = {
        robot: [float(time) for time, name, *_ in commands if name == robot]
        for robot in ("pioneer1", "pioneer2")
    }
    assert not [time for time in driven["pioneer1"] if 3.56 < time <= 4.7], (
        "its computer is off, and waits for the hub"
    )
    assert not [time for times in driven.values() for time in times if 6.56 < time <= 7.5], (
        "nothing crosses"
    )


def cut_link(demo):
    """Suspends a robot's gateway while the robot drives, until the base station drops its links."""
    demo.await_words("waypoints  [", _WHOLE)  # waypoints are being sent now
    running = demo.processes().items()
    (gateway,) = (
        pid
        for pid, line in running
        if "__name:=gateway" in line and has_variable(pid, "ROBOT_NAME", "pioneer1")
    )
    port = re.search(r"Hub_Gateway (\d+)", demo.text())[1]
    master = MasterClient(f"http://127.0.0.1:{port}/")

    def linked():
        return "/pioneer1/lockstep/done" in master.system_state()[0]

    assert linked()
    os.kill(gateway, signal.SIGSTOP)
    try:
        wait_until(lambda: not linked(), "the link's end", 60.0)
    finally:
        os.kill(gateway, signal.SIGCONT)
        master.close_clients()


def assert_opens(bag):
    """Checks that the rosbags package reads each computer's messages, under the computer that published them."""
    with AnyReader([bag]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        scans = [one for one in reader.connections if one.topic == "/base/pioneer1/base_scan"]
        connection, _, data = next(reader.messages(connections=scans))
        assert len(reader.deserialize(data, connection.msgtype).ranges) == 180
    assert all(counts[f"/aadi{number}/pioneer{number}/amcl_pose"] for number in (1, 2))
    assert not any(topic.endswith("/clock") for topic in counts if topic != "/base/clock"), (
        "not what gateways carry"
    )
