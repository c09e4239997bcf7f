"""Serves /echo: answers with the text it receives; some texts make it fail, wait, die or return the caller's name.

"hold" waits until another client sends "release".
"""

import os
import sys
import threading

import rospy
from gateway_msgs.srv import ConnectHub, ConnectHubRequest, ConnectHubResponse

RELEASED = threading.Event()


def echo(request: ConnectHubRequest) -> ConnectHubResponse:
    what, _, number = request.uri[:40].partition(" ")
    if what == "fail":
        raise rospy.ServiceException("as you wish")
    if what == "die":
        os._exit(1)
    if what == "wait":
        sys.stdout.write("waiting\n")
        sys.stdout.flush()
        rospy.rostime.wallsleep(float(number))
    if what == "hold":
        RELEASED.wait(60)
    if what == "release":
        RELEASED.set()
    if what == "who":
        return ConnectHubResponse(0, request._connection_header["callerid"])
    return ConnectHubResponse(len(request.uri) % 100, request.uri)


def main() -> None:
    rospy.init_node("server")
    rospy.Service("/echo", ConnectHub, echo)
    rospy.spin()


if __name__ == "__main__":
    sys.exit(main())
