"""A process of nodes without rospy: how they start, what they log, and how they end."""

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
from tcpros.adapters.node_context import NodeContext
from tcpros.adapters.reactor import Reactor

Build = Callable[[NodeHandle], Any]
"""Makes the object that does a node's work. Its ``end``, if it has one, gets what to call once it has ended."""

FAREWELL = 3.0
"""For so long the nodes may take themselves back from the master [s]."""

_PRIVATE = re.compile(r"_[A-Za-z][\w/]*:=")
"""A private parameter on the command line, ``_name:=value``."""
_LOOK_EVERY = 0.25
"""How often a master that does not answer is asked again [s]."""
_FORMAT = "[${severity}] [${time}]: ${message}"
_SEVERITIES = {"WARNING": "WARN", "CRITICAL": "FATAL"}
_FILE_FORMAT = "[%(name)s][%(levelname)s] %(asctime)s: %(message)s"
_FILE_SIZE, _FILES = 50_000_000, 4
"""As rosgraph's python_logging.conf."""


class NodeProcess:
    """The nodes of this process, which end together when it gets SIGINT or SIGTERM.

    When one is asked to end by itself (``rosnode kill``), the others continue; the process ends with the last.

    Args:
        words: the command line, for remappings and the log file.
        expected: errors of a node's making that mean bad input: one line, no traceback. ``ParameterError`` is one.
        wall_time: see `NodeHandle`.
        logger: what ``~get_loggers`` calls the nodes' logger.
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
        self.context = NodeContext(self._reactor, rosgraph.get_master_uri(), host, bind, self._logger)  #: of all nodes
        self._handles: dict[str, NodeHandle] = {}
        self._objects: dict[str, Any] = {}
        self._closing: set[str] = set()
        self._status = 0
        self._set_up_logging()
        self._ending = EndRequest()
        self._reactor.wake_on_signals()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._interrupt())

    def add(self, name: str, build: Build, joined: Callable[[NodeHandle], object] = lambda _: None) -> bool:
        """Makes a node of this name, below the process's namespace, with what ``build`` returns to do its work.

        ``joined`` gets the handle before ``build`` does. Returns whether the node was made; else the reason is logged.
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
            self._logger.critical("%s: no answer of the ROS master at %s: %s", resolved, self.context.master_uri, error)
        except Exception:  # the outermost of a node's making: whatever arrives here is a bug and gets its traceback
            self._logger.critical("%s ended by an error", resolved, exc_info=True)
        else:
            return True
        if resolved in self._handles:
            self._reactor.call(partial(self._close, resolved))
        return False

    def _has_master(self, node: str) -> bool:
        """Waits for the master, as rospy does; returns whether it answers, and not the end was asked for."""
        master = MasterParameters(self.context.master_uri, node)
        told = False
        while not self._ending.is_set():
            try:
                return master.ask("getPid")[0]
            except (OSError, http.client.HTTPException, xmlrpc.client.Error):
                if not told:
                    self._logger.warning("waiting for the ROS master at %s", self.context.master_uri)
                told = True
                self._ending.wait(_LOOK_EVERY)
        return False

    def _handle(self, name: str) -> NodeHandle:
        remappings = {
            rosgraph.names.resolve_name(old, name): rosgraph.names.resolve_name(new, name)
            for old, new in self._mappings.items()
            if not old.startswith("_")
        }
        handle = NodeHandle(self.context, name, remappings, partial(self._shut_down, name), **self._options)
        for word in self._own_parameters:
            key, _, value = word.partition(":=")
            handle.set_parameter(f"~{key[1:]}", yaml.safe_load(value))
        return handle

    def fail(self) -> None:
        """Has the process end with status 1, once the nodes are taken back from the master."""
        if not self._ending.is_set():
            self._status = 1
        self._reactor.call(self._end)

    def run(self) -> int:
        """Runs until the last node has ended; returns the exit status."""
        if self._handles:
            self._reactor.run()
        return self._status

    def own_name(self, otherwise: str) -> str:
        """Returns the name that the command line gives to the one node of a process."""
        return str(self._mappings.get("__name", otherwise))

    def _interrupt(self) -> None:
        """Asks for the end, in a signal's handler: it takes no lock, which the code that it interrupts may hold."""
        self._ending.set()
        self._reactor.call(self._end)

    def _end(self) -> None:
        """Takes all nodes back from the master; not for ever."""
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
        """Ends what a node does, and takes it back from the master meanwhile, which may hang."""
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
        # ROS's class for loggers finds who calls rospy's functions; here it would name this process's first line.
        self._logger.findCaller = MethodType(logging.Logger.findCaller, self._logger)  # type: ignore[method-assign,assignment]
        self._logger.handlers = [_Terminal(), _Topic(self._reactor)]
        for handler in self._logger.handlers:
            handler.addFilter(self._named)
        # What libraries log is in the file only.
        root, path = logging.getLogger(), self._mappings.get("__log")
        root.setLevel(logging.INFO)
        root.handlers = [logging.NullHandler()]
        if path:
            file = logging.handlers.RotatingFileHandler(path, maxBytes=_FILE_SIZE, backupCount=_FILES, delay=True)
            file.setFormatter(logging.Formatter(_FILE_FORMAT))
            root.addHandler(file)

    def _named(self, record: logging.LogRecord) -> bool:
        """Gives a line that is no node's to the node that was made last."""
        if not hasattr(record, "node"):
            record.node = next(reversed(self._handles.values()), None)
        return True


class _Terminal(logging.Handler):
    """Prints lines in rospy's form: warnings and worse on the standard error."""

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
