"""A set of launch files and commands that start and end together."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self, TypeVar

import rosgraph
import roslaunch
import roslaunch.parent
import roslaunch.pmon
import roslib.packages
from rospkg import ResourceNotFound, RosPack, get_log_dir

from pioneer_gazebo.error import SimulatorError
from pioneer_gazebo.fleet.argument import usage
from pioneer_launch import door
from pioneer_node.adapters.end_request import EndRequest

# A node gets SIGINT, then SIGTERM after the first time limit, then SIGKILL after the second [s].
SIGINT_TIMEOUT, SIGTERM_TIMEOUT = 2.0, 1.0
SIGNALS = (signal.SIGINT, signal.SIGTERM)
POLL = 0.1
"""Polling interval of conditions [s]."""
LONGEST = 2.0
"""Polling interval where the end of a node also ends the wait [s]."""
RUN_ID_PATIENCE = 5.0
"""Maximum time to wait for a master's run id [s]."""
PATIENCE = 1.0
"""Waits longer than this are reported [s]."""

Options = TypeVar("Options")

LaunchFile = tuple[str, str, dict[str, str]]
"""Package, file in its ``launch`` folder, arguments."""


class SessionError(SimulatorError):
    """Something that the session needs has failed or ended."""


class Interrupted(Exception):  # noqa: N818 - not an error: shutdown was requested
    """Ctrl-C or SIGTERM."""


class Session(roslaunch.pmon.ProcessListener):
    """One roslaunch for several launch files, additional commands, and an orderly shutdown of all of them.

    To be used as a context manager in the main thread. From entry on, SIGINT and SIGTERM raise `Interrupted` in
    `wait_for`, `run` and `spin`. On exit all started processes are ended within `SIGINT_TIMEOUT` and
    `SIGTERM_TIMEOUT`. The previous signal handlers are then restored, unless shutdown was requested: the process is
    about to exit, and signals are ignored.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._stop = EndRequest()
        self._parents: list[roslaunch.parent.ROSLaunchParent] = []
        self._required: set[str] = set()
        self._ended: list[str] = []
        self._handlers: dict[int, object] = {}

    def __enter__(self) -> Self:
        for number in SIGNALS:
            self._handlers[number] = signal.getsignal(number)
        self._stop.take_signals(*SIGNALS)
        return self

    def __exit__(self, *exception: object) -> None:
        # A second Ctrl-C must not leave processes behind.
        for parent in self._parents:
            parent.shutdown()
        for number, handler in self._handlers.items():
            # If Ctrl-C is held down, it must not cause a KeyboardInterrupt between here and the exit.
            signal.signal(number, signal.SIG_IGN if self._stop.is_set() else handler)  # type: ignore[arg-type]

    def say(self, line: str) -> None:
        """Prints a line under the session's name."""
        sys.stdout.write(f"{self._name}: {line}\n")
        sys.stdout.flush()

    def launch(self, files: Sequence[LaunchFile]) -> None:
        """Starts launch files, after the master of ROS_MASTER_URI if none is running there.

        Raises:
            SessionError: a file is missing or invalid.
        """
        self.check()
        paths = [
            (_launch_path(package, file), [f"{name}:={value}" for name, value in arguments.items()])
            for package, file, arguments in files
        ]
        try:
            run_id = rosgraph.Master(f"/{self._name}").getParam("/run_id")
        except (rosgraph.MasterError, OSError):
            run_id = roslaunch.core.generate_run_id()
        try:
            parent = roslaunch.parent.ROSLaunchParent(
                run_id, paths, process_listeners=[self], show_summary=False,
                sigint_timeout=SIGINT_TIMEOUT, sigterm_timeout=SIGTERM_TIMEOUT,
            )  # fmt: skip
            self._parents.append(parent)
            parent.start(auto_terminate=False)
        except roslaunch.RLException as error:
            raise SessionError(f"cannot launch: {error}") from None
        finally:
            # roslaunch installs its own handlers when it creates its first process.
            self._stop.take_signals(*SIGNALS)
        self._required |= {
            rosgraph.names.ns_join(node.namespace, node.name).strip("/")
            for node in parent.config.nodes
            if node.required
        }

    def process_died(self, process_name: str, exit_code: int | None) -> None:
        """Called by roslaunch, in its thread, when a node has ended."""
        name = process_name.rpartition("-")[0].strip("/")
        if name in self._required:
            self._ended.append(
                f"/{name} ended with exit status {exit_code}; its log is in {get_log_dir()}/latest"
            )
        self._stop.wake()

    def check(self) -> None:
        """Raises Interrupted if shutdown was requested, SessionError if a required node has ended."""
        if self._stop.is_set():
            raise Interrupted
        if self._ended:
            raise SessionError(self._ended[0])
        for parent in self._parents:
            if parent.pm is not None and parent.pm.is_shutdown:
                raise SessionError(
                    f"a required node has ended; the logs are in {get_log_dir()}/latest"
                )

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        """Waits until ``condition`` holds; prints ``what`` it waits for if that takes longer than `PATIENCE`."""
        started, told = time.monotonic(), False
        while not condition():
            self.check()
            if not told and time.monotonic() - started > PATIENCE:
                self.say(f"waiting for {what}")
                told = True
            self._stop.wait(POLL)
        self.check()

    def wait_for_master(self) -> None:
        """Waits until the ROS master of ROS_MASTER_URI responds and has its run id.

        A roslaunch that starts a master sets the run id a moment later, and fails if another process has set one in the
        meantime. A master without one after ``RUN_ID_PATIENCE`` was started by other means and needs none.
        """
        master = rosgraph.Master(f"/{self._name}")
        self.wait_for(lambda: succeeds(master.getPid), f"the ROS master at {master.master_uri}")
        deadline = time.monotonic() + RUN_ID_PATIENCE
        self.wait_for(
            lambda: _has_run_id(master) or time.monotonic() > deadline, "the master's run id"
        )

    def run(self, package: str, program: str, *arguments: str) -> None:
        """Runs a package's program until it ends; if the session is interrupted, the program is ended first.

        Raises:
            SessionError: there is no such program, or its exit status is not 0.
        """
        self.check()
        # Same as rosrun, which starts ten processes for it.
        try:
            paths = roslib.packages.find_node(package, program)
        except ResourceNotFound:
            paths = []
        if not paths:
            raise SessionError(
                f"package {package} has no program {program}: is the workspace sourced?"
            )
        command = [paths[0], *arguments]
        process = door.start(command)
        try:
            while (status := process.poll()) is None:
                self.check()
                self._stop.wait(POLL)
        finally:
            _end_group(process)
        if status:
            raise SessionError(f"{' '.join(command)} failed with exit status {status}")

    def spin(self) -> None:
        """Waits until shutdown is requested or a required node ends."""
        while True:
            self.check()
            self._stop.wait(LONGEST)


def run_command(
    name: str, options: type, read: Callable[[Sequence[str]], Options], body: Callable[["Session", Options], None],
    argv: Sequence[str] | None,
) -> int:  # fmt: skip
    """Runs a command's ``body`` in a session; returns the exit status.

    Args:
        name: of the command.
        options: the dataclass of its options.
        read: returns the options of a command line; may raise SimulatorError.
        body: takes the session and the options.
        argv: the command line; None for the process's.
    """
    words = sys.argv[1:] if argv is None else argv
    if {"-h", "--help"} & set(words):
        sys.stdout.write(f"usage: {name} [name:=value …]\n{usage(options)}\n")
        return 0
    try:
        found = read(words)
    except SimulatorError as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 2
    return run_session(name, lambda session: body(session, found))


def run_session(name: str, body: Callable[[Session], None]) -> int:
    """Runs ``body`` in a session; returns the exit status: 0 after a requested shutdown, 1 on any failure."""
    try:
        with Session(name) as session:
            body(session)
    except Interrupted:
        return 0
    except SimulatorError as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 1
    return 0


def _launch_path(package: str, file: str) -> str:
    try:
        path = Path(RosPack().get_path(package)) / "launch" / file
    except ResourceNotFound:
        raise SessionError(f"package {package} is not found: is the workspace sourced?") from None
    if not path.is_file():
        raise SessionError(f"package {package} has no launch file {file}")
    return str(path)


def succeeds(request: Callable[..., object], *arguments: str) -> bool:
    """Returns whether a request to the ROS master succeeds."""
    try:
        request(*arguments)
    except (OSError, rosgraph.MasterException):
        return False
    return True


def _has_run_id(master: rosgraph.Master) -> bool:
    """Returns whether the master has its run id; false also if it refuses the connection, as a busy one may."""
    try:
        return bool(master.hasParam("/run_id"))
    except (OSError, rosgraph.MasterException):
        return False


def _end_group(process: door.Process) -> None:
    """Ends a command and its child processes: SIGINT, then SIGKILL."""
    for number in (signal.SIGINT, signal.SIGKILL):
        if process.poll() is not None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(SIGINT_TIMEOUT)


def host_name() -> str:
    """Returns the environment's HOSTNAME, which the tutorial has users export, or the system's host name."""
    return os.environ.get("HOSTNAME") or socket.gethostname()
