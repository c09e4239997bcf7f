"""Random fault schedules against the real hub client; `python3 test_live_hub.py FIRST SECONDS` runs some.

A seed gives the same schedule in each process with PYTHONHASHSEED=0.
"""

import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))
from live_world import LiveWorld
from schedule import drawn
from simulated_thread import SimulatedThread

CHUNK = 25


@pytest.mark.parametrize("first", range(0, 100, CHUNK))
def test_hub_clients_converge_after_any_faults(first: int) -> None:
    wrong = {seed: LiveWorld(seed, drawn(seed)).run() for seed in range(first, first + CHUNK)}
    assert {seed: one for seed, one in wrong.items() if one} == {}


def test_a_schedule_with_threads_is_the_same_in_each_run() -> None:
    def times() -> list[float]:
        found: list[float] = []

        class Watched(LiveWorld):
            def delay(self) -> None:
                super().delay()
                found.append(self.now)

        assert Watched(7, drawn(7)).run() == ""
        return found

    first = times()
    assert len(first) > 100
    assert times() == first
    assert SimulatedThread.current is None


def main(first: int, seconds: float) -> int:
    """Runs schedules for this long; prints each seed that fails, with what was wrong."""
    began, seed, failed = time.monotonic(), first, 0
    while time.monotonic() - began < seconds:
        if wrong := LiveWorld(seed, drawn(seed)).run():
            failed += 1
            sys.stdout.write(f"seed {seed}: {wrong[:2000]}\n")
            sys.stdout.flush()
        seed += 1
    sys.stdout.write(f"seeds {first} to {seed - 1}: {failed} failed\n")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), float(sys.argv[2])))
