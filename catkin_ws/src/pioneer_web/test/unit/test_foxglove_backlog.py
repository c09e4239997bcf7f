"""What waits for a slow event loop, or for a slow client, is limited in number and size."""

import asyncio
import threading
from types import SimpleNamespace

import pytest

from pioneer_web.access.access_control import Role
from pioneer_web.foxglove import frames
from pioneer_web.foxglove.frames import Frames
from pioneer_web.foxglove.server import BACKLOG_BYTES, Visitor
from tcpros.topic_source import Sender

SESSION = SimpleNamespace(role=Role.VIEWER)
SENDER = Sender("/robot", latching=False)


def _arrive(source, bodies):
    for body in bodies:
        source._arrived("/scan", memoryview(body), SENDER)


async def _received(bodies):
    """Returns what arrives from another thread while the event loop is blocked."""
    received = []
    source = Frames("/page", lambda topic, stamp, body: received.append(body))
    source._loop = asyncio.get_running_loop()
    reader = threading.Thread(target=_arrive, args=(source, bodies))
    reader.start()
    reader.join()
    async with asyncio.timeout(10):
        while not received or received[-1] != bodies[-1]:
            await asyncio.sleep(0.01)
    return received


@pytest.mark.parametrize(("number", "size"), [(10_000, 10), (100, 1_000_000), (1, 50_000_000)])
def test_a_blocked_event_loop_gets_the_newest_messages_in_order(number, size):
    bodies = [number.to_bytes(4, "big") + bytes(size) for number in range(number)]
    received = asyncio.run(_received(bodies))
    assert received == bodies[-len(received) :]
    assert len(received) <= frames.WAITING
    assert len(received) == 1 or sum(map(len, received)) <= frames.WAITING_BYTES


def test_frames_for_a_client_that_reads_nothing_are_limited_in_size():
    async def queued():
        visitor = Visitor(SimpleNamespace(), SESSION)
        for _ in range(100):
            visitor.send(bytes(1_000_000))
        return visitor._queue.qsize()

    assert asyncio.run(queued()) == BACKLOG_BYTES // 1_000_000


def test_a_frame_of_any_size_reaches_a_client_that_reads():
    sent = []

    async def send_bytes(frame):
        sent.append(len(frame))

    async def forwarded():
        visitor = Visitor(SimpleNamespace(send_bytes=send_bytes), SESSION)
        forwarding = asyncio.create_task(visitor.forward())
        for _ in range(3):
            visitor.send(bytes(2 * BACKLOG_BYTES))
            await asyncio.sleep(0)
        forwarding.cancel()

    asyncio.run(forwarded())
    assert sent == [2 * BACKLOG_BYTES] * 3
