"""Process groups that are always cleaned up, including all descendants."""

import contextlib
import dataclasses
import os
import selectors
import shutil
import signal
import subprocess
import threading
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pioneer_harness.accounting import Account
from pioneer_harness.error import ProcessDiedError, ProcessStartError
from pioneer_harness.proc import (
    ProcessState,
    arguments,
    become_subreaper,
    descendants,
    has_variable,
    process_state,
    process_states,
)

# Each group has its own variable, so that it recognises its processes even if a nested group started them, such as a
# test's group inside the test runner's.
_VARIABLE = "PIONEER_PROCESS_GROUP_"
_POLL_INTERVAL = 0.02
_LAST_LINES = 15
# A shell starts background jobs with SIGINT ignored, which children would inherit. And when this process is killed
# with SIGKILL, its children must end too.
_PREFIX = ("/usr/bin/env", "--default-signal=INT", "/usr/bin/setpriv", "--pdeathsig", "TERM", "--")


@dataclasses.dataclass(frozen=True)
class Death:
    """A process that died unexpectedly."""

    name: str  #: as given to ``start``
    pid: int  #: its process id
    status: int  #: as ``subprocess.Popen.returncode``: negative signal number if a signal ended it
    log: Path | None  #: its log file, if any

    @property
    def headline(self) -> str:
        """One line: the process, and its signal or exit status."""
        how = f"ended, status {self.status}"
        if self.status < 0:
            how = f"was killed by {signal.Signals(-self.status).name}"
        return f"{self.name} (pid {self.pid}) {how}"

    def __str__(self) -> str:
        lines = last_lines(self.log) if self.log else ""
        return self.headline + (f"; the last lines of {self.log}:\n{lines}" if lines else "")


@dataclasses.dataclass
class _Member:
    name: str
    popen: "subprocess.Popen[bytes]"
    log: Path | None
    may_end: bool
    pidfd: int
    killed: bool = False


class ProcessGroup:
    """Starts processes, detects at once when one ends, and finally ends all of them with all their descendants.

    Each process leads its own session and gets SIGTERM if this process dies first. This process becomes a subreaper, so
    that descendants can be found after their parent died. Only processes that come from ``start`` are ever signalled:
    descendants are recognised by the process tree and by a variable in their environment.

    Threads: one, which sleeps until a process ends. Call ``start`` from a thread that lives as long as
    the group, because Linux delivers the parent-death signal when the *thread* ends.
    """

    def __init__(self) -> None:
        become_subreaper()
        self._variable = _VARIABLE + uuid.uuid4().hex
        self.changed = threading.Condition()  #: notified whenever a process ends
        self._members: dict[int, _Member] = {}
        #: names of processes whose unexpected end is no fault of the group: the caller starts them again
        self.restartable: frozenset[str] = frozenset()
        self._deaths: list[Death] = []
        self._restartable_deaths: list[Death] = []
        self._known: set[tuple[int, int]] = set()
        self._stopping = False
        # epoll also watches descriptors that are registered while it waits.
        self._selector = selectors.EpollSelector()
        self._end_reader, self._end_writer = os.pipe2(os.O_CLOEXEC)
        self._selector.register(self._end_reader, selectors.EVENT_READ)
        self._watcher = threading.Thread(target=self._watch, name="process group", daemon=True)
        self._watcher.start()

    def start(
        self,
        name: str,
        argv: Sequence[str],
        env: Mapping[str, str] | None = None,
        log: Path | None = None,
        may_end: bool = False,
        folder: Path | None = None,
    ) -> int:
        """Starts ``argv`` and returns its pid.

        Args:
            name: name of the process in messages.
            argv: program and arguments; the program is looked up on the PATH of ``env``.
            env: the whole environment; None for this process's.
            log: file to append its output to; None to share this process's output.
            may_end: exit status 0 is not an unexpected end.
            folder: working directory; None for this process's.

        Raises:
            ProcessStartError: there is no such program or folder, the log cannot be opened, or the group is stopping.
        """
        environment = {**(os.environ if env is None else env), self._variable: "1"}
        program = shutil.which(argv[0], path=environment.get("PATH"))
        if program is None:
            raise ProcessStartError(f"{name}: no program '{argv[0]}' on the PATH")
        with self.changed:
            if self._stopping:
                raise ProcessStartError(f"{name}: not started, the group is stopping")
            popen = _spawn(name, [*_PREFIX, program, *argv[1:]], environment, log, folder)
            _wait_for_the_program(popen.pid)
            member = _Member(name, popen, log, may_end, os.pidfd_open(popen.pid))
            self._members[popen.pid] = member
        self._selector.register(member.pidfd, selectors.EVENT_READ, member)
        return popen.pid

    @property
    def deaths(self) -> tuple[Death, ...]:
        """The unexpected ends so far, oldest first."""
        with self.changed:
            return tuple(self._deaths)

    def take_restartable_deaths(self) -> list[Death]:
        """Returns the unexpected ends of restartable processes since the last call."""
        with self.changed:
            taken = self._restartable_deaths
            self._restartable_deaths = []
            return taken

    def check(self) -> None:
        """Raises ``ProcessDiedError`` if a process has ended unexpectedly."""
        if deaths := self.deaths:
            raise ProcessDiedError(str(deaths[0]))

    def is_running(self, name: str) -> bool:
        """Returns whether a process with this name is running."""
        with self.changed:
            return any(
                member.name == name and member.popen.returncode is None
                for member in self._members.values()
            )

    def kill(self, name: str) -> None:
        """Kills a process and its descendants with SIGKILL, like a power failure; not counted as unexpected."""
        with self.changed:
            living = [
                one
                for one in self._members.values()
                if one.name == name and one.popen.returncode is None
            ]
            for member in living:
                member.killed = True
        pids = [
            pid for member in living for pid in descendants(process_states(), {member.popen.pid})
        ]
        # The parent first, so that it does not respawn its children.
        for pid in [*(member.popen.pid for member in living), *pids]:
            _send(pid, signal.SIGKILL)

    def states(self) -> dict[int, ProcessState]:
        """Returns the group's processes and all their descendants, including orphans and zombies."""
        everything = process_states()
        with self.changed:
            roots = set(self._members)
        for state in everything.values():
            if self._is_adopted(state) and (
                state.key in self._known
                or state.session in roots
                or has_variable(state.pid, self._variable, "1")
            ):
                roots.add(state.pid)
        ours = {pid: everything[pid] for pid in descendants(everything, roots)}
        self._known.update(state.key for state in ours.values())
        return ours

    def sample(self, account: Account) -> None:
        """Adds a sample of the group's current processes to ``account``."""
        account.add(self.states().values(), arguments)

    def stop(
        self, grace: float = 3.0, urgent: Callable[[], bool] = lambda: False
    ) -> tuple[str, ...]:
        """Ends everything: SIGINT to the started processes, after ``grace`` [s] SIGKILL to all that are left.

        Orphans that the started processes leave behind get SIGINT too.

        Args:
            grace: time for an orderly exit [s].
            urgent: polled; the grace period ends once it returns true.

        Returns:
            The command lines of the processes that had to be killed; empty if all exited by themselves.
        """
        with self.changed:
            self._stopping = True
            for member in self._members.values():
                if member.popen.returncode is None:
                    member.popen.send_signal(signal.SIGINT)
        self._wait_for_the_end(time.monotonic() + grace, urgent)
        killed = self._kill_all()
        self._close()
        return killed

    def __enter__(self) -> "ProcessGroup":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _living(self) -> list[ProcessState]:
        living = []
        for state in self.states().values():
            if state.alive:
                living.append(state)
            elif self._is_adopted(state):
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(state.pid, os.WNOHANG)
        return living

    def _wait_for_the_end(self, deadline: float, urgent: Callable[[], bool]) -> None:
        asked: set[tuple[int, int]] = set()
        while (living := self._living()) and time.monotonic() < deadline and not urgent():
            for state in living:
                if self._is_adopted(state) and state.key not in asked:
                    asked.add(state.key)
                    _send(state.pid, signal.SIGINT)
            time.sleep(_POLL_INTERVAL)

    def _is_adopted(self, state: ProcessState) -> bool:
        return state.parent == os.getpid() and state.pid not in self._members

    def _kill_all(self) -> tuple[str, ...]:
        killed: dict[tuple[int, int], str] = {}
        # Children of a killed process may show up as ours only now, so repeat until nothing is left.
        while living := self._living():
            for state in living:
                # A process without a command line has released its memory: it is exiting by itself.
                if line := " ".join(arguments(state.pid)):
                    killed.setdefault(state.key, line)
                _send(state.pid, signal.SIGKILL)
            time.sleep(_POLL_INTERVAL)
        return tuple(killed.values())

    def _watch(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.data is None:
                    return
                self._note_end(key.data)

    def _note_end(self, member: _Member) -> None:
        self._selector.unregister(member.pidfd)
        os.close(member.pidfd)
        with self.changed:
            status = member.popen.wait()
            if not self._stopping and not member.killed and not (member.may_end and status == 0):
                deaths = (
                    self._restartable_deaths if member.name in self.restartable else self._deaths
                )
                deaths.append(Death(member.name, member.popen.pid, status, member.log))
            self.changed.notify_all()

    def _close(self) -> None:
        if not self._watcher.is_alive():
            return
        with self.changed:
            self.changed.wait_for(
                lambda: all(m.popen.returncode is not None for m in self._members.values())
            )
        os.close(self._end_writer)
        self._watcher.join()
        self._selector.close()
        os.close(self._end_reader)


def last_lines(path: Path, count: int = _LAST_LINES) -> str:
    """Returns the last ``count`` lines of a text file, indented; empty if it cannot be read."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 400 * count))
            lines = file.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    return "\n".join(f"    {line.rstrip()}" for line in lines[-count:] if line.strip())


def _spawn(
    name: str,
    argv: Sequence[str],
    environment: Mapping[str, str],
    log: Path | None,
    folder: Path | None,
) -> "subprocess.Popen[bytes]":
    try:
        output = log.open("ab") if log else None
    except OSError as error:
        raise ProcessStartError(f"{name}: cannot write {log}: {error.strerror}") from error
    try:
        return subprocess.Popen(
            argv, env=environment, cwd=folder, stdin=subprocess.DEVNULL, stdout=output,
            stderr=subprocess.STDOUT if output else None, start_new_session=True,
        )  # fmt: skip
    except FileNotFoundError as error:
        raise ProcessStartError(f"{name}: there is no folder {folder}") from error
    finally:
        if output:
            output.close()


def _wait_for_the_program(pid: int) -> None:
    """Waits until the prefix commands have exec'ed the program: until then inherited signal dispositions apply."""
    # During exec the command line is empty.
    while arguments(pid)[:1] in ((), (_PREFIX[0],), (_PREFIX[2],)):
        state = process_state(pid)
        if state is None or not state.alive:
            return
        time.sleep(0.001)


def _send(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)
