"""Starts rospy nodes on request, each as a process forked from this one, which has imported rospy already.

Reads a JSON object a line: `name`, `master`, `run`, `publishes`, `latches`, `subscribes`, `serves`, `log`, `ready`;
writes the PID of each started node. A node that is registered makes the file `ready`. It publishes `RUN NUMBER` ten
times a second on each topic that it publishes, and `RUN 0` once, latched. For each message that it receives it appends
`seconds topic run number` to its log. Its services return its run.
"""

import ctypes
import json
import os
import signal
import sys
import time
from functools import partial

import rospy
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

DEATH_SIGNAL = 1
"""`PR_SET_PDEATHSIG` of prctl(2)."""


def run(order: dict) -> None:
    os.environ["ROS_MASTER_URI"] = order["master"]
    rospy.init_node(order["name"], disable_signals=True, disable_rosout=True)
    signal.signal(signal.SIGINT, lambda *_: rospy.signal_shutdown("asked to end"))
    log = os.open(order["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def heard(topic: str, message: String) -> None:
        os.write(log, f"{time.monotonic():.6f} {topic} {message.data}\n".encode())

    for topic in order["subscribes"]:
        rospy.Subscriber(topic, String, partial(heard, topic), queue_size=1000)
    for service in order["serves"]:
        rospy.Service(service, Trigger, lambda _request: TriggerResponse(True, order["run"]))
    latched = [rospy.Publisher(one, String, queue_size=1, latch=True) for one in order["latches"]]
    for publisher in latched:
        publisher.publish(f"{order['run']} 0")
    publishers = [rospy.Publisher(topic, String, queue_size=1000) for topic in order["publishes"]]
    open(order["ready"], "x").close()
    number = 0
    while not rospy.is_shutdown():
        for publisher in publishers:
            publisher.publish(f"{order['run']} {number}")
        number += 1
        rospy.rostime.wallsleep(0.1)


def main() -> None:
    parent = os.getpid()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    for line in sys.stdin:
        pid = os.fork()
        if not pid:
            ctypes.CDLL(None).prctl(DEATH_SIGNAL, signal.SIGKILL)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            if os.getppid() == parent:
                run(json.loads(line))
            os._exit(0)
        sys.stdout.write(f"{pid}\n")
        sys.stdout.flush()


main()
