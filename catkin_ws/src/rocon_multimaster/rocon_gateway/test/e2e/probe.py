"""A node with one topic: `probe.py WHAT NAME TOPIC [BYTES RATE]`.

`talk` publishes its name; `hear` appends a line `seconds text` for each message of `talk`.
`load` publishes numbered, verifiable texts of BYTES at RATE; `check` appends `seconds number bytes good|bad` for each.
`count` publishes numbers as std_msgs/Int32.
`clock` publishes /clock at RATE; SIGUSR1 advances it by a million seconds, SIGUSR2 resets it to its start.
"""

import signal
import sys
import time

import rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32, String


def say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def text(number: int, size: int) -> str:
    """Returns a text that reveals whether any part of it was lost or duplicated."""
    unit = f"{number:08d}"
    return (unit * (size // len(unit) + 1))[: max(size, len(unit))]


def check(message: String) -> None:
    number = int(message.data[:8])
    good = message.data == text(number, len(message.data))
    say(time.monotonic(), number, len(message.data), "good" if good else "bad")


def publish(topic: str, size: int, rate: float, name: str) -> None:
    publisher = rospy.Publisher(topic, String, queue_size=10)
    number = 0
    while not rospy.is_shutdown():
        publisher.publish(text(number, size) if size else name)
        number += 1
        rospy.rostime.wallsleep(1 / rate)


def count(topic: str) -> None:
    publisher = rospy.Publisher(topic, Int32, queue_size=10)
    number = 0
    while not rospy.is_shutdown():
        publisher.publish(number)
        number += 1
        rospy.rostime.wallsleep(0.02)


def tell_time(rate: float) -> None:
    publisher = rospy.Publisher("/clock", Clock, queue_size=1)
    now = [100.0]
    signal.signal(signal.SIGUSR1, lambda *_: now.__setitem__(0, now[0] + 1e6))
    signal.signal(signal.SIGUSR2, lambda *_: now.__setitem__(0, 100.0))
    while not rospy.is_shutdown():
        publisher.publish(rospy.Time.from_sec(now[0]))
        now[0] += 1 / rate
        rospy.rostime.wallsleep(1 / rate)


def main() -> None:
    what, name, topic, *more = rospy.myargv(sys.argv)[1:]
    rospy.init_node(name)
    if what in ("hear", "check"):
        heard = check if what == "check" else lambda message: say(time.monotonic(), message.data)
        rospy.Subscriber(topic, String, heard)
        rospy.spin()
    elif what == "count":
        count(topic)
    elif what == "clock":
        tell_time(float(more[0]))
    else:
        size, rate = (int(more[0]), float(more[1])) if more else (0, 50.0)
        publish(topic, size, rate, name)


main()
