"""A client of Foxglove's protocol, like Foxglove and Lichtblick."""

import json
import struct
from contextlib import contextmanager
from io import BytesIO

from websockets.sync.client import connect

WAIT = 60


class Client:
    def __init__(self, socket):
        self.socket, self.channels, self.services, self.status = socket, {}, {}, []
        self.info = self.await_op("serverInfo")

    def take(self):
        frame = self.socket.recv(WAIT)
        if isinstance(frame, bytes):
            return frame
        fields = json.loads(frame)
        if fields["op"] == "advertise":
            self.channels.update((one["topic"], one) for one in fields["channels"])
        if fields["op"] == "advertiseServices":
            self.services.update((one["name"], one) for one in fields["services"])
        return fields

    def await_op(self, op):
        while True:
            fields = self.take()
            if isinstance(fields, dict) and fields["op"] == op:
                return fields

    def await_topic(self, *topics):
        while not set(topics) <= self.channels.keys():
            self.take()

    def await_service(self, name):
        while name not in self.services:
            self.take()

    def send(self, **fields):
        self.socket.send(json.dumps(fields))

    def messages(self, **topics):
        """Returns the first message of each topic, in the order of the arguments."""
        wanted = {number: self.channels[topic] for number, topic in enumerate(topics.values(), 1)}
        rows = [{"id": number, "channelId": channel["id"]} for number, channel in wanted.items()]
        self.send(op="subscribe", subscriptions=rows)
        found = {}
        while len(found) < len(rows):
            frame = self.take()
            if isinstance(frame, bytes) and frame[0] == 1:
                number, stamp = struct.unpack_from("<IQ", frame, 1)
                assert stamp > 0
                found.setdefault(number, frame[13:])
        self.send(op="unsubscribe", subscriptionIds=list(wanted))
        return [found[number] for number in sorted(found)]


@contextmanager
def foxglove_client(url, token):
    """Yields a client of the page's server at ``url``."""
    url = url.replace("http", "ws") + f"/foxglove/{token}"
    with connect(
        url, subprotocols=["foxglove.websocket.v1"], max_size=None, open_timeout=WAIT
    ) as socket:
        assert socket.subprotocol == "foxglove.websocket.v1"
        yield Client(socket)


def body(message):
    file = BytesIO()
    message.serialize(file)
    return file.getvalue()


def advertise(client, number, topic, kind):
    """Advertises messages of type ``kind`` on channel ``number``."""
    channel = {"id": number, "topic": topic, "encoding": "ros1", "schemaName": kind}
    client.send(op="advertise", channels=[channel])


def publish(client, number, message):
    """Publishes a message on a channel."""
    client.socket.send(struct.pack("<BI", 1, number) + body(message))
