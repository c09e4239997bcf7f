"""roslaunch that forks its Python nodes from one interpreter instead of starting each separately.

rospy, numpy and message classes are then in memory only once, and a node starts in a few hundredths of a second.
Everything else works as in roslaunch: names, arguments, environment, output, logs, respawn, required, signals, exit
codes. Each node is a separate process, also in ``ps``. A program is executed normally if it is not a Python script of
this workspace, has a ``launch-prefix``, or changes environment variables that the interpreter reads at startup.
"""

import contextlib
import errno
import importlib
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from pioneer_launch.fork_client import SOCKET
from pioneer_launch.fork_server import (
    ForkedProcess,
    ForkServer,
    ForkServerError,
    Guard,
    lent_server,
    listen,
    start_server,
)
from pioneer_launch.forked_program import Program
from pioneer_launch.patch import (
    leave_setuptools_out,
    read_versions_here,
    remember_packages,
    tell_registrations,
    wake_master_workers,
)
from pioneer_launch.process_report import report_deaths
from pioneer_launch.process_watch import watch_processes
from pioneer_launch.program import early_differences, interpreter
from pioneer_launch.switch import is_on
from pioneer_node.adapters.light_import import import_without_numpy
from pioneer_node.adapters.output import lose_what_cannot_be_written

_SHARED = (
    "numpy", "numpy.typing", "difflib", "encodings.idna", "rospy", "roslaunch", "rosmaster", "actionlib",
    "std_msgs.msg", "std_srvs.srv", "geometry_msgs.msg", "sensor_msgs.msg", "nav_msgs.msg", "nav_msgs.srv",
    "actionlib_msgs.msg", "move_base_msgs.msg", "map_msgs.msg", "tf2_msgs.msg", "dynamic_reconfigure.msg",
    "dynamic_reconfigure.srv", "diagnostic_msgs.msg", "roscpp.srv", "rosgraph_msgs.msg", "yaml", "logging.handlers",
    "pioneer_node.adapters.node_process",
)  # fmt: skip
"""Modules that at least two programs of a computer import. No nodes of this workspace: they open files on import."""
_THREADS = "OPENBLAS_NUM_THREADS"
_MASTER = "rosmaster"
Started = ForkedProcess | subprocess.Popen[bytes]
_popen: list[Callable[..., Started]] = [subprocess.Popen]


def run(module: str, function: str = "main") -> int | None:
    """Runs a launcher's function with its Python nodes as forks; returns its exit status."""
    if not is_on():
        loaded = import_without_numpy(module)
    else:
        server = shared_server()
        if isinstance(server, Program):
            server.run()
        if server is not None:
            fork_nodes(server)
        loaded = importlib.import_module(module)
    report_deaths()
    lose_what_cannot_be_written()
    return getattr(loaded, function)()


def shared_server() -> ForkServer | Program | None:
    """Imports the shared modules and forks the server; returns None if other threads are already running.

    Like fork, it returns a second time in each process that the server forks, with the program to run at once. A
    launcher started by `computer` gets the server of `computer`. Any other launcher, and `computer` itself, also
    accepts requests from ``forked PROGRAM …`` at the path in ``PIONEER_FORK_SOCKET``.
    """
    if (lent := lent_server()) is not None:
        return lent
    # Listen before the imports, which take seconds on a busy machine: clients then wait and do not import themselves.
    listener = _listener()
    _import_shared()
    remember_packages()
    wake_master_workers()
    tell_registrations()
    if len(os.listdir("/proc/self/task")) == 1:
        return start_server(Guard(listener, _is_same_forked) if listener else None)
    if listener:
        listener.close()
    return None


def _listener() -> socket.socket | None:
    """Returns the socket for requests of other processes; None if not configured or it cannot be created."""
    path = os.environ.get(SOCKET)
    if not path:
        return None
    try:
        return listen(path)
    except OSError as error:
        sys.stderr.write(
            f"cannot listen at {path} ({error.strerror}): programs start an interpreter each\n"
        )
        return None


def _import_shared() -> None:
    leave_setuptools_out()
    before = os.environ.get(_THREADS)
    os.environ[_THREADS] = "1"  # a library with running threads cannot be forked
    for name in _SHARED:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    if before is None:
        del os.environ[_THREADS]
    else:
        os.environ[_THREADS] = before


def fork_nodes(server: ForkServer) -> None:
    """Makes roslaunch and `started` fork nodes, the master and commands from ``server`` where possible."""
    import roslaunch.nodeprocess

    # LocalProcess.start uses only Popen of subprocess, so nothing else needs replacing.
    _popen.append(starter(server))
    popen = refuse_while_ending(_popen[-1])
    roslaunch.nodeprocess.subprocess = SimpleNamespace(Popen=popen, PIPE=subprocess.PIPE)
    watch_processes()
    read_versions_here()


def refuse_while_ending(start: Callable[..., Started]) -> Callable[..., Started]:
    """Returns a ``Popen`` for roslaunch that starts nothing once a signal has ended its process monitor.

    roslaunch handles a signal between any two instructions: its monitor ends all nodes, and then the interrupted launch
    of the next node continues. Nobody would end that node.
    """
    import roslaunch.pmon

    def start_unless_ending(arguments: Sequence[str], **how: Any) -> Started:
        if roslaunch.pmon._shutting_down:
            raise OSError(errno.ECANCELED, "roslaunch is ending")
        return start(arguments, **how)

    return start_unless_ending


def started(command: Sequence[str]) -> Started:
    """Starts a command in its own session without standard input; as a fork if this process is a launcher."""
    return _popen[-1](command, stdin=subprocess.DEVNULL, **as_here())


def launcher_starter(
    server: ForkServer | None,
) -> Callable[[Sequence[str], Mapping[str, str], int], ForkedProcess | None]:
    """Returns a function that starts a launcher as a fork; it returns None where that is impossible.

    Args:
        server: the server that this process was forked from; None if it was not.
    """

    def start(
        command: Sequence[str], environment: Mapping[str, str], output: int
    ) -> ForkedProcess | None:
        if server is None or server.is_lost or not os.path.isabs(command[0]):
            return None
        if early_differences(os.environ, environment):
            return None
        with contextlib.suppress(ForkServerError):  # it cannot fork: the caller has another way
            return server.start(command, environment, os.getcwd(), output, output, lend=True)
        return None

    return start


def as_here() -> dict[str, Any]:
    """Returns `starter` arguments for this process's environment, folder and output, and a new session."""
    return {
        "env": dict(os.environ),
        "cwd": os.getcwd(),
        "stdout": None,
        "stderr": None,
        "start_new_session": True,
    }


def starter(server: ForkServer, lend: bool = False) -> Callable[..., Started]:
    """Returns a replacement for ``subprocess.Popen`` that forks where ``server`` can. Requires ``env`` and ``cwd``.

    Args:
        server: the fork server.
        lend: whether the started programs, which are launchers, may use the server too.
    """
    ours = dict(os.environ)

    def start(arguments: Sequence[str], **how: Any) -> Started:
        with contextlib.suppress(ForkServerError):
            path = _script(arguments[0], how["env"])
            if path and not server.is_lost and not early_differences(ours, how["env"]):
                stdout, stderr = (
                    _descriptor(how[name], number)
                    for name, number in (("stdout", 1), ("stderr", 2))
                )
                return server.start(
                    [path, *arguments[1:]], how["env"], how["cwd"], stdout, stderr, lend
                )
        return subprocess.Popen(arguments, **how)

    return start


def resolved(command: Sequence[str]) -> list[str]:
    """Returns a command with ``rosrun`` replaced by the program's path: rosrun would spawn ten processes to find it."""
    if command[0] != "rosrun":
        return list(command)
    paths = [
        Path(prefix, "lib", *command[1:3])
        for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep)
    ]
    return next(([str(path), *command[3:]] for path in paths if path.is_file()), list(command))


def _is_same_forked(program: Program) -> bool:
    """Returns whether a requested program behaves the same forked as executed; called in the server."""
    path = program.arguments[0]
    return _script(path, program.environment) == path and not early_differences(
        os.environ, program.environment
    )


def _script(program: str, environment: Mapping[str, str]) -> str:
    """Returns the path of a Python script built by this workspace, or of the ROS master; empty for other programs."""
    path = shutil.which(program, path=environment.get("PATH")) or ""
    if not path or not (program == _MASTER or _built_here(Path(path))):
        return ""
    with open(path, "rb") as file:
        first_line = file.readline()
    found = interpreter(
        first_line, {"python3": shutil.which("python3", path=environment.get("PATH")) or ""}
    )
    same = found == sys.executable or (
        program == _MASTER and os.path.realpath(found) == os.path.realpath(sys.executable)
    )
    return path if same else ""


def _built_here(path: Path) -> bool:
    """Returns whether catkin has put a program beside this one: in a sibling package folder."""
    return path.parent.parent == Path(os.path.abspath(sys.argv[0])).parent.parent


def _descriptor(stream: Any, default: int) -> int:
    if stream == subprocess.PIPE:
        raise ForkServerError("no pipes")
    return default if stream is None else stream.fileno()
