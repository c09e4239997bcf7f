"""Subscriber for benches: `hear TOPIC` prints each message's arrival time; `hear TOPIC SECONDS [header]` measures.

The measurement begins half a second after the first message and prints `begin`, then one line of JSON. Messages are
not deserialised: the time of sending is where `talk` writes it or, with `header`, the stamp of the Header that they
begin with.
"""

import json
import os
import struct
import sys
import threading
import time

import rospy

from pioneer_bench.nodes.talk import STAMP
from pioneer_node.nodes import entry

WARM_UP = 0.5
"""Time ignored at the beginning [s]."""

_BEFORE_STAMP = 12  # bytes of a std_msgs/UInt8MultiArray: no dimensions, offset 0, data length
_HEADER_STAMP = struct.Struct("<II")
_BEFORE_HEADER_STAMP = 4  # bytes of Header.seq


def _sent_by_talk(data: bytes) -> float:
    """Returns when `talk` sent a message, monotonic [s]."""
    (sent,) = STAMP.unpack_from(data, _BEFORE_STAMP)
    return float(sent)


def _sent_in_header(data: bytes) -> float:
    """Returns the stamp of a message's Header [s]."""
    seconds, nanoseconds = _HEADER_STAMP.unpack_from(data, _BEFORE_HEADER_STAMP)
    return float(seconds) + 1e-9 * float(nanoseconds)


class Hearer:
    """Prints each message's arrival time, or measures a window of ``seconds``."""

    def __init__(self, topic: str, seconds: float | None, has_header: bool = False) -> None:
        self._sent = _sent_in_header if has_header else _sent_by_talk
        self._finished = threading.Event()
        self._seconds = seconds or 0.0
        self._first = self._begin = 0.0
        self._bytes = 0
        self._delays: list[float] = []
        entry.on_shutdown(self._finished.set)
        if seconds is None:
            rospy.Subscriber(topic, rospy.AnyMsg, self._tell, tcp_nodelay=True)
        else:
            rospy.Subscriber(topic, rospy.AnyMsg, self._measure, tcp_nodelay=True, buff_size=2**20)

    def spin(self) -> None:
        """Runs until shutdown, or until the window is over."""
        self._finished.wait()

    def _tell(self, _message: rospy.AnyMsg) -> None:
        print(time.monotonic(), flush=True)

    def _measure(self, message: rospy.AnyMsg) -> None:
        now = time.monotonic()
        self._first = self._first or now
        if now < self._first + WARM_UP or self._finished.is_set():
            return
        if not self._begin:
            self._begin = now
            print("begin", flush=True)
        self._bytes += len(message._buff)
        self._delays.append(now - self._sent(message._buff))
        if now >= self._begin + self._seconds:
            self._print(now - self._begin)
            self._finished.set()

    def _print(self, seconds: float) -> None:
        delays, count = sorted(self._delays), len(self._delays)
        result = {
            "messages": count / seconds,
            "bytes": self._bytes / seconds,
            "p50": delays[count // 2],
            "p99": delays[count * 99 // 100],
        }
        print(json.dumps(result), flush=True)


def main() -> int:
    """Entry point."""
    topic, *more = rospy.myargv(sys.argv)[1:]
    seconds = float(more[0]) if more else None
    has_header = more[1:] == ["header"]
    # Several instances may run on one master.
    return entry.run(f"hear_{os.getpid()}", lambda: Hearer(topic, seconds, has_header))


if __name__ == "__main__":
    sys.exit(main())
