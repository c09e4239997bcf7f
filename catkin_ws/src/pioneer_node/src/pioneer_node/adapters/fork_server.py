"""A process that has imported what Python programs share, and starts them by forking itself.

A program started this way is a process of its own, with the arguments, environment, folder and output that it would
have got from ``subprocess.Popen``, but its interpreter and the modules that were imported before are already in memory,
and shared with every other program that was forked from the same server.
"""

import atexit
import contextlib
import dataclasses
import gc
import importlib
import io
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import traceback
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from pioneer_node.adapters import process_title

_LARGEST = 1 << 20
"""Bytes of a request at most; a socket of this kind takes less than that by default."""
_STREAMS = 3
_MOMENT = 0.05
"""Within this [s] another thread may have read the report that one waits for."""
_SIGNALS = (signal.SIGHUP, signal.SIGTERM, signal.SIGCHLD)
_lent: list["ForkServer"] = []


class ForkServerError(Exception):
    """The server cannot start this program."""


@dataclasses.dataclass(frozen=True)
class Program:
    """A Python script that is to run in this process, which was forked for it."""

    arguments: Sequence[str]
    environment: Mapping[str, str]
    folder: str

    def run(self) -> NoReturn:
        """Runs the script as ``__main__`` and ends the process as the interpreter would.

        The interpreter itself is not taken apart: in a fork with threads that are still at work this can wait for good.
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
        threading._shutdown()  # type: ignore[attr-defined] # waits for threads that are no daemons
        atexit._run_exitfuncs()
        with contextlib.suppress(OSError, ValueError):  # what the output was connected to may have ended first
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)

    def _execute(self) -> None:
        path = self.arguments[0]
        os.chdir(self.folder)
        os.environ.clear()
        os.environ.update(self.environment)
        process_title.show([sys.executable, *self.arguments], self.environment, os.path.basename(path))
        # In place: functions have the list as default of a parameter.
        sys.argv[:], sys.orig_argv[:] = self.arguments, [sys.executable, *self.arguments]
        sys.path[0] = str(Path(path).resolve().parent)
        _forget()
        main = types.ModuleType("__main__")
        main.__file__ = path
        sys.modules["__main__"] = main
        exec(compile(Path(path).read_bytes(), path, "exec"), main.__dict__)


def _status(end: SystemExit) -> int:
    if end.code is None or isinstance(end.code, int):
        return (end.code or 0) & 0xFF
    sys.stderr.write(f"{end.code}\n")
    return 1


class ForkedProcess:
    """A program that the server has started; what ``subprocess.Popen`` offers of it to roslaunch."""

    def __init__(self, server: "ForkServer", pid: int) -> None:
        self.pid = pid
        self._server = server
        self._status: int | None = None
        try:
            self._handle = os.pidfd_open(pid)
        except ProcessLookupError:  # it has ended, and the server has taken note
            self._handle = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def poll(self) -> int | None:
        """Returns the exit status, minus the signal's number where one ended it; None while the program runs.

        Without the server, which alone can learn it, the status of a program that has ended is -SIGKILL.
        """
        if self._status is None:
            self._status = self._server.status(self.pid)
        if self._status is None and self._server.is_lost and select.select([self._handle], [], [], 0)[0]:
            self._status = -signal.SIGKILL
        return self._status

    def wait(self, timeout: float) -> int:
        """Returns the exit status.

        Raises:
            TimeoutExpired: the program has not ended after so many seconds.
        """
        if not select.select([self._handle], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        while (status := self.poll()) is None:
            self._server.await_report()
        return status

    def __del__(self) -> None:
        os.close(self._handle)


class ForkServer:
    """The starting side. Threads: any."""

    def __init__(self, line: socket.socket, pid: int) -> None:
        self._line, self._pid = line, pid
        self._lock = threading.Lock()
        self._ended: dict[int, int] = {}
        self.is_lost = False

    def start(
        self,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        folder: str,
        stdout: int,
        stderr: int,
        lend: bool = False,
    ) -> ForkedProcess:
        """Starts the script ``arguments[0]`` in a session of its own; with ``lend`` it may use this server as well.

        Raises:
            ForkServerError: the server has ended, or the request is too long.
        """
        request = json.dumps([[list(arguments), dict(environment), folder], lend]).encode()
        with self._lock:
            try:
                socket.send_fds(self._line, [request], [0, stdout, stderr])
            except OSError as error:
                raise ForkServerError(str(error)) from None
            while (started := self._take()) is None:
                if self.is_lost:
                    raise ForkServerError("it has ended")
            self._ended.pop(started, None)
            return ForkedProcess(self, started)

    def status(self, pid: int) -> int | None:
        """Returns the exit status of ``pid``, once; None while it runs."""
        with self._lock:
            while not self.is_lost and select.select([self._line], [], [], 0)[0]:
                self._take()
            return self._ended.pop(pid, None)

    def await_report(self) -> None:
        """Waits a moment, or until the server reports the end of some program."""
        select.select([self._line], [], [], _MOMENT)

    def _take(self) -> int | None:
        """Reads one message; returns the pid of a program that was started."""
        try:
            message = self._line.recv(_LARGEST)
        except OSError:
            message = b""
        if not message:
            self.is_lost = True
            with contextlib.suppress(ChildProcessError):
                os.waitpid(self._pid, 0)
            return None
        pid, status = json.loads(message)
        if status is None:
            return int(pid)
        self._ended[pid] = status
        return None


def start_server() -> ForkServer | Program:
    """Forks the server, with all that is imported by now.

    Returns:
        In this process the side that starts programs. In each program's process the program, to be run at once.
    """
    gc.collect()
    gc.freeze()  # a collection would write into pages that are shared
    ours, theirs = _line()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        theirs.close()
        return ForkServer(ours, pid)
    ours.close()
    return _Server(theirs).serve()


def lent_server() -> ForkServer | None:
    """Returns, once, the server that this process was forked from and may use; None where there is none."""
    return _lent.pop() if _lent else None


def _line() -> tuple[socket.socket, socket.socket]:
    lines = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for one in lines:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _LARGEST)
    return lines


class _Server:
    """The forking side: a line to each process that may ask, and the line that each program was asked for on."""

    def __init__(self, line: socket.socket) -> None:
        self._lines = [line]
        self._asked: dict[int, socket.socket] = {}

    def serve(self) -> Program:
        """Starts what is asked for until nobody is left to ask; returns in the programs' processes only."""
        reader = _become_server()
        while self._lines:
            ready = select.select([*self._lines, reader], [], [])[0]
            if reader in ready:
                os.read(reader, 4096)
                self._report()
            for line in [one for one in self._lines if one in ready]:
                program = self._request(line)
                if program is not None:
                    return program
        os._exit(0)

    def _request(self, line: socket.socket) -> Program | None:
        """Starts one program; returns it in its own process."""
        try:
            request, streams, *_ = socket.recv_fds(line, _LARGEST, _STREAMS)
        except OSError:
            request = b""
        if not request:
            self._drop(line)
            return None
        fields, lend = json.loads(request)
        return self._fork(line, Program(*fields), streams, lend)

    def _fork(self, line: socket.socket, program: Program, streams: Sequence[int], lend: bool) -> Program | None:
        """Returns the program in the new process, None in this one once that leads a session of its own."""
        reader, writer = os.pipe2(os.O_CLOEXEC)
        server = os.getpid()
        ours, theirs = _line() if lend else (None, None)
        pid = os.fork()
        if not pid:
            os.setsid()
            for one in self._lines:
                one.detach()
            if theirs is not None:
                theirs.detach()
            _settle(streams, keep=ours)
            if ours is not None:
                _lent.append(ForkServer(ours, server))
            return program
        os.close(writer)
        for stream in streams:
            os.close(stream)
        if ours is not None and theirs is not None:
            ours.close()
            self._lines.append(theirs)
        os.read(reader, 1)  # its end was closed: by _settle
        os.close(reader)
        self._asked[pid] = line
        self._send(line, [pid, None])
        return None

    def _report(self) -> None:
        with contextlib.suppress(ChildProcessError):
            while (found := os.waitpid(-1, os.WNOHANG))[0]:
                line = self._asked.pop(found[0])
                if line in self._lines:
                    self._send(line, [found[0], os.waitstatus_to_exitcode(found[1])])

    def _send(self, line: socket.socket, message: Any) -> None:
        try:
            line.sendall(json.dumps(message).encode())
        except OSError:
            self._drop(line)

    def _drop(self, line: socket.socket) -> None:
        if line in self._lines:
            self._lines.remove(line)
            line.close()


def _become_server() -> int:
    """Makes this process the server; returns what is readable when a program has ended."""
    os.setsid()
    process_title.show([sys.executable, "fork_server", *sys.argv], os.environ, "fork_server")
    reader, writer = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    return reader


def _settle(streams: Sequence[int], keep: socket.socket | None) -> None:
    """Makes a forked process like one that was executed: signals, files, standard streams."""
    signal.set_wakeup_fd(-1)
    for one in _SIGNALS:
        signal.signal(one, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    nothing = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
    kept = {0, 1, 2, nothing, keep.fileno() if keep else nothing}
    for other in {int(name) for name in os.listdir("/proc/self/fd")} - kept:
        # Not closed: what the launcher has opened, its own script for one, closes its number when it ends.
        os.dup2(nothing, other, inheritable=False)
    sys.stdin = sys.__stdin__ = _stream(0, "r", sys.stdin)
    sys.stdout = sys.__stdout__ = _stream(1, "w", sys.stdout)
    sys.stderr = sys.__stderr__ = _stream(2, "w", sys.stderr)


def _stream(number: int, mode: str, like: Any) -> io.TextIOWrapper:
    """Returns a standard stream as the interpreter makes it at its start."""
    unbuffered = mode == "w" and bool(os.environ.get("PYTHONUNBUFFERED"))
    # As long as the process lives.
    binary: Any = open(number, mode + "b", 0 if unbuffered else -1, closefd=False)  # noqa: SIM115
    return io.TextIOWrapper(
        binary, like.encoding, like.errors, newline="\n" if mode == "w" else None,
        line_buffering=number == 2 or os.isatty(number), write_through=unbuffered,
    )  # fmt: skip


def _forget() -> None:
    """Takes back what modules keep of the process that imported them."""
    names = sys.modules.get("rospy.names")
    if names is not None:
        importlib.reload(names)  # which reads ROS_NAMESPACE and the remappings
    random = sys.modules.get("numpy.random")
    if random is not None:
        random.seed()
