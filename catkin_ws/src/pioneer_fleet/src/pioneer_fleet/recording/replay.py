"""``./pioneer replay FILE``: publishes a recording again on its own ROS master, for RViz and other tools."""
# ruff: noqa: T201 - a command talks to people on standard output

import argparse
import math
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import rospy

from pioneer_fleet.recording.pause_key import PauseKey
from pioneer_fleet.recording.player import Pace, Replay
from pioneer_fleet.recording.recording import (
    RecordingError,
    messages_of,
    repair,
    topics_of,
)
from pioneer_fleet.recording.replay_option import parser
from pioneer_fleet.recording.replay_page import ReplayPage
from pioneer_fleet.recording.selection import chosen, in_simulated_time, is_chosen, since
from pioneer_harness.error import HarnessError
from pioneer_harness.masters import Master
from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.adapters.forced_end import ForcedEnd


def main(words: Sequence[str]) -> int:
    """Plays a recording; returns the exit status: 0, 1 for a failure, 2 for bad arguments, 130 after Ctrl-C."""
    command = parser()
    options = command.parse_args(words)
    if not options.rate > 0.0:
        command.error(f"--rate must be above 0 (got {options.rate:g})")
    if not options.file.is_file():
        command.error(f"there is no recording {options.file}")
    if options.web and options.file.suffix != ".mcap":
        command.error("--web plays .mcap files only")
    if options.repair is not None and options.repair.suffix not in (".mcap", ".bag"):
        command.error(f"--repair must name a new file such as new.mcap, not {options.repair}")
    if not 0.0 <= options.start < math.inf:
        command.error(f"--start must be 0 or more (got {options.start:g})")
    if options.web and (options.start or options.loop or options.topics or options.simulated):
        command.error(
            "--web has a slider: it does not go with --start, --loop, --topics, --simulated"
        )
    key = PauseKey(lambda: _toggle(pace))
    end = ForcedEnd(signal.SIGINT, signal.SIGTERM, before=key.restore)
    pace = Pace(options.rate, end)
    try:
        if options.repair is not None:
            return _repair(options.file, options.repair)
        # Before a master is started: the file may be no recording.
        clocks = {topic for topic in topics_of(options.file) if topic.endswith("/clock")}
        with Master() as master:
            os.environ.update(ROS_MASTER_URI=master.uri, ROS_IP="127.0.0.1")
            print(f"export ROS_MASTER_URI={master.uri}", flush=True)
            rospy.init_node("replay", disable_signals=True, disable_rostime=True)
            if any(is_chosen(topic, options.topics) for topic in clocks):
                rospy.set_param("/use_sim_time", True)
            if options.web:
                with ReplayPage(options.file, pace) as page:
                    page.play(Replay(pace), end)
            else:
                with key:
                    print(f"{_play(options, pace, end)} messages were published", flush=True)
                if options.stay:
                    end.wait()
            rospy.signal_shutdown("the recording has ended")
    except (RecordingError, HarnessError, OSError) as error:
        print(f"pioneer replay: {error}", file=sys.stderr)
        return 1
    return 128 + end.number if end.number else 0


def _play(options: argparse.Namespace, pace: Pace, end: EndRequest) -> int:
    """Plays what the options choose, once or until the end is requested; returns the number of messages."""
    replay = Replay(pace)
    total = 0
    while True:
        messages = messages_of(options.file)
        if options.start:
            messages = since(messages, options.start)
        if options.simulated:
            messages = in_simulated_time(messages)
        count = replay.play(chosen(messages, options.topics))
        total += count
        # Nothing to play would otherwise be played again at once, and so on.
        if not options.loop or not count or end.is_set():
            return total


def _toggle(pace: Pace) -> None:
    pace.paused = not pace.paused
    print("paused" if pace.paused else "continued", flush=True)


def _repair(path: Path, new: Path) -> int:
    """Writes a complete recording from an incomplete one, and prints what is missing; returns the exit status."""
    count, losses = repair(path, new)
    for line in losses.lines:
        print(f"{path}: {line}")
    print(f"{new} has {count} messages")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
