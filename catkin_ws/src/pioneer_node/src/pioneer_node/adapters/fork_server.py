"""A process that has imported what Python programs share, and starts them by forking itself.

A program started this way is a process of its own, with the arguments, environment, folder and output that it would
have got from ``subprocess.Popen``, but its interpreter and the modules that were imported before are already in memory,
and shared with every other program that was forked from the same server.

The process that starts the server asks it for programs, and so may launchers among these. With a `Guard`, any process
of the same user may connect and ask (`fork_client`); its program gets SIGTERM when the connection ends.
"""

import contextlib
import dataclasses
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pioneer_node.adapters import process_title
from pioneer_node.adapters.forked_program import Program, settle

_LARGEST = 1 << 20
"""Bytes of a request at most; a socket of this kind takes less than that by default."""
_STREAMS = 3
_MOMENT = 0.05
"""Within this [s] another thread may have read the report that one waits for."""
_lent: list["ForkServer"] = []


class ForkServerError(Exception):
    """The server cannot start this program."""


@dataclasses.dataclass(frozen=True)
class Guard:
    """Lets other processes of this user connect to the server and ask for programs."""

    listener: socket.socket
    #: whether a program may be forked, asked in the server's process; the client of any other executes it
    allows: Callable[[Program], bool]


def listen(path: str) -> socket.socket:
    """Listens at ``path``, in place of what an earlier process left there; nobody but this user can connect.

    Once there is something at ``path``, it takes connections.

    Raises:
        OSError: the socket cannot be made there.
    """
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    made = f"{path}.new"
    before = os.umask(0o177)
    try:
        Path(made).unlink(missing_ok=True)
        listener.bind(made)
        listener.listen()
        Path(made).rename(path)
    except OSError:
        listener.close()
        raise
    finally:
        os.umask(before)
    return listener


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


def start_server(guard: Guard | None = None) -> ForkServer | Program:
    """Forks the server, with all that is imported by now. The listener of ``guard`` is the server's from then on.

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
        if guard:
            guard.listener.close()
        return ForkServer(ours, pid)
    ours.close()
    return _Server(theirs, guard).serve()


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

    def __init__(self, line: socket.socket, guard: Guard | None) -> None:
        self._lines = [line]
        self._asked: dict[int, socket.socket] = {}
        self._guard = guard
        self._guests: set[socket.socket] = set()

    def serve(self) -> Program:
        """Starts what is asked for until nobody is left to ask; returns in the programs' processes only."""
        reader = _become_server()
        listeners = [self._guard.listener] if self._guard else []
        while self._lines:
            ready = select.select([*self._lines, *listeners, reader], [], [])[0]
            if reader in ready:
                os.read(reader, 4096)
                self._report()
            for listener in [one for one in listeners if one in ready]:
                guest, _ = listener.accept()
                self._guests.add(guest)
                self._lines.append(guest)
            for line in [one for one in self._lines if one in ready]:
                program = self._request(line)
                if program is not None:
                    return program
        os._exit(0)

    def _request(self, line: socket.socket) -> Program | None:
        """Starts one program; returns it in its own process."""
        streams: Sequence[int] = ()
        try:
            request, streams, *_ = socket.recv_fds(line, _LARGEST, _STREAMS)
            fields, lend = json.loads(request)
            program = Program(*fields)
        except (OSError, ValueError, TypeError):  # the end of the connection is no JSON either
            allowed = False
        else:
            allowed = self._guard is None or line not in self._guests or self._guard.allows(program)
        if allowed:
            return self._fork(line, program, streams, lend)
        _close(streams)
        self._drop(line)
        return None

    def _fork(self, line: socket.socket, program: Program, streams: Sequence[int], lend: bool) -> Program | None:
        """Returns the program in the new process, None in this one once that leads a session of its own."""
        reader, writer = os.pipe2(os.O_CLOEXEC)
        server = os.getpid()
        ours, theirs = _line() if lend else (None, None)
        pid = os.fork()
        if not pid:
            os.setsid()
            for one in [*self._lines, *([self._guard.listener] if self._guard else [])]:
                one.detach()
            if theirs is not None:
                theirs.detach()
            settle(streams, keep=ours)
            if ours is not None:
                _lent.append(ForkServer(ours, server))
            return program
        os.close(writer)
        _close(streams)
        if ours is not None and theirs is not None:
            ours.close()
            self._lines.append(theirs)
        os.read(reader, 1)  # its end was closed: by settle
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
        if line not in self._lines:
            return
        self._lines.remove(line)
        line.close()
        if line in self._guests:
            self._guests.remove(line)
            for pid in [pid for pid, asked in self._asked.items() if asked is line]:
                os.kill(pid, signal.SIGTERM)


def _close(streams: Sequence[int]) -> None:
    for stream in streams:
        os.close(stream)


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
