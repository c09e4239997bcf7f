"""``python3 -m pioneer_bench.nodes.crowd PORT SIZE RULES CHANGES``: simulates many gateways on a hub until interrupted.

They speak the protocol of `docs/gateway.md` with a real hub, all in one process. Each has two connections of its own
and does what a gateway does on the hub: it joins, sends heartbeats, offers topics to its successor in a ring, and
answers its predecessor. There are no relays, so no messages are carried.

Prints ``converged SECONDS``, ``change SECONDS`` for each change, then ``ready``.
"""

import re
import selectors
import sys
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

from rocon_hub_protocol.key import (
    GATEWAYS_KEY,
    NAME_KEY,
    PROTOCOL_KEY,
    alive_key,
    lost_key,
    record_key,
    requests_key,
)
from rocon_hub_protocol.password import password_from
from rocon_hub_protocol.record import (
    Offer,
    PeerRequest,
    Purpose,
    Record,
    Reply,
    request_from_text,
    text_from_record,
    text_from_request,
)
from rocon_hub_protocol.redis_client import TCP_OPTIONS, Access, HubConnection
from rocon_hub_protocol.rule import Kind, RemoteRule, Rule
from tcpros.descriptor import raise_limit

PATIENCE = 120.0
"""Time-out for all gateways to converge [s]."""
HEARTBEAT, ALIVE = 0.5, 2000
"""Heartbeat period [s]; time to live of a heartbeat on the hub [ms]."""

_EVENT = re.compile(rb"\*3\r\n\$\d+\r\n\w+\r\n\$\d+\r\n(.*)\r\n(?:\$\d+\r\n(.*)|:\d+)\r\n")
"""Matches channel and text of a message to a subscriber, or the confirmation of a subscription, which has no text."""


class Connection(HubConnection):
    """A connection to the hub with pipelined commands; encodes them itself, which is faster than redis-py."""

    def fileno(self) -> int:
        """Returns the descriptor of its socket, for a selector."""
        return int(self._sock.fileno())

    def receive(self) -> bytes:
        """Returns what has arrived since the last reply; raises OSError if the hub has closed the connection."""
        data = bytes(self._sock.recv(1 << 18))
        if not data:
            raise OSError("the hub closed a connection")
        return data

    def send(self, *commands: tuple[object, ...]) -> None:
        """Sends commands; their replies are read later, with ``read_response``."""
        self.send_packed_command([b"".join(map(_encoded, commands))])

    def ask(self, *commands: tuple[object, ...]) -> list[Any]:
        """Sends commands and returns their replies."""
        self.send(*commands)
        return [self.read_response() for _ in commands]


def _encoded(command: tuple[object, ...]) -> bytes:
    words = [word if isinstance(word, bytes) else str(word).encode() for word in command]
    return b"*%d\r\n" % len(words) + b"".join(
        b"$%d\r\n%s\r\n" % (len(word), word) for word in words
    )


@dataclass
class Member:
    """One simulated gateway."""

    name: str
    onward: str
    speech: Connection
    events: Connection
    rest: bytes = b""
    changes: int = 0
    answered: int = 0
    answered_at: float = 0.0


class Crowd:
    """A ring of simulated gateways.

    Args:
        port: of the hub.
        size: number of gateways.
        rules: number of rules of each gateway: flips of publishers to the next one.
    """

    def __init__(self, port: int, size: int, rules: int) -> None:
        self._rules = rules
        self._selector = selectors.DefaultSelector()
        self._members: dict[str, Member] = {}
        names = [f"crowd{number:05d}" for number in range(size)]
        access = Access(password_from(""))
        for number, name in enumerate(names):
            ends = [
                Connection(
                    access,
                    host="127.0.0.1",
                    port=port,
                    socket_timeout=10.0,
                    socket_keepalive=True,
                    socket_keepalive_options=TCP_OPTIONS,
                )
                for _ in range(2)
            ]
            for end in ends:
                end.connect()
            self._members[name] = Member(name, names[(number + 1) % size], *ends)
        self._beats: deque[tuple[float, Member]] = deque()

    def converge(self, patience: float) -> float:
        """Joins all gateways; returns the time until every rule of every gateway is answered [s].

        Raises:
            OSError: that took longer than `patience` [s].
        """
        began = time.monotonic()
        for member in self._members.values():
            self._join(member)
            self.turn(0.0)
        while any(member.answered < 1 for member in self._members.values()):
            if time.monotonic() - began > patience:
                late = sum(member.answered < 1 for member in self._members.values())
                raise OSError(
                    f"{late} of {len(self._members)} gateways have no answers after {patience:g} s"
                )
            self.turn(0.05)
        return time.monotonic() - began

    def change(self, number: int) -> float:
        """Changes the offers of one gateway; returns the time until the next gateway's answer arrives [s]."""
        member = self._members[f"crowd{number % len(self._members):05d}"]
        member.changes += 1
        before, asked = member.answered, time.monotonic()
        self._offer(member)
        while member.answered == before:
            if time.monotonic() - asked > 30:
                raise OSError(f"{member.name} has no answer after 30 s")
            self.turn(0.05)
        return member.answered_at - asked

    def turn(self, wait: float) -> None:
        """Handles incoming events, waiting at most `wait` [s] for them, and sends the heartbeats that are due."""
        for key, _ in self._selector.select(wait):
            self._take(key.data)
        now = time.monotonic()
        due = []
        while self._beats and self._beats[0][0] <= now:
            due.append(self._beats.popleft()[1])
            self._beats.append((now + HEARTBEAT, due[-1]))
        # Send all heartbeats before waiting for a reply: gateways on separate machines would not wait for one another.
        for member in due:
            alive = alive_key(member.name)
            life = (
                ("GET", alive),
                ("SISMEMBER", GATEWAYS_KEY, member.name),
                ("PEXPIRE", alive, ALIVE),
            )
            member.speech.send(("MULTI",), *life, ("EXEC",))
        for member in due:
            *_, replies = (member.speech.read_response() for _ in range(5))
            if replies[0] != b"instance":
                raise OSError(f"the hub lost {member.name}")

    def _join(self, member: Member) -> None:
        name, speech = member.name, member.speech
        member.events.ask(("SUBSCRIBE", GATEWAYS_KEY), ("SUBSCRIBE", requests_key(name)))
        flips = tuple(
            RemoteRule(member.onward, Rule(Kind.PUBLISHER, topic)) for topic in self._topics(member)
        )
        record = text_from_record(Record(name, "instance", "127.0.0.1", 9, flips=flips))
        _, present = speech.ask(("MGET", NAME_KEY, PROTOCOL_KEY), ("SMEMBERS", GATEWAYS_KEY))
        speech.ask(
            ("MGET", *(alive_key(other.decode()) for other in present or [name.encode()])),
            ("MULTI",),
            *(("HDEL", requests_key(other.decode()), name) for other in present),
            ("SET", record_key(name), record),
            ("SET", alive_key(name), "instance", "PX", ALIVE),
            ("DEL", lost_key(name)),
            ("SADD", GATEWAYS_KEY, name),
            ("PUBLISH", GATEWAYS_KEY, f'{{"gateway": "{name}", "event": "joined"}}'),
            ("EXEC",),
            ("HGETALL", requests_key(name)),
        )
        self._selector.register(member.events, selectors.EVENT_READ, member)
        self._beats.append((time.monotonic() + HEARTBEAT, member))
        if member.onward.encode() in present:
            self._meet(member)

    def _meet(self, member: Member) -> None:
        """Handles the next gateway's registration: subscribes to its record and sends it our offers."""
        member.events.send(("SUBSCRIBE", record_key(member.onward)))
        member.speech.ask(("MGET", record_key(member.onward)))
        self._offer(member)

    def _topics(self, member: Member) -> list[str]:
        return [f"/{member.name}/topic{number}_{member.changes}" for number in range(self._rules)]

    def _offer(self, member: Member) -> None:
        offers = tuple(
            Offer(one, "std_msgs/String", "/node", Purpose.FLIP) for one in self._topics(member)
        )
        self._write(member, member.onward, PeerRequest(offers=offers))

    def _write(self, member: Member, receiver: str, request: PeerRequest) -> None:
        key = requests_key(receiver)
        member.speech.ask(
            ("MULTI",),
            ("HSET", key, member.name, text_from_request(request)),
            ("PUBLISH", key, member.name),
            ("EXEC",),
        )

    def _take(self, member: Member) -> None:
        data, taken = member.rest + member.events.receive(), 0
        for event in _EVENT.finditer(data):
            channel, said = event.groups(b"")
            taken = event.end()
            if channel == requests_key(member.name).encode() and said:
                self._take_request(member, said.decode())
            elif (
                channel == GATEWAYS_KEY.encode()
                and member.onward.encode() in said
                and b'"joined"' in said
            ):
                self._meet(member)
        member.rest = data[taken:]

    def _take_request(self, member: Member, sender: str) -> None:
        (texts,) = member.speech.ask(("HMGET", requests_key(member.name), sender))
        request = request_from_text(texts[0])
        if request.offers:
            replies = tuple(
                Reply(Kind.PUBLISHER, one.topic, one.node, "active") for one in request.offers
            )
            self._write(member, sender, PeerRequest(replies=replies))
        elif {one.topic for one in request.replies} == set(self._topics(member)):
            member.answered += 1
            member.answered_at = time.monotonic()


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
