"""Everything that this workspace changes in ROS's own Python packages, each with its reason.

rospy is imported within the functions: `import_without_numpy` has to come first.
"""

import contextlib
import errno
import functools
import importlib
import io
import sys
import threading
from collections.abc import Callable
from types import ModuleType
from typing import Any, NoReturn

_ACCEPT_RETRY = 0.2
"""How long a server waits for a free file descriptor [s]: the kernel does not report one."""

_WORKERS_LOOK = 1.0
"""How long a master's worker waits for work before it looks whether to end [s]."""

_LONGEST_AWAIT = 10.0
"""For how long a master keeps somebody waiting for a registration [s]: each takes a thread."""

_COUNTS = 2**31
"""XML-RPC's numbers end there."""


def import_without_numpy(module: str) -> ModuleType:
    """Returns a node's module, imported without numpy; for nodes that compute nothing.

    genpy imports numpy where it is installed, only to complain about messages of wrong types, and works without it.
    This spares a node 15 MB and 0.2 s of processor time. numpy itself can still be imported afterwards.
    """
    if "numpy" not in sys.modules:
        sys.modules["numpy"] = None  # type: ignore[assignment] # an import of it raises ImportError
        try:
            import genpy  # noqa: F401
        finally:
            del sys.modules["numpy"]
    return importlib.import_module(module)


def leave_setuptools_out() -> None:
    """Has ``distutils`` be Python's own where Python has one.

    rosclean, which roslaunch imports, takes one function of it. setuptools puts itself in its place: 144 modules, 11 MB
    and 0.17 s of processor time.
    """
    if sys.version_info < (3, 12):
        with contextlib.suppress(ImportError):
            importlib.import_module("_distutils_hack").remove_shim()


def allow_publishing_at_shutdown() -> None:
    """Makes a publisher of a node that is shutting down do nothing.

    rospy closes topics before `is_shutdown` returns True; a callback that publishes then would get an exception.
    """
    import rospy

    rospy.topics.is_shutdown = rospy.core.is_shutdown_requested


def log_broken_requests() -> None:
    """Makes a request that does not parse one line; rospy's thread for that connection would end with a traceback."""
    import rospy

    others = threading.excepthook

    def note(failure: threading.ExceptHookArgs) -> None:
        if isinstance(failure.exc_value, rospy.exceptions.TransportException):
            rospy.logwarn_throttle(5.0, f"a connection was closed: {failure.exc_value}")
        else:
            others(failure)

    threading.excepthook = note


def keep_accepting(is_ending: Callable[[], bool], wait: Callable[[float], object]) -> None:
    """Keeps the TCPROS server of this process alive when the process runs out of file descriptors.

    rospy's server thread ends at the first connection that it cannot accept, and the node, still registered, never
    serves a subscriber or a client again. Here the connection waits in the kernel's queue until a descriptor is free.

    Args:
        is_ending: whether the node is shutting down.
        wait: waits so many seconds, or until it is.
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
    """Ends the thread that serves XML-RPC when the node shuts down.

    rospy only closes that thread's socket. The thread then tries to accept from it without pause, until the process
    ends, which took a node up to half a second of processor time.
    """
    from rosgraph.xmlrpc import XmlRpcNode

    close = XmlRpcNode.shutdown

    def end_thread() -> NoReturn:
        raise OSError("the node shuts down")

    def shutdown(node: Any, reason: str) -> None:
        server = node.server
        close(node, reason)
        if server:
            server.service_actions = end_thread  # which the thread calls after each look; it takes it for a lost socket

    XmlRpcNode.shutdown = shutdown


def keep_publisher_updates() -> None:
    """Connects subscribers of this process also to publishers that register at the same moment.

    rospy keeps the newest list of a topic's publishers that it was given. The master's answer to a subscription may be
    handled after the update that the master sent next, and its older list then replaced the newer one: the subscriber
    stayed without connection. Here lists that have not been handled yet are joined.
    """
    from rospy.impl.registration import RegManager

    def publisher_update(manager: Any, topic: str, uris: list[str]) -> None:
        with manager.cond:
            known = (uri for name, earlier in manager.updates if name == topic for uri in earlier)
            manager.updates.append((topic, list(dict.fromkeys([*uris, *known]))))
            manager.cond.notify_all()

    RegManager.publisher_update = publisher_update


def write_at_once() -> None:
    """Has publishers of this process write messages themselves instead of having a thread for each subscriber do it."""
    import rospy

    from pioneer_node.nodes.direct_connection import DirectConnection

    rospy.topics.QueuedConnection = DirectConnection


def read_versions_here() -> None:
    """Has roslaunch read ROS's versions in this process. For each core it starts two interpreters that print them."""
    from roslaunch import loader

    read = loader.Loader.param_value

    def param_value(self: Any, verbose: bool, name: str, kind: str, *sources: str | None) -> Any:
        *others, command = sources
        if command and command.startswith("rosversion ") and not any(one is not None for one in others):
            text = _printed_versions(command)
            if text:
                return loader.convert_value(text, kind)
        return read(self, verbose, name, kind, *sources)

    loader.Loader.param_value = param_value


@functools.cache
def _printed_versions(command: str) -> str:
    """Returns what ``rosversion`` prints; empty where it fails."""
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
    """Has this process, and those that it forks, search each folder of packages once.

    ROS's tools search all of them for nearly each package that they look up, a Python node when it sets up its log:
    27 ms, and 1,400 calls of the file system. A package that is not found is searched for again.
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
        except rospack.ResourceNotFound:  # added since, perhaps
            known.clear()
            manager._location_cache = None
            return str(find(manager, name))

    rospack.list_by_path, RosPack.get_path = list_by_path, get_path
    RosPack().list()


def wake_master_workers() -> None:
    """Has the workers of the ROS masters in this process wait for work; each looked for some 10 times a second.

    They tell subscribers of new publishers, and did so up to 0.1 s late.
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
        # Work that was given since this worker's last wait counts: it may have looked before that.
        with given:
            given.wait_for(lambda: count != getattr(worker, "seen", 0), _WORKERS_LOOK)
            worker.seen = count

    pool = threadpool.MarkedThreadPool
    pool.queue_task = with_notice(pool.queue_task)
    pool.remove_marker = with_notice(pool.remove_marker)  # a task waits for the one before it with its marker
    threadpool.sleep = wait_for_work


def tell_registrations() -> None:
    """Adds a call to the ROS master of this process that returns when somebody has registered or unregistered.

    ``awaitRegistrations(caller_id, known, seconds)`` returns how many times that has happened, as soon as it is not
    ``known``, or after so many seconds, 10 at most. ROS's master tells changes of single topics only, so a client that
    wants to know of all has to ask for the whole state again and again.
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

    def await_registrations(_master: Any, _caller_id: str, known: int, seconds: float) -> tuple[int, str, int]:
        with happened:
            happened.wait_for(lambda: count != known, max(0.0, min(float(seconds), _LONGEST_AWAIT)))
            return 1, "registrations", count

    for what in ("Publisher", "Subscriber", "Service"):
        for name in (f"register{what}", f"unregister{what}"):
            setattr(ROSMasterHandler, name, with_notice(getattr(ROSMasterHandler, name)))
    ROSMasterHandler.awaitRegistrations = await_registrations
