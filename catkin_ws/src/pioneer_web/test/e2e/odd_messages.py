"""Publishes odd messages on all topics that the fleet page subscribes to, with a seed and for a time [s]."""

import io
import random
import sys
import time

import hostile
import roslib.message
import rospy


def main(seed, seconds):
    rospy.init_node("odd_messages", disable_rostime=True)
    rng = random.Random(seed)
    poison = hostile.Poison(rng, ("map", "pioneer1/odom", "pioneer2/odom", "pioneer1/laser"))
    master = rospy.get_master()
    subscriptions = master.getSystemState()[2][1]
    types = dict(master.getTopicTypes()[2])
    publishers = []
    for topic, nodes in subscriptions:
        if "/fleet_page" in nodes:
            kind = roslib.message.get_message_class(types[topic])
            raw = hostile.raw_class(kind)
            publishers.append((rospy.Publisher(topic, raw, queue_size=1), kind, raw))
    ends = time.monotonic() + seconds
    count = 0
    pace = rospy.Rate(50)
    while time.monotonic() < ends:
        for publisher, kind, raw in publishers:
            buffer = io.BytesIO()
            poison.fill(kind()).serialize(buffer)
            publisher.publish(raw(buffer.getvalue()))
            count += 1
        pace.sleep()
    sys.stdout.write(f"{len(publishers)} {count}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
