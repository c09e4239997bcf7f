"""Sends hostile messages, requests and parameters to the nodes of one ROS master until interrupted.

Run it as ``ros.py SEED RATE ROBOT…``; each second it writes a line of JSON with the number of inputs per target.
"""

import contextlib
import io
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import hostile
import roslib.message
import rospy
import rosservice
from dynamic_reconfigure.srv import Reconfigure
from figures import tell

FOREIGN = ("robot_state_publisher", "roslaunch")
"""Words in the names of nodes that are not part of this project."""
OBSERVERS = ("fleet_observer", "fleet_page", "rosout")
"""Nodes that only watch: robots do not drive otherwise, whatever messages these receive."""
OBEYED = ("/clock", "/status", "/map_goal_client/cancel", "/safety_stop")
"""Suffixes of topics that are not fuzzed: ROS 1 does not authenticate senders, so nodes must obey fake messages."""
OBEYED_BY_ALL = ("/clock",)
"""Those that are not fuzzed even if only observers read them."""
ORDERS = (
    "pause_physics",
    "unpause_physics",
    "reset_world",
    "reset_simulation",
    "step",
    "global_localization",
    "clear",
)
ORDERS += ("patrol", "set_logger_level", "clear_costmaps", "set_watcher_period", "advertise_all")
"""Services that are not called, because they act whatever the request contains."""
LOOK_EVERY = 10.0
"""Interval for looking for new topics and services [s]."""
ROBOT_LINKS = ("", "::base_link", "::left_wheel", "::ghost")
BODIES = (
    "<box><size>1 1 {}</size></box>",
    "<sphere><radius>{}</radius></sphere>",
    "<cylinder><radius>1</radius><length>{}</length></cylinder>",
    "<mesh><uri>file:///dev/zero</uri><scale>{} 1 1</scale></mesh>",
)
MODEL = (
    "<sdf version='1.6'><model name='m'><link name='l'><inertial><mass>{}</mass></inertial>"
    "<collision name='c'><geometry>{}</geometry></collision></link></model></sdf>"
)


class Fuzzer:
    """The targets on this master, and how often each was hit."""

    def __init__(self, seed: int, robots: list[str]) -> None:
        self.rng, self.counts = random.Random(seed), Counter[str]()
        links = tuple(f"{robot}{link}" for robot in robots for link in ROBOT_LINKS)
        frames = tuple(
            f"{robot}/{frame}" for robot in robots for frame in ("odom", "base_link", "laser")
        )
        self.poison = hostile.Poison(self.rng, (*links, *frames, "map", "world", "fuzz0"))
        self.drive_poison = hostile.Poison(self.rng, ("ghost",), huge=False)
        self.actions: dict[str, Callable[[], None]] = {}
        self.asked: dict[str, Any] = {}

    def look(self) -> None:
        """Adds the topics and services that are new: some exist only while a page is open."""
        master = rospy.get_master()
        _, subscriptions, services = master.getSystemState()[2]
        types = dict(master.getTopicTypes()[2])
        for topic, nodes in subscriptions:
            readers = [node for node in nodes if _is_ours(node)]
            acting = [node for node in readers if not node.endswith(OBSERVERS)]
            obeyed = OBEYED if acting else OBEYED_BY_ALL
            is_new = topic in types and topic not in self.actions
            if readers and is_new and not topic.endswith(obeyed):
                self._add_topic(topic, types[topic], bool(acting))
        for name, (node, *_) in services:
            is_new = f"{name}()" not in self.actions
            is_order = name.rpartition("/")[2] in ORDERS or "logger" in name
            if is_new and _is_ours(node) and not is_order:
                self._add_service(name)

    def turn(self) -> None:
        """Sends one hostile input to each target."""
        actions = [*self.actions.values()]
        for action in self.rng.sample(actions, len(actions)):
            action()

    def _add_topic(self, topic: str, type_: str, is_acted_upon: bool) -> None:
        kind = roslib.message.get_message_class(type_)
        raw = hostile.raw_class(kind)
        publisher = rospy.Publisher(topic, raw, queue_size=1)
        target = "navigation topics" if is_acted_upon else "observed topics"
        if is_acted_upon and ("gazebo" in topic or "pioneer/cmd_vel" in topic):
            target = "simulator topics"
        self.actions[topic] = partial(self._publish, target, publisher, kind, raw)

    def _publish(self, target: str, publisher: rospy.Publisher, kind: Any, raw: Any) -> None:
        if not publisher.get_num_connections():
            return
        publisher.publish(raw(self._bytes(self._message(kind))))
        self.counts[target] += 1

    def _message(self, kind: Any) -> Any:
        framed = kind._type.endswith(("LaserScan", "Stamped", "TFMessage", "ActionGoal"))
        if framed and self.rng.random() < 0.3:
            return hostile.foreign(self.rng, kind())
        # Robots obey finite commands as far as they can, and take finite speeds in odometry as their true speed.
        poison = self.drive_poison if kind._type.endswith("Twist") else self.poison
        message = poison.fill(kind())
        if kind._type.endswith("GoalID"):
            message.id = "ghost"
            message.stamp.secs = self.rng.choice(hostile.FAR_AHEAD)
        return message

    def _bytes(self, message: Any) -> bytes:
        if self.rng.random() < 0.2:
            return hostile.spoilt(self.rng, message)
        buffer = io.BytesIO()
        message.serialize(buffer)
        return buffer.getvalue()

    def _add_service(self, name: str) -> None:
        kind = rosservice.get_service_class_by_name(name)
        raw = SimpleNamespace(
            _type=kind._type,
            _md5sum=kind._md5sum,
            _request_class=hostile.raw_class(kind._request_class),
            _response_class=hostile.raw_class(kind._response_class),
        )
        proxy = rospy.ServiceProxy(name, raw)
        make, target = partial(self._request, name, kind), "navigation services"
        if name.startswith("/gazebo/"):
            target = "simulator services"
        elif kind._type == Reconfigure._type:
            make, target = partial(self._parameters, name), "dynamic_reconfigure"
        elif kind._type.startswith("gateway_msgs/"):
            make, target = partial(self._rules, name, kind), "gateway services"
        self.actions[f"{name}()"] = partial(self._call, target, proxy, make)

    def _call(self, target: str, proxy: rospy.ServiceProxy, make: Callable[[], Any]) -> None:
        # A refusal or a closed connection is an answer, too. Without an answer the count stops and the test fails.
        with contextlib.suppress(rospy.ServiceException, rospy.ROSException):
            proxy.call(self._bytes(make()))
        self.counts[target] += 1

    def _request(self, name: str, kind: Any) -> Any:
        message = self.poison.fill(kind._request_class())
        if name.endswith("delete_model"):
            message.model_name = self.rng.choice((*hostile.ODD, "fuzz0", "fuzz1"))
        if name.endswith("_model") and "spawn" in name:
            number = self.rng.choice(("nan", "-1", "1e308", "0", "", "x", "1e-300", "1"))
            body = self.rng.choice(BODIES).format(self.rng.choice(("nan", "1", number)))
            text = MODEL.format(number, body)
            message.model_xml = text[
                : self.rng.choice((len(text), len(text), self.rng.randrange(len(text))))
            ]
            message.model_name = self.rng.choice(("fuzz0", "fuzz1", *hostile.ODD))
            if self.rng.random() < 0.5:
                message.initial_pose = type(message.initial_pose)()
                message.initial_pose.position.x = self.rng.uniform(500.0, 600.0)
                message.initial_pose.orientation.w = 1.0
                message.reference_frame = ""
        return message

    def _rules(self, name: str, kind: Any) -> Any:
        """Returns a request for rules with gateways that do not exist, half of them with sound topics.

        Every second request takes back what the one before has asked for, so that rules do not accumulate.
        """
        before = self.asked.pop(name, None)
        if before is not None:
            before.cancel = True
            return before
        request = self.poison.fill(kind._request_class())
        ghost = f"ghost{self.rng.randrange(10**9)}"
        if hasattr(request, "gateway"):
            request.gateway = ghost
        for remote in getattr(request, "remotes", []):
            remote.gateway = self.rng.choice((ghost, ghost, *hostile.FOREIGN))
            if self.rng.random() < 0.5:
                remote.rule.type = self.rng.choice(("publisher", "subscriber"))
                remote.rule.name = self.rng.choice(("/clock", "/tf", f"/{ghost}/odom", ".*"))
                remote.rule.node = self.rng.choice(("", f"/{ghost}", ".*"))
        for rule in getattr(request, "rules", []):
            # Advertisements need no other gateway: those of topics that do exist would be legitimate.
            rule.name = f"/{ghost}/{self.rng.choice(('odom', '(', 'scan.*'))}"
        if hasattr(request, "cancel"):
            request.cancel = False
            self.asked[name] = request
        return request

    def _parameters(self, name: str) -> Any:
        """Returns non-finite values for existing parameters, of the right type or not, or anything for unknown ones."""
        request = Reconfigure._request_class()
        own = rospy.get_param(name.rpartition("/")[0], {})
        names = [key for key, value in own.items() if isinstance(value, float)] or ["ghost"]
        self.poison.fill(request.config)
        for entry in (*request.config.bools, *request.config.ints, *request.config.strs):
            entry.name = self.rng.choice(("ghost", *hostile.ODD))
        for entry in request.config.doubles:
            entry.name, entry.value = self.rng.choice(names), float("nan")
        for entry in request.config.strs[:1]:
            entry.name = self.rng.choice(names)
        return request


def _is_ours(node: str) -> bool:
    return node != rospy.get_name() and not any(word in node for word in FOREIGN)


def main() -> None:
    """Runs until SIGINT."""
    seed, rate, *robots = sys.argv[1:]
    rospy.init_node("fuzz", disable_rostime=True)
    fuzzer, told, looked = Fuzzer(int(seed), robots), 0.0, -LOOK_EVERY
    pace = rospy.Rate(float(rate))
    while not rospy.is_shutdown():
        if time.monotonic() - looked > LOOK_EVERY:
            fuzzer.look()
            looked = time.monotonic()
        fuzzer.turn()
        if time.monotonic() - told > 1.0:
            told = time.monotonic()
            tell(fuzzer.counts)
        with contextlib.suppress(rospy.ROSInterruptException):
            pace.sleep()


main()
