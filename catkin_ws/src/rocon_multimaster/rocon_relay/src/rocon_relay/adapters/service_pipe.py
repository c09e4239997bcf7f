"""Bytes of calls from one connection to another and back, no further ahead than the slower one takes them."""

from collections.abc import Callable

from tcpros.adapters.stream import Stream
from tcpros.core.service_call import Conversation

Follow = Callable[[memoryview], None]
"""Sees what passes; raises RelayError for what must not."""


class ServicePipe:
    """Joins a client's connection, or the link that stands for it, with the server's, or the link that leads there."""

    def __init__(self, client: Stream, server: Stream, max_size: int) -> None:
        self.conversation = Conversation(max_size)  #: what has passed
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
