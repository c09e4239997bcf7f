"""``python -m pioneer_demo``: the commands behind ``./pioneer demo``, ``fleet``, ``run-scenario``, ``experiment``."""

import logging
import os
import sys

from pioneer_demo.console.interrupt import Interrupt


def _open_standard_streams() -> None:
    """Opens what is closed of the standard streams on ``/dev/null``, so that no other file gets their numbers."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            stream = open(number, "r" if number == 0 else "w", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)


if __name__ == "__main__":
    # Before anything opens a file: it would get the number of a closed stream.
    _open_standard_streams()
    # Before the imports below, so that Ctrl-C during them also ends the command cleanly.
    interrupt = Interrupt()
    # A line that rospy cannot write, as on a full disk, costs that line; each would print a stack of calls.
    logging.raiseExceptions = False
    if sys.argv[1:2] == ["experiment"]:
        from pioneer_demo.study import experiment

        sys.exit(experiment.main(sys.argv[2:], interrupt))
    from pioneer_demo.main import main

    sys.exit(main(sys.argv[1:], interrupt))
