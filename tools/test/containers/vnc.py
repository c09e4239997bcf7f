"""The browser's side of the desktop: its page, and the screen's protocol over a WebSocket (RFC 6455, 6143)."""

import struct
from collections.abc import Callable
from types import TracebackType

import numpy as np
import websocket
from numpy.typing import NDArray

_BLUE_GREEN_RED_DEPTH_24 = struct.pack(">BBBBHHHBBBxxx", 32, 24, 0, 1, 255, 255, 255, 16, 8, 0)
_RAW = 0
_UPDATE, _COLOURS, _BELL, _CLIPBOARD = range(4)


class VncError(Exception):
    """The server violates the VNC protocol; the message says how."""


class Screen:
    """A screen behind websockify; as a context manager, it disconnects on exit.

    Args:
        url: "ws://…/websockify?token=…".
        patience: the longest wait for an answer [s].

    Raises:
        websocket.WebSocketException, OSError: there is no server, or the token is wrong.
        VncError: the server is not a screen without a password.
    """

    def __init__(self, url: str, patience: float) -> None:
        self._received = bytearray()
        self._socket = websocket.create_connection(url, timeout=patience, subprotocols=["binary"])
        try:
            self.size = self._greet()
        except BaseException:
            self._socket.close()
            raise

    def _greet(self) -> tuple[int, int]:
        version = self._read(12)
        if version != b"RFB 003.008\n":
            raise VncError(f"a screen begins with its version, not with {version!r}")
        self._socket.send_binary(version)
        kinds = self._read(self._read(1)[0])
        if 1 not in kinds:
            raise VncError(f"the screen wants a password (security types {list(kinds)})")
        self._socket.send_binary(b"\x01")
        if self._read(4) != bytes(4):
            raise VncError("the screen refuses us")
        self._socket.send_binary(b"\x01")  # shared: other clients stay connected
        width, height, _, length = struct.unpack(">HH16sI", self._read(24))
        self._read(length)
        self._socket.send_binary(b"\x00\x00\x00\x00" + _BLUE_GREEN_RED_DEPTH_24)
        self._socket.send_binary(struct.pack(">BxHi", 2, 1, _RAW))
        return width, height

    def picture(self) -> NDArray[np.uint8]:
        """Returns the current screen as an array of shape (height, width, 3), RGB."""
        width, height = self.size
        self._socket.send_binary(struct.pack(">BBHHHH", 3, 0, 0, 0, width, height))
        found = np.zeros((height, width, 3), np.uint8)
        while not self._update(found):
            pass
        return found

    def _update(self, image: NDArray[np.uint8]) -> bool:
        """Reads one message into the picture; returns whether it was a framebuffer update."""
        others: dict[int, Callable[[], object]] = {
            _COLOURS: lambda: self._read(6 * struct.unpack(">x2xH", self._read(5))[0]),
            _BELL: lambda: None,
            _CLIPBOARD: lambda: self._read(struct.unpack(">3xI", self._read(7))[0]),
        }
        kind = self._read(1)[0]
        if kind != _UPDATE:
            if kind not in others:
                raise VncError(f"a message of kind {kind}, which the protocol does not have")
            others[kind]()
            return False
        for _ in range(struct.unpack(">xH", self._read(3))[0]):
            x, y, width, height, encoding = struct.unpack(">HHHHi", self._read(12))
            if encoding != _RAW:
                raise VncError(f"a picture in encoding {encoding}, which was not asked for")
            pixels = np.frombuffer(self._read(4 * width * height), np.uint8).reshape(
                height, width, 4
            )
            image[y : y + height, x : x + width] = pixels[..., 2::-1]
        return True

    def _read(self, size: int) -> bytes:
        while len(self._received) < size:
            more = self._socket.recv()
            if not more:
                raise VncError("the screen has hung up")
            self._received += more
        found = bytes(self._received[:size])
        del self._received[:size]
        return found

    def __enter__(self) -> "Screen":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._socket.close()
