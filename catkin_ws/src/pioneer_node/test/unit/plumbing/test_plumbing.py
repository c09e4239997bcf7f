"""Random schedules of the plumbing; `python3 test_plumbing.py FIRST SECONDS` runs them from a seed for some time."""

import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from plumbing_world import World


@pytest.mark.parametrize("seed", range(3))
def test_nodes_work_again_after_any_faults(seed: int) -> None:
    assert World(seed).run() == ""


def report(line: str) -> None:
    """Prints a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main(first: int, seconds: float) -> int:
    """Runs schedules for this long; prints each seed that fails, with what was wrong."""
    began, seed, failed = time.monotonic(), first, 0
    while time.monotonic() - began < seconds:
        wrong = World(seed).run()
        if wrong:
            failed += 1
            report(f"seed {seed}: {wrong[:2000]}")
        seed += 1
        if not seed % 50:
            report(f"{seed - first} schedules, {failed} failed")
    report(f"seeds {first} to {seed - 1}: {failed} failed")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), float(sys.argv[2])))
