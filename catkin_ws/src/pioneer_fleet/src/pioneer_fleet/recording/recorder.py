"""``python3 -m pioneer_fleet.recording.recorder FILE NAME=URI …``: records the topics of several masters in one file.

Each message is recorded once, on the master of the node that publishes it, not where gateways forward it. Topics are
prefixed with the name of their master: ``/aadi1/pioneer1/amcl_pose``. Messages are written in serialised form.
"""

import argparse
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from rosgraph.names import anonymous_name

from pioneer_fleet.recording.disk import RESERVE, free_name, has_room
from pioneer_fleet.recording.recording import Kind, Message, RecordingError, writer_of
from pioneer_fleet.recording.selection import is_chosen
from pioneer_node.adapters.end_request import EndRequest
from rocon_relay.connection import is_proxy_uri
from tcpros.client import Client, Connection
from tcpros.error import TcprosError

NAME = "fleet_recorder"
"""Name of the recorder's node, without what tells it from other recorders."""
_LOOK = 1.0
"""Poll interval for new publishers [s]."""
_LEFT_OUT = "/rosout_agg"
"""Suffix of topics to skip because they only repeat other topics."""
_WAITING = 20_000
"""Write queue size [messages]; when it is full, new messages are dropped and counted."""
_FLUSH = 1.0
"""Interval at which messages are written to the disk [s]: a recorder that is killed loses at most those of so long."""
_FIRST = 0.5
"""Longest time at the end to wait for the latched messages that publishers send to a new subscriber [s]."""
_DRAIN = 2.0
"""Longest time at the end to read messages that have arrived, but have not been read yet [s]."""


class FullDiskError(RecordingError):
    """The disk has no room for more."""


class _Receiver:
    """A thread that receives the messages of one publisher of one topic.

    Args:
        connection: the connection to the publisher.
        take: is called with each message.
        closed: is called when the connection has ended.
    """

    def __init__(
        self, connection: Connection, take: Callable[[bytes], None], closed: Callable[[], None]
    ) -> None:
        self._connection = connection
        self._take = take
        self._closed = closed
        self._thread = threading.Thread(target=self._run, name="receiver", daemon=True)
        self._is_complete = threading.Event()
        """Set unless a latched message may be on its way."""
        if connection.header.get("latching") != "1":
            self._is_complete.set()
        connection.be_patient()

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def wait_for_latched(self, timeout: float) -> None:
        """Waits until a latching publisher has sent a message, at most ``timeout`` seconds."""
        self._is_complete.wait(timeout)

    def finish(self) -> None:
        """Makes the thread end once it has read the messages that have arrived until now."""
        self._connection.finish()

    def join(self, timeout: float) -> None:
        """Waits for the end of the thread, at most ``timeout`` seconds."""
        self._thread.join(timeout)

    def _run(self) -> None:
        try:
            with self._connection:
                while True:
                    self._take(self._connection.read_frame())
                    self._is_complete.set()
        except OSError:
            self._is_complete.set()
            self._closed()


class Recorder:
    """Records all publishers of several masters until `end` is called.

    Threads: one polls for publishers, one writes; one per publisher receives its messages.
    """

    def __init__(
        self, path: Path, masters: Mapping[str, str], topics: Sequence[str] = (), split: int = 0
    ) -> None:
        """Creates the file.

        Args:
            path: the file, a bag if its suffix is ``.bag``, else in MCAP.
            masters: master URIs by name.
            topics: shell patterns for names of topics, with their masters' names or without; empty for all.
            split: size at which the recording continues in a new file [bytes]; 0 for never.
        """
        self._topics = topics
        self._split = split
        self._repeated = (
            0  # size of what the file begins with: the latched messages of the one before
        )
        self._latched: dict[tuple[str, str], Message] = {}
        # A publisher closes the connection of one subscriber when another one of the same name connects.
        own_name = "/" + anonymous_name(NAME)
        self._masters = {name: Client(uri, own_name) for name, uri in masters.items()}
        self._first = path
        self._path = path
        self._writer = writer_of(path)
        self._proxies: set[tuple[str, str]] = set()
        self._waiting: queue.Queue[Message | None] = queue.Queue(_WAITING)
        self._end = threading.Event()
        self._polling = threading.Thread(target=self._look, name="publishers", daemon=True)
        self._receivers: dict[tuple[str, str, str], _Receiver] = {}
        self.written = self.dropped = 0

    def run(self) -> None:
        """Records until `end` is called, then finishes the file.

        Raises:
            FullDiskError: the disk has got full; the file is finished.
            OSError: the file cannot be written.
        """
        self._polling.start()
        flushed = time.monotonic()
        while True:
            now = time.monotonic()
            if now - flushed >= _FLUSH:
                flushed = now
                self._writer.flush()
                if not has_room(self._path.parent):
                    self._writer.close()
                    raise FullDiskError
                size = self._path.stat().st_size - self._repeated
                if self._split and size >= self._split:
                    self._continue_in_a_new_file()
            try:
                message = self._waiting.get(timeout=max(0.0, flushed + _FLUSH - now))
            except queue.Empty:
                continue
            if message is None:
                break
            self._writer.add(message)
            self.written += 1
            if self._split and message.kind.latching:
                self._latched[message.topic, message.kind.sender] = message
        self._writer.close()

    def _continue_in_a_new_file(self) -> None:
        """Completes the file and begins the next one, with what is latched, so that it can be played by itself."""
        self._writer.close()
        self._path = free_name(self._first)
        self._writer = writer_of(self._path)
        now = time.time_ns()
        for message in self._latched.values():
            self._writer.add(message._replace(time=now))
        self._writer.flush()
        self._repeated = self._path.stat().st_size

    def end(self) -> None:
        """Makes `run` return after writing the messages that have arrived so far, read or not.

        The last messages of a publisher that never stops are bounded by `_DRAIN`.
        """
        self._end.set()
        # A subscription may be under way: its publisher already sends to it.
        if self._polling.is_alive():
            self._polling.join(_DRAIN)
        receivers = list(self._receivers.values())
        latched_by = time.monotonic() + _FIRST
        for receiver in receivers:
            receiver.wait_for_latched(max(0.0, latched_by - time.monotonic()))
        drained_by = time.monotonic() + _DRAIN
        for receiver in receivers:
            receiver.finish()
        for receiver in receivers:
            receiver.join(max(0.0, drained_by - time.monotonic()))
        self._waiting.put(None)

    def _look(self) -> None:
        while not self._end.is_set():
            for name, client in self._masters.items():
                try:
                    publishers, _, _ = client.ask_master("getSystemState")
                except (OSError, TcprosError):
                    continue  # not running yet, or no longer
                for topic, nodes in publishers:
                    for node in nodes:
                        if topic.endswith(_LEFT_OUT) or not is_chosen(
                            f"/{name}{topic}", self._topics
                        ):
                            continue
                        if not self._end.is_set():
                            self._connect(name, client, topic, node)
            self._end.wait(_LOOK)

    def _connect(self, name: str, client: Client, topic: str, node: str) -> None:
        key = (name, topic, node)
        if key in self._receivers or (name, node) in self._proxies:
            return
        try:
            if is_proxy_uri(str(client.ask_master("lookupNode", node))):
                self._proxies.add((name, node))
                return
            connection = client.subscribe(node, topic)
        except (OSError, TcprosError):
            return  # the publisher has just ended; the next poll will notice
        header = connection.header
        if not {"type", "md5sum"} <= header.keys():
            connection.interrupt()
            return  # not a publisher; the next poll will ask again
        kind = Kind(
            type=header["type"],
            md5sum=header["md5sum"],
            definition=header.get("message_definition", ""),
            latching=header.get("latching") == "1",
            sender=node,
        )
        receiver = _Receiver(
            connection,
            take=lambda data: self._take(Message(f"/{name}{topic}", kind, time.time_ns(), data)),
            closed=lambda: self._forget(key),
        )
        self._receivers[key] = receiver
        receiver.start()

    def _take(self, message: Message) -> None:
        try:
            self._waiting.put_nowait(message)
        except queue.Full:
            self.dropped += 1

    def _forget(self, key: tuple[str, str, str]) -> None:
        del self._receivers[key]


def main(words: Sequence[str]) -> int:
    """Records until SIGINT or SIGTERM; returns the exit status."""
    options = _parser().parse_args(words)
    path = options.file
    if not has_room(Path(path).parent):
        _full(path, 0)
    try:
        recorder = Recorder(
            Path(path),
            dict(word.split("=", 1) for word in options.masters),
            options.topics,
            options.split * 10**6,
        )
    except OSError as error:
        _failed(path, 0, error)
    ending = EndRequest()
    ending.take_signals(signal.SIGINT, signal.SIGTERM)

    def end_when_asked() -> None:
        ending.wait()
        recorder.end()

    threading.Thread(target=end_when_asked, name="end", daemon=True).start()
    try:
        recorder.run()
    except FullDiskError:
        _full(path, recorder.written)
    except OSError as error:
        _failed(path, recorder.written, error)
    sys.stdout.write(f"{path}: {recorder.written} messages, {recorder.dropped} dropped\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "recorder", description="Records the topics of several masters."
    )
    parser.add_argument("file", metavar="FILE", help="the recording, .mcap or .bag")
    parser.add_argument("masters", nargs="+", metavar="NAME=URI", help="the masters")
    parser.add_argument(
        "--topics",
        action="append",
        default=[],
        metavar="PATTERN",
        help="record only topics like it",
    )
    parser.add_argument(
        "--split", type=int, default=0, metavar="MB", help="continue in a new file at this size"
    )
    return parser


def _full(path: str, written: int) -> NoReturn:
    """Reports a disk without room, and ends the process with status 1."""
    _fail(f"{path} ends after {written} messages: its disk has less than {RESERVE >> 20} MB free")


def _failed(path: str, written: int, error: OSError) -> NoReturn:
    """Reports why the recording ends, such as a full disk, and ends the process with status 1."""
    _fail(f"cannot write {path} after {written} messages: {error.strerror or error}")


def _fail(line: str) -> NoReturn:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
    # At once: the file, closed at the interpreter's end, would be written to again.
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
