"""Runs a Python script in a forked process that looks as if the script had been executed."""

import atexit
import contextlib
import dataclasses
import importlib
import io
import os
import resource
import signal
import socket
import sys
import threading
import traceback
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from pioneer_launch import process_title

_SIGNALS = (signal.SIGHUP, signal.SIGTERM, signal.SIGCHLD)


@dataclasses.dataclass(frozen=True)
class Program:
    """A Python script to run in this freshly forked process."""

    arguments: Sequence[str]
    environment: Mapping[str, str]
    folder: str
    #: umask, niceness, processors and limits as from `fork_client.surroundings`; None keeps the server's
    surroundings: Mapping[str, Any] | None = None

    def run(self) -> NoReturn:
        """Runs the script as ``__main__`` and exits with the status that the interpreter would return.

        Skips interpreter finalization, which can hang in a fork whose threads are still running.
        """
        try:
            self._execute()
            status = 0
        except SystemExit as end:
            status = _status(end)
        except KeyboardInterrupt:
            traceback.print_exc()
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGINT)
            status = 128 + signal.SIGINT
        except Exception:  # noqa: BLE001 - the outermost of this process
            traceback.print_exc()
            status = 1
        threading._shutdown()  # type: ignore[attr-defined] # joins all non-daemon threads
        atexit._run_exitfuncs()
        with contextlib.suppress(
            OSError, ValueError
        ):  # the output's receiver may have exited first
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)

    def _execute(self) -> None:
        path = self.arguments[0]
        os.chdir(self.folder)
        if self.surroundings is not None:
            _take_on(self.surroundings)
        os.environ.clear()
        os.environ.update(self.environment)
        process_title.show(
            [sys.executable, *self.arguments], self.environment, os.path.basename(path)
        )
        # In place: some functions use the list as a default argument.
        sys.argv[:], sys.orig_argv[:] = self.arguments, [sys.executable, *self.arguments]
        sys.path[0] = str(Path(path).resolve().parent)
        _forget()
        main = types.ModuleType("__main__")
        main.__file__ = path
        sys.modules["__main__"] = main
        exec(compile(Path(path).read_bytes(), path, "exec"), main.__dict__)


def _take_on(surroundings: Mapping[str, Any]) -> None:
    """Gives this process the umask, niceness, processors and limits, as far as it may have them."""
    os.umask(surroundings["umask"])
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, surroundings["nice"])
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, surroundings["cpus"])
    for name, (soft, hard) in surroundings["limits"].items():
        number = getattr(resource, name)
        highest = resource.getrlimit(number)[1]
        hard = _lower(hard, highest)
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(number, (_lower(soft, hard), hard))


def _lower(limit: int, other: int) -> int:
    finite = [one for one in (limit, other) if one != resource.RLIM_INFINITY]
    return min(finite, default=resource.RLIM_INFINITY)


def _status(end: SystemExit) -> int:
    if end.code is None or isinstance(end.code, int):
        return (end.code or 0) & 0xFF
    sys.stderr.write(f"{end.code}\n")
    return 1


def settle(streams: Sequence[int], keep: socket.socket | None) -> None:
    """Makes a forked process like one that was executed: signals, files, standard streams.

    Args:
        streams: descriptors to use as standard streams.
        keep: a socket that also stays open.
    """
    signal.set_wakeup_fd(-1)
    for one in _SIGNALS:
        signal.signal(one, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    nothing = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    kept = {0, 1, 2, nothing, keep.fileno() if keep else nothing}
    for other in {int(name) for name in os.listdir("/proc/self/fd")} - kept:
        # Replaced, not closed: objects opened by the launcher, such as its script, close their descriptor later.
        os.dup2(nothing, other, inheritable=False)
    sys.stdin = sys.__stdin__ = _stream(0, "r", sys.stdin)
    sys.stdout = sys.__stdout__ = _stream(1, "w", sys.stdout)
    sys.stderr = sys.__stderr__ = _stream(2, "w", sys.stderr)


def _stream(number: int, mode: str, like: Any) -> io.TextIOWrapper:
    """Returns a standard stream, configured as the interpreter does at startup."""
    unbuffered = mode == "w" and bool(os.environ.get("PYTHONUNBUFFERED"))
    # Stays open for the lifetime of the process.
    binary: Any = open(number, mode + "b", 0 if unbuffered else -1, closefd=False)  # noqa: SIM115
    return io.TextIOWrapper(
        binary, like.encoding, like.errors, newline="\n" if mode == "w" else None,
        line_buffering=number == 2 or os.isatty(number), write_through=unbuffered,
    )  # fmt: skip


def _forget() -> None:
    """Resets state that modules cached in the process that imported them."""
    names = sys.modules.get("rospy.names")
    if names is not None:
        importlib.reload(names)  # reads ROS_NAMESPACE and the remappings again
    random = sys.modules.get("numpy.random")
    if random is not None:
        random.seed()
