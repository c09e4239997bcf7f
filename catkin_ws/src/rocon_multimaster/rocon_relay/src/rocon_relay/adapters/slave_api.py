"""The XML-RPC API of a ROS node, as a proxy node answers it. (https://wiki.ros.org/ROS/Slave_API)"""

import os
import xmlrpc.client
from collections.abc import Callable, Mapping
from typing import Any

from rocon_relay.adapters.proxy_topic import ProxyTopic
from rocon_relay.core.error import RelayError
from tcpros.core.http import NONSENSE

Answer = tuple[int, str, Any]


class SlaveApiError(RelayError):
    """What arrived is no XML-RPC call."""


class SlaveApi:
    """Answers calls to one proxy node; no socket."""

    def __init__(
        self, name: str, uri: str, master_uri: str, host: str, port: int, topics: Mapping[str, ProxyTopic]
    ) -> None:
        self._name = name
        self._uri = uri
        self._master_uri = master_uri
        self._address = host, port
        self._topics = topics
        self._methods: dict[str, Callable[..., Answer]] = {
            "getBusInfo": self._bus_info,
            "getBusStats": self._bus_stats,
            "getMasterUri": lambda _caller: (1, "", self._master_uri),
            "getName": lambda _caller: (1, "", self._name),
            "getPid": lambda _caller: (1, "", os.getpid()),
            "getPublications": self._publications,
            "getSubscriptions": lambda _caller: (1, "subscriptions", []),
            "getUri": lambda _caller: (1, "", self._uri),
            "paramUpdate": lambda _caller, _key, _value: (1, "", 0),
            "publisherUpdate": lambda _caller, _topic, _publishers: (1, "", 0),
            "requestTopic": self._request_topic,
            "shutdown": self._shutdown,
        }

    def answer(self, request: bytes) -> bytes:
        """Returns the response's body.

        Raises:
            SlaveApiError: it is no XML-RPC call at all. A wrong method or wrong arguments get a response.
        """
        try:
            arguments, method = xmlrpc.client.loads(request)  # type: ignore[arg-type]
        except NONSENSE:
            raise SlaveApiError("no XML-RPC call") from None
        function = self._methods.get(method or "")
        if function is None:
            fault = xmlrpc.client.Fault(-1, f"a relayed node has no method {method}")
            return xmlrpc.client.dumps(fault).encode()
        try:
            answer = function(*arguments)
        except NONSENSE:
            answer = (-1, f"wrong arguments for {method}", 0)
        return xmlrpc.client.dumps((answer,), methodresponse=True).encode()

    def _publications(self, _caller: str) -> Answer:
        return 1, "publications", [[topic.wanted.topic, topic.wanted.type] for topic in self._topics.values()]

    def _bus_info(self, _caller: str) -> Answer:
        rows = [
            [number, name, "o", "TCPROS", topic.wanted.topic, True, f"TCPROS connection on port {self._address[1]}"]
            for topic in self._topics.values()
            for number, name in enumerate(topic.subscribers.values(), 1)
        ]
        return 1, "bus info", rows

    def _bus_stats(self, _caller: str) -> Answer:
        return 1, "", [[[topic.wanted.topic, 0, []] for topic in self._topics.values()], [], []]

    def _request_topic(self, caller: str, name: str, protocols: list[list[str]]) -> Answer:
        topic = self._topics.get(name)
        if topic is None:
            return 0, f"{self._name} does not publish {name}", []
        refusal = topic.refusal(caller)
        if refusal:
            return 0, refusal, []
        if not any(protocol and protocol[0] == "TCPROS" for protocol in protocols):
            return 0, "only TCPROS is relayed", []
        return 1, "ready", ["TCPROS", *self._address]

    def _shutdown(self, _caller: str, reason: str = "") -> Answer:
        return 0, f"{self._name} is shown by a gateway; take back its rule there to end it", 0
