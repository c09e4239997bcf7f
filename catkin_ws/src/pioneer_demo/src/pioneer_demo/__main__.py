"""``python -m pioneer_demo``: the commands behind ``./pioneer demo`` and ``./pioneer fleet``."""

import sys

from pioneer_demo.adapters.interrupt import Interrupt

if __name__ == "__main__":
    interrupt = Interrupt()  # first, so that Ctrl-C during the imports below ends the command in order, too
    from pioneer_demo.nodes.main import main

    sys.exit(main(sys.argv[1:], interrupt))
