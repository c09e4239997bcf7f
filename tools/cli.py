"""The parts of ``./pioneer`` that need no set-up: help on its commands, suggestions for unknown ones."""

import difflib
import sys
from collections.abc import Sequence
from pathlib import Path

from containers import SOURCE

_REGISTRY = Path(__file__).parent / "commands.tsv"
COMMANDS = tuple(
    line.partition("\t")[0]
    for line in _REGISTRY.read_text().splitlines()
    if not line.startswith("#")
)


def main(words: Sequence[str]) -> int:
    """Runs one of the subcommands ``help``, ``check`` and ``unknown``; returns the exit status."""
    match words:
        case ["check", command, *arguments]:
            return check(command, arguments)
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
        from pioneer_fleet.recording.replay_option import parser

        parser().parse_args(["--help"])
    elif command == "check":
        import check_files

        check_files.parser().parse_args(["--help"])
    elif command == "bench":
        sys.path.append(str(SOURCE / "pioneer_bench" / "src"))
        from pioneer_bench.__main__ import main as bench

        bench()
    else:
        parse(command, ["--help"])


def check(command: str, arguments: Sequence[str]) -> int:
    """Checks a command's options before the set-up, so that nobody waits for it to learn of a typo.

    Returns:
        The exit status: 0, or 2 after one line about the first wrong option.
    """
    if command == "replay":
        from pioneer_fleet.recording.replay_option import parser

        file = parser().parse_args(arguments).file
        if not file.is_file():
            print(f"pioneer replay: there is no file {file}", file=sys.stderr)
            return 2
        return 0
    from pioneer_demo.error import OptionError

    try:
        parse(command, arguments)
    except OptionError as error:
        print(f"pioneer {command}: {error}", file=sys.stderr)
        return 2
    return 0


def parse(command: str, arguments: Sequence[str]) -> None:
    """Parses the options of a command that starts fleets.

    Raises:
        OptionError: an option is wrong.
    """
    from pioneer_demo.error import OptionError
    from pioneer_demo.scenario.option import CONFIGS, Machine
    from pioneer_demo.scenario.world_folder import place_count, places_by_world
    from pioneer_demo.study.option import experiment_config

    stack = SOURCE / "pioneer_gazebo_ros"
    poses = stack / "pioneer_description" / "config"
    places = places_by_world(stack / "pioneer_gazebo" / "map", poses)
    # The robots in a fleet's or a scenario's file are counted once YAML can be read.
    machine = Machine(places, place_count(poses), 1.0, names_of=lambda _: ("robot",))
    if command != "experiment":
        CONFIGS[command](arguments, machine)
        return
    study = experiment_config(arguments, machine).study
    if not study.is_file():
        raise OptionError(f"there is no study {study}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
