"""Callbacks that invalid messages cost one warning each, instead of a traceback for each message."""

from collections.abc import Callable
from typing import Any

import rospy


def tolerant(topic: str, callback: Callable[..., None]) -> Callable[..., None]:
    """Returns a callback that ignores messages whose values ``callback`` cannot use, with one warning for the topic."""
    warned = False

    def called(*arguments: Any) -> None:
        nonlocal warned
        try:
            callback(*arguments)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            if not warned:
                rospy.logwarn(
                    "%s: messages with invalid values are ignored: %s", topic, str(error)[:200]
                )
            warned = True

    return called
