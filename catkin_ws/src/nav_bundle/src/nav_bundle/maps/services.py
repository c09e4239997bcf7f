"""A client of the service ``static_map`` (nav_msgs/GetMap), which asks until it gets a map."""

import rospy

from nav_bundle.maps.conversions import GetMapArray, GridMessage

_RETRY = 0.5
"""Time between two requests [s, wall time]."""
_WARNING_PERIOD = 5.0


def fetch_map() -> GridMessage | None:
    """Waits for the service and returns its map; None at shutdown. Warns of failed requests and repeats them."""
    name = rospy.resolve_name("static_map")
    rospy.loginfo("waiting for the map from service %s", name)
    while not rospy.is_shutdown():
        try:
            rospy.wait_for_service("static_map")
            return rospy.ServiceProxy("static_map", GetMapArray)().map
        except (rospy.ROSException, rospy.ServiceException) as error:
            if not rospy.is_shutdown():
                rospy.logwarn_throttle(
                    _WARNING_PERIOD, f"no map from service {name} yet; trying again: {error}"
                )
                rospy.rostime.wallsleep(_RETRY)
    return None
