"""An echo server: ``serve SERVICE``."""

import sys

import rospy
from gateway_msgs.srv import ConnectHub, ConnectHubRequest, ConnectHubResponse

from pioneer_node.nodes import entry


def echo(request: ConnectHubRequest) -> ConnectHubResponse:
    """Returns the request's text."""
    return ConnectHubResponse(0, request.uri)


def main() -> int:
    """Serves until shutdown."""
    (service,) = rospy.myargv(sys.argv)[1:]
    return entry.run("serve", lambda: rospy.Service(service, ConnectHub, echo))


if __name__ == "__main__":
    sys.exit(main())
