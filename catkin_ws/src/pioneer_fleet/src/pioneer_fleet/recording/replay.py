"""``./pioneer replay FILE``: publishes a recording again on its own ROS master, for RViz and other tools."""
# ruff: noqa: T201 - a command talks to people on standard output

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

import rospy

from pioneer_fleet.recording.player import Pace, Replay
from pioneer_fleet.recording.recording import RecordingError, messages_of, repair
from pioneer_fleet.recording.replay_option import parser
from pioneer_fleet.recording.replay_page import ReplayPage
from pioneer_harness.error import HarnessError
from pioneer_harness.masters import Master
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
    end = ForcedEnd(signal.SIGINT, signal.SIGTERM)
    try:
        if options.repair is not None:
            return _repair(options.file, options.repair)
        with Master() as master:
            os.environ.update(ROS_MASTER_URI=master.uri, ROS_IP="127.0.0.1")
            print(f"export ROS_MASTER_URI={master.uri}", flush=True)
            rospy.init_node("replay", disable_signals=True, disable_rostime=True)
            pace = Pace(options.rate, end)
            if options.web:
                with ReplayPage(options.file, pace) as page:
                    page.play(Replay(pace), end)
            else:
                print(
                    f"{Replay(pace).play(messages_of(options.file))} messages were published",
                    flush=True,
                )
                if options.stay:
                    end.wait()
            rospy.signal_shutdown("the recording has ended")
    except (RecordingError, HarnessError, OSError) as error:
        print(f"pioneer replay: {error}", file=sys.stderr)
        return 1
    return 128 + end.number if end.number else 0


def _repair(path: Path, new: Path) -> int:
    """Writes a complete recording from an incomplete one, and prints what is missing; returns the exit status."""
    count, losses = repair(path, new)
    for line in losses.lines:
        print(f"{path}: {line}")
    print(f"{new} has {count} messages")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
