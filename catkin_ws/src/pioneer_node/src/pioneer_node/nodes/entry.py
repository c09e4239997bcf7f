"""The one way a node of this workspace starts and ends."""

import contextlib
import http.client
import io
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any, NoReturn

import rosgraph
import rospy

from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.adapters.heap import limit_arenas
from pioneer_node.core.parameter import UNKNOWN, ParameterError
from pioneer_node.core.ring import MEMBERS
from pioneer_node.nodes import patch

_STRICT = "strict_parameters"
_ending = EndRequest()
"""Set as soon as a signal asks the process to end; rospy knows of a shutdown a moment later."""
_initialised = threading.Event()
_REGISTERING = 3.0
"""So long a node that is to end may still register [s]: without a master, rospy tries for ever and holds its locks."""


def run(
    name: str, build: Callable[[], Any], expected: tuple[type[Exception], ...] = (), wall_time: bool = False
) -> int:
    """Initialises the node, builds it, spins until shutdown, and returns the process's exit status.

    After a signal the process ends here, once the node is unregistered: nothing that follows runs.

    Args:
        name: the node's default name.
        build: makes the node object; it is kept alive while the node spins. An object with a ``spin``
            method is spun by that method, any other by ``rospy.spin``. In lockstep its ``step``, if it has one, is
            called once a period, from the time on when its ``ready``, if it has one, has returned true.
        expected: errors that mean bad input rather than a fault of ours: one line, no traceback.
            ``ParameterError`` always counts as one.
        wall_time: the node keeps to wall time even where ``/use_sim_time`` is set, and does not listen to ``/clock``.
    """
    # Into a pipe or a file, what a node says would otherwise stand in a buffer until it ends.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    limit_arenas()
    ending = threading.Thread(target=_shut_down_when_asked, name="shutdown", daemon=True)
    ending.start()
    _ending.take_signals(signal.SIGINT, signal.SIGTERM)
    patch.allow_publishing_at_shutdown()
    patch.log_broken_requests()
    patch.keep_publisher_updates()
    patch.write_at_once()
    patch.stop_serving_at_shutdown()
    patch.keep_accepting(is_ending, _ending.wait)
    rospy.init_node(name, disable_rostime=wall_time, disable_signals=True)
    _initialised.set()
    status = _spun(name, build if wall_time else _as_member(build), expected)
    if _ending.is_set():
        ending.join()  # the process ends once the node is unregistered
        _leave(status)
    return status


def _leave(status: int) -> NoReturn:
    """Ends the process without taking Python's modules apart, which costs four times what an orderly shutdown does."""
    logging.shutdown()
    with contextlib.suppress(OSError, ValueError):  # what the output was connected to may have ended first
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


def _spun(name: str, build: Callable[[], Any], expected: tuple[type[Exception], ...]) -> int:
    try:
        node = build()
        getattr(node, "spin", rospy.spin)()
    except rospy.ROSInterruptException:
        return 0
    except (ParameterError, *expected) as error:
        rospy.logfatal("%s", error)
        rospy.signal_shutdown(str(error))
        return 1
    except Exception as error:  # the outermost loop: whatever arrives here is a bug and gets its traceback
        if is_ending() and isinstance(error, OSError | http.client.HTTPException):
            # The master, or a peer, may have ended first.
            logging.getLogger(__name__).info("%s ended while it lost a connection: %s", name, error)
            return 0
        logging.getLogger("rosout").critical("%s ended by an error", name, exc_info=True)
        rospy.signal_shutdown("internal error")
        return 1
    return 0


def _as_member(build: Callable[[], Any]) -> Callable[[], Any]:
    """Returns what builds the node and, where it is a member of a ring, has each period's token call its ``step``."""
    if MEMBERS not in os.environ:
        return build
    from pioneer_node.nodes import lockstep

    def built() -> Any:
        member = lockstep.joined()
        node = build()
        return node if member is None else lockstep.Turns(member, node)

    return built


def is_ending() -> bool:
    """Returns whether the node is shutting down: from the signal on, ``rospy.is_shutdown`` only later."""
    return _ending.is_set() or bool(rospy.is_shutdown())


def wait(seconds: float) -> bool:
    """Rests for a time [s of wall time] at most; returns early, and true, when a signal asks the process to end."""
    return _ending.wait(seconds)


def _shut_down_when_asked() -> None:
    """Shuts rospy down once a signal has set the flag, in a thread that exists before the signal.

    A handler runs in the middle of the main thread, whose locks it would wait for without end: rospy's own, and the
    one that starting a thread takes. So the handler only sets the flag. Further signals change nothing.
    """
    _ending.wait()
    if not _initialised.wait(_REGISTERING):
        sys.stderr.write(f"ended while registering with the ROS master at {rosgraph.get_master_uri()}\n")
        os._exit(0)
    rospy.signal_shutdown("signal")


def on_shutdown(wake: Callable[[], object]) -> None:
    """Registers ``wake`` to be called at shutdown, once ``rospy.is_shutdown`` is true.

    ``rospy.on_shutdown`` calls earlier: a loop woken then may see no shutdown yet, and sleep for good.
    """
    rospy.core.add_shutdown_hook(lambda _reason: wake())


def parameters() -> dict[str, Any]:
    """Returns the node's private parameters, an empty dictionary when there are none.

    ``strict_parameters``, the node's own or that of a namespace above it, has unknown parameters refused.
    """
    values = rospy.get_param("~", {})
    key = rospy.search_param(_STRICT)
    UNKNOWN.strict = bool(key and rospy.get_param(key))
    return {name: values[name] for name in values if name != _STRICT} if isinstance(values, dict) else {}
