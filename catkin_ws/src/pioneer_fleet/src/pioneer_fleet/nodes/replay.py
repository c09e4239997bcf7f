"""``./pioneer replay FILE``: a recording's messages again, on one ROS master of its own, for RViz and others."""
# ruff: noqa: T201 - a command talks to people on standard output

import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Sequence

import rospy

from pioneer_fleet.adapters.recording import Kind, Message, RecordingError, messages_of
from pioneer_fleet.core.replay_option import parser
from pioneer_harness.masters import Master


class Replay:
    """Publishes recorded messages on this node's master, at the pace they came; topics lose their masters' names."""

    def __init__(self, rate: float, end: threading.Event) -> None:
        """``rate`` is how many recorded seconds pass in one; ``end`` ends it early."""
        self._rate, self._end = rate, end
        self._publishers: dict[tuple[str, Kind], tuple[rospy.Publisher, type]] = {}

    def play(self, messages: Iterable[Message]) -> int:
        """Publishes all; returns how many were published."""
        count, began, first = 0, time.monotonic(), 0
        for message in messages:
            first = first or message.time
            due = began + (message.time - first) / 1e9 / self._rate
            if self._end.wait(max(0.0, due - time.monotonic())):
                break
            publisher, raw = self._publisher(message)
            data = raw()
            data._buff = message.data
            publisher.publish(data)
            count += 1
        return count

    def _publisher(self, message: Message) -> tuple[rospy.Publisher, type]:
        topic = "/" + message.topic.lstrip("/").partition("/")[2]
        key = (topic, message.kind)
        if key not in self._publishers:
            kind = message.kind
            fields = {"_type": kind.type, "_md5sum": kind.md5sum, "_full_text": kind.definition}
            raw = type("Raw", (rospy.AnyMsg,), fields)
            self._publishers[key] = rospy.Publisher(topic, raw, queue_size=100, latch=kind.latching), raw
        return self._publishers[key]


def main(words: Sequence[str]) -> int:
    """Plays a recording; returns the exit status: 0, 1 for a failure, 2 for bad arguments, 130 after Ctrl-C."""
    command = parser()
    options = command.parse_args(words)
    if not options.rate > 0.0:
        command.error(f"--rate must be above 0 (got {options.rate:g})")
    if not options.file.is_file():
        command.error(f"there is no recording {options.file}")
    end = threading.Event()
    numbers = list[int]()

    def interrupted(number: int, _: object) -> None:
        numbers.append(number)
        end.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupted)
    try:
        with Master() as master:
            os.environ.update(ROS_MASTER_URI=master.uri, ROS_IP="127.0.0.1")
            print(f"export ROS_MASTER_URI={master.uri}", flush=True)
            rospy.init_node("replay", disable_signals=True, disable_rostime=True)
            print(f"{Replay(options.rate, end).play(messages_of(options.file))} messages were published", flush=True)
            if options.stay:
                end.wait()
            rospy.signal_shutdown("the recording has ended")
    except (RecordingError, OSError) as error:
        print(f"pioneer replay: {error}", file=sys.stderr)
        return 1
    return 128 + numbers[0] if numbers else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
