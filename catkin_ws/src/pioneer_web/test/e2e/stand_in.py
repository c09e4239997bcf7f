"""A stand-in for the base station, without simulator and gateways: robots that obey, rules, and a map."""

import math
import sys
import threading

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from gateway_msgs.msg import ErrorCodes, GatewayInfo
from gateway_msgs.srv import Remote, RemoteResponse
from gazebo_msgs.srv import GetModelState, GetModelStateResponse
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Twist
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, LaserScan
from simple_navigation_goals.msg import WaypointQueue
from std_msgs.msg import Empty, Float64, String
from std_srvs.srv import Empty as EmptyService
from std_srvs.srv import Trigger, TriggerResponse
from tf2_msgs.msg import TFMessage

RATE = 20.0
SPEED, TURN = 0.8, 1.5
MODEL = """<robot name="r"><link name="base_link"/><link name="laser"/><joint name="j" type="fixed">
<parent link="base_link"/><child link="laser"/><origin xyz="0.15 0 0.27"/></joint></robot>"""


def turned(message, yaw):
    message.z, message.w = math.sin(yaw / 2), math.cos(yaw / 2)


class Robot:
    """Obeys pioneer/cmd_vel as the simulator does, and commands itself towards its goals as its own computer does."""

    def __init__(self, name, x, y, rates):
        self.name, self.x, self.y, self.yaw, self.speed, self.turn = name, x, y, 0.0, 0.0, 0.0
        self.start = x, y
        self.goals, self.reached, self.received = [], 0, 0
        self.odom = rospy.Publisher(f"/{name}/odom", Odometry, queue_size=10)
        self.scan = rospy.Publisher(f"/{name}/base_scan", LaserScan, queue_size=10)
        self.command = rospy.Publisher(f"/{name}/pioneer/cmd_vel", Twist, queue_size=1)
        self.queue = rospy.Publisher(
            f"/{name}/map_goal_client/queue", WaypointQueue, queue_size=1, latch=True
        )
        self.plan = rospy.Publisher(f"/{name}/move_base/NavfnROS/plan", Path, queue_size=1)
        self.costs = rospy.Publisher(
            f"/{name}/move_base/local_costmap/costmap", OccupancyGrid, queue_size=1
        )
        rospy.Subscriber(f"/{name}/pioneer/cmd_vel", Twist, self.obey, queue_size=1)
        rospy.Subscriber(f"/{name}/map_goal_pose", PoseStamped, self.add)
        rospy.Subscriber(f"/{name}/map_goal_client/cancel", Empty, self.clear)
        rospy.Subscriber(f"/{name}/initialpose", PoseWithCovarianceStamped, self.localise)
        self.load = rospy.Publisher(f"/{name}/computer", DiagnosticStatus, queue_size=1, latch=True)
        values = {"processors": "0.310", "memory [byte]": str(180 * 2**20)}
        self.load.publish(DiagnosticStatus(values=[KeyValue(*one) for one in values.items()]))
        rospy.set_param(f"/{name}/tf_prefix", name)
        self.rates = rates
        self.tell("waiting")

    def obey(self, message):
        self.speed, self.turn = message.linear.x, message.angular.z

    def add(self, message):
        self.goals.append(message)
        self.received += 1
        self.tell("driving")

    def clear(self, _):
        self.goals.clear()
        self.command.publish(Twist())
        self.tell("dropped all waypoints")

    def restart(self):
        self.x, self.y = self.start
        self.yaw = self.speed = self.turn = 0.0

    def localise(self, message):
        place = message.pose.pose.position
        rospy.set_param(f"/stand_in/{self.name}/localised", [place.x, place.y])

    def tell(self, text):
        message = WaypointQueue(
            state=2 if self.goals else 0, received=self.received, reached=self.reached, text=text
        )
        if self.goals:
            message.current, message.waiting = self.goals[0], self.goals[1:]
        self.queue.publish(message)

    def drive(self):
        if not self.goals:
            return
        goal = self.goals[0].pose.position
        away, aim = (
            math.hypot(goal.x - self.x, goal.y - self.y),
            math.atan2(goal.y - self.y, goal.x - self.x),
        )
        if away < 0.2:
            self.goals.pop(0)
            self.reached += 1
            self.command.publish(Twist())
            self.tell("reached a waypoint")
            return
        command = Twist()
        off = math.remainder(aim - self.yaw, math.tau)
        command.angular.z = max(-TURN, min(TURN, 3 * off))
        command.linear.x = SPEED if abs(off) < 0.5 else 0.0
        self.command.publish(command)

    def move(self, step):
        self.x += self.speed * step * math.cos(self.yaw)
        self.y += self.speed * step * math.sin(self.yaw)
        self.yaw += self.turn * step

    def publish_odometry(self, stamp):
        odom = Odometry()
        odom.header.stamp, odom.header.frame_id, odom.child_frame_id = (
            stamp,
            f"{self.name}/odom",
            f"{self.name}/base_link",
        )
        odom.pose.pose.position.x, odom.pose.pose.position.y = self.x, self.y
        turned(odom.pose.pose.orientation, self.yaw)
        odom.twist.twist.linear.x, odom.twist.twist.angular.z = self.speed, self.turn
        self.odom.publish(odom)

    def publish_sight(self, stamp, samples):
        scan = LaserScan(
            angle_min=-math.pi, angle_increment=math.tau / samples, range_min=0.1, range_max=30.0
        )
        scan.header.stamp, scan.header.frame_id, scan.ranges = (
            stamp,
            f"{self.name}/laser",
            self.ranges(samples),
        )
        self.scan.publish(scan)
        if not self.goals:
            return
        plan = Path()
        plan.header.frame_id = "map"
        goal = self.goals[0].pose.position
        for part in np.linspace(0, 1, 60):
            pose = PoseStamped()
            pose.header.frame_id = "map"
            pose.pose.position.x, pose.pose.position.y = (
                self.x + part * (goal.x - self.x),
                self.y + part * (goal.y - self.y),
            )
            plan.poses.append(pose)
        self.plan.publish(plan)
        costs = OccupancyGrid()
        costs.header.frame_id = f"{self.name}/odom"
        costs.info.resolution, costs.info.width, costs.info.height = 0.05, 60, 60
        costs.info.origin.position.x, costs.info.origin.position.y = self.x - 1.5, self.y - 1.5
        costs.info.origin.orientation.w = 1.0
        rows, cols = np.mgrid[0:60, 0:60]
        costs.data = (
            np.clip(100 - 4 * np.hypot(rows - 45, cols - 50), 0, 100)
            .astype(np.int8)
            .ravel()
            .tolist()
        )
        self.costs.publish(costs)

    def ranges(self, samples):
        angles = self.yaw - math.pi + np.arange(samples) * math.tau / samples
        with np.errstate(divide="ignore"):
            across = np.where(np.cos(angles) > 0, HALF[0] - self.x, -HALF[0] - self.x) / np.cos(
                angles
            )
            along = np.where(np.sin(angles) > 0, HALF[1] - self.y, -HALF[1] - self.y) / np.sin(
                angles
            )
        return np.minimum(across, along)


HALF = (6.0, 4.0)
"""Half the room's width and height [m]."""


def room():
    grid = OccupancyGrid()
    grid.info.resolution, grid.info.width, grid.info.height = 0.05, 400, 300
    grid.info.origin.position.x, grid.info.origin.position.y, grid.info.origin.orientation.w = (
        -10.0,
        -7.5,
        1.0,
    )
    cells = np.full((300, 400), -1, np.int8)
    cells[66:234, 76:324] = 100
    cells[70:230, 80:320] = 0
    grid.data = cells.ravel().tolist()
    return grid


def rules(names, lost):
    found = DiagnosticArray()
    for number, name in enumerate(names, 1):
        gateway = f"aadi{number}_gateway"
        state, reason = (
            ("no such gateway", f"{gateway} is not on the hub")
            if gateway == lost
            else ("active", "")
        )
        for topic in ("/tf", f"/{name}/move_base/NavfnROS/plan"):
            values = {
                "action": "flip",
                "gateway": gateway,
                "type": "subscriber",
                "name": topic,
                "node": "",
                "state": state,
                "reason": reason,
            }
            found.status.append(
                DiagnosticStatus(name=topic, values=[KeyValue(*one) for one in values.items()])
            )
    return found


def robot_at(index, rate):
    return Robot(f"pioneer{index + 1}", -4.0 + 1.6 * (index % 6), -2.0 + 1.8 * (index // 6), rate)


def main(count, rate, samples):
    rospy.init_node("stand_in", disable_rostime=True)
    names = [f"pioneer{number}" for number in range(1, count + 1)]
    rospy.set_param("/robot_description", MODEL)
    robots = [robot_at(n, rate) for n in range(count)]
    state = rospy.Publisher("/gateway/rules", DiagnosticArray, queue_size=1, latch=True)
    state.publish(rules(names, ""))
    info = rospy.Publisher("/gateway/gateway_info", GatewayInfo, queue_size=1, latch=True)
    info.publish(GatewayInfo(name="Hub_Gateway", connected=True, hub_names=["Pioneer Hub"]))
    rospy.Service("/gateway/flip", Remote, lambda _: RemoteResponse(ErrorCodes.SUCCESS, ""))
    paused = threading.Event()
    rospy.Service("/gazebo/pause_physics", EmptyService, lambda _: paused.set() or {})
    rospy.Service("/gazebo/unpause_physics", EmptyService, lambda _: paused.clear() or {})
    rospy.Service(
        "/gazebo/reset_world", EmptyService, lambda _: [one.restart() for one in robots] and {}
    )
    rospy.Service("/gazebo/step", Trigger, lambda _: TriggerResponse(paused.is_set(), "not paused"))

    def model_state(request):
        one = next(one for one in robots if one.name == request.model_name)
        answer = GetModelStateResponse(success=True)
        answer.pose.position.x, answer.pose.position.y = one.x, one.y
        turned(answer.pose.orientation, one.yaw)
        return answer

    rospy.Service("/gazebo/get_model_state", GetModelState, model_state)
    rospy.Subscriber("/stand_in/lose", String, lambda one: state.publish(rules(names, one.data)))

    def join(_):
        robots.append(robot_at(len(robots), rate))
        names.append(robots[-1].name)
        rospy.set_param("/robot_names", names)

    rospy.Subscriber("/stand_in/join", Empty, join)
    plan = rospy.Publisher("/map", OccupancyGrid, queue_size=1, latch=True)
    plan.publish(room())
    clock, tf = (
        rospy.Publisher("/clock", Clock, queue_size=1),
        rospy.Publisher("/tf", TFMessage, queue_size=10),
    )
    factor = rospy.Publisher("/gazebo/real_time_factor", Float64, queue_size=1)
    rospy.set_param("/robot_names", names)
    camera = rospy.Publisher(f"/{names[0]}/camera/image_raw", Image, queue_size=1)
    ticks, timer = 0, rospy.Rate(rate)
    while not rospy.is_shutdown():
        timer.sleep()
        if paused.is_set():
            continue
        ticks += 1
        stamp = rospy.Time.from_sec(ticks / rate)
        clock.publish(Clock(stamp))
        for robot in robots:
            robot.move(1 / rate)
            robot.publish_odometry(stamp)
            tf.publish(
                TFMessage([transform(f"{robot.name}/odom", f"{robot.name}/base_link", stamp)])
            )
            if ticks % max(1, round(rate / RATE)) == 0:
                robot.drive()
            if ticks % max(1, round(rate / 10)) == 0:
                robot.publish_sight(stamp, samples)
        if ticks % max(1, round(rate / 10)) == 0:
            tf.publish(TFMessage([transform("map", f"{name}/odom", stamp) for name in names]))
            factor.publish(1.0)
            if camera.get_num_connections():
                cells = np.full((48, 64, 3), (200, ticks % 256, 40), np.uint8)
                camera.publish(
                    Image(width=64, height=48, step=192, encoding="rgb8", data=cells.tobytes())
                )


def transform(parent, child, stamp):
    """Returns a transform of which only the frames matter."""
    one = TransformStamped()
    one.header.stamp, one.header.frame_id, one.child_frame_id = stamp, parent, child
    one.transform.rotation.w = 1.0
    return one


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:4]))
