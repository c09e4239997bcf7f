"""``python3 -m pioneer_fleet.recording.recorder FILE NAME=URI …``: records the topics of several masters in one file.

Each message is recorded once, on the master of the node that publishes it, not where gateways forward it. Topics are
prefixed with the name of their master: ``/aadi1/pioneer1/amcl_pose``. Messages are written in serialised form.
"""

import queue
import signal
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from pioneer_fleet.recording.recording import BagFile, Kind, McapFile, Message
from pioneer_node.adapters.end_request import EndRequest
from rocon_relay.connection import is_proxy_uri
from tcpros.client import Client, Connection
from tcpros.error import TcprosError

NAME = "/fleet_recorder"
_LOOK = 1.0
"""Poll interval for new publishers [s]."""
_LEFT_OUT = "/rosout_agg"
"""Suffix of topics to skip because they only repeat other topics."""
_WAITING = 20_000
"""Write queue size [messages]; when it is full, new messages are dropped and counted."""


class Recorder:
    """Records all publishers of several masters until `end` is called.

    Threads: one polls for publishers, one writes; one per publisher receives its messages.
    """

    def __init__(self, path: Path, masters: Mapping[str, str]) -> None:
        """``masters`` maps names to master URIs."""
        self._masters = {name: Client(uri, NAME) for name, uri in masters.items()}
        self._writer: BagFile | McapFile = (
            BagFile(path) if path.suffix == ".bag" else McapFile(path)
        )
        self._connected: set[tuple[str, str, str]] = set()
        self._proxies: set[tuple[str, str]] = set()
        self._waiting: queue.Queue[Message | None] = queue.Queue(_WAITING)
        self._end = threading.Event()
        self.written = self.dropped = 0

    def run(self) -> None:
        """Records until `end` is called, then finishes the file."""
        looking = threading.Thread(target=self._look, name="publishers", daemon=True)
        looking.start()
        while (message := self._waiting.get()) is not None:
            self._writer.add(message)
            self.written += 1
        self._writer.close()

    def end(self) -> None:
        """Makes `run` return after writing the messages received so far."""
        self._end.set()
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
                        if not topic.endswith(_LEFT_OUT):
                            self._connect(name, client, topic, node)
            self._end.wait(_LOOK)

    def _connect(self, name: str, client: Client, topic: str, node: str) -> None:
        key = (name, topic, node)
        if key in self._connected or (name, node) in self._proxies:
            return
        try:
            if is_proxy_uri(str(client.ask_master("lookupNode", node))):
                self._proxies.add((name, node))
                return
            connection = client.subscribe(node, topic)
        except (OSError, TcprosError):
            return  # the publisher has just ended; the next poll will notice
        self._connected.add(key)
        threading.Thread(
            target=self._receive, args=(key, connection), name=topic, daemon=True
        ).start()

    def _receive(self, key: tuple[str, str, str], connection: Connection) -> None:
        name, topic, _ = key
        header = connection.header
        latching = header.get("latching") == "1"
        kind = Kind(
            header["type"], header["md5sum"], header.get("message_definition", ""), latching
        )
        connection.be_patient()
        try:
            with connection:
                while True:
                    data = connection.read_frame()
                    try:
                        self._waiting.put_nowait(
                            Message(f"/{name}{topic}", kind, time.time_ns(), data)
                        )
                    except queue.Full:
                        self.dropped += 1
        except OSError:
            self._connected.remove(key)


def main(words: Sequence[str]) -> int:
    """Records until SIGINT or SIGTERM; returns the exit status."""
    path, *masters = words
    recorder = Recorder(Path(path), dict(word.split("=", 1) for word in masters))
    ending = EndRequest()
    ending.take_signals(signal.SIGINT, signal.SIGTERM)

    def end_when_asked() -> None:
        ending.wait()
        recorder.end()

    threading.Thread(target=end_when_asked, name="end", daemon=True).start()
    recorder.run()
    sys.stdout.write(f"{path}: {recorder.written} messages, {recorder.dropped} dropped\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
