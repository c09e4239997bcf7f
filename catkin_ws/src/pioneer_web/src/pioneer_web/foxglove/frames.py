"""Raw messages of any topics for the event loop of a server: read by one thread, handed over in bounded batches."""

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import rosgraph

from tcpros.node_context import NodeContext
from tcpros.reactor import Reactor
from tcpros.topic_source import Sender, TopicSource

BATCH_EVERY = 0.01
"""Interval at which messages are handed over [s]: a wake-up of the event loop costs more than a message."""
BATCH = 100
"""Maximum number of messages handed over at once: the loop serves its sockets in between."""
WAITING, WAITING_BYTES = 400, 1 << 24
"""Limits for messages that wait for the event loop: number and size [bytes]; the oldest are dropped."""

Deliver = Callable[[str, int, bytes], None]
"""Called in the event loop with topic, time of arrival [ns] and serialised message."""


class Frames:
    """Connections to the publishers of topics, without a registration at the master.

    Does not use rospy, which shares one subscription per topic in a process: the page's are decoded and throttled.
    All methods are for the event loop's thread.

    Args:
        name: node name to use towards publishers.
        deliver: receives the messages.
    """

    def __init__(self, name: str, deliver: Deliver) -> None:
        self._name, self._deliver = name, deliver
        self._sources: dict[str, TopicSource] = {}
        self._followed: dict[str, Sequence[str]] = {}
        self._waiting = deque[tuple[str, int, bytes]]()
        # No lock: each counter is written by one thread, so that neither ever waits for the other.
        self._arrived_bytes = self._dropped_bytes = self._delivered_bytes = 0
        self._is_due = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._context: NodeContext | None = None

    def follow(self, topics: Mapping[str, Sequence[str]]) -> None:
        """Connects to these topics' publishers, given by their URIs; ends all other connections."""
        if topics == self._followed:
            return
        self._followed = dict(topics)
        self._loop = asyncio.get_running_loop()
        if self._context is None:
            logger = logging.getLogger("rosout")
            reactor = Reactor(logger)
            self._context = NodeContext(reactor, rosgraph.get_master_uri(), "", "", logger)
            reactor.start()
        self._context.reactor.call(partial(self._update, self._context, dict(topics)))

    def close(self) -> None:
        """Ends all connections and the thread."""
        if self._context is not None:
            reactor = self._context.reactor
            reactor.call(reactor.stop)
            reactor.join(1.0)

    # In the reactor's thread

    def _update(self, context: NodeContext, topics: Mapping[str, Sequence[str]]) -> None:
        for topic in self._sources.keys() - topics.keys():
            self._sources.pop(topic).close()
        for topic, uris in topics.items():
            if topic not in self._sources:
                fields = {"topic": topic, "type": "*", "md5sum": "*"}
                taken = partial(self._arrived, topic)
                self._sources[topic] = TopicSource(context, self._name, fields, taken)
            self._sources[topic].update(list(uris))

    def _arrived(self, topic: str, message: memoryview, _: Sender) -> None:
        self._waiting.append((topic, time.time_ns(), bytes(message)))
        self._arrived_bytes += len(message)
        while len(self._waiting) > 1 and self._is_full():
            with contextlib.suppress(IndexError):  # the event loop was faster
                self._dropped_bytes += len(self._waiting.popleft()[2])
        if not self._is_due:
            self._is_due = True
            self._schedule()

    def _is_full(self) -> bool:
        size = self._arrived_bytes - self._dropped_bytes - self._delivered_bytes
        return len(self._waiting) > WAITING or size > WAITING_BYTES

    def _schedule(self) -> None:
        loop = self._loop
        if loop is not None:
            with contextlib.suppress(RuntimeError):  # the server ends
                loop.call_soon_threadsafe(loop.call_later, BATCH_EVERY, self._hand_over)

    # In the event loop

    def _hand_over(self) -> None:
        self._is_due = False
        for _ in range(BATCH):
            try:
                topic, stamp, body = self._waiting.popleft()
            except IndexError:
                return
            self._delivered_bytes += len(body)
            self._deliver(topic, stamp, body)
        self._is_due = True
        self._schedule()
