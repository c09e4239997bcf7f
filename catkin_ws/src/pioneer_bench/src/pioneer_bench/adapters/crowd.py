"""Many simulated gateways in one process that speak the protocol of `docs/gateway.md` with a real hub.

Each has two connections of its own and does what a gateway does on the hub: it joins, sends heartbeats, offers topics
to its successor in a ring, and answers its predecessor. There are no relays, so no messages are carried.
"""

import selectors
import socket
import time
from collections import deque
from dataclasses import dataclass

from rocon_hub_protocol.adapters.password import password_from
from rocon_hub_protocol.adapters.redis_client import prove
from rocon_hub_protocol.core.key import (
    GATEWAYS_KEY,
    NAME_KEY,
    PROTOCOL_KEY,
    alive_key,
    lost_key,
    record_key,
    requests_key,
)
from rocon_hub_protocol.core.record import (
    Offer,
    PeerRequest,
    Purpose,
    Record,
    Reply,
    request_from_text,
    text_from_record,
    text_from_request,
)
from rocon_hub_protocol.core.rule import Kind, RemoteRule, Rule

HEARTBEAT, ALIVE = 0.5, 2000
"""Heartbeat period [s]; time to live of a heartbeat on the hub [ms]."""


class Connection:
    """A connection to Redis with pipelined commands; kept small, because there are thousands."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), 10)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if password := password_from(""):
            prove(self.socket, password())
        self._data, self._at = b"", 0

    def send(self, *commands: tuple[object, ...]) -> None:
        """Sends commands; their replies are read later, with ``reply``."""
        self.socket.sendall(b"".join(map(_encoded, commands)))

    def ask(self, *commands: tuple[object, ...]) -> list[object]:
        """Sends commands and returns their replies."""
        self.send(*commands)
        return [self.reply() for _ in commands]

    def reply(self) -> object:
        """Returns the next reply; raises OSError if Redis reports an error."""
        line = self._line()
        kind, rest = line[:1], line[1:]
        if kind == b"-":
            raise OSError(rest.decode())
        if kind == b"$":
            return None if rest == b"-1" else self._exactly(int(rest))
        if kind == b"*":
            return [self.reply() for _ in range(int(rest))]
        return rest

    def _line(self) -> bytes:
        while (end := self._data.find(b"\r\n", self._at)) < 0:
            self._more()
        line, self._at = self._data[self._at : end], end + 2
        return line

    def _exactly(self, size: int) -> bytes:
        while len(self._data) < self._at + size + 2:
            self._more()
        found, self._at = self._data[self._at : self._at + size], self._at + size + 2
        return found

    def _more(self) -> None:
        more = self.socket.recv(1 << 16)
        if not more:
            raise OSError("the hub closed a connection")
        self._data, self._at = self._data[self._at :] + more, 0


def _encoded(command: tuple[object, ...]) -> bytes:
    words = [word if isinstance(word, bytes) else str(word).encode() for word in command]
    return b"*%d\r\n" % len(words) + b"".join(b"$%d\r\n%s\r\n" % (len(word), word) for word in words)


def _messages(data: bytes) -> tuple[list[tuple[bytes, bytes]], bytes]:
    """Returns channel and text of each complete message, and the bytes left over; skips subscription confirmations."""
    found, begin = [], 0
    try:
        while begin < len(data):
            _, at = _bulk(data, data.index(b"\r\n", begin) + 2)
            channel, at = _bulk(data, at)
            if data[at : at + 1] == b":":
                begin = data.index(b"\r\n", at) + 2
                continue
            said, begin = _bulk(data, at)
            found.append((channel, said))
    except ValueError:
        pass  # the rest has not arrived yet
    return found, data[begin:]


def _bulk(data: bytes, at: int) -> tuple[bytes, int]:
    """Returns the bulk string at `at`, and the offset behind it. Raises ValueError if it is incomplete."""
    begin = data.index(b"\r\n", at) + 2
    end = begin + int(data[at + 1 : begin - 2])
    if end + 2 > len(data):
        raise ValueError("the text is not whole yet")
    return data[begin:end], end + 2


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
        for number, name in enumerate(names):
            ends = Connection(port), Connection(port)
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
                raise OSError(f"{late} of {len(self._members)} gateways have no answers after {patience:g} s")
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
            life = ("GET", alive), ("SISMEMBER", GATEWAYS_KEY, member.name), ("PEXPIRE", alive, ALIVE)
            member.speech.send(("MULTI",), *life, ("EXEC",))
        for member in due:
            replies = [member.speech.reply() for _ in range(5)][-1]
            if not isinstance(replies, list) or replies[0] != b"instance":
                raise OSError(f"the hub lost {member.name}")

    def _join(self, member: Member) -> None:
        name, speech = member.name, member.speech
        member.events.ask(("SUBSCRIBE", GATEWAYS_KEY), ("SUBSCRIBE", requests_key(name)))
        flips = tuple(RemoteRule(member.onward, Rule(Kind.PUBLISHER, topic)) for topic in self._topics(member))
        record = text_from_record(Record(name, "instance", "127.0.0.1", 9, flips=flips))
        _, present = speech.ask(("MGET", NAME_KEY, PROTOCOL_KEY), ("SMEMBERS", GATEWAYS_KEY))
        assert isinstance(present, list)
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
        self._selector.register(member.events.socket, selectors.EVENT_READ, member)
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
        offers = tuple(Offer(one, "std_msgs/String", "/node", Purpose.FLIP) for one in self._topics(member))
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
        data = member.events.socket.recv(1 << 18)
        if not data:
            raise OSError(f"the hub closed the connection of {member.name}")
        messages, member.rest = _messages(member.rest + data)
        for channel, said in messages:
            if channel == requests_key(member.name).encode():
                self._take_request(member, said.decode())
            elif channel == GATEWAYS_KEY.encode() and member.onward.encode() in said and b'"joined"' in said:
                self._meet(member)

    def _take_request(self, member: Member, sender: str) -> None:
        (texts,) = member.speech.ask(("HMGET", requests_key(member.name), sender))
        assert isinstance(texts, list)
        request = request_from_text(texts[0])
        if request.offers:
            replies = tuple(Reply(Kind.PUBLISHER, one.topic, one.node, "active") for one in request.offers)
            self._write(member, sender, PeerRequest(replies=replies))
        elif {one.topic for one in request.replies} == set(self._topics(member)):
            member.answered += 1
            member.answered_at = time.monotonic()
