"""How busy a gateway's computer is, and what its nodes log, on topics that may cross."""

import time

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rosgraph_msgs.msg import Log

from rocon_gateway.adapters.program_load import ProgramLoad

PERIOD = 5.0
"""Between two messages [s]."""


class ComputerTopic:
    """Publishes processor time and memory of the programs of this master, on ``/NAMESPACE/computer``.

    Each 5 s while somebody listens; it looks at nothing otherwise.
    """

    def __init__(self, gateway: str, namespace: str) -> None:
        self._gateway = gateway
        self.topic = f"/{namespace}/computer"
        self._publisher = rospy.Publisher(self.topic, DiagnosticStatus, queue_size=1)
        self._load: ProgramLoad | None = None
        self._due = 0.0

    def turn(self) -> None:
        """Publishes if it is time; called once a second or so."""
        now = time.monotonic()
        if not self._publisher.get_num_connections():
            self._load = None
        elif self._load is None:
            # The first look has nothing to compare with.
            self._load, self._due = ProgramLoad(rosgraph.get_master_uri()), now + 1.0
            self._load.look(now)
        elif now >= self._due:
            self._due = now + PERIOD
            load = self._load.look(now)
            values = {"processors": f"{load.processors:.3f}", "memory [byte]": str(load.memory)}
            self._publisher.publish(
                DiagnosticStatus(
                    name=f"{self._gateway}: computer",
                    message=f"{load.processors:.2f} processors, {load.memory / 2**20:.0f} MiB",
                    hardware_id=self._gateway,
                    values=[KeyValue(*one) for one in values.items()],
                )
            )


class LogTopic:
    """Passes what this master's rosout has collected on to ``/NAMESPACE/rosout_agg``, while somebody listens.

    The fleet's rules let none of ``/rosout.*`` itself cross.
    """

    def __init__(self, namespace: str) -> None:
        self.topic = f"/{namespace}/rosout_agg"
        self._publisher = rospy.Publisher(self.topic, Log, queue_size=100)
        self._subscriber: rospy.Subscriber | None = None

    def turn(self) -> None:
        """Subscribes, or no longer; called once a second or so."""
        heard = self._publisher.get_num_connections() > 0
        if heard and self._subscriber is None:
            self._subscriber = rospy.Subscriber("/rosout_agg", Log, self._publisher.publish, queue_size=100)
        elif not heard and self._subscriber is not None:
            self._subscriber.unregister()
            self._subscriber = None
