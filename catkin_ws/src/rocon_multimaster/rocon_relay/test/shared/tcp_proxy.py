"""A small TCP proxy that delays or swallows data."""

import contextlib
import selectors
import socket
import threading
import time
from collections import deque


class TcpProxy:
    """Forwards connections to an address, in one thread.

    Args:
        host: host to forward to.
        port: port to forward to.
    """

    def __init__(self, host: str, port: int) -> None:
        self._target = (host, port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[
            1
        ]  #: its listening port, on the loopback interface
        #: swallows: whether incoming data is read and discarded, and nothing is sent back
        #: delay: how long each byte is delayed in each direction [s]
        self.delay, self.swallows = 0.0, False
        self._peers: dict[socket.socket, socket.socket] = {}
        self._late: deque[tuple[float, socket.socket, bytes]] = deque()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="proxy", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stopping:
            for key, _ in self._selector.select(0.005 if self._late else 0.05):
                if key.fileobj is self._listener:
                    self._accept()
                elif isinstance(key.fileobj, socket.socket):
                    self._read(key.fileobj)
            while self._late and self._late[0][0] <= time.monotonic():
                _, receiver, data = self._late.popleft()
                with contextlib.suppress(OSError):
                    receiver.sendall(data)

    def _accept(self) -> None:
        near, _ = self._listener.accept()
        try:
            far = socket.create_connection(self._target, 5)
        except OSError:
            near.close()
            return
        for one, other in ((near, far), (far, near)):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._peers[one] = other
            self._selector.register(one, selectors.EVENT_READ)

    def _read(self, sender: socket.socket) -> None:
        try:
            data = sender.recv(65536)
        except OSError:
            data = b""
        receiver = self._peers.get(sender)
        if data and receiver is not None and not self.swallows:
            self._late.append((time.monotonic() + self.delay, receiver, data))
        elif not data:
            for one in (sender, receiver):
                self._drop(one)

    def _drop(self, one: socket.socket | None) -> None:
        if one is not None and self._peers.pop(one, None) is not None:
            self._selector.unregister(one)
            one.close()

    def close(self) -> None:
        """Closes all connections."""
        self._stopping = True
        self._thread.join()
        for one in list(self._peers):
            self._drop(one)
        self._selector.close()
        self._listener.close()
