"""``python3 -m pioneer_bench.nodes.crowd PORT SIZE RULES CHANGES``: simulates many gateways on a hub until interrupted.

Prints ``converged SECONDS``, ``change SECONDS`` for each change, then ``ready``.
"""

import sys

from pioneer_bench.adapters.crowd import Crowd
from tcpros.adapters.descriptor import raise_limit

PATIENCE = 120.0
"""Time-out for all gateways to converge [s]."""


def main() -> int:
    """Entry point."""
    port, size, rules, changes = map(int, sys.argv[1:])
    raise_limit()
    crowd = Crowd(port, size, rules)
    print(f"converged {crowd.converge(PATIENCE):.3f}", flush=True)
    for number in range(changes):
        print(f"change {crowd.change(37 * number):.4f}", flush=True)
    print("ready", flush=True)
    try:
        while True:
            crowd.turn(0.2)
    except KeyboardInterrupt:
        return 0


if __name__ == "__main__":
    sys.exit(main())
