"""TLS handshakes that count as unfinished requests: clients that never end one must not keep others out."""

import asyncio
import ssl
from collections.abc import Callable
from typing import Any

from pioneer_web.access.admission import PATIENCE, Admission


def secured_protocol(
    protocol: Callable[..., asyncio.Protocol],
    context: ssl.SSLContext,
    admission: Admission,
    patience: float = PATIENCE,
) -> Callable[..., asyncio.Protocol]:
    """Returns a factory of protocols that do the handshake on a plain connection and then hand over to ``protocol``.

    asyncio's own TLS servers give a handshake a minute, and call a protocol only once it has succeeded: until then,
    nothing could count the connections. For asyncio's event loop: uvloop reads from a paused connection, so that the
    beginning of the handshake would be lost.

    Args:
        protocol: factory of the protocol above TLS.
        context: the server's certificate and options.
        admission: counts the connections; it may close one in its handshake.
        patience: time-out for the handshake [s].
    """

    def build(*arguments: Any, **options: Any) -> asyncio.Protocol:
        return _Handshake(lambda: protocol(*arguments, **options), context, admission, patience)

    return build


class _Handshake(asyncio.Protocol):
    """A connection until its handshake is complete."""

    is_idle = True

    def __init__(
        self,
        build: Callable[[], asyncio.Protocol],
        context: ssl.SSLContext,
        admission: Admission,
        patience: float,
    ) -> None:
        self._build, self._context, self._admission = build, context, admission
        self._patience = patience
        self.transport: Any = None
        self._task: asyncio.Task[None] | None = None

    def connection_made(self, transport: Any) -> None:
        self.transport = transport
        peer = transport.get_extra_info("peername")
        self._admission.add(self, str(peer[0]) if isinstance(peer, tuple) else "")
        transport.pause_reading()  # what arrives before `start_tls` is the handshake's
        self._task = asyncio.get_running_loop().create_task(self._secure())

    async def _secure(self) -> None:
        loop = asyncio.get_running_loop()
        early = _Early()
        try:
            secured = await loop.start_tls(
                self.transport,
                early,
                self._context,
                server_side=True,
                ssl_handshake_timeout=self._patience,
                ssl_shutdown_timeout=self._patience,
            )
        except (OSError, TimeoutError):  # ssl.SSLError is an OSError
            self.transport.abort()
            return
        finally:
            self._admission.remove(self)
        if secured is None:  # closed meanwhile
            return
        early.hand_over(secured, self._build())


class _Early(asyncio.Protocol):
    """Keeps what a client sends together with the end of its handshake."""

    def __init__(self) -> None:
        self._received = bytearray()
        self._is_lost = False

    def data_received(self, data: bytes) -> None:
        self._received += data

    def connection_lost(self, exc: Exception | None) -> None:
        self._is_lost = True

    def hand_over(self, transport: Any, protocol: asyncio.Protocol) -> None:
        """Makes ``protocol`` that of the transport, as if the connection had begun now."""
        if self._is_lost:
            return
        transport.set_protocol(protocol)
        protocol.connection_made(transport)
        if self._received:
            protocol.data_received(bytes(self._received))
