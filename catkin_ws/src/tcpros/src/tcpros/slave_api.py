"""The XML-RPC slave API of a ROS node, called by the master, subscribers and tools. Opens no socket.

(https://wiki.ros.org/ROS/Slave_API)
"""

import os
import xmlrpc.client
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from tcpros.error import TcprosError
from tcpros.http import NONSENSE, xmlrpc_values
from tcpros.topic_source import TopicSource

Answer = tuple[int, str, Any]


class SlaveApiError(TcprosError):
    """The request is not an XML-RPC call."""


class Published(Protocol):
    """A topic that a node publishes."""

    @property
    def type(self) -> str:
        """Its message type."""

    @property
    def subscribers(self) -> Mapping[Any, str]:
        """The names of the connected subscribers by connection."""

    def refusal(self, name: str) -> str:
        """Returns why a node of that name may not subscribe, "" if it may."""


@dataclass(slots=True)
class SlaveApi:
    """Answers calls to one node from its data and callbacks."""

    name: str
    uri: str
    master_uri: str
    address: tuple[str, int]  #: where it serves topics: host and port
    published: Mapping[str, Published]  #: by topic
    #: the subscriptions of each topic
    subscribed: Mapping[str, Sequence[TopicSource]] = field(default_factory=dict)
    #: by name of a subscribed parameter; called with its new value
    parameters: Mapping[str, Callable[[Any], object]] = field(default_factory=dict)
    #: called with the reason of a shutdown request; returns why the node refuses, "" if it shuts down
    shut_down: Callable[[str], str] = lambda _reason: "it does not end when asked"
    _methods: dict[str, Callable[..., Answer]] = field(init=False)

    def __post_init__(self) -> None:
        self._methods = {
            "getBusInfo": self._bus_info,
            "getBusStats": self._bus_stats,
            "getMasterUri": lambda _caller: (1, "", self.master_uri),
            "getName": lambda _caller: (1, "", self.name),
            "getPid": lambda _caller: (1, "", os.getpid()),
            "getPublications": self._publications,
            "getSubscriptions": self._subscriptions,
            "getUri": lambda _caller: (1, "", self.uri),
            "paramUpdate": self._parameter_update,
            "publisherUpdate": self._publisher_update,
            "requestTopic": self._request_topic,
            "shutdown": self._shutdown,
        }

    def answer(self, request: bytes) -> bytes:
        """Returns the body of the response. A wrong method or wrong arguments get an error response.

        Raises:
            SlaveApiError: the request is not an XML-RPC call.
        """
        try:
            arguments, method = xmlrpc_values(request)
        except NONSENSE:
            raise SlaveApiError("no XML-RPC call") from None
        function = self._methods.get(method or "")
        if function is None:
            fault = xmlrpc.client.Fault(-1, f"{self.name} has no method {method}")
            return xmlrpc.client.dumps(fault).encode()
        try:
            answer = function(*arguments)
        except NONSENSE:
            answer = (-1, f"wrong arguments for {method}", 0)
        return xmlrpc.client.dumps((answer,), methodresponse=True).encode()

    def _publications(self, _caller: str) -> Answer:
        return 1, "publications", [[topic, one.type] for topic, one in self.published.items()]

    def _subscriptions(self, _caller: str) -> Answer:
        types = [[topic, sources[0].type] for topic, sources in self.subscribed.items()]
        return 1, "subscriptions", types

    def _received(self, topic: str) -> list[tuple[str, int]]:
        """Returns the URI and the received bytes of each publisher of each subscription."""
        return [row for source in self.subscribed[topic] for row in source.received]

    def _bus_info(self, _caller: str) -> Answer:
        told = f"TCPROS connection on port {self.address[1]}"
        rows = [
            [number, name, "o", "TCPROS", topic, True, told]
            for topic, one in self.published.items()
            for number, name in enumerate(one.subscribers.values(), 1)
        ]
        rows += [
            [number, uri, "i", "TCPROS", topic, True, f"TCPROS connection to {uri}"]
            for topic in self.subscribed
            for number, (uri, _) in enumerate(self._received(topic), 1)
        ]
        return 1, "bus info", rows

    def _bus_stats(self, _caller: str) -> Answer:
        out = [[topic, 0, []] for topic in self.published]
        into = [
            [
                topic,
                [
                    [number, count, -1, True]
                    for number, (_, count) in enumerate(self._received(topic), 1)
                ],
            ]
            for topic in self.subscribed
        ]
        return 1, "", [out, into, []]

    def _parameter_update(self, _caller: str, name: str, value: Any) -> Answer:
        changed = self.parameters.get(name.rstrip("/"))
        if changed is not None:
            changed(value)
        return 1, "", 0

    def _publisher_update(self, _caller: str, name: str, publishers: list[str]) -> Answer:
        uris = [str(uri) for uri in publishers]
        for source in self.subscribed.get(name, ()):
            source.notify(uris)
        return 1, "", 0

    def _request_topic(self, caller: str, name: str, protocols: list[list[str]]) -> Answer:
        topic = self.published.get(name)
        if topic is None:
            return 0, f"{self.name} does not publish {name}", []
        refusal = topic.refusal(caller)
        if refusal:
            return 0, refusal, []
        if not any(protocol and protocol[0] == "TCPROS" for protocol in protocols):
            return 0, f"{self.name} speaks TCPROS only", []
        return 1, "ready", ["TCPROS", *self.address]

    def _shutdown(self, _caller: str, reason: str = "") -> Answer:
        refusal = self.shut_down(str(reason))
        return (0, refusal, 0) if refusal else (1, "it ends", 0)
