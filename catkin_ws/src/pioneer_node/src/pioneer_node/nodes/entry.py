"""The one way a node of this workspace starts and ends."""

import http.client
import io
import logging
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

import rospy

from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.core.parameter import ParameterError

_ending = EndRequest()
"""Set as soon as a signal asks the process to end; rospy knows of a shutdown a moment later."""


def run(
    name: str, build: Callable[[], Any], expected: tuple[type[Exception], ...] = (), wall_time: bool = False
) -> int:
    """Initialises the node, builds it, spins until shutdown, and returns the process's exit status.

    Args:
        name: the node's default name.
        build: makes the node object; it is kept alive while the node spins. An object with a ``spin``
            method is spun by that method, any other by ``rospy.spin``.
        expected: errors that mean bad input rather than a fault of ours: one line, no traceback.
            ``ParameterError`` always counts as one.
        wall_time: the node keeps to wall time even where ``/use_sim_time`` is set, and does not listen to ``/clock``.
    """
    # Into a pipe or a file, what a node says would otherwise stand in a buffer until it ends.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _shut_down)
    # Before is_shutdown() says so, rospy closes topics; a callback that publishes then is no fault of its node's.
    rospy.topics.is_shutdown = rospy.core.is_shutdown_requested
    rospy.init_node(name, disable_rostime=wall_time, disable_signals=True)
    try:
        node = build()
        getattr(node, "spin", rospy.spin)()
    except rospy.ROSInterruptException:
        return 0
    except (ParameterError, *expected) as error:
        rospy.logfatal("%s", error)
        rospy.signal_shutdown(str(error))
        return 1
    except Exception as error:  # the outermost loop: whatever arrives here is a fault of ours and is told whole
        if is_ending() and isinstance(error, OSError | http.client.HTTPException):
            # Whoever ends may have lost its master, or its peers, before.
            logging.getLogger(__name__).info("%s ended while it lost a connection: %s", name, error)
            return 0
        logging.getLogger("rosout").critical("%s ended by an error", name, exc_info=True)
        rospy.signal_shutdown("internal error")
        return 1
    return 0


def is_ending() -> bool:
    """Tells whether the node ends: from the signal on, where ``rospy.is_shutdown`` does so later."""
    return _ending.is_set() or bool(rospy.is_shutdown())


def _shut_down(number: int, _frame: object) -> None:
    """Shuts down in a thread of its own.

    rospy's own handler does it in the interrupted main thread, where it waits for ever for a lock that this thread
    may hold. The thread is no daemon: the process ends when the node is unregistered. A second signal changes nothing.
    """
    if _ending.is_set():
        return
    _ending.set()
    threading.Thread(target=rospy.signal_shutdown, args=(f"signal-{number}",), name="shutdown").start()


def on_shutdown(wake: Callable[[], object]) -> None:
    """Has ``wake`` called at shutdown, when ``rospy.is_shutdown`` is true already.

    ``rospy.on_shutdown`` calls before that: a loop that is woken then may find that there is no shutdown, and sleep on
    for ever.
    """
    rospy.core.add_shutdown_hook(lambda _reason: wake())


def parameters() -> dict[str, Any]:
    """Returns the node's private parameters, an empty dictionary when there are none."""
    values = rospy.get_param("~", {})
    return values if isinstance(values, dict) else {}
