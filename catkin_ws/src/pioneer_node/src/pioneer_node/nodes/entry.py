"""Common startup and shutdown of all nodes in this workspace."""

import contextlib
import http.client
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any, NoReturn
from urllib.parse import urlsplit

import rosgraph
import rospy

from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.adapters.heap import limit_arenas
from pioneer_node.adapters.launch_door import launch_door
from pioneer_node.adapters.output import lose_what_cannot_be_written
from pioneer_node.core.parameter import UNKNOWN, ParameterError
from pioneer_node.core.ring import MEMBERS

_STRICT = "strict_parameters"
_ending = EndRequest()
"""Set as soon as a signal requests shutdown; rospy's shutdown flag follows a moment later."""
_initialised = threading.Event()
_REGISTERING = 3.0
"""Time-out for registration after a shutdown request [s]: without a master rospy retries forever, holding locks."""
_RETRY = 0.1
"""Interval for trying to reach the master [s]."""
_TRIES_UNTIL_REPORT = 10


def run(
    name: str,
    build: Callable[[], Any],
    expected: tuple[type[Exception], ...] = (),
    wall_time: bool = False,
) -> int:
    """Initialises the node, builds it, spins until shutdown, and returns the process's exit status.

    After a signal it does not return: the process exits once the node is unregistered.

    Args:
        name: the node's default name.
        build: creates the node object, which is kept alive while the node spins. Its ``spin`` method is used if it
            has one, else ``rospy.spin``. In lockstep its optional ``step`` is called once per period, as soon as its
            optional ``ready`` has returned true, and its optional ``stop`` when the node ends, also by an exception.
        expected: exceptions that mean bad input rather than a bug: logged in one line without traceback.
            Always includes ``ParameterError``.
        wall_time: use wall time even if ``/use_sim_time`` is set, and do not subscribe to ``/clock``.
    """
    lose_what_cannot_be_written()
    limit_arenas()
    ending = threading.Thread(target=_shut_down_when_asked, name="shutdown", daemon=True)
    ending.start()
    _ending.take_signals(signal.SIGINT, signal.SIGTERM)
    door = launch_door()
    if door is not None:
        door.patch_node(is_ending, _ending.wait)
    if _has_private_parameters(sys.argv) and not _master_answers():
        _leave(0)
    rospy.init_node(name, disable_rostime=wall_time, disable_signals=True)
    _initialised.set()
    status = _spun(name, build if wall_time else _as_member(build), expected)
    if _ending.is_set():
        ending.join()  # the process ends once the node is unregistered
        _leave(status)
    return status


def _has_private_parameters(arguments: Sequence[str]) -> bool:
    """Returns whether there is a ``_name:=value``. rospy sets these at once: it fails without a master.

    Without one, rospy itself waits for the master.
    """
    return any(
        ":=" in argument and argument.startswith("_") and not argument.startswith("__")
        for argument in arguments
    )


def _master_answers() -> bool:
    """Waits until the ROS master accepts connections; returns false if a signal ends the wait."""
    uri = rosgraph.get_master_uri()
    try:
        master = urlsplit(uri)
        address = (master.hostname or "", master.port or 80)
    except ValueError:
        return True  # rospy reports an invalid URI
    tried = 0
    while not _ending.is_set():
        try:
            socket.create_connection(address, 1.0).close()
            return True
        except OSError as error:
            tried += 1
            if tried == _TRIES_UNTIL_REPORT:
                sys.stderr.write(f"waiting for the ROS master at {uri}: {error}\n")
        _ending.wait(_RETRY)
    return False


def _leave(status: int) -> NoReturn:
    """Exits without interpreter finalization, which takes four times as long as the orderly shutdown before it."""
    logging.shutdown()
    with contextlib.suppress(OSError, ValueError):  # the output's receiver may have exited first
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
    except Exception as error:  # outermost handler: anything else is a bug, log its traceback
        if is_ending() and isinstance(error, OSError | http.client.HTTPException):
            # The master or a peer may have exited first.
            logging.getLogger(__name__).info("%s ended while it lost a connection: %s", name, error)
            return 0
        logging.getLogger("rosout").critical("%s ended by an error", name, exc_info=True)
        rospy.signal_shutdown("internal error")
        return 1
    return 0


def _as_member(build: Callable[[], Any]) -> Callable[[], Any]:
    """Wraps ``build`` so that a ring member's ``step`` is called for each period's token."""
    if MEMBERS not in os.environ:
        return build
    from pioneer_node.nodes import lockstep

    def built() -> Any:
        member = lockstep.joined()
        node = build()
        return node if member is None else lockstep.Turns(member, node)

    return built


def is_ending() -> bool:
    """Returns whether the node is shutting down: true from the signal on, earlier than ``rospy.is_shutdown``."""
    return _ending.is_set() or bool(rospy.is_shutdown())


def wait(seconds: float) -> bool:
    """Sleeps up to ``seconds`` [s of wall time]; returns true, and early, if a signal requests shutdown."""
    return _ending.wait(seconds)


def _shut_down_when_asked() -> None:
    """Waits for the shutdown flag and shuts rospy down, in a thread started before any signal.

    A signal handler interrupts the main thread and would deadlock on locks held there: rospy's, or the one for
    starting a thread. So the handler only sets the flag. Further signals have no effect.
    """
    _ending.wait()
    if not _initialised.wait(_REGISTERING):
        sys.stderr.write(
            f"ended while registering with the ROS master at {rosgraph.get_master_uri()}\n"
        )
        os._exit(0)
    rospy.signal_shutdown("signal")


def on_shutdown(wake: Callable[[], object]) -> None:
    """Registers ``wake`` to be called at shutdown, once ``rospy.is_shutdown`` is true.

    ``rospy.on_shutdown`` calls earlier: a loop woken then may not see the shutdown yet and sleep forever.
    """
    rospy.core.add_shutdown_hook(lambda _reason: wake())


def parameters() -> dict[str, Any]:
    """Returns the node's private parameters, an empty dictionary when there are none.

    If ``strict_parameters`` is set for the node or an enclosing namespace, unknown parameters are errors.
    """
    values = parameters_below(rospy.get_name())
    key = rospy.search_param(_STRICT)
    UNKNOWN.strict = bool(key and rospy.get_param(key))
    return {name: values[name] for name in values if name != _STRICT}


def parameters_below(namespace: str) -> dict[str, Any]:
    """Returns all parameters in a namespace, those below it as nested dictionaries; empty if there are none.

    ``rospy.get_param`` answers for a namespace from its cache, which has only the names that rospy asked for itself:
    in ``/``, as soon as the node has logged, the single name ``rosout_disable_topics_generation``.
    """
    try:
        values = rosgraph.Master(rospy.get_name()).getParam(rospy.resolve_name(namespace))
    except rosgraph.MasterError:
        return {}
    return values if isinstance(values, dict) else {}
