"""Forwards tokens from one topic to another, but drops a period's token as many times as the period is listed."""

import sys

import rospy
from pioneer_msgs.msg import LockstepToken


def main() -> None:
    """Forwards tokens until shutdown."""
    source, sink, *periods = sys.argv[1:]
    losses = list(map(int, periods))
    rospy.init_node("lossy_link", anonymous=True)
    publisher = rospy.Publisher(sink, LockstepToken, queue_size=100)

    def forward(token: LockstepToken) -> None:
        if token.kind == LockstepToken.PERIOD and token.period in losses:
            losses.remove(token.period)
            sys.stdout.write(f"lost {token.period}\n")
            sys.stdout.flush()
        else:
            publisher.publish(token)

    rospy.Subscriber(source, LockstepToken, forward)
    rospy.spin()


if __name__ == "__main__":
    main()
