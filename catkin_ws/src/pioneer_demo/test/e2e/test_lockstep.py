"""Demos in lockstep: the same bytes, whatever else the machine does, recorded or not."""

import json
import subprocess
import sys

from rosbags.highlevel import AnyReader

from pioneer_harness.proc import processors

_WHOLE = 300.0
_SAME = ("ground_truth.csv", "commands.csv", "report.json")


def test_two_runs_in_lockstep_are_equal_byte_by_byte_one_beside_a_busy_machine(start, tmp_path):
    recording = tmp_path / "run.bag"

    def run(*options):
        demo = start("--lockstep", "--robots", 2, "--waypoints", 1, "--world", "small_world", "--seed", 4, *options)
        assert demo.process.wait(_WHOLE) == 0, demo.text()
        return {name: (demo.report / name).read_bytes() for name in _SAME}

    alone = run()
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(round(processors()) or 1)]
    try:
        beside = run("--record", recording)
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()
    assert [name for name in _SAME if alone[name] != beside[name]] == []
    assert alone["commands.csv"].count(b"\n") > 100
    assert json.loads(alone["report.json"])["success"]
    assert_opens(recording)


def assert_opens(bag):
    """rosbags, as PyPI has it, reads the bag: each computer's messages, where they were published."""
    with AnyReader([bag]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        scans = [one for one in reader.connections if one.topic == "/base/pioneer1/base_scan"]
        connection, _, data = next(reader.messages(connections=scans))
        assert len(reader.deserialize(data, connection.msgtype).ranges) == 180
    assert all(counts[f"/aadi{number}/pioneer{number}/amcl_pose"] for number in (1, 2))
    assert not any(topic.endswith("/clock") for topic in counts if topic != "/base/clock"), "not what gateways carry"
