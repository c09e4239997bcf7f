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
from process import HUB
from redis_model import ClientModel, RedisModel
from schedule import drawn
from simulated_thread import SimulatedThread

from rocon_gateway.hub import session as hub_session
from rocon_gateway.hub.session import KEPT, HubSession
from rocon_hub.registry import Registry
from rocon_hub_protocol.key import requests_key
from rocon_hub_protocol.record import PeerRequest, Record
from rocon_hub_protocol.redis_client import OPEN

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


def test_a_request_withdrawn_while_its_receiver_joins_again_is_deleted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The receiver kept a flip that nobody had any more, and its rule stayed `refused`."""
    hub = RedisModel(1, lambda: 0.0, lambda _subscription, _message: None)
    Registry(ClientModel(lambda: hub), 60.0).open("Pioneer Hub")
    monkeypatch.setattr(hub_session, "redis_client", lambda *_: ClientModel(lambda: hub))
    session = HubSession(HUB, OPEN, "sender", "first run")
    record = Record("sender", "first run", "host", 1, False)
    session.join(record, {"receiver": PeerRequest()})
    assert hub.hgetall(requests_key("receiver")).keys() == {"sender"}
    session.forget("receiver")
    session.write(record, {})
    assert hub.hgetall(requests_key("receiver")) == {}


def test_a_text_is_kept_for_some_weeks_after_the_last_heartbeat(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was kept for ever, also of gateways that never come again."""
    now = 0.0
    hub = RedisModel(1, lambda: now, lambda _subscription, _message: None)
    Registry(ClientModel(lambda: hub), 60.0).open("Pioneer Hub")
    monkeypatch.setattr(hub_session, "redis_client", lambda *_: ClientModel(lambda: hub))
    session = HubSession(HUB, OPEN, "robot", "first run")
    session.join(Record("robot", "first run", "host", 1, False), {})
    assert session.keep("text")
    now = 0.9 * KEPT
    session.live()
    now = 1.8 * KEPT
    assert session.kept() == "text"
    now = 1.9 * KEPT + 1.0
    assert session.kept() == ""


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
