"""All patches that this workspace applies to ROS's own Python packages, each with its reason.

rospy is imported inside the functions: most programs need only some of them.
"""

import contextlib
import errno
import functools
import importlib
import io
import sys
import threading
from collections.abc import Callable
from typing import Any, NoReturn

_ACCEPT_RETRY = 0.2
"""Retry interval while no file descriptor is free [s]: the kernel does not report when one becomes free."""

_WORKERS_LOOK = 1.0
"""Interval at which an idle master worker checks whether to end [s]."""

_LONGEST_AWAIT = 10.0
"""Maximum time that a master blocks a client waiting for registrations [s]: each client occupies a thread."""

_COUNTS = 2**31
"""Counters wrap here: XML-RPC integers have 32 bits."""


def leave_setuptools_out() -> None:
    """Makes ``distutils`` refer to Python's own package, if Python includes it.

    rosclean, which roslaunch imports, uses one function of it. setuptools replaces it with its own copy: 144 modules,
    11 MB and 0.17 s of CPU time.
    """
    if sys.version_info < (3, 12):
        with contextlib.suppress(ImportError):
            importlib.import_module("_distutils_hack").remove_shim()


def allow_publishing_at_shutdown() -> None:
    """Turns publishing into a no-op while the node is shutting down.

    rospy closes topics before `is_shutdown` returns True; a callback that publishes in between would get an exception.
    """
    import rospy

    rospy.topics.is_shutdown = rospy.core.is_shutdown_requested


def log_broken_requests() -> None:
    """Logs one line for a malformed request, instead of the traceback of rospy's thread for that connection."""
    import rospy

    others = threading.excepthook

    def note(failure: threading.ExceptHookArgs) -> None:
        if isinstance(failure.exc_value, rospy.exceptions.TransportException):
            rospy.logwarn_throttle(5.0, f"a connection was closed: {failure.exc_value}")
        else:
            others(failure)

    threading.excepthook = note


def keep_accepting(is_ending: Callable[[], bool], wait: Callable[[float], object]) -> None:
    """Keeps this process's TCPROS server alive when file descriptors run out.

    rospy's server thread ends at the first connection that it cannot accept; the node stays registered but never serves
    a subscriber or service client again. With this patch the connection waits in the kernel's backlog until a
    descriptor is free.

    Args:
        is_ending: returns whether the node is shutting down.
        wait: sleeps for the given seconds, or until shutdown.
    """
    import rospy

    accept = rospy.impl.tcpros_base.TCPServer.run

    def run(server: Any) -> None:
        while not is_ending():
            try:
                accept(server)
                return
            except OSError as error:
                if error.errno not in (errno.EMFILE, errno.ENFILE):
                    raise
                text = "out of file descriptors (see ulimit -n); new connections wait until others close"
                rospy.logerr_throttle(10.0, text)
                wait(_ACCEPT_RETRY)

    rospy.impl.tcpros_base.TCPServer.run = run


def stop_serving_at_shutdown() -> None:
    """Stops the XML-RPC server thread when the node shuts down.

    rospy only closes the thread's socket. The thread then calls accept in a busy loop until the process ends, which
    cost a node up to 0.5 s of CPU time.
    """
    from rosgraph.xmlrpc import XmlRpcNode

    close = XmlRpcNode.shutdown

    def end_thread() -> NoReturn:
        raise OSError("the node shuts down")

    def shutdown(node: Any, reason: str) -> None:
        server = node.server
        close(node, reason)
        if server:
            server.service_actions = (
                end_thread  # called after each poll; the thread treats the error as a lost socket
            )

    XmlRpcNode.shutdown = shutdown


def keep_publisher_updates() -> None:
    """Fixes a race in which subscribers miss publishers that register at the same moment.

    rospy uses the last list of a topic's publishers that it received. If it handles the master's answer to a
    subscription after the master's next update, the older list replaces the newer one and the subscriber never
    connects. This patch merges all lists that are not handled yet.
    """
    from rospy.impl.registration import RegManager

    def publisher_update(manager: Any, topic: str, uris: list[str]) -> None:
        with manager.cond:
            known = (uri for name, earlier in manager.updates if name == topic for uri in earlier)
            manager.updates.append((topic, list(dict.fromkeys([*uris, *known]))))
            manager.cond.notify_all()

    RegManager.publisher_update = publisher_update


def write_at_once() -> None:
    """Makes publishers write messages in their own thread instead of one thread per subscriber."""
    import rospy

    from pioneer_launch.direct_connection import DirectConnection

    rospy.topics.QueuedConnection = DirectConnection


def read_versions_here() -> None:
    """Makes roslaunch read ROS versions in this process; it normally spawns two interpreters per core to print them."""
    from roslaunch import loader

    read = loader.Loader.param_value

    def param_value(self: Any, verbose: bool, name: str, kind: str, *sources: str | None) -> Any:
        *others, command = sources
        if (
            command
            and command.startswith("rosversion ")
            and not any(one is not None for one in others)
        ):
            text = _printed_versions(command)
            if text:
                return loader.convert_value(text, kind)
        return read(self, verbose, name, kind, *sources)

    loader.Loader.param_value = param_value


@functools.cache
def _printed_versions(command: str) -> str:
    """Returns the output of a ``rosversion`` command; empty if it fails."""
    from rospkg import rosversion

    given, sys.argv = sys.argv, command.split()
    try:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            rosversion.main()
    except SystemExit as end:
        return "" if end.code else printed.getvalue()
    finally:
        sys.argv = given
    return printed.getvalue()


def remember_packages() -> None:
    """Caches package folders, so that this process and its forks search each of them only once.

    ROS's tools search all folders for almost every package look-up, for example when a Python node sets up logging:
    27 ms and 1,400 file system calls. If a package is not found, the search is repeated.
    """
    from rospkg import RosPack, rospack

    search, find = rospack.list_by_path, RosPack.get_path
    known: dict[tuple[str, str], dict[str, str]] = {}

    def list_by_path(manifest: str, path: str, cache: dict[str, str] | None) -> list[str]:
        found = known.get((manifest, path))
        if found is None:
            found = {}
            search(manifest, path, found)
            known[manifest, path] = found
        if cache is not None:
            cache.update(found)
        return list(found)

    def get_path(manager: Any, name: str) -> str:
        try:
            return str(find(manager, name))
        except rospack.ResourceNotFound:  # possibly added since
            known.clear()
            manager._location_cache = None
            return str(find(manager, name))

    rospack.list_by_path, RosPack.get_path = list_by_path, get_path
    RosPack().list()


def wake_master_workers() -> None:
    """Makes the worker threads of ROS masters in this process wait for work instead of polling 10 times a second.

    The workers notify subscribers of new publishers; polling delayed this by up to 0.1 s.
    """
    from rosmaster import threadpool

    given, count, worker = threading.Condition(), 0, threading.local()

    def with_notice(method: Callable[..., Any]) -> Callable[..., Any]:
        def notify(*arguments: Any, **named: Any) -> Any:
            nonlocal count
            result = method(*arguments, **named)
            with given:
                count += 1
                given.notify_all()
            return result

        return notify

    def wait_for_work(_seconds: float) -> None:
        # Also return for work queued since this worker's last wait: it may have checked the queue before that.
        with given:
            given.wait_for(lambda: count != getattr(worker, "seen", 0), _WORKERS_LOOK)
            worker.seen = count

    pool = threadpool.MarkedThreadPool
    pool.queue_task = with_notice(pool.queue_task)
    pool.remove_marker = with_notice(
        pool.remove_marker
    )  # a task waits for the previous one with the same marker
    threadpool.sleep = wait_for_work


def tell_registrations() -> None:
    """Adds an API call to the ROS master of this process that blocks until a node registers or unregisters something.

    ``awaitRegistrations(caller_id, known, seconds)`` returns the number of changes once it differs from ``known``, or
    after ``seconds``, at most 10. The standard master reports changes of single topics only, so a client that needs all
    changes would have to poll the whole system state.
    """
    from rosmaster.master_api import ROSMasterHandler

    happened, count = threading.Condition(), 0

    def with_notice(method: Callable[..., Any]) -> Callable[..., Any]:
        def register(*arguments: Any) -> Any:
            nonlocal count
            result = method(*arguments)
            with happened:
                count = (count + 1) % _COUNTS
                happened.notify_all()
            return result

        return register

    def await_registrations(
        _master: Any, _caller_id: str, known: int, seconds: float
    ) -> tuple[int, str, int]:
        with happened:
            happened.wait_for(lambda: count != known, max(0.0, min(float(seconds), _LONGEST_AWAIT)))
            return 1, "registrations", count

    for what in ("Publisher", "Subscriber", "Service"):
        for name in (f"register{what}", f"unregister{what}"):
            setattr(ROSMasterHandler, name, with_notice(getattr(ROSMasterHandler, name)))
    ROSMasterHandler.awaitRegistrations = await_registrations


def close_master_connections() -> None:
    """Makes the workers of ROS masters in this process close a connection to a node when they drop it.

    They end some time after their master, and would leave the sockets open until Python's garbage collection.
    """
    from rosmaster import util

    class ClosingProxy(util.ServerProxy):  # type: ignore[misc]
        """A proxy that closes its connection when it is deleted."""

        def __del__(self) -> None:
            self("close")()

    util.ServerProxy = ClosingProxy


def replace_topics(publisher: Any, subscriber: Any, timer: Any) -> None:
    """Replaces rospy's classes for topics and timers in this process: lockstep passes messages on by tokens."""
    import rospy

    rospy.Publisher, rospy.Subscriber, rospy.Timer = publisher, subscriber, timer


def stop_following_clock() -> None:
    """Ends rospy's subscription to ``/clock`` and sets ROS time to 0; `set_ros_time` sets it from then on."""
    import rospy

    clock = getattr(rospy.impl.simtime, "_clock_sub", None)
    if clock is not None:
        clock.unregister()
    set_ros_time(rospy.Time())


def set_ros_time(now: Any) -> None:
    """Sets ROS time (rospy.Time) in this process."""
    import rospy

    rospy.rostime._set_rostime(now)
