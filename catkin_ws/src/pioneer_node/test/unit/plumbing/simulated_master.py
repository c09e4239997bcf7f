"""A ROS master in simulated time: calls are executed and answered in random order, or get lost."""

import random
from collections import defaultdict, deque
from collections.abc import Callable
from typing import Any

from simulated_network import SimulatedReactor

from tcpros.xmlrpc_client import NoAnswer, Server

TIMEOUT = 5.0
"""After which a call without an answer fails [s]."""


class SimulatedMaster:
    """Replaces the client of the master in a `NodeContext`.

    Notifications go over simulated connections to the nodes' real ports, in order for each node, as rosmaster sends
    them; one that gets lost is repeated, since its loss would be rosmaster's fault.

    Args:
        reactor: the loop.
        server: returns a client for a node's URI.
    """

    def __init__(self, reactor: SimulatedReactor, server: Callable[[str], Server]) -> None:
        self.publishers: dict[str, dict[str, str]] = defaultdict(dict)  #: URI by topic and node
        self.subscribers: dict[str, dict[str, str]] = defaultdict(dict)
        self.services: dict[str, str] = {}
        self.is_faulty = True  #: whether calls get lost
        self._reactor = reactor
        self._server = server
        self._notifications: dict[str, deque[tuple[str, list[str]]]] = defaultdict(deque)

    @property
    def _drawn(self) -> random.Random:
        return self._reactor.drawn

    def call(
        self,
        method: str,
        arguments: tuple[Any, ...],
        done: Callable[[Any], object],
        failed: Callable[[str], object],
    ) -> None:
        """Calls the master, like `Server.call`."""
        # A node that ends does not wait for long to be unregistered, so those calls are not lost here.
        is_safe = not self.is_faulty or method.startswith("unregister")
        fate = 1.0 if is_safe else self._drawn.random()
        if fate < 0.05:
            self._lose(method, failed)
            return

        def execute() -> None:
            value = getattr(self, f"_{method}")(*arguments)
            if fate < 0.1:
                self._lose(method, failed)
            else:
                self._reactor.call_later(self._delay(), lambda: done(value))

        self._reactor.call_later(self._delay(), execute)

    def restart(self) -> None:
        """Forgets everything."""
        self.publishers.clear()
        self.subscribers.clear()
        self.services.clear()

    def _delay(self) -> float:
        return self._drawn.choice((0.0, 0.001, 0.01, 0.3))

    def _lose(self, method: str, failed: Callable[[str], object]) -> None:
        self._reactor.call_later(TIMEOUT, lambda: failed(NoAnswer(f"{method} was lost")))

    def _registerPublisher(self, name: str, topic: str, _type: str, uri: str) -> list[str]:
        self.publishers[topic][name] = uri
        self._notify(topic)
        return list(self.subscribers[topic].values())

    def _unregisterPublisher(self, name: str, topic: str, uri: str) -> int:
        if self.publishers[topic].get(name) == uri:
            del self.publishers[topic][name]
            self._notify(topic)
        return 1

    def _registerSubscriber(self, name: str, topic: str, _type: str, uri: str) -> list[str]:
        self.subscribers[topic][name] = uri
        return list(self.publishers[topic].values())

    def _unregisterSubscriber(self, name: str, topic: str, uri: str) -> int:
        if self.subscribers[topic].get(name) == uri:
            del self.subscribers[topic][name]
        return 1

    def _registerService(self, _name: str, service: str, address: str, _uri: str) -> int:
        self.services[service] = address
        return 1

    def _unregisterService(self, _name: str, service: str, address: str) -> int:
        if self.services.get(service) == address:
            del self.services[service]
        return 1

    def _notify(self, topic: str) -> None:
        for uri in self.subscribers[topic].values():
            waiting = self._notifications[uri]
            waiting.append((topic, list(self.publishers[topic].values())))
            if len(waiting) == 1:
                self._send(uri)

    def _send(self, uri: str) -> None:
        waiting = self._notifications[uri]
        topic, publishers = waiting[0]
        if not any(uri in nodes.values() for nodes in self.subscribers.values()):
            waiting.clear()
            return

        def next_one(_value: Any) -> None:
            waiting.popleft()
            if waiting:
                self._reactor.call_later(self._delay(), lambda: self._send(uri))

        def again(_reason: str) -> None:
            self._reactor.call_later(0.1, lambda: self._send(uri))

        self._server(uri).call("publisherUpdate", ("/master", topic, publishers), next_one, again)
