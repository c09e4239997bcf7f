"""Messages, requests and bytes that no sane program sends, and that no robot obeys.

Input that a program of the fleet may legitimately send (another goal, a valid pose in ``map``) would change what robots
do. So every message contains invalid numbers or names of things that do not exist.
"""

import io
import random
import struct
import xmlrpc.client
from typing import Any

import genpy
import roslib.message

ODD = (
    *("", "/", "//", "/a b", "/\0", "~x", "-1", "../..", "%s%n", "(", "/a\n/b", "\x1b[2J"),
    *("." * 5000, "ü" * 300, "a" * 200_000, "nan", "map/../odom", "/ghost/" * 40),
)
FOREIGN = ("ghost", "/a b", "x\0y", "ü" * 300, "." * 5000, "ghost/odom", "%s%n")
"""Frames that no TF tree has. The empty name is left out: it would mean the node's own frame."""

NOT_FINITE = (float("nan"), float("inf"), float("-inf"))
HUGE = {"float32": (3e38, -3e38), "float64": (1e308, -1e308, 1e200)}
FAR_AHEAD = (2_000_000_000, 2**32 - 1)
"""Stamps in the far future [s]."""
SIZES = {
    "int8": (1, True),
    "uint8": (1, False),
    "byte": (1, True),
    "char": (1, False),
    "int16": (2, True),
}
SIZES |= {
    "uint16": (2, False),
    "int32": (4, True),
    "uint32": (4, False),
    "int64": (8, True),
    "uint64": (8, False),
}


class Poison:
    """Draws messages in which every number and name is bad.

    Args:
        rng: the source of all draws.
        names: strings to draw from, in addition to ``ODD``.
        huge: whether to draw huge numbers as well as non-finite ones.
    """

    def __init__(self, rng: random.Random, names: tuple[str, ...], huge: bool = True) -> None:
        self._rng, self._names, self._huge = rng, names, huge

    def fill(self, message: genpy.Message) -> genpy.Message:
        """Fills a message of any type and returns it."""
        for slot, kind in zip(message.__slots__, message._slot_types, strict=True):
            setattr(message, slot, self._value(kind))
        return message

    def _value(self, kind: str) -> Any:
        base, bracket, count = kind.partition("[")
        if not bracket:
            return self._single(base)
        length = int(count[:-1]) if count[:-1] else self._rng.choice((0, 1, 2, 7))
        if base in ("uint8", "char"):
            return self._rng.randbytes(length)
        return [self._single(base) for _ in range(length)]

    def _single(self, kind: str) -> Any:
        rng = self._rng
        if kind in HUGE:
            return rng.choice((*NOT_FINITE, *(HUGE[kind] if self._huge else ())))
        if kind == "bool":
            return rng.random() < 0.5
        if kind in SIZES:
            size, signed = SIZES[kind]
            least, most = (
                (-(2 ** (8 * size - 1)), 2 ** (8 * size - 1) - 1)
                if signed
                else (0, 2 ** (8 * size) - 1)
            )
            return rng.choice((least, most, 0, 1, rng.randint(least, most)))
        if kind == "string":
            return rng.choice(self._names if rng.random() < 0.6 else ODD)
        if kind == "time":
            return genpy.Time(rng.choice((0, *FAR_AHEAD)), rng.choice((0, 999_999_999)))
        if kind == "duration":
            return genpy.Duration(rng.choice((-(2**31), 2**31 - 1)), rng.choice((0, 999_999_999)))
        return self.fill(
            roslib.message.get_message_class("std_msgs/Header" if kind == "Header" else kind)()
        )


def foreign(rng: random.Random, message: genpy.Message) -> genpy.Message:
    """Fills a message with valid numbers, but with frames and names of things that do not exist."""
    for slot, kind in zip(message.__slots__, message._slot_types, strict=True):
        value = getattr(message, slot)
        if isinstance(value, genpy.Message):
            foreign(rng, value)
        elif kind == "string":
            setattr(message, slot, rng.choice(FOREIGN))
        elif kind in HUGE:
            setattr(message, slot, rng.uniform(-3.0, 3.0))
        elif kind == "float32[]":
            setattr(message, slot, [rng.uniform(0.1, 9.0) for _ in range(90)])
        elif kind == "geometry_msgs/TransformStamped[]":
            item = roslib.message.get_message_class(kind[:-2])
            setattr(message, slot, [foreign(rng, item()) for _ in range(3)])
    return message


def spoilt(rng: random.Random, message: genpy.Message) -> bytes:
    """Returns a message's bytes, truncated or with a wrong length field."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    data = buffer.getvalue()
    if len(data) < 4 or rng.random() < 0.5:
        return data[: rng.randrange(len(data))] if data else b""
    place = rng.randrange(len(data) - 3)
    return data[:place] + b"\xff\xff\xff\xff" + data[place + 4 :]


def raw_class(kind: Any) -> Any:
    """Returns a message class with the name and MD5 sum of ``kind`` that stores and sends raw bytes."""

    class Raw(genpy.Message):  # type: ignore[misc]
        __slots__ = ("data",)
        _slot_types = ("string",)
        _type, _md5sum, _full_text, _has_header = kind._type, kind._md5sum, kind._full_text, False

        def serialize(self, buff: io.BytesIO) -> None:
            buff.write(self.data)

        def deserialize(self, data: bytes) -> Any:
            self.data = data
            return self

    return Raw


def junk(rng: random.Random, depth: int = 3) -> Any:
    """Returns a random XML-RPC value, which may be a list or a dictionary."""
    kind = rng.randrange(8 if depth else 6)
    if kind == 6:
        return [junk(rng, depth - 1) for _ in range(rng.randrange(4))]
    if kind == 7:
        return {str(rng.randrange(9)): junk(rng, depth - 1) for _ in range(rng.randrange(3))}
    texts = [text for text in ODD if text.isprintable()]
    return (
        rng.randint(-(2**31), 2**31 - 1),
        rng.uniform(-9, 9),
        True,
        rng.choice(texts),
        rng.randbytes(9),
        "/f",
    )[kind]


METHODS = (
    *(
        "requestTopic",
        "publisherUpdate",
        "paramUpdate",
        "getBusStats",
        "getBusInfo",
        "getMasterUri",
        "getPid",
    ),
    *(
        "getSubscriptions",
        "getPublications",
        "getName",
        "system.listMethods",
        "system.multicall",
        "__class__",
        "_x",
        "",
    ),
)
"""Without ``shutdown``, which ends a ROS 1 node by design; updates for topics in use are not faked either."""


def request(rng: random.Random) -> bytes:
    """Returns hostile input for an XML-RPC server: calls with odd arguments, broken documents and broken HTTP."""
    method = rng.choice(METHODS)
    body = xmlrpc.client.dumps(
        ("/fuzz", *(junk(rng) for _ in range(rng.randrange(4)))), method
    ).encode()
    fault = rng.randrange(8)
    if fault == 0:
        body = body[: rng.randrange(len(body))]
    elif fault == 1:
        body = b"<methodCall>" + b"<array><data><value>" * 2000
    elif fault == 2:
        place = rng.randrange(len(body))
        body = body[:place] + rng.randbytes(4) + body[place:]
    length = (
        rng.choice((b"-1", b"x", b"99999999999", b"0", b"1 2"))
        if fault == 3
        else str(len(body)).encode()
    )
    if fault == 4:
        return rng.randbytes(rng.randrange(300))
    head = b"POST /RPC2 HTTP/1.%d\r\nHost: x\r\nContent-Type: text/xml\r\n" % rng.randrange(3)
    if fault == 5:
        head += b"X-%d: %s\r\n" % (rng.randrange(9), b"y" * 70_000)
    return head + b"Content-Length: " + length + b"\r\n\r\n" + body


def hello(rng: random.Random) -> bytes:
    """Returns hostile input for a relay or a node's TCPROS port: headers with odd fields, or no header at all."""
    keys = (
        "relay",
        "topic",
        "service",
        "call",
        "parameter",
        "type",
        "md5sum",
        "callerid",
        "persistent",
    )
    keys += (
        "source_node",
        "source_gateway",
        "sink_gateway",
        "nonce",
        "proof",
        "gateways_passed",
        "rate",
        "tf_frames",
    )
    body = b""
    for key in rng.sample(keys, rng.randrange(len(keys))):
        field = (
            key.encode() + b"=" + rng.choice((*ODD[:12], "1", "2", "*", "/tf", "/ghost")).encode()
        )
        body += struct.pack("<I", len(field)) + field
    fault = rng.randrange(5)
    if fault == 0:
        return rng.randbytes(rng.randrange(300))
    if fault == 1:
        return struct.pack("<I", rng.randrange(2**32)) + body
    if fault == 2:
        body = body[: rng.randrange(len(body) + 1)]
    return struct.pack("<I", len(body)) + body


def proof(rng: random.Random) -> bytes:
    """Returns what an unauthenticated client may send to a hub: parts of the proof, Redis commands, or garbage."""
    session = rng.randbytes(rng.choice((16, 16, 0, 15, 200))).hex().encode()
    share = rng.choice(
        (bytes(32), b"\xff" * 32, rng.randbytes(32), rng.randbytes(31), (1).to_bytes(32, "little"))
    )
    tag = rng.randbytes(rng.choice((64, 64, 0, 3)))
    lines = (
        b"ROCON-PROVE 1 " + session,
        b"ROCON-PROVE 1 " + session + b"\r\n" + share.hex().encode() + b" " + tag.hex().encode(),
        b"ROCON-PROVE 99999999999999999999 " + session,
        b"AUTH hub " + session,
        b"*1\r\n$4\r\nPING",
        b"*99999999\r\n$-7",
        rng.randbytes(rng.randrange(300)),
        b"x" * 9000,
    )
    return rng.choice(lines) + rng.choice((b"\r\n", b"\n", b""))


COMMANDS = (
    *(
        "EVAL while(true)do(end) 0",
        "CLIENT PAUSE 100000",
        "ACL SETUSER default",
        "SYNC",
        "FLUSHALL",
        "CONFIG SET a b",
    ),
    *(
        "SHUTDOWN",
        "DEBUG SLEEP 9",
        "KEYS *",
        "MONITOR",
        "SCRIPT KILL",
        "SET rocon:hub:salt x",
        "DEL rocon:hub:name",
    ),
    *(
        "PUBLISH rocon:gateways [[[",
        "PUBLISH rocon:gateways {}",
        "SET rocon:gateway:ghost {",
        "SADD rocon:gateways ghost",
    ),
    *(
        "HSET rocon:requests:ghost a [",
        "SET rocon:alive:ghost x",
        "SELECT 3",
        "RESET",
        "PING",
        "INFO",
        "MULTI",
        "EXEC",
    ),
)
"""Input from a member of the fleet: forbidden commands, and nonsense in keys that it may write."""
