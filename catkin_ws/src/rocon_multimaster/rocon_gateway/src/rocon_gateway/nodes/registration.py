"""Our own topics and services on a master that has forgotten them."""

import rosgraph
import rospy
from rospy.impl import registration


def register_anew() -> None:
    """Tells the master what this node offers and subscribes; rospy does that once, at the node's start.

    Raises:
        OSError: the master does not answer.
    """
    master, uri = rosgraph.Master(rospy.get_name()), rospy.get_node_uri()
    for topic, kind in registration.get_topic_manager().get_publications():
        master.registerPublisher(topic, kind, uri)
    for topic, kind in registration.get_topic_manager().get_subscriptions():
        master.registerSubscriber(topic, kind, uri)
    for service, address in registration.get_service_manager().get_services():
        master.registerService(service, address, uri)
