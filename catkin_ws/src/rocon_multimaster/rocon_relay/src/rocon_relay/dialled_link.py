"""The import side of a link: the outgoing connection to the exporting relay."""

import dataclasses
import socket
import time
from typing import Protocol

from rocon_relay.connection import Address, LinkState, Subject
from rocon_relay.context import Context
from rocon_relay.link import VERSION, Hello, LinkError, is_proof, proof, state_from_field
from rocon_relay.path import HEADERS, MARGIN, MAX_PROBE, PROBE_TIMEOUT, advice
from tcpros.dialled_stream import DialledStream, watch_liveness
from tcpros.frame import LENGTH_SIZE, control_frame, is_control
from tcpros.header import header_bytes, header_parser, printable


class LinkOwner(Protocol):
    """Receives the events of a link."""

    def link_up(self, fields: dict[str, str]) -> None:
        """Called with the far relay's welcome."""

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Called once when the link has been closed."""


class TopicOwner(LinkOwner, Protocol):
    """Receives the events of a topic's link."""

    def told(self, fields: dict[str, str]) -> None:
        """Called with the fields of each received control frame."""


class DialledLink(DialledStream):
    """One connection attempt, which becomes the link if it succeeds."""

    def __init__(self, context: Context, owner: LinkOwner, address: Address, hello: Hello) -> None:
        peer = f"{hello.source_gateway} at {address.host}:{address.port}"
        super().__init__(context.reactor, peer, header_bytes(hello.fields()), context.tls)
        watch_liveness(self._socket)
        self._context = context
        self._owner = owner
        self._hello = hello
        self._address = address
        self.path = context.paths.choice(address)  #: size of its TCP segments
        self._is_probing = False
        self._expected = ""
        self._state = LinkState.UNREACHABLE
        self._timer = context.reactor.call_later(context.config.handshake_timeout, self._too_late)
        self.parse = header_parser(self._take_answer)

    def connect(self, host: str, port: int) -> None:
        """Starts connecting, with the segment size that the path needs; both ends then keep to it."""
        if self.path.segment:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, self.path.segment)
        super().connect(host, port)

    def connected(self) -> None:
        """Sends the hello, which asks for a probe of the path between two machines."""
        if self._hello.subject is not Subject.CALL and not self._stays_on_this_machine():
            full = self._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG)
            self._hello = dataclasses.replace(self._hello, probe=min(full + MARGIN, MAX_PROBE))
            self._request = header_bytes(self._hello.fields())
        super().connected()

    def _stays_on_this_machine(self) -> bool:
        try:
            return bool(self._socket.getpeername()[0] == self._socket.getsockname()[0])
        except OSError:
            return True  # it has just been closed

    def accepted(self, fields: dict[str, str]) -> None:
        """Called with the far relay's welcome."""
        self.parse = self._parse_more
        self._owner.link_up(fields)

    def closed(self, reason: str) -> None:
        """Reports the lost link to its owner."""
        self._timer.cancel()
        if reason.startswith("malformed"):
            self._context.logger.warning("link to %s: %s", self.peer, reason)
        if reason.startswith("TLS"):
            self._state = LinkState.REFUSED
        self._owner.link_lost(self._state, f"{self.peer}: {reason or 'it closed the connection'}")

    def _too_late(self) -> None:
        if self._shaking and not self._connecting:
            # The certificates fill a packet: it may be those that the path swallows.
            self._context.paths.swallows(self._address, self.path.segment, is_proved=False)
        self.close("no answer in time")

    def _await_probe(self) -> None:
        """Waits for the rest of the welcome: the small packet in front of it has arrived."""
        if self._is_probing:
            raise LinkError("it probes twice")
        self._is_probing = True
        self._timer.cancel()
        self._timer = self._reactor.call_later(PROBE_TIMEOUT, self._probe_lost)

    def _probe_lost(self) -> None:
        former = self.path.segment
        self._context.paths.swallows(self._address, former, is_proved=True)
        following = advice(self._context.paths.choice(self._address))
        what = f"packets of {former + HEADERS} bytes" if former else "full packets"
        self._context.logger.warning(
            "link to %s: small packets arrive, %s do not%s",
            self.peer,
            what,
            f": {following}" if following else "",
        )
        self.close(f"small packets arrive, {what} do not: check the MTU on the path")

    def _take_answer(self, fields: dict[str, str]) -> None:
        if "error" in fields:
            self._state = state_from_field(fields.get("state", ""))
            self.close(printable(fields["error"]))
        elif fields.get("relay") != VERSION:
            raise LinkError(f"it does not speak version {VERSION} of the link protocol")
        elif "challenge" in fields:
            self._answer_challenge(fields["challenge"], fields.get("key", ""))
        elif "probe" in fields:
            self._await_probe()
        elif self._context.config.keyring and not is_proof(fields.get("proof", ""), self._expected):
            self._state = LinkState.REFUSED
            self.close("it does not prove that it knows our password")
        else:
            self._timer.cancel()
            self.accepted(fields)

    def _answer_challenge(self, challenge: str, name: str) -> None:
        keyring = self._context.config.keyring
        found = keyring.key((name,)) if keyring and name in self._hello.keys else None
        if found is None or self._expected:
            self._state = LinkState.REFUSED
            self.close("it asks for a proof that we cannot give")
            return
        hello = self._hello.fields()
        self._expected = proof(found[1], "source", hello, challenge)
        self.send(
            header_bytes({"relay": VERSION, "proof": proof(found[1], "sink", hello, challenge)})
        )

    def _parse_more(self, data: memoryview) -> int:
        """Parses the data that follows the welcome."""
        raise LinkError("it sends what was not asked for")


class TopicLink(DialledLink):
    """A link that receives messages."""

    longest_hold = 2.0  # the source considers a link dead that is not read for seven seconds

    def __init__(self, context: Context, owner: TopicOwner, address: Address, hello: Hello) -> None:
        super().__init__(context, owner, address, hello)
        self._topic_owner = owner
        self._pings = 0
        self._pinged = 0.0
        self._awaits_pong = False
        self._measures = False
        self._heard = (0, time.monotonic())

    @property
    def is_up(self) -> bool:
        """Whether the far relay has accepted the link."""
        return self.fanout is not None

    def ping(self, last: float, measures: bool = True) -> None:
        """Asks the far relay to answer, unless an answer is still due.

        Args:
            last: the previous round-trip time, reported to the far relay [s].
            measures: whether the round trip is recorded.
        """
        if self._awaits_pong:
            return
        self._awaits_pong, self._measures = True, measures
        self._pings += 1
        self._pinged = time.monotonic()
        self.send(control_frame(op="ping", token=str(self._pings), last=f"{last:.6f}"))

    def watch(self, late: bool) -> None:
        """Sends a heartbeat if the link is silent, and closes the link if it stays silent.

        A middlebox may acknowledge bytes and then drop them, so the kernel does not notice that the peer has vanished.

        Args:
            late: whether this check is overdue; the silence then proves nothing and its timer restarts.
        """
        received, now = self.received(), time.monotonic()
        if late or received != self._heard[0]:
            self._heard = (received, now)
        elif now - self._heard[1] >= self._context.config.silence:
            self.close(
                f"nothing has come for {now - self._heard[1]:.0f} s, though it was asked to answer"
            )
        else:
            self.ping(0.0, measures=False)

    def _parse_more(self, data: memoryview) -> int:
        assert self.fanout is not None
        return self.fanout.feed(data) or self._parse_control(data)

    def _parse_control(self, data: memoryview) -> int:
        return header_parser(self._control, LENGTH_SIZE)(data) if is_control(data) else 0

    def _control(self, fields: dict[str, str]) -> None:
        if fields.get("op") == "pong":
            self._take_pong(fields.get("token", ""))
        else:
            self._topic_owner.told(fields)

    def _take_pong(self, token: str) -> None:
        if self._awaits_pong and token == str(self._pings):
            self._awaits_pong = False
            if self._measures:
                self._context.round_trip(
                    self._hello.source_gateway, time.monotonic() - self._pinged
                )
