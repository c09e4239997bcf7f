"""A node that answers with what it is asked: ``serve SERVICE``."""

import sys

import rospy
from gateway_msgs.srv import ConnectHub, ConnectHubRequest, ConnectHubResponse


def echo(request: ConnectHubRequest) -> ConnectHubResponse:
    """Returns the request's text."""
    return ConnectHubResponse(0, request.uri)


def main() -> None:
    """Serves until shutdown."""
    (service,) = rospy.myargv(sys.argv)[1:]
    rospy.init_node("serve")
    rospy.Service(service, ConnectHub, echo)
    rospy.spin()


if __name__ == "__main__":
    main()
