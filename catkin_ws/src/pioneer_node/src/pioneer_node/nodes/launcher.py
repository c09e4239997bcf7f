"""roslaunch whose Python nodes are forked from one interpreter in place of started each by itself.

rospy, numpy and message classes are then in memory once, and a node starts in some hundredths of a second. Everything
else is roslaunch's: names, arguments, environment, output, logs, respawn, required, signals, exit codes. Each node is a
process of its own, also for ``ps``. Programs are started as before if they are no Python scripts of this workspace,
have a ``launch-prefix``, or an environment with other variables that an interpreter reads at its start.
"""

import contextlib
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

from pioneer_node.adapters.fork_client import SOCKET, SWITCH
from pioneer_node.adapters.fork_server import (
    ForkedProcess,
    ForkServer,
    ForkServerError,
    Guard,
    lent_server,
    listen,
    start_server,
)
from pioneer_node.adapters.forked_program import Program
from pioneer_node.core.program import early_differences, interpreter
from pioneer_node.nodes.patch import (
    import_without_numpy,
    leave_setuptools_out,
    read_versions_here,
    remember_packages,
    tell_registrations,
    wake_master_workers,
)
from pioneer_node.nodes.process_watch import watch_processes

_SHARED = (
    "numpy", "numpy.typing", "difflib", "encodings.idna", "rospy", "roslaunch", "rosmaster", "actionlib",
    "std_msgs.msg", "std_srvs.srv", "geometry_msgs.msg", "sensor_msgs.msg", "nav_msgs.msg", "nav_msgs.srv",
    "actionlib_msgs.msg", "move_base_msgs.msg", "map_msgs.msg", "tf2_msgs.msg", "dynamic_reconfigure.msg",
    "dynamic_reconfigure.srv", "diagnostic_msgs.msg", "roscpp.srv", "rosgraph_msgs.msg", "yaml", "logging.handlers",
    "pioneer_node.adapters.node_process",
)  # fmt: skip
"""What at least two of a computer's programs import. No nodes of this workspace, which open files at import."""
_THREADS = "OPENBLAS_NUM_THREADS"
_MASTER = "rosmaster"
Started = ForkedProcess | subprocess.Popen[bytes]
_popen: list[Callable[..., Started]] = [subprocess.Popen]


def run(module: str, function: str = "main") -> int | None:
    """Runs a launcher's function, and its Python nodes as forks; returns its exit status."""
    if os.environ.get(SWITCH) == "0":
        return getattr(import_without_numpy(module), function)()
    server = shared_server()
    if isinstance(server, Program):
        server.run()
    if server is not None:
        fork_nodes(server)
    return getattr(importlib.import_module(module), function)()


def shared_server() -> ForkServer | Program | None:
    """Imports what programs share and forks the server; None where a thread runs already.

    In a process that the server forks it returns again, with the program that the process is to run at once. A launcher
    that `computer` started gets that one's server. Any other, and `computer` itself, has ``forked PROGRAM …`` ask for
    programs, too, at the path in ``PIONEER_FORK_SOCKET``.
    """
    if (lent := lent_server()) is not None:
        return lent
    # Listens before the imports, which take seconds on a busy machine: a client then waits, and imports nothing itself.
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
    """Returns the socket at which other programs can be asked for, if there is to be one and it can be made."""
    path = os.environ.get(SOCKET)
    if not path:
        return None
    try:
        return listen(path)
    except OSError as error:
        sys.stderr.write(f"cannot listen at {path} ({error.strerror}): programs start an interpreter each\n")
        return None


def _import_shared() -> None:
    leave_setuptools_out()
    before = os.environ.get(_THREADS)
    os.environ[_THREADS] = "1"  # a library that has threads cannot be forked
    for name in _SHARED:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    if before is None:
        del os.environ[_THREADS]
    else:
        os.environ[_THREADS] = before


def fork_nodes(server: ForkServer) -> None:
    """Has roslaunch, and `started`, start through ``server`` what can be forked of nodes, the master and commands."""
    import roslaunch.nodeprocess

    # LocalProcess.start calls subprocess.Popen, and that alone; so the rest of it stays as it is.
    _popen.append(starter(server))
    roslaunch.nodeprocess.subprocess = SimpleNamespace(Popen=_popen[-1], PIPE=subprocess.PIPE)
    watch_processes()
    read_versions_here()


def started(command: Sequence[str]) -> Started:
    """Starts a command in a session of its own, without input: as a fork where this process is a launcher."""
    return _popen[-1](command, stdin=subprocess.DEVNULL, **as_here())


def as_here() -> dict[str, Any]:
    """Returns the arguments of a `starter` for this environment, folder and output, in a session of its own."""
    return {"env": dict(os.environ), "cwd": os.getcwd(), "stdout": None, "stderr": None, "start_new_session": True}


def starter(server: ForkServer, lend: bool = False) -> Callable[..., Started]:
    """Returns a ``subprocess.Popen`` that forks what ``server`` can start. ``env`` and ``cwd`` are to be given.

    Args:
        server: what forks.
        lend: what it starts are launchers, which may use the server too.
    """
    ours = dict(os.environ)

    def start(arguments: Sequence[str], **how: Any) -> Started:
        with contextlib.suppress(ForkServerError):
            path = _script(arguments[0], how["env"])
            if path and not server.is_lost and not early_differences(ours, how["env"]):
                stdout, stderr = (_descriptor(how[name], number) for name, number in (("stdout", 1), ("stderr", 2)))
                return server.start([path, *arguments[1:]], how["env"], how["cwd"], stdout, stderr, lend)
        return subprocess.Popen(arguments, **how)

    return start


def resolved(command: Sequence[str]) -> list[str]:
    """Returns a command with the path of the program that ``rosrun`` would find, which takes ten processes for it."""
    if command[0] != "rosrun":
        return list(command)
    paths = [Path(prefix, "lib", *command[1:3]) for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep)]
    return next(([str(path), *command[3:]] for path in paths if path.is_file()), list(command))


def _is_same_forked(program: Program) -> bool:
    """Whether a program that another process asks for behaves as if it had been executed; called by the server."""
    path = program.arguments[0]
    return _script(path, program.environment) == path and not early_differences(os.environ, program.environment)


def _script(program: str, environment: Mapping[str, str]) -> str:
    """Returns the path of a Python script that this workspace has built, or of the ROS master; empty for all else."""
    path = shutil.which(program, path=environment.get("PATH")) or ""
    if not path or not (program == _MASTER or _built_here(Path(path))):
        return ""
    with open(path, "rb") as file:
        first_line = file.readline()
    found = interpreter(first_line, {"python3": shutil.which("python3", path=environment.get("PATH")) or ""})
    same = found == sys.executable or (
        program == _MASTER and os.path.realpath(found) == os.path.realpath(sys.executable)
    )
    return path if same else ""


def _built_here(path: Path) -> bool:
    """Whether a program lies where catkin has put this one: in a package's folder beside its own."""
    return path.parent.parent == Path(os.path.abspath(sys.argv[0])).parent.parent


def _descriptor(stream: Any, default: int) -> int:
    if stream == subprocess.PIPE:
        raise ForkServerError("no pipes")
    return default if stream is None else stream.fileno()
