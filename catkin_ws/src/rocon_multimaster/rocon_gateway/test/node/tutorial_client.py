"""A client that makes the same calls as the tutorial's Listings 1 to 3: `tutorial_client.py WHAT ARGUMENT …`.

Imports, services and the way requests are filled in match the listings; their text is not copied.
"""

import sys

import gateway_msgs.msg as gateway_msgs
import gateway_msgs.srv as gateway_srvs
import rospy

import rocon_gateway  # noqa: F401  (the listings import it without using it)


def advertise(topic):
    """Listing 1."""
    rospy.init_node("advertise_hub_publisher")
    rospy.wait_for_service("/gateway/advertise")
    service = rospy.ServiceProxy("/gateway/advertise", gateway_srvs.Advertise)
    request, rule = gateway_srvs.AdvertiseRequest(), gateway_msgs.Rule()
    rule.name, rule.type, rule.node = f"/{topic}", gateway_msgs.ConnectionType.PUBLISHER, ""
    request.rules.append(rule)
    return service(request)


def pull(topic):
    """Listing 2: never sets the rule's node."""
    rospy.init_node("pull_hub_publisher")
    rospy.wait_for_service("/gateway/pull")
    service = rospy.ServiceProxy("/gateway/pull", gateway_srvs.Remote)
    request, rule = gateway_srvs.RemoteRequest(), gateway_msgs.Rule()
    request.cancel, request.remotes = False, []
    rule.name, rule.type = f"/{topic}", gateway_msgs.ConnectionType.PUBLISHER
    request.remotes.append(gateway_msgs.RemoteRule("Hub_Gateway", rule))
    return service(request)


def flip(namespace, topic, node, gate):
    """Listing 3: does not wait for the service."""
    rospy.init_node("flip_hub_subscriber")
    service = rospy.ServiceProxy("/gateway/flip", gateway_srvs.Remote)
    request, rule = gateway_srvs.RemoteRequest(), gateway_msgs.Rule()
    request.cancel, request.remotes = False, []
    rule.name = topic if topic[0] == "/" else f"/{namespace}/{topic}"
    rule.type, rule.node = gateway_msgs.ConnectionType.SUBSCRIBER, f"/{node}"
    request.remotes.append(gateway_msgs.RemoteRule(f"{gate}_gateway", rule))
    return service(request)


if __name__ == "__main__":
    response = {"advertise": advertise, "pull": pull, "flip": flip}[sys.argv[1]](*sys.argv[2:])
    sys.stdout.write(f"{response.result} {response.error_message}\n")
