"""Shared parts of the command line of ``./pioneer``'s commands."""

import argparse
import os
import sys
from collections.abc import Callable, Sequence

from containers.engine import ContainerError


class Subcommands:
    """Commands, each with a function that takes its options and returns an exit status."""

    def __init__(self) -> None:
        self._parser = argparse.ArgumentParser("./pioneer")
        self._parser.set_defaults(project=os.environ.get("PIONEER_PROJECT", "pioneer"))
        self._commands = self._parser.add_subparsers(required=True, metavar="COMMAND")

    def add(
        self, name: str, run: Callable[[argparse.Namespace], int], description: str, example: str
    ) -> argparse.ArgumentParser:
        """Adds a command and returns its parser, for its options."""
        epilog = f"example: ./pioneer {example}"
        command = self._commands.add_parser(
            name, help=description, description=description, epilog=epilog
        )
        command.set_defaults(run=run)
        return command

    def run(self, words: Sequence[str], interrupted: str = "") -> int:
        """Runs one command; returns the exit status. On Ctrl-C prints ``interrupted``."""
        options = self._parser.parse_args(words)
        try:
            status = int(options.run(options))
            sys.stdout.flush()
            return status
        except ContainerError as error:
            print(f"pioneer: {error}", file=sys.stderr)
            return 1
        except BrokenPipeError:
            # For example after "| head": avoids another error when the interpreter flushes at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        except KeyboardInterrupt:
            print(interrupted, end="")
            return 130
