"""Our own topics and services on a master that has forgotten them."""

import http.client

import rosgraph
import rospy
from rospy.impl import registration

from rocon_gateway.adapters.master_line import MasterError
from tcpros.core.http import NONSENSE


def register_anew() -> None:
    """Tells the master what this node offers and subscribes; rospy does that once, at the node's start.

    Raises:
        MasterError: the master answers nonsense.
        OSError: the master does not answer.
    """
    try:
        _register(rosgraph.Master(rospy.get_name()), rospy.get_node_uri())
    except (rosgraph.MasterException, http.client.HTTPException, *NONSENSE) as error:
        raise MasterError(f"the ROS master does not register us: {error}") from None


def _register(master: rosgraph.Master, uri: str) -> None:
    for topic, kind in registration.get_topic_manager().get_publications():
        master.registerPublisher(topic, kind, uri)
    for topic, kind in registration.get_topic_manager().get_subscriptions():
        master.registerSubscriber(topic, kind, uri)
    for service, address in registration.get_service_manager().get_services():
        master.registerService(service, address, uri)
