"""``forked PROGRAM ARGUMENT …``: runs a program as a fork of `computer`'s interpreter, or executes it if impossible.

The program gets this process's arguments, environment, folder, standard streams, umask, niceness and limits; its exit
status is returned.
SIGINT and SIGTERM are forwarded to it, and it gets SIGTERM if this process ends first. Waits for a `computer` that is
just starting.
Keep imports few: startup must take milliseconds.
"""

import contextlib
import json
import os
import resource
import select
import signal
import socket
import sys
import time
from collections.abc import Sequence
from types import FrameType
from typing import Any

from pioneer_launch.switch import is_on

SOCKET = "PIONEER_FORK_SOCKET"
"""Variable: socket path of `computer`'s fork server; a regular file there means that no server runs."""
_START = 10.0
"""Time-out for `computer` to start listening after the container has started [s]."""
_CREATED = 0x100 | 0x80
"""IN_CREATE and IN_MOVED_TO of inotify(7)."""
_FORWARDED = (signal.SIGINT, signal.SIGTERM)


def main() -> int:
    """Runs the command; returns the program's exit status."""
    if len(sys.argv) < 2:
        sys.stderr.write("usage: forked PROGRAM ARGUMENT …, PROGRAM being a path\n")
        return 2
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    command = [os.path.abspath(sys.argv[1]), *sys.argv[2:]]
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as line:
        if _has_connected(line):
            signals = _Signals()
            pid = _asked(line, command)
            if pid is not None:
                return _end_like(_awaited(line, pid, signals))
            signals.release()
    return _execute(command)


def _has_connected(line: socket.socket) -> bool:
    """Connects to the fork server; returns False if there is none."""
    path = os.environ.get(SOCKET)
    if not path or not is_on():
        return False
    with contextlib.suppress(OSError):
        try:
            line.connect(path)
        except FileNotFoundError:
            _await_creation(path)
            line.connect(path)
        return True
    return False


def _asked(line: socket.socket, command: Sequence[str]) -> int | None:
    """Requests a program from the fork server; returns its pid, or None if the server refuses or ends."""
    # Same format as in ForkServer.start: a program, not a launcher, and its standard streams.
    program = [command, dict(os.environ), os.getcwd(), surroundings()]
    request = json.dumps([program, False]).encode()
    try:
        socket.send_fds(line, [request], [0, 1, 2])
        answer = line.recv(4096)
    except OSError:
        answer = b""
    return json.loads(answer)[0] if answer else None


def surroundings() -> dict[str, Any]:
    """Returns what else a process inherits: umask, niceness, processors and limits. Not thread-safe."""
    umask = os.umask(0)
    os.umask(umask)
    names = [name for name in dir(resource) if name.startswith("RLIMIT_")]
    return {
        "umask": umask,
        "nice": os.getpriority(os.PRIO_PROCESS, 0),
        "cpus": sorted(os.sched_getaffinity(0)),
        "limits": {name: resource.getrlimit(getattr(resource, name)) for name in names},
    }


def _await_creation(path: str) -> None:
    """Waits until ``path`` exists, with a time-out for `computer` to start.

    Raises:
        OSError: inotify cannot watch the folder.
    """
    import ctypes  # imported here: takes as long as all other imports together

    library, deadline = ctypes.CDLL(None, use_errno=True), time.monotonic() + _START
    watch = library.inotify_init1(os.O_CLOEXEC)
    if (
        watch < 0
        or library.inotify_add_watch(watch, os.fsencode(os.path.dirname(path)), _CREATED) < 0
    ):
        raise OSError(ctypes.get_errno(), "cannot watch the folder")
    while (
        not os.path.exists(path)
        and select.select([watch], [], [], max(0.0, deadline - time.monotonic()))[0]
    ):
        os.read(watch, 4096)
    os.close(watch)


def _awaited(line: socket.socket, pid: int, signals: "_Signals") -> int:
    """Waits for the program to end; returns its status, the negative signal number if a signal ended it."""
    running: list[int] = []
    with contextlib.suppress(OSError):  # it has ended already, or no descriptor is left
        running.append(os.pidfd_open(pid))
        signals.forward_to(running[0])
    signals.wait_for(line.fileno())
    try:
        answer = line.recv(4096)
    except OSError:
        answer = b""
    if answer:
        return json.loads(answer)[1]
    if running:
        signals.wait_for(running[0])
    sys.stderr.write("forked: the fork server has ended: the program's exit status is unknown\n")
    return 1


class _Signals:
    """Catches SIGINT and SIGTERM and forwards them to the program once it has started."""

    def __init__(self) -> None:
        self._program: int | None = None
        self._early: list[int] = []
        # Without a wake-up pipe, a signal just before a blocking system call would be handled only after the call.
        self._reader, writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        self._taken = [
            number for number in _FORWARDED if signal.getsignal(number) is not signal.SIG_IGN
        ]
        for number in self._taken:
            signal.signal(number, self._take)

    def forward_to(self, program: int) -> None:
        """Forwards past and future signals to a program, given by its pidfd."""
        self._program = program
        for number in self._early:
            self._take(number, None)

    def wait_for(self, descriptor: int) -> None:
        """Waits until a descriptor is readable; forwards signals meanwhile."""
        while descriptor not in select.select([descriptor, self._reader], [], [])[0]:
            os.read(self._reader, 64)

    def release(self) -> None:
        """Restores the default signal handling and raises signals caught so far again."""
        for number in self._taken:
            signal.signal(number, signal.SIG_DFL)
        for early in self._early:
            os.kill(os.getpid(), early)

    def _take(self, number: int, _: FrameType | None) -> None:
        if self._program is None:
            self._early.append(number)
            return
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._program, number)


def _end_like(status: int) -> int:
    """Returns the exit status, or ends this process by the signal that ended the program."""
    if status >= 0:
        return status
    with contextlib.suppress(OSError):  # SIGKILL has no handler to reset
        signal.signal(-status, signal.SIG_DFL)
    os.kill(os.getpid(), -status)
    return 128 - status


def _execute(command: list[str]) -> int:
    for number in (signal.SIGPIPE, signal.SIGXFSZ):  # ignored by the interpreter
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execv(command[0], command)
    except OSError as error:
        sys.stderr.write(f"forked: cannot run {command[0]}: {error.strerror}\n")
        return 127 if isinstance(error, FileNotFoundError) else 126
