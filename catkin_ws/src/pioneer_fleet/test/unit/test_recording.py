"""Recordings: messages of several masters are written to one file and replayed unchanged."""

import contextlib
import io
import os
import pty
import random
import signal
import struct
import subprocess
import sys
import termios
import xmlrpc.client
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rosbag
import rospy
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros1.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from pioneer_fleet.recording import replay
from pioneer_fleet.recording.recording import (
    Kind,
    McapFile,
    Message,
    RecordingError,
    is_complete,
    messages_of,
    topics_of,
)
from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from tcpros.client import Client, Connection
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


def receives(master: Master, name: str, talker_name: str = "/talker") -> bool:
    """Returns whether the talker of a master sends to a node whose name begins with ``name``."""
    try:
        uri = Client(master.uri, "/test").ask_master("lookupNode", talker_name)
        with xmlrpc.client.ServerProxy(uri) as talker:
            return any(
                row[1].startswith(name) and row[4] == "/words"
                for row in talker.getBusInfo("/test")[2]
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
    running = subprocess.Popen(
        module("pioneer_fleet.recording.replay", path, "--stay"),
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert running.stdout is not None
    uri = running.stdout.readline().strip().partition("=")[2]
    assert "messages were published" in running.stdout.readline()
    assert Client(uri, "/test").latched("/replay", "/words", String).data in ("hello", "world")
    running.send_signal(signal.SIGINT)
    assert running.wait(START) == 130
    running.stdout.close()


SENDER = """
import sys, rospy
from std_msgs.msg import String
rospy.init_node(sys.argv[1], disable_signals=True)
publisher = rospy.Publisher("words", String, queue_size=100, latch=True)
publisher.publish(sys.argv[1])
rospy.spin()
"""


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_a_late_subscriber_of_a_replay_gets_what_each_sender_has_latched(
    tmp_path: Path, suffix: str
) -> None:
    """As /tf_static, on which each robot's node latches the robot's own transforms."""
    path = tmp_path / f"run.{suffix}"
    names = ("one", "two", "three")
    with Master() as master, ProcessGroup() as group:
        for name in names:
            group.start(name, [sys.executable, "-c", SENDER, name], master.environment)
        wait_until(lambda: publishers(master, "/words") == set(names), "the senders", START)
        environment = with_path(master)
        words = module("pioneer_fleet.recording.recorder", path, f"base={master.uri}")
        recorder = subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)
        for name in names:
            wait_until(
                lambda n=name: receives(master, "/fleet_recorder", f"/{n}"),  # type: ignore[misc]
                "the recorder's connections",
                START,
            )
        recorder.send_signal(signal.SIGINT)
        recorder.communicate(timeout=START)
    senders = {one.kind.sender for one in messages_of(path) if one.topic == "/base/words"}
    assert senders == {f"/{name}" for name in names}
    with replayed(path, environment, "--stay") as replaying:
        uri = uri_of(replaying)
        assert "messages were published" in replaying.stdout.readline()
        with Client(uri, "/late").subscribe("/replay", "/words") as connection:
            heard = {String().deserialize(connection.read_frame()).data for _ in names}
    assert heard == set(names)


def test_two_recorders_at_once_each_have_all_messages(tmp_path: Path) -> None:
    """The page's button while --record is on."""
    paths = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    with Master() as master, ProcessGroup() as group:
        group.start("counter", [sys.executable, "-c", COUNT], master.environment)
        wait_until(lambda: publishers(master, "/numbers") == {"counter"}, "the sender", START)
        recorders = [
            subprocess.Popen(
                module("pioneer_fleet.recording.recorder", path, f"base={master.uri}"),
                env=with_path(master),
                stdout=subprocess.PIPE,
                text=True,
            )
            for path in paths
        ]

        def listeners() -> int:
            with xmlrpc.client.ServerProxy(node_uri(master, "/counter")) as counter:
                rows = counter.getBusInfo("/test")[2]
            return len({row[1] for row in rows if row[4] == "/numbers"})

        wait_until(lambda: listeners() == len(paths), "both recorders", START)
        with Client(master.uri, "/test").subscribe("/counter", "/numbers") as connection:
            first = int(String().deserialize(connection.read_frame()).data)
            while int(String().deserialize(connection.read_frame()).data) < first + 200:
                pass
        for recorder in recorders:
            recorder.send_signal(signal.SIGINT)
        told = [recorder.communicate(timeout=START)[0] for recorder in recorders]
    assert all("0 dropped" in line for line in told)
    for path in paths:
        found = [
            int(String().deserialize(one.data).data)
            for one in messages_of(path)
            if one.topic == "/base/numbers"
        ]
        assert found == list(range(found[0], found[-1] + 1))
        assert found[0] <= first
        assert found[-1] >= first + 200


COUNT = """
import itertools, os, rospy, sys
from std_msgs.msg import String
rospy.init_node("counter", disable_signals=True)
length = int((sys.argv[1:] or [0])[0])
publisher = rospy.Publisher("numbers", String, queue_size=100)
rate = rospy.Rate(200)
for number in itertools.count():
    # What repeats is compressed to nothing.
    publisher.publish(f"{number} {os.urandom(length // 2).hex()}")
    rate.sleep()
"""


def with_path(master: Master) -> dict[str, str]:
    """Returns an environment in which a master's programs find our modules."""
    return {**master.environment, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


def node_uri(master: Master, name: str) -> str:
    return str(Client(master.uri, "/test").ask_master("lookupNode", name))


def publishers(master: Master, topic: str) -> set[str]:
    """Returns the names of the nodes that publish a topic, without their first slash."""
    published, _, _ = Client(master.uri, "/test").ask_master("getSystemState")
    return {node[1:] for name, nodes in published if name == topic for node in nodes}


@contextlib.contextmanager
def replayed(
    path: Path, environment: dict[str, str], *options: str
) -> Iterator[subprocess.Popen[str]]:
    """Starts a replay and interrupts it at the end."""
    words = module("pioneer_fleet.recording.replay", path, *options)
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) as running:
        try:
            yield running
        finally:
            running.send_signal(signal.SIGINT)
            running.wait(START)


def uri_of(running: subprocess.Popen[str]) -> str:
    """Returns the address of a replay's master, which is its first line."""
    assert running.stdout is not None
    return running.stdout.readline().strip().partition("=")[2]


@pytest.fixture
def numbers(tmp_path: Path) -> Path:
    """Returns a recording of 5 s with a number each second, and the clock at half of real time."""
    path = tmp_path / "numbers.mcap"
    kind = Kind(String._type, String._md5sum, String._full_text, latching=False, sender="/a")
    clock = Kind(Clock._type, Clock._md5sum, Clock._full_text, latching=False, sender="/b")
    file = McapFile(path)
    for second in range(6):
        moment = (1000 + second) * 10**9
        file.add(Message("/base/clock", clock, moment, struct.pack("<II", second // 2, 0)))
        file.add(Message("/base/numbers", kind, moment, serialized(String(str(second)))))
    file.close()
    return path


def serialized(message: Any) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def test_a_replay_sets_use_sim_time_and_begins_where_it_is_told(numbers: Path) -> None:
    with Master() as master:
        environment = with_path(master)
    options = ("--start", "4", "--stay", "--topics", "/numbers", "/clock")
    with replayed(numbers, environment, *options) as running:
        uri = uri_of(running)
        assert running.stdout.readline() == "4 messages were published\n"
        assert Client(uri, "/test").ask_master("getParam", "/use_sim_time") is True
    with replayed(numbers, environment, "--topics", "/numbers", "--rate", "100") as running:
        uri_of(running)
        assert running.stdout.readline() == "6 messages were published\n"


def test_a_replay_loops_until_ctrl_c(numbers: Path) -> None:
    with Master() as master:
        environment = with_path(master)
    with replayed(numbers, environment, "--loop", "--rate", "20") as running:
        client = Client(uri_of(running), "/test")
        connection = wait_until(lambda: subscription(client, "/numbers"), "the topic", START)
        with connection:
            heard = [int(String().deserialize(connection.read_frame()).data) for _ in range(13)]
        running.send_signal(signal.SIGINT)
        assert running.wait(START) == 130
    first = heard[0]
    assert heard == [(first + step) % 6 for step in range(13)]


def test_the_space_bar_pauses_a_replay_and_continues_it(numbers: Path) -> None:
    with Master() as master:
        environment = with_path(master)
    ours, its = pty.openpty()
    before = termios.tcgetattr(its)
    words = module("pioneer_fleet.recording.replay", numbers, "--rate", "10")
    with subprocess.Popen(
        words, env=environment, stdin=its, stdout=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        assert "space bar" in "".join(running.stdout.readline() for _ in range(2))
        os.write(ours, b" ")
        assert running.stdout.readline() == "paused\n"
        with pytest.raises(subprocess.TimeoutExpired):
            running.wait(2.0)
        os.write(ours, b" ")
        assert running.stdout.readline() == "continued\n"
        assert running.stdout.readline() == "12 messages were published\n"
        assert running.wait(START) == 0
    assert termios.tcgetattr(its) == before
    os.close(ours)
    os.close(its)


def subscription(client: Client, topic: str) -> Connection | None:
    """Returns a connection to the replay's publisher of a topic; None while there is none."""
    try:
        return client.subscribe("/replay", topic)
    except (OSError, TcprosError):
        return None


def test_a_file_that_is_no_recording_is_named(tmp_path: Path) -> None:
    for name in ("a.mcap", "a.bag"):
        (tmp_path / name).write_bytes(b"nothing")
        with pytest.raises(RecordingError, match=f"{name} is not a complete"):
            next(messages_of(tmp_path / name))


def test_a_replay_looks_at_the_file_before_it_starts_a_master(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.mcap", "a.bag"):
        (tmp_path / name).write_bytes(b"nothing")
        assert replay.main([str(tmp_path / name)]) == 1
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.startswith(f"pioneer replay: {tmp_path / name} is not a complete ")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Returns the folder of a file system of 64 KB."""
    yield from mounted(tmp_path / "disk", "64k")


@pytest.fixture
def large_disk(tmp_path: Path) -> Iterator[Path]:
    """Returns the folder of a file system of 20 MB."""
    yield from mounted(tmp_path / "disk", "20m")


def mounted(disk: Path, size: str) -> Iterator[Path]:
    """Mounts a file system in memory."""
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_a_file_that_takes_no_byte_is_named_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.symlink_to("/dev/full")
    said = recorded_in_vain(path)
    assert said.startswith(f"cannot write {path} after ")
    assert said.endswith("No space left on device\n")


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_a_recorder_on_a_full_disk_leaves_the_rest_to_others(small_disk: Path, suffix: str) -> None:
    path = small_disk / f"run.{suffix}"
    said = recorded_in_vain(path)
    assert said == f"{path} ends after 0 messages: its disk has less than 16 MB free\n"
    assert not path.exists()


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_a_recording_is_complete_when_the_disk_gets_full_meanwhile(
    large_disk: Path, suffix: str
) -> None:
    path = large_disk / f"run.{suffix}"
    with Master() as master, ProcessGroup() as group:
        group.start("counter", [sys.executable, "-c", COUNT], master.environment)
        words = module("pioneer_fleet.recording.recorder", path, f"base={master.uri}")
        with subprocess.Popen(
            words, env=with_path(master), stderr=subprocess.PIPE, text=True
        ) as recorder:
            wait_until(lambda: bool(numbers_in(path)), "some numbers on the disk", START)
            (large_disk / "filler").write_bytes(bytes(6 * 2**20))
            _, said = recorder.communicate(timeout=START)
    assert recorder.returncode == 1
    assert said.startswith(f"{path} ends after ")
    assert said.endswith(" messages: its disk has less than 16 MB free\n")
    assert is_complete(path)
    found = numbers_in(path)
    assert found == list(range(found[0], found[-1] + 1))


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_a_recording_has_the_chosen_topics_and_continues_in_new_files(
    tmp_path: Path, suffix: str
) -> None:
    """Each file has what was latched before, so that it can be played by itself."""
    path = tmp_path / f"run.{suffix}"
    parts = [path, *(tmp_path / f"run-{number}.{suffix}" for number in (2, 3))]
    with Master() as master, ProcessGroup() as group:
        group.start("talker", [sys.executable, "-c", TALK, "latched"], master.environment)
        group.start("counter", [sys.executable, "-c", COUNT, "20000"], master.environment)
        options = ("--topics=/numbers", "--topics=/base/wor*", "--split=1")
        words = module("pioneer_fleet.recording.recorder", path, f"base={master.uri}", *options)
        with subprocess.Popen(
            words, env=with_path(master), stdout=subprocess.PIPE, text=True
        ) as recorder:
            wait_until(parts[-1].exists, "a third file", START)
            recorder.send_signal(signal.SIGINT)
            said, _ = recorder.communicate(timeout=START)
    assert " 0 dropped" in said
    assert all(is_complete(part) for part in parts)
    found = [number for part in parts for number in numbers_in(part)]
    assert found == list(range(found[0], found[-1] + 1))
    for part in parts:
        messages = list(messages_of(part))
        assert {one.topic for one in messages} - {"/base/numbers"} == {"/base/words"}
        latched = [one for one in messages if one.kind.latching]
        assert [String().deserialize(one.data).data for one in latched] == ["latched"]


@pytest.mark.parametrize("suffix", ["mcap", "bag"])
def test_a_killed_recorder_loses_what_came_in_its_last_second(
    tmp_path: Path, suffix: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / f"run.{suffix}"
    with Master() as master, ProcessGroup() as group:
        group.start("counter", [sys.executable, "-c", COUNT], master.environment)
        words = module("pioneer_fleet.recording.recorder", path, f"base={master.uri}")
        with subprocess.Popen(words, env=with_path(master), stdout=subprocess.PIPE) as recorder:
            wait_until(lambda: len(numbers_in(path)) > 100, "some seconds", START)
            recorder.kill()
    caplog.clear()
    found = numbers_in(path)
    assert len(found) > 100
    assert found == list(range(found[0], found[-1] + 1))
    said = [record.getMessage() for record in caplog.records]
    assert (
        said[0]
        == f"{path} is incomplete: what can be read is used (--repair NEW writes it to a new file)"
    )
    assert said[1].startswith(f"{path}: it was not completed: what was recorded after ")
    new = tmp_path / f"new.{'bag' if suffix == 'mcap' else 'mcap'}"
    assert replay.main([str(path), "--repair", str(new)]) == 0
    assert is_complete(new)
    assert numbers_in(new) == found


def numbers_in(path: Path) -> list[int]:
    """Returns the counter's numbers in a recording; none if there is no recording yet."""
    try:
        return [
            int(String().deserialize(one.data).data.split()[0])
            for one in messages_of(path)
            if one.topic == "/base/numbers"
        ]
    except (OSError, RecordingError):
        return []


def recorded_in_vain(path: Path) -> str:
    """Returns what a recorder says whose disk is full, which is one line."""
    with Master() as master, ProcessGroup() as group:
        group.start("talker", [sys.executable, "-c", TALK, "x"], master.environment)
        words = module("pioneer_fleet.recording.recorder", path, f"one={master.uri}")
        recorder = subprocess.Popen(words, env=with_path(master), stderr=subprocess.PIPE, text=True)
        wait_until(
            lambda: recorder.poll() is not None or receives(master, "/fleet_recorder"),
            "the recorder's connection",
            START,
        )
        recorder.send_signal(signal.SIGINT)
        _, said = recorder.communicate(timeout=START)
    assert recorder.returncode == 1
    assert said.count("\n") == 1
    return said


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


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_an_error_of_a_damaged_bag_names_its_file(tmp_path: Path, compression: str) -> None:
    """Errors of the decompression came through without it."""
    path = tmp_path / "run.bag"
    drawn = random.Random(5)
    with rosbag.Bag(str(path), "w", compression, chunk_threshold=400) as written:
        for number in range(100):
            text = String(str(drawn.random()))
            written.write(f"/topic{number % 3}", text, rospy.Time(1000 + number))
    whole = path.read_bytes()
    faults = []
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[drawn.randrange(13, len(whole))] ^= 1 << drawn.randrange(8)
        path.write_bytes(damaged)
        for read in (lambda: list(messages_of(path)), lambda: topics_of(path)):
            try:
                read()
            except RecordingError as error:
                faults.append(str(error))
    assert len(faults) > 20
    assert all(line.startswith(f"{path} is not a complete bag: ") for line in faults)
