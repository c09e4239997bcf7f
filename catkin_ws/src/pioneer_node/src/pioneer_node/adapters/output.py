"""Standard output that cannot end a process: on a full disk, or without a reader, lines are lost instead."""

import contextlib
import io
import logging
import sys


class _Output(io.TextIOWrapper):
    """A standard stream that loses what cannot be written, as on a full disk, without an error."""

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError):
            super().write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError):
            super().flush()


def lose_what_cannot_be_written() -> None:
    """Makes prints and log lines of this process never raise an OSError: those that cannot be written are lost.

    In rospy nodes and in roslaunch, the exception of a log line ends the thread, or the process, that has logged it.
    """
    logging.raiseExceptions = False
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper) and not isinstance(stream, _Output):
            made = _Output(
                open(stream.fileno(), "wb", closefd=False),  # noqa: SIM115 - stays open
                stream.encoding,
                stream.errors,
                line_buffering=True,  # a reader of a log file sees each line at once
            )
            with contextlib.suppress(OSError):
                stream.flush()
            setattr(sys, name, made)
