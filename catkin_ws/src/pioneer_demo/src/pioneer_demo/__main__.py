"""``python -m pioneer_demo``: the command behind ``./pioneer demo``."""

import sys

from pioneer_demo.nodes.main import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
