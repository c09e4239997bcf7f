"""The parts of ``./pioneer`` that need no set-up: help on its commands, suggestions for unknown ones."""

import difflib
import sys
from collections.abc import Sequence

from containers import SOURCE

COMMANDS = (
    "demo", "fleet", "run-scenario", "experiment", "replay", "status", "rviz", "teleop", "up", "down", "logs", "exec",
    "image", "run", "shell", "setup", "test", "bench", "package", "docs",
)  # fmt: skip


def main(words: Sequence[str]) -> int:
    """Runs one of the subcommands ``help`` and ``unknown``; returns the exit status."""
    match words:
        case ["unknown", command]:
            print(f"pioneer: {unknown(command)}", file=sys.stderr)
            return 2
        case ["help", command]:
            show_help(command)
            return 0
    raise ValueError(f"no such question: {' '.join(words)}")


def unknown(command: str) -> str:
    """Returns the error line for an unknown command."""
    near = difflib.get_close_matches(command, COMMANDS, 1)
    hint = f"did you mean '{near[0]}'?" if near else f"available: {', '.join(COMMANDS)}"
    return f"unknown command '{command}': {hint} (./pioneer --help)"


def show_help(command: str) -> None:
    """Prints the help of a command whose options are parsed after the set-up."""
    sys.argv = [f"./pioneer {command}", "--help"]
    if command == "test":
        import test

        test.arguments_from(["--help"])
    elif command == "replay":
        from pioneer_fleet.core.replay_option import parser

        parser().parse_args(["--help"])
    elif command == "bench":
        sys.path.append(str(SOURCE / "pioneer_bench" / "src"))
        from pioneer_bench.__main__ import main as bench

        bench()
    else:
        from pioneer_demo.core.option import CONFIGS, Machine
        from pioneer_demo.core.study_option import experiment_config

        worlds = (SOURCE / "pioneer_gazebo_ros" / "pioneer_gazebo" / "worlds").glob("*.world")
        machine = Machine(dict.fromkeys(sorted(path.stem for path in worlds), 1), 0, 1.0)
        config = experiment_config if command == "experiment" else CONFIGS[command]
        config(["--help"], machine)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
