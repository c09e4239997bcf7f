"""Publishes the load of a gateway's computer and the log of its nodes on topics that other gateways may import."""

import time
from functools import partial

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rosgraph_msgs.msg import Log

from pioneer_node.adapters.node_handle import NodeHandle, Subscriber
from pioneer_node.conversions import framed
from rocon_gateway.node.program_load import ProgramLoad

PERIOD = 5.0
"""Publishing period [s]."""


class ComputerTopic:
    """Publishes CPU and memory use of the programs of this master on ``/NAMESPACE/computer``.

    Publishes every 5 s while there are subscribers; otherwise it does not measure.
    """

    def __init__(self, node: NodeHandle, master_uri: str, gateway: str, namespace: str) -> None:
        self._node, self._master_uri, self._gateway = node, master_uri, gateway
        self.topic = f"/{namespace}/computer"
        self._publisher = node.advertise(self.topic, DiagnosticStatus)
        self._load: ProgramLoad | None = None
        self._due = 0.0

    def turn(self) -> None:
        """Publishes if due; called about once a second, from any thread."""
        now = time.monotonic()
        if not self._publisher.has_subscribers:
            self._load = None
        elif self._load is None:
            # The first measurement has no previous one to compare with.
            self._load, self._due = ProgramLoad(self._master_uri), now + 1.0
            self._load.look(now)
        elif now >= self._due:
            self._due = now + PERIOD
            load = self._load.look(now)
            values = {"processors": f"{load.processors:.3f}", "memory [byte]": str(load.memory)}
            status = DiagnosticStatus(
                name=f"{self._gateway}: computer",
                message=f"{load.processors:.2f} processors, {load.memory / 2**20:.0f} MiB",
                hardware_id=self._gateway,
                values=[KeyValue(*one) for one in values.items()],
            )
            self._node.call(partial(self._publisher.publish, status))


class LogTopic:
    """Republishes this master's ``/rosout_agg`` as ``/NAMESPACE/rosout_agg`` while there are subscribers.

    The fleet's rules block ``/rosout.*`` itself.
    """

    def __init__(self, node: NodeHandle, namespace: str) -> None:
        self._node = node
        self.topic = f"/{namespace}/rosout_agg"
        self._publisher = node.advertise(self.topic, Log)
        self._subscriber: Subscriber | None = None

    def turn(self) -> None:
        """Subscribes or unsubscribes as needed; called about once a second, from any thread."""
        if self._publisher.has_subscribers != (self._subscriber is not None):
            self._node.call(self._change)

    def _change(self) -> None:
        if self._subscriber is None:
            self._subscriber = self._node.subscribe_serialised("/rosout_agg", Log, self._pass_on)
        else:
            self._subscriber.close()
            self._subscriber = None

    def _pass_on(self, message: bytes | memoryview, _sender: str) -> None:
        self._publisher.send(framed(bytes(message)))
