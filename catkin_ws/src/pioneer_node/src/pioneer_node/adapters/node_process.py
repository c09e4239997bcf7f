"""A process that hosts nodes without rospy: startup, logging and shutdown."""

import contextlib
import http.client
import logging
import logging.handlers
import os
import re
import signal
import sys
import time
import xmlrpc.client
from collections.abc import Callable, Sequence
from functools import partial
from types import MethodType
from typing import Any

import rosgraph
import yaml

from pioneer_node.adapters.end_request import EndRequest
from pioneer_node.adapters.node_handle import LOGGER, MasterParameters, NodeHandle
from pioneer_node.core.parameter import ParameterError
from tcpros.node_context import NodeContext
from tcpros.reactor import Reactor

Build = Callable[[NodeHandle], Any]
"""Creates the object that does a node's work. Its optional ``end`` method takes a callback to call when done."""

FAREWELL = 3.0
"""Time for the nodes to unregister from the master [s]."""

_PRIVATE = re.compile(r"_[A-Za-z][\w/]*:=")
"""A private parameter on the command line, ``_name:=value``."""
_LOOK_EVERY = 0.25
"""Retry interval while the master does not answer [s]."""
_FORMAT = "[${severity}] [${time}]: ${message}"
_SEVERITIES = {"WARNING": "WARN", "CRITICAL": "FATAL"}
_FILE_FORMAT = "[%(name)s][%(levelname)s] %(asctime)s: %(message)s"
_FILE_SIZE, _FILES = 50_000_000, 4
"""Same as in rosgraph's python_logging.conf."""


class NodeProcess:
    """The nodes of this process, which shut down together on SIGINT or SIGTERM.

    ``rosnode kill`` ends a single node and the others continue; the process ends with its last node.

    Args:
        words: the command line, for remappings and the log file.
        expected: exceptions that mean bad input when a node is created: logged in one line without traceback.
            Always includes ``ParameterError``.
        wall_time: see `NodeHandle`.
        logger: name of the nodes' logger in ``~get_loggers``.
    """

    def __init__(
        self,
        words: Sequence[str],
        expected: tuple[type[Exception], ...] = (),
        wall_time: bool = False,
        logger: str = LOGGER,
    ) -> None:
        self._mappings = rosgraph.names.load_mappings(list(words))
        self._namespace = rosgraph.names.get_ros_namespace(argv=words)
        self._own_parameters = [word for word in words if _PRIVATE.match(word)]
        self._expected = (ParameterError, *expected)
        self._options: dict[str, Any] = {"wall_time": wall_time, "logger": logger}
        self._logger = logging.getLogger(LOGGER)
        self._reactor = Reactor(self._logger)
        host, bind = rosgraph.network.get_host_name(), rosgraph.network.get_bind_address()
        self.context = NodeContext(
            self._reactor, rosgraph.get_master_uri(), host, bind, self._logger
        )  #: shared
        self._handles: dict[str, NodeHandle] = {}
        self._objects: dict[str, Any] = {}
        self._closing: set[str] = set()
        self._status = 0
        self._set_up_logging()
        self._ending = EndRequest()
        self._reactor.wake_on_signals()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._interrupt())

    def add(
        self, name: str, build: Build, joined: Callable[[NodeHandle], object] = lambda _: None
    ) -> bool:
        """Creates a node with this name in the process's namespace; ``build`` returns the object that does its work.

        ``joined`` gets the handle before ``build``. Returns whether the node was created; logs the reason if not.
        """
        resolved = rosgraph.names.resolve_name(name, f"{self._namespace}node")
        if not self._has_master(resolved):
            return False
        try:
            self._handles[resolved] = handle = self._handle(resolved)
            joined(handle)
            self._objects[resolved] = build(handle)
        except self._expected as error:
            self._logger.critical("%s: %s", resolved, error)
        except (OSError, xmlrpc.client.Error) as error:
            self._logger.critical(
                "%s: no answer from the ROS master at %s: %s",
                resolved,
                self.context.master_uri,
                error,
            )
        except (
            Exception
        ):  # outermost handler of node creation: anything else is a bug, log its traceback
            self._logger.critical("%s ended by an error", resolved, exc_info=True)
        else:
            return True
        if resolved in self._handles:
            self._reactor.call(partial(self._close, resolved))
        return False

    def _has_master(self, node: str) -> bool:
        """Waits for the master, as rospy does; returns False if shutdown was requested before it answered."""
        master = MasterParameters(self.context.master_uri, node)
        told = False
        while not self._ending.is_set():
            try:
                return master.ask("getPid")[0]
            except (OSError, http.client.HTTPException, xmlrpc.client.Error):
                if not told:
                    self._logger.warning(
                        "waiting for the ROS master at %s", self.context.master_uri
                    )
                told = True
                self._ending.wait(_LOOK_EVERY)
        return False

    def _handle(self, name: str) -> NodeHandle:
        remappings = {
            rosgraph.names.resolve_name(old, name): rosgraph.names.resolve_name(new, name)
            for old, new in self._mappings.items()
            if not old.startswith("_")
        }
        handle = NodeHandle(
            self.context, name, remappings, partial(self._shut_down, name), **self._options
        )
        for word in self._own_parameters:
            key, _, value = word.partition(":=")
            handle.set_parameter(f"~{key[1:]}", yaml.safe_load(value))
        return handle

    def fail(self) -> None:
        """Ends the process with status 1 once the nodes are unregistered from the master."""
        if not self._ending.is_set():
            self._status = 1
        self._reactor.call(self._end)

    def run(self) -> int:
        """Runs until the last node has ended; returns the exit status."""
        if self._handles:
            self._reactor.run()
        return self._status

    def own_name(self, otherwise: str) -> str:
        """Returns the node name from the command line (``__name:=``) of a single-node process, else ``otherwise``."""
        return str(self._mappings.get("__name", otherwise))

    def _interrupt(self) -> None:
        """Requests shutdown from a signal handler, without locks: the interrupted code may hold them."""
        self._ending.set()
        self._reactor.call(self._end)

    def _end(self) -> None:
        """Unregisters all nodes from the master, with a time-out."""
        self._reactor.call_later(FAREWELL, self._stop_anyway)
        for name in tuple(self._handles):
            self._close(name)

    def _stop_anyway(self) -> None:
        self._logger.warning("the master does not answer: it may still show nodes that have ended")
        self._reactor.stop()

    def _shut_down(self, name: str, reason: str) -> None:
        if name in self._handles:
            self._logger.info("%s ends: %s", name, reason)
            self._close(name)

    def _close(self, name: str) -> None:
        """Stops a node's work and, in parallel, unregisters it from the master, which may hang."""
        if name not in self._handles or name in self._closing:
            return
        self._closing.add(name)
        end = getattr(self._objects.get(name), "end", None)
        missing = 1 if end is None else 2

        def done() -> None:
            nonlocal missing
            missing -= 1
            if not missing and self._handles.pop(name, None) is not None and not self._handles:
                self._reactor.stop()

        self._handles[name].close(done)
        if end is not None:
            end(lambda: self._reactor.call(done))

    def _set_up_logging(self) -> None:
        self._logger.setLevel(logging.INFO)
        # A line that cannot be written to the file, as on a full disk, would print a stack of calls.
        logging.raiseExceptions = False
        # ROS's logger class looks for the caller of rospy's functions; here it would report this process's first line.
        self._logger.findCaller = MethodType(logging.Logger.findCaller, self._logger)  # type: ignore[method-assign,assignment]
        self._logger.handlers = [_Terminal(), _Topic(self._reactor)]
        for handler in self._logger.handlers:
            handler.addFilter(self._named)
        # Log lines of libraries go to the file only.
        root, path = logging.getLogger(), self._mappings.get("__log")
        root.setLevel(logging.INFO)
        root.handlers = [logging.NullHandler()]
        if path:
            file = logging.handlers.RotatingFileHandler(
                path, maxBytes=_FILE_SIZE, backupCount=_FILES, delay=True
            )
            file.setFormatter(logging.Formatter(_FILE_FORMAT))
            root.addHandler(file)

    def _named(self, record: logging.LogRecord) -> bool:
        """Attributes a log line without a node to the node that was created last."""
        if not hasattr(record, "node"):
            record.node = next(reversed(self._handles.values()), None)
        return True


class _Terminal(logging.Handler):
    """Prints lines in rospy's format; warnings and above go to standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        node: NodeHandle | None = record.node  # type: ignore[attr-defined]
        fields = {
            "severity": _SEVERITIES.get(record.levelname, record.levelname),
            "time": node.time_text() if node else f"{time.time():f}",
            "message": self.format(record),
            "node": node.name if node else "",
            "walltime": f"{time.time():f}",
            "logger": record.name,
            "thread": str(record.thread),
            "file": record.pathname,
            "line": str(record.lineno),
            "function": record.funcName or "",
        }
        line = os.environ.get("ROSCONSOLE_FORMAT") or _FORMAT
        for name, text in fields.items():
            line = line.replace(f"${{{name}}}", text)
        stream = sys.stdout if record.levelno < logging.WARNING else sys.stderr
        # A full disk or a pipe without reader costs the line, not the process. It still goes to /rosout and the file.
        with contextlib.suppress(OSError, ValueError):
            stream.write(f"{line}\n")
            stream.flush()


class _Topic(logging.Handler):
    """Sends lines to ``/rosout``."""

    def __init__(self, reactor: Reactor) -> None:
        super().__init__()
        self._reactor = reactor

    def emit(self, record: logging.LogRecord) -> None:
        node: NodeHandle | None = record.node  # type: ignore[attr-defined]
        if node is not None:
            self._reactor.call(partial(node.publish_line, record))
