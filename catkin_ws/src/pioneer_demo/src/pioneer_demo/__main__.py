"""``python -m pioneer_demo``: the commands behind ``./pioneer demo``, ``fleet``, ``run-scenario``, ``experiment``."""

import sys

from pioneer_demo.console.interrupt import Interrupt

if __name__ == "__main__":
    interrupt = (
        Interrupt()
    )  # first, so that Ctrl-C during the imports below also ends the command cleanly
    if sys.argv[1:2] == ["experiment"]:
        from pioneer_demo.study import experiment

        sys.exit(experiment.main(sys.argv[2:], interrupt))
    from pioneer_demo.main import main

    sys.exit(main(sys.argv[1:], interrupt))
