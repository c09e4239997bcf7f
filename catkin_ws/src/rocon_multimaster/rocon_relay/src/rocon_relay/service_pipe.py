"""Forwards service calls between two connections in both directions, with back-pressure."""

from collections.abc import Callable

from tcpros.service_call import CallTotals, Conversation
from tcpros.stream import Stream

Follow = Callable[[memoryview], None]
"""Checks the bytes that pass; raises TcprosError for invalid ones."""


class ServicePipe:
    """Joins the client side (its connection or link) with the server side (the server's connection or link)."""

    def __init__(self, client: Stream, server: Stream, max_size: int, totals: CallTotals) -> None:
        self.conversation = Conversation(max_size, totals)  #: tracks the calls that pass
        _join(client, server, self.conversation.request)
        _join(server, client, self.conversation.response)


def _join(source: Stream, sink: Stream, follow: Follow) -> None:
    def parse(data: memoryview) -> int:
        follow(data)
        if not sink.is_closed:
            sink.pass_on(data)
            if not sink.backlog.is_empty:
                source.hold()
        return len(data)

    source.parse = parse
    sink.relieved = source.release
    source.release()
