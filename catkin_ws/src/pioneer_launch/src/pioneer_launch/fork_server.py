"""Fork server: a process that has imported what Python programs share and starts them by forking itself.

A forked program is a separate process with the same arguments, environment, folder and output as under
``subprocess.Popen``. But its interpreter and the imported modules are already in memory, shared with all programs
forked from the same server.

The process that starts the server requests programs from it, and launchers among these programs may do the same. With
a `Guard`, any process of the same user may connect and request a program (`fork_client`); that program gets SIGTERM
when the connection ends.
"""

import contextlib
import dataclasses
import gc
import json
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pioneer_launch import process_title
from pioneer_launch.forked_program import Program, settle
from tcpros.descriptor import readable
from tcpros.loop_faults import LoopFaults

_LARGEST = 1 << 20
"""Maximum request size [bytes]; above the default limit of such a socket."""
_STREAMS = 3
_MOMENT = 0.05
"""Poll interval [s]: another thread may have read the report that this one waits for."""
_WITHOUT_ROOM = 1.0
"""Pause in accepting clients while there is no descriptor for one [s]."""
_AFTER_FAULT = 0.1
"""Pause after an unexpected exception [s]."""
_lent: list["ForkServer"] = []


class ForkServerError(Exception):
    """The server cannot start this program."""


@dataclasses.dataclass(frozen=True)
class Guard:
    """Lets other processes of this user connect to the server and request programs."""

    listener: socket.socket
    #: decides, in the server's process, whether a program may be forked; if not, the client executes it
    allows: Callable[[Program], bool]


def listen(path: str) -> socket.socket:
    """Listens at ``path``, replacing any stale socket; only this user can connect.

    The socket accepts connections as soon as ``path`` exists.

    Raises:
        OSError: the socket cannot be created there.
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
    """A program started by the server, with the part of ``subprocess.Popen``'s interface that roslaunch uses."""

    def __init__(self, server: "ForkServer", pid: int) -> None:
        self.pid = pid
        self._server = server
        self._status: int | None = None
        self._handle = (
            -1
        )  # none: it has ended, and the server keeps its status, or no descriptor is left
        with contextlib.suppress(OSError):
            self._handle = os.pidfd_open(pid)

    def poll(self) -> int | None:
        """Returns the exit status, the negative signal number if a signal ended it; None while the program runs.

        Only the server can know the status: if the server is lost, an ended program counts as -SIGKILL.
        """
        if self._status is None:
            self._status = self._server.status(self.pid)
        if self._status is None and self._server.is_lost and not self._is_running():
            self._status = -signal.SIGKILL
        return self._status

    def wait(self, timeout: float) -> int:
        """Waits for the program to end; returns the exit status.

        Raises:
            TimeoutExpired: the program is still running after ``timeout`` [s].
        """
        if self._handle >= 0:
            readable([self._handle], timeout)
        end = time.monotonic() + (timeout if self._handle < 0 else 0.0)
        while (status := self.poll()) is None:
            if time.monotonic() >= end and self._is_running():
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            self._server.await_report()
        return status

    def _is_running(self) -> bool:
        if self._handle >= 0:
            return not readable([self._handle], 0.0)
        return Path(f"/proc/{self.pid}").exists()

    def __del__(self) -> None:
        if self._handle >= 0:
            os.close(self._handle)


class ForkServer:
    """The client side of the server, which starts programs. Thread-safe."""

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
        """Starts the script ``arguments[0]`` in its own session; with ``lend`` it may use this server too.

        Raises:
            ForkServerError: the server has ended or cannot fork, or the request is too long.
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
        """Returns the exit status of ``pid``, only once; None while it runs."""
        with self._lock:
            while not self.is_lost and readable([self._line], 0.0):
                self._take()
            return self._ended.pop(pid, None)

    def await_report(self) -> None:
        """Waits briefly, or until the server reports the end of a program."""
        readable([self._line], _MOMENT)

    def _take(self) -> int | None:
        """Reads one message; returns the pid if it reports a started program."""
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
        if pid is None:
            raise ForkServerError(status)
        if status is None:
            return int(pid)
        self._ended[pid] = status
        return None


def start_server(guard: Guard | None = None) -> ForkServer | Program:
    """Forks the server with all modules imported so far. The server takes over the listener of ``guard``.

    Returns:
        In this process, the client side. In each forked process, the program to run at once.
    """
    gc.collect()
    gc.freeze()  # a garbage collection would write to shared pages
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
    """Returns, only once, the server that this process was forked from and may use; None if there is none."""
    return _lent.pop() if _lent else None


def _line() -> tuple[socket.socket, socket.socket]:
    lines = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for one in lines:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _LARGEST)
    return lines


class _Server:
    """The forking side. Keeps a connection to each client, and the connection on which each program was requested."""

    def __init__(self, line: socket.socket, guard: Guard | None) -> None:
        self._lines = [line]
        self._asked: dict[int, socket.socket] = {}
        self._guard = guard
        self._guests: set[socket.socket] = set()
        self._accepts_from = 0.0  # monotonic [s]
        self._has_news = False  # whether programs have ended that are not reported yet

    def serve(self) -> Program:
        """Serves requests until no client is left; returns only in the forked processes."""
        reader = _become_server()
        faults = LoopFaults(logging.getLogger("fork server"), "the fork server")
        while self._lines:
            # A forked process leaves the loop with its program: exceptions of programs never get here.
            with faults:
                program = self._step(reader)
                if program is not None:
                    return program
            if faults.has_failed:
                time.sleep(_AFTER_FAULT)
        os._exit(0)

    def _step(self, reader: int) -> Program | None:
        """Waits for requests and ends of programs, and handles them; returns a program in its forked process."""
        accepts = self._guard is not None and time.monotonic() >= self._accepts_from
        listeners = [self._guard.listener] if self._guard and accepts else []
        ready = readable([*self._lines, *listeners, reader], _WITHOUT_ROOM)
        self._has_news = self._has_news or reader in ready
        if reader in ready:
            os.read(reader, 4096)
        if self._has_news:
            self._report()
            self._has_news = False
        for listener in [one for one in listeners if one.fileno() in ready]:
            if not self._accept(listener):
                self._accepts_from = time.monotonic() + _WITHOUT_ROOM
        for line in [one for one in self._lines if one.fileno() in ready]:
            program = self._request(line)
            if program is not None:
                return program
        return None

    def _accept(self, listener: socket.socket) -> bool:
        """Accepts a client; returns False if there is no descriptor for it, so that it has to wait."""
        try:
            guest, _ = listener.accept()
        except OSError:
            return False
        self._guests.add(guest)
        self._lines.append(guest)
        return True

    def _request(self, line: socket.socket) -> Program | None:
        """Starts one program; returns it in the forked process, None in the server."""
        try:
            request, streams, *_ = socket.recv_fds(line, _LARGEST, _STREAMS)
        except OSError:
            self._drop(line)
            return None
        try:
            fields, lend = json.loads(request)
            program = Program(*fields)
        except Exception:  # noqa: BLE001 - whatever a client sends; an empty read at its end is not JSON either
            allowed = False
        else:
            # Without a descriptor for each stream, some have not been passed.
            allowed = len(streams) == _STREAMS and self._allows(line, program)
        if allowed:
            try:
                return self._fork(line, program, streams, lend)
            except OSError as error:  # no process or descriptor left
                _close(streams)
                self._send(line, [None, f"it cannot fork: {error.strerror}"])
                return None
        _close(streams)
        self._drop(line)
        return None

    def _allows(self, line: socket.socket, program: Program) -> bool:
        if self._guard is None or line not in self._guests:
            return True
        try:
            return self._guard.allows(program)
        except Exception:  # noqa: BLE001 - no program, or it cannot be read: the client shows it when it executes it
            return False

    def _fork(
        self, line: socket.socket, program: Program, streams: Sequence[int], lend: bool
    ) -> Program | None:
        """Forks; returns the program in the new process, and None here once the new process leads its own session."""
        server = os.getpid()
        with contextlib.ExitStack() as opened:
            reader, writer = os.pipe2(os.O_CLOEXEC)
            opened.callback(os.close, reader)
            opened.callback(os.close, writer)
            ours, theirs = _line() if lend else (None, None)
            for one in (ours, theirs):
                if one is not None:
                    opened.callback(one.close)
            pid = os.fork()
            opened.pop_all()
        if not pid:
            try:
                self._become_program(streams, ours, theirs, server)
            except BaseException:  # noqa: BLE001 - printed; this process must never serve
                traceback.print_exc()
                os._exit(1)
            return program
        self._asked[pid] = line
        os.close(writer)
        _close(streams)
        if ours is not None and theirs is not None:
            ours.close()
            self._lines.append(theirs)
        try:
            os.read(reader, 1)  # returns when settle has closed the write end
        finally:
            self._send(line, [pid, None])  # the client waits for it
            os.close(reader)
        return None

    def _become_program(
        self,
        streams: Sequence[int],
        ours: socket.socket | None,
        theirs: socket.socket | None,
        server: int,
    ) -> None:
        """Leaves the server's session and files, in the forked process."""
        os.setsid()
        # Closed at once: there may be no other descriptor for what `settle` opens.
        for one in [*self._lines, *([self._guard.listener] if self._guard else [])]:
            os.close(one.detach())
        if theirs is not None:
            os.close(theirs.detach())
        settle(streams, keep=ours)
        if ours is not None:
            _lent.append(ForkServer(ours, server))

    def _report(self) -> None:
        with contextlib.suppress(ChildProcessError):
            while (found := os.waitpid(-1, os.WNOHANG))[0]:
                line = self._asked.pop(found[0], None)
                if line is not None and line in self._lines:
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
                with contextlib.suppress(
                    OSError
                ):  # it has ended, or belongs to another user by now
                    os.kill(pid, signal.SIGTERM)


def _close(streams: Sequence[int]) -> None:
    for stream in streams:
        os.close(stream)


def _become_server() -> int:
    """Makes this process the server; returns a descriptor that becomes readable when a program ends."""
    os.setsid()
    process_title.show([sys.executable, "fork_server", *sys.argv], os.environ, "fork_server")
    reader, writer = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    return reader
