"""Nodes on a simulated network and master that do random things while connections, calls and answers get lost.

At the end of a schedule nothing gets lost any more, and everything must be as if nothing had been.
"""

import logging
import random
import struct
import zlib
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any
from unittest import mock

from ring import Ring
from simulated_master import SimulatedMaster
from simulated_network import SLOWEST_LOOK_UP, Network, SimulatedReactor
from std_msgs.msg import String
from std_srvs.srv import Empty

from pioneer_node.adapters import node_handle
from pioneer_node.adapters.node_handle import NodeHandle, Publisher, Subscriber
from tcpros import (
    brake,
    dialled_stream,
    listener,
    node,
    node_port,
    resolver,
    stream,
    topic_source,
)
from tcpros.dialled_stream import DialledStream
from tcpros.header import header_bytes, header_parser
from tcpros.node_context import NodeContext
from tcpros.resolver import DialError
from tcpros.stream import message_parser

NAMES = ("/one", "/two", "/three", "/four")
TOPICS = ("/a", "/b", "/c", "/latched")
SIZES = (0, 1, 100, 5_000, 65_536, 131_073, 262_140, 300_000, 1_000_000)
LARGEST = 20_000_000
STEPS = 60
HOSTS = 40
"""Number of names that are looked up, of which every fourth does not exist."""
BURST = 150
"""Number of messages that fill the queue of a subscriber."""
SETTLE = 60.0
"""Within which everything works again once nothing gets lost any more [simulated s]."""

_HEAD = struct.Struct("<IIII")
"""Of a message: number of the publishing node's instance, number of the message, size and checksum of the rest."""


class Faults(logging.Handler):
    """Collects log lines that report an error of the software."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(self.format(record))


class FakeParameters:
    """A master's parameter API without parameters."""

    def __init__(self, *_: object) -> None: ...

    def ask(self, *_: object) -> tuple[bool, object]:
        """Returns that the parameter is not set."""
        return False, None


class Call(DialledStream):
    """A call of a service: persistent, with several requests sent at once."""

    def __init__(self, world: "World", service: str, requests: list[bytes]) -> None:
        fields = {"service": service, "callerid": "/client", "md5sum": "*", "persistent": "1"}
        super().__init__(world.reactor, service, header_bytes(fields))  # type: ignore[arg-type]
        self.is_ended = False
        self.wrong = ""
        self._requests = requests
        self._expected = [request[::-1] for request in requests]
        self.parse = header_parser(self._greeted)
        self._network = world.network

    def _greeted(self, header: dict[str, str]) -> None:
        if "error" in header:
            self.close(header["error"])
            return
        self.parse = self._status
        for request in self._requests:
            self.send(len(request).to_bytes(4, "little") + request)

    def _status(self, data: memoryview) -> int:
        self._has_failed = data[0] != 1
        if self._has_failed and not self._network.refused_threads:
            self.wrong = "the service failed"
        self.parse = message_parser(self, self._take)
        return 1

    def _take(self, data: memoryview) -> None:
        expected = self._expected.pop(0)
        if self._has_failed:
            expected = b"the request is not processed: can't start new thread"
        if bytes(data) != expected:
            self.wrong = "a wrong response"
        if self._expected:
            self.parse = self._status
        else:
            self.close("done")

    def closed(self, reason: str) -> None:
        self.is_ended = True


class Member:
    """One instance of a node, with its topics."""

    def __init__(self, world: "World", name: str, number: int) -> None:
        self.name, self.number = name, number
        self.is_over = self.is_closed = False
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: list[Subscription] = []
        self.sent = 0
        self.handle = NodeHandle(world.context, name, {}, self._shut_down)
        self._world = world
        self.handle._node.serve("/reverse" + name, Empty, world.answer, may_wait=True)

    def _shut_down(self, reason: str) -> None:
        self._world.complain(f"{self.name} was shut down: {reason}")

    def publish(self, topic: str, size: int) -> int:
        """Publishes a message of this size, advertising the topic if need be; returns its number."""
        if topic not in self.publishers:
            self.publishers[topic] = self.handle.advertise(topic, String, latch=topic == "/latched")
        self.sent += 1
        body = self._world.body(size)
        head = _HEAD.pack(self.number, self.sent, size, zlib.adler32(body))
        frame = struct.pack("<I", len(head) + size) + head + body
        self.publishers[topic].send(frame)
        return self.sent

    def withdraw(self, topic: str) -> None:
        """Withdraws a topic, if it is advertised."""
        if topic in self.publishers:
            self.publishers.pop(topic).close()

    def subscribe(self, topic: str) -> None:
        """Adds a subscription."""
        self.subscriptions.append(Subscription(self._world, self.handle, topic))

    def unsubscribe(self, index: int) -> None:
        """Ends a subscription, if there is one."""
        if self.subscriptions:
            self.subscriptions.pop(index % len(self.subscriptions)).subscriber.close()

    def close(self) -> None:
        """Ends the node."""
        self.is_over = True

        def closed() -> None:
            self.is_closed = True

        self.handle.close(closed)


class Subscription:
    """Checks the messages that one subscription gets."""

    def __init__(self, world: "World", handle: NodeHandle, topic: str) -> None:
        self.topic = topic
        self.newest: dict[
            int, int
        ] = {}  #: number of the newest message by instance of the publisher
        self._world = world
        self.subscriber: Subscriber = handle.subscribe_serialised(topic, String, self._take)

    def _take(self, data: Any, sender: str) -> None:
        number, message, size, checksum = _HEAD.unpack_from(data)
        body = data[_HEAD.size :]
        if len(body) != size or zlib.adler32(body) != checksum:
            self._world.complain(f"a damaged message on {self.topic} from {sender}")
        if message < self.newest.get(number, 0):
            self._world.complain(f"messages on {self.topic} from {sender} in a wrong order")
        self.newest[number] = message


class Question:
    """A host name that is looked up: it must be answered exactly once."""

    def __init__(self, world: "World", number: int) -> None:
        self.host = f"host{number}"
        self.answers: list[str] = []
        self._exists = number % 4 > 0
        self._world = world
        world.context.resolver.resolve(self.host, self._found, self._failed)

    def _found(self, address: str) -> None:
        self.answers.append(address)
        if self._world.network.is_faulty and self._world.drawn.random() < 0.1:
            raise DialError("no socket available")
        if not self._exists:
            self._world.complain(f"{self.host} was found")

    def _failed(self, reason: str) -> None:
        if not reason:
            self._world.complain(f"{self.host} failed without a reason")
        self.answers.append("")

    @property
    def is_answered(self) -> bool:
        """Whether it is answered; an address that could not be dialled is followed by a failure."""
        return bool(self.answers)


class World:
    """A schedule: what nodes do, and what fails, drawn from a seed."""

    def __init__(self, seed: int) -> None:
        self.drawn = random.Random(seed)
        self.reactor = SimulatedReactor(self.drawn)
        self.network = Network(self.reactor)
        self.wrong: list[str] = []
        self._bytes = self.drawn.randbytes(1 << 16) * (LARGEST // (1 << 16) + 2)
        self._numbers = 0
        self._calls: list[Call] = []
        self._faults = Faults()
        # Without restarts of the master, everything must be right without another registration.
        self._restarts = self.drawn.random() < 0.5
        self._questions: list[Question] = []
        self.members: list[Member] = []
        self.ring: Ring

    def complain(self, what: str) -> None:
        """Records what is wrong."""
        self.wrong.append(what)

    def body(self, size: int) -> bytes:
        """Returns random bytes."""
        start = self.drawn.randrange(1 << 16)
        return self._bytes[start : start + size]

    def answer(self, request: bytes) -> bytes:
        """Answers the service of each node."""
        return len(request).to_bytes(4, "little") + request[::-1]

    def run(self) -> str:
        """Runs the schedule; returns what was wrong, "" for nothing."""
        with ExitStack() as stack:
            self._replace(stack)
            logger = logging.getLogger("plumbing")
            logger.propagate = False
            logger.handlers = [self._faults]
            arguments = ("http://master:11311", "robot", "", logger)
            self.context = NodeContext(self.reactor, *arguments)  # type: ignore[arg-type]
            self.master = SimulatedMaster(self.reactor, self.context.server)
            self.context.master = self.master  # type: ignore[assignment]
            rosout = logging.getLogger(node_handle.LOGGER)
            rosout.addHandler(self._faults)
            stack.callback(rosout.removeHandler, self._faults)
            Ring(self)
            self._play()
            self._settle()
        self.wrong += [repr(one) for one in self.reactor.failures]
        self.wrong += self._faults.lines
        return "; ".join(dict.fromkeys(self.wrong))

    def _replace(self, stack: ExitStack) -> None:
        """Replaces sockets, threads, time and the parameter server in the modules under test."""
        sockets, threads = self.network.socket_module(), self.network.threading_module()
        time = self.network.time_module()
        for module in (listener, resolver, stream, node_port, topic_source):
            stack.enter_context(mock.patch.object(module, "socket", sockets))
        scarce = self.network.socket_module(is_scarce=True)
        stack.enter_context(mock.patch.object(dialled_stream, "socket", scarce))
        for module in (resolver, node):
            stack.enter_context(mock.patch.object(module, "threading", threads))
        for module in (resolver, node_port, brake, node_handle):
            stack.enter_context(mock.patch.object(module, "time", time))
        stack.enter_context(mock.patch.object(node_handle, "MasterParameters", FakeParameters))

    def _play(self) -> None:
        actions: list[tuple[int, Callable[[], object]]] = [
            (3, self._start),
            (10, self._publish),
            (1, self._burst),
            (4, self._look_up),
            (6, self._subscribe),
            (3, self._unsubscribe),
            (2, self._withdraw),
            (2, self._end),
            (5, self._call),
            (5, self.network.break_one),
            (2, self._register_one_again),
            (1 if self._restarts else 0, self._restart_master),
        ]
        weights, acts = zip(*actions, strict=True)
        for _ in range(STEPS):
            self.drawn.choices(acts, weights)[0]()
            self.reactor.run(self.drawn.choice((0.0, 0.001, 0.05, 1.0, 6.0)))

    def _settle(self) -> None:
        """Ends all faults and checks that everything works within `SETTLE`."""
        self.network.is_faulty = self.master.is_faulty = False
        if not self.reactor.run(SETTLE, lambda: all(call.is_ended for call in self._calls)):
            self.complain("a call has not ended")
        if not self.reactor.run(SETTLE, lambda: all(one.is_answered for one in self._questions)):
            self.complain("a look-up has not ended")
        self.wrong += [call.wrong for call in self._calls if call.wrong]
        if self._restarts:
            for member in (*self._live(), *self.ring.nodes):
                member.handle.register_again()
        if not self.reactor.run(SETTLE, self._is_registered):
            self.complain("registrations: " + self._difference())
        # A look-up that began among the faults takes long, and then comes a retry.
        self.reactor.run(SLOWEST_LOOK_UP + 10.0)
        for member in self._live():
            # The last message must arrive also if it is the last of many that meet full queues.
            if self.drawn.random() < 0.3:
                for topic in member.publishers:
                    self._publish_many(member, topic)
        expected = [
            (member.number, topic, member.publish(topic, self.drawn.choice(SIZES)))
            for member in self._live()
            for topic in tuple(member.publishers)
        ]
        if not self.reactor.run(SETTLE, lambda: not self._missing(expected)):
            self.complain("messages did not arrive: " + "; ".join(self._missing(expected)))
        self._settle_ring()
        for one in self._questions:
            if len(one.answers) > 1 and one.answers[1:] != [""]:
                self.complain(f"{one.host} was answered with {one.answers}")
        self._compare_fanouts()
        for part in (*self._live(), *self.ring.nodes):
            part.close()
        nodes = (*self.members, *self.ring.nodes)
        if not self.reactor.run(SETTLE, lambda: all(one.is_closed for one in nodes)):
            self.complain("a node did not end")
        self.reactor.run(10.0)
        left = [
            name
            for nodes in (*self.master.publishers.values(), *self.master.subscribers.values())
            for name in nodes
        ]
        if left or self.master.services:
            self.complain(f"left on the master: {left} {self.master.services}")
        if not self.reactor.run(SETTLE, self.reactor.is_idle):
            self.complain(f"left in the loop: {self.reactor.left()}")
        resolver = self.context.resolver
        if resolver._threads or resolver._questions or resolver._waiting:
            self.complain(f"left in the resolver: {resolver._threads} {list(resolver._questions)}")
        for one in nodes:
            if one.handle._node._port._connections:
                self.complain(f"left at {one.name}: connections")

    def _compare_fanouts(self) -> None:
        """Checks that publications send to their subscribers only, not to connections that have ended."""
        for member in self._live():
            for topic, publication in member.handle._node._published.items():
                if len(publication._fanout) != len(publication.subscribers):
                    self.complain(f"{member.name} sends {topic} to connections that have ended")

    def _settle_ring(self) -> None:
        """Checks that the ring goes round and that each of its messages has arrived everywhere."""
        ring = self.ring
        ring.is_quiet = True
        last = ring.gate.period + 4
        if not self.reactor.run(SETTLE, lambda: ring.gate.period >= last):
            self.complain("the ring stands still")
        elif missing := ring.missing():
            self.complain("in the ring: " + "; ".join(missing))
        ring.is_over = True

    def _live(self) -> list[Member]:
        return [one for one in self.members if not one.is_over]

    def _missing(self, expected: list[tuple[int, str, int]]) -> list[str]:
        subscriptions = [
            (member.name, one) for member in self._live() for one in member.subscriptions
        ]
        return [
            f"{name} has no {topic} of instance {number}"
            for number, topic, message in expected
            for name, one in subscriptions
            if one.topic == topic and one.newest.get(number, 0) < message
        ]

    def _wanted(self) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
        publishers: dict[str, set[str]] = {"/rosout": set()}
        subscribers: dict[str, set[str]] = {}
        for member in self._live():
            for topic in (*member.publishers, "/rosout"):
                publishers.setdefault(topic, set()).add(member.name)
            for one in member.subscriptions:
                subscribers.setdefault(one.topic, set()).add(member.name)
        ring = self.ring
        publishers["/rosout"] |= {node.handle.name for node in ring.nodes}
        for topic, name in ring.publishers():
            publishers.setdefault(topic, set()).add(name)
        for topic, name in ring.subscribers():
            subscribers.setdefault(topic, set()).add(name)
        return publishers, subscribers

    def _registered(self) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
        def names(rows: dict[str, dict[str, str]]) -> dict[str, set[str]]:
            return {topic: set(nodes) for topic, nodes in rows.items() if nodes}

        return names(self.master.publishers), names(self.master.subscribers)

    def _is_registered(self) -> bool:
        wanted = ({t: n for t, n in rows.items() if n} for rows in self._wanted())
        return tuple(wanted) == self._registered()

    def _difference(self) -> str:
        return f"wanted {self._wanted()}, found {self._registered()}"

    def _any(self) -> Member:
        live = self._live()
        return self.drawn.choice(live) if live else self._start()

    def _start(self) -> Member:
        """Starts a node, unless all run; a name is used again once its node has ended."""
        used = {one.name for one in self.members if not one.is_closed}
        free = [name for name in NAMES if name not in used]
        if not free:
            return self.drawn.choice([one for one in self.members if not one.is_closed])
        self._numbers += 1
        self.members.append(Member(self, self.drawn.choice(free), self._numbers))
        return self.members[-1]

    def _acting(self) -> Member | None:
        member = self._any()
        return None if member.is_over else member

    def _publish(self) -> None:
        if member := self._acting():
            size = LARGEST if self.drawn.random() < 0.02 else self.drawn.choice(SIZES)
            for _ in range(self.drawn.choice((1, 1, 5))):
                member.publish(self.drawn.choice(TOPICS), size)

    def _burst(self) -> None:
        """Fills the queues of subscribers."""
        if member := self._acting():
            self._publish_many(member, self.drawn.choice(TOPICS))

    def _publish_many(self, member: Member, topic: str) -> None:
        size = self.drawn.choice((1, 100, 20_000))
        for _ in range(BURST):
            member.publish(topic, size)

    def _look_up(self) -> None:
        """Looks up some names, more than are looked up at a time."""
        for _ in range(self.drawn.choice((1, 3, 30))):
            self._questions.append(Question(self, self.drawn.randrange(HOSTS)))

    def _subscribe(self) -> None:
        if member := self._acting():
            member.subscribe(self.drawn.choice(TOPICS))

    def _unsubscribe(self) -> None:
        if member := self._acting():
            member.unsubscribe(self.drawn.randrange(9))

    def _withdraw(self) -> None:
        if member := self._acting():
            member.withdraw(self.drawn.choice(TOPICS))

    def _end(self) -> None:
        if member := self._acting():
            member.close()

    def _call(self) -> None:
        member = self._acting()
        if member is None:
            return
        requests = [self.body(self.drawn.choice(SIZES)) for _ in range(self.drawn.randint(1, 4))]
        if self.drawn.random() < 0.02:
            requests.append(self.body(LARGEST))
        try:
            call = Call(self, "/reverse" + member.name, requests)
        except DialError:
            return
        self._calls.append(call)
        port = int(member.handle._node.uri.rsplit(":", 1)[1].rstrip("/"))
        call.connect("127.0.0.1", port)

    def _restart_master(self) -> None:
        """Restarts the master; the nodes register again, as those of a gateway do."""
        self.master.restart()
        for member in self._live():
            self.reactor.call_later(1.0, partial(self._register_again, member))
        for part in self.ring.nodes:
            self.reactor.call_later(1.0, part.handle.register_again)

    def _register_one_again(self) -> None:
        """Registers a node again at a master that knows it."""
        if member := self._acting():
            member.handle.register_again()

    def _register_again(self, member: Member) -> None:
        if not member.is_over:
            member.handle.register_again()
