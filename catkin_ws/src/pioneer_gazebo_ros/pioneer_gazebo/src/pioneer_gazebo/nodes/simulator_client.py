"""A client of a running simulator: waits for readiness, spawns robots, unpauses."""

import threading

import rosgraph
import rospy
from gazebo_msgs.srv import SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion
from std_msgs.msg import Bool
from std_srvs.srv import Empty

from pioneer_gazebo.core.error import SpawnError
from pioneer_gazebo.core.fleet import InitialPose
from pioneer_gazebo.core.pose import quaternion_from_rpy

SPAWN_SERVICE = "/gazebo/spawn_urdf_model"


class SimulatorClient:
    """A client of the simulator at ``/gazebo``; the process must be a ROS node.

    Subscribes:
        /gazebo/ready (std_msgs/Bool): whether the world is loaded and running.

    Services called:
        /gazebo/spawn_urdf_model, /gazebo/unpause_physics.

    Threads: rospy's; `ready` is thread-safe.
    """

    def __init__(self) -> None:
        self._ready = threading.Event()
        self._master = rosgraph.Master(rospy.get_name())
        rospy.Subscriber("/gazebo/ready", Bool, self._store_ready, queue_size=1)

    def _store_ready(self, message: Bool) -> None:
        if message.data:
            self._ready.set()
        else:
            self._ready.clear()

    def ready(self) -> bool:
        """Returns whether the world is loaded and running."""
        return self._ready.is_set()

    def serving(self) -> bool:
        """Returns whether robots can be spawned."""
        try:
            self._master.lookupService(SPAWN_SERVICE)
        except (OSError, rosgraph.MasterException):
            return False
        return True

    def spawn(self, robot: str, description: str, pose: InitialPose) -> None:
        """Spawns a robot in the namespace of its name.

        Raises:
            SpawnError: the simulator refused the request or did not respond.
        """
        orientation = Quaternion(*quaternion_from_rpy(0.0, 0.0, pose.a))
        try:
            answer = rospy.ServiceProxy(SPAWN_SERVICE, SpawnModel)(
                robot, description, robot, Pose(Point(pose.x, pose.y, 0.0), orientation), "world"
            )
        except rospy.ServiceException as error:
            raise SpawnError(f"spawning {robot} failed: {error}") from None
        if not answer.success:
            raise SpawnError(f"spawning {robot} failed: {answer.status_message}")

    def unpause(self) -> None:
        """Unpauses simulated time.

        Raises:
            SpawnError: the simulator did not respond.
        """
        try:
            rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        except rospy.ServiceException as error:
            raise SpawnError(f"unpausing the simulator failed: {error}") from None
