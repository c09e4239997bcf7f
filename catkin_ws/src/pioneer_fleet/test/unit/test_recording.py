"""Recordings: messages of several masters are written to one file and replayed unchanged."""

import os
import signal
import subprocess
import sys
import xmlrpc.client
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros1.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from std_msgs.msg import String

from pioneer_fleet.recording.recording import RecordingError, messages_of
from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from tcpros.client import Client
from tcpros.error import TcprosError

TALK = """
import sys, rospy
from std_msgs.msg import String
rospy.init_node("talker", disable_signals=True)
publisher = rospy.Publisher("words", String, queue_size=100, latch=True)
publisher.publish(sys.argv[1])
rospy.spin()
"""


def module(name: str, *words: object) -> list[str]:
    return [sys.executable, "-m", name, *map(str, words)]


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_two_masters_are_recorded_under_their_names_and_replayed_as_one(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"run.{suffix}"
    with Master() as one, Master() as two, ProcessGroup() as group:
        for master, word in ((one, "hello"), (two, "world")):
            group.start("talker", [sys.executable, "-c", TALK, word], master.environment)
        environment = {**one.environment, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        words = module("pioneer_fleet.recording.recorder", path, f"one={one.uri}", f"two={two.uri}")
        recorder = subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)
        # The recorder is connected once it is listed among the talker's subscribers.
        for master in (one, two):
            wait_until(
                lambda m=master: receives(m, "/fleet_recorder"), "the recorder's connection", START
            )  # type: ignore[misc]
        recorder.send_signal(signal.SIGINT)
        said, _ = recorder.communicate(timeout=START)
    assert "0 dropped" in said
    found = {message.topic: message for message in messages_of(path)}
    assert {topic: String().deserialize(one.data).data for topic, one in found.items() if topic.endswith("words")} == {
        "/one/words": "hello", "/two/words": "world",
    }  # fmt: skip
    assert found["/one/words"].kind.latching
    assert opened_by_others(path) == {"/one/words", "/two/words"}
    assert_replayed(path, environment)


def receives(master: Master, name: str) -> bool:
    """Returns whether the talker of a master sends to the node ``name``."""
    try:
        uri = Client(master.uri, "/test").ask_master("lookupNode", "/talker")
        with xmlrpc.client.ServerProxy(uri) as talker:
            return any(
                row[1] == name and row[4] == "/words" for row in talker.getBusInfo("/test")[2]
            )
    except (OSError, TcprosError):
        return False


def opened_by_others(path: Path) -> set[str]:
    """Returns the topics of words that common readers find: rosbags in a bag, the MCAP library in an MCAP file."""
    if path.suffix == ".bag":
        with AnyReader([path]) as reader:
            words = [one for one in reader.connections if one.msgtype == "std_msgs/msg/String"]
            read = [
                (one.topic, reader.deserialize(data, one.msgtype))
                for one, _, data in reader.messages(words)
            ]
    else:
        with path.open("rb") as file:
            found = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
            read = [
                (channel.topic, message)
                for schema, channel, _, message in found
                if schema.name == String._type
            ]
    assert {message.data for _, message in read} == {"hello", "world"}
    return {topic for topic, _ in read}


def assert_replayed(path: Path, environment: dict[str, str]) -> None:
    """Checks that the words are replayed, without the masters' names in their topics."""
    replay = subprocess.Popen(
        module("pioneer_fleet.recording.replay", path, "--stay"),
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert replay.stdout is not None
    uri = replay.stdout.readline().strip().partition("=")[2]
    assert "messages were published" in replay.stdout.readline()
    assert Client(uri, "/test").latched("/replay", "/words", String).data in ("hello", "world")
    replay.send_signal(signal.SIGINT)
    assert replay.wait(START) == 130
    replay.stdout.close()


def test_a_file_that_is_no_recording_is_named(tmp_path: Path) -> None:
    for name in ("a.mcap", "a.bag"):
        (tmp_path / name).write_bytes(b"nothing")
        with pytest.raises(RecordingError, match=f"{name} is not a complete"):
            next(messages_of(tmp_path / name))


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_a_full_disk_is_named_in_one_line(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run.{suffix}"
    path.symlink_to("/dev/full")
    with Master() as master, ProcessGroup() as group:
        group.start("talker", [sys.executable, "-c", TALK, "x"], master.environment)
        environment = {**master.environment, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        words = module("pioneer_fleet.recording.recorder", path, f"one={master.uri}")
        recorder = subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, text=True)
        wait_until(
            lambda: recorder.poll() is not None or receives(master, "/fleet_recorder"),
            "the recorder's connection",
            START,
        )
        recorder.send_signal(signal.SIGINT)
        _, said = recorder.communicate(timeout=START)
    assert recorder.returncode == 1
    assert said.count("\n") == 1
    assert said.startswith(f"cannot write {path} after ")
    assert said.endswith("No space left on device\n")


def test_a_definition_that_is_not_utf8_is_passed_on_with_one_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros1", "another program")
        schema = writer.register_schema("std_msgs/String", "ros1msg", b"string data # gr\xfc\xdfe")
        channel = writer.register_channel("/words", "ros1", schema)
        for time in range(3):
            writer.add_message(channel, time, b"\x01\0\0\0x", time)
        writer.finish()
    assert [message.data for message in messages_of(path)] == [b"\x01\0\0\0x"] * 3
    assert [record.getMessage() for record in caplog.records] == [
        "/words: the definition of std_msgs/String is not UTF-8 (invalid start byte at byte 16) "
        "and is passed on with replacement characters"
    ]


def test_a_name_that_is_not_utf8_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros1", "another program")
        schema = writer.register_schema("std_msgs/String", "ros1msg", b"")
        channel = writer.register_channel("/wordsXX", "ros1", schema)
        writer.add_message(channel, 0, b"", 0)
        writer.finish()
    path.write_bytes(path.read_bytes().replace(b"/wordsXX", b"/words\xff\xff"))
    with pytest.raises(RecordingError, match="utf-8"):
        list(messages_of(path))
