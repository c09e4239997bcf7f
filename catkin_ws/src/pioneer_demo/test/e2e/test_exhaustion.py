"""Takes descriptors, processes, disk or output from each process of a fleet of two robots; prints what happens.

It must keep running, or end with one line, and the fleet says which. Takes half an hour (``./pioneer test --soak``).
``PIONEER_FAILURES`` restricts it to processes whose name in the tables matches this regular expression.
"""

import contextlib
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from subprocess import CalledProcessError

import psutil
import pytest
from real_fleet import Fleet

from pioneer_harness.wait import WaitError, wait_until
from tcpros.header import header_bytes

pytestmark = pytest.mark.soak

LEFT = 12
"""Descriptors that a process has left."""
CONNECTIONS = 60
"""How many connections are opened to each port of a process that has too little."""
HELD = 4.0
"""How long they stay open [s]."""
RESTORED = 60.0
"""Time limit for the fleet to be as before once there is enough again [s]."""
NAMED = 3.0
"""Within which the fleet has seen a process that did not answer [s]."""
BUSY = 0.9
"""Share of a processor that a process without descriptors may take, but for the simulator."""
_BODY = b"<?xml version='1.0'?><methodCall><methodName>getPid</methodName><params>"
_BODY += b"<param><value><string>/x</string></value></param></params></methodCall>"
ASKS = (
    b"POST /RPC2 HTTP/1.1\r\nHost: x\r\nContent-Type: text/xml\r\n"
    b"Content-Length: %d\r\n\r\n%s" % (len(_BODY), _BODY)
)
OURS = re.compile(r"Traceback \(most.*\n(?:  .*\n)*?  File .*/catkin_ws/src/")
"""A traceback with code of this workspace."""
NOBODY = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups"]
# The folders of the tests are closed to others.
NOBODY += ["--inh-caps=+dac_override", "--ambient-caps=+dac_override"]


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def limit_descriptors(pid: int, left: int) -> tuple[int, int]:
    """Leaves a process this many descriptors; returns its former limits."""
    used = {int(name) for name in os.listdir(f"/proc/{pid}/fd")}
    limit = found = 0
    while found < left:
        found += limit not in used
        limit += 1
    former = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (limit, former[1]))
    return former


def limit_processes(pid: int, soft: str = "1") -> str:
    """Limits the processes and threads of a process's user, for this process; returns its former limit.

    It is done as that user: root may not be allowed to change the limits of another's process.
    """
    limits = Path(f"/proc/{pid}/limits").read_text()
    former = re.search(r"Max processes +(\S+)", limits)
    user = NOBODY if os.stat(f"/proc/{pid}").st_uid != os.getuid() else []
    command = [*user, "prlimit", f"--pid={pid}", f"--nproc={soft}:"]
    subprocess.run(command, check=True, capture_output=True)
    return former[1]


def ports(pid: int) -> list[int]:
    """Returns the TCP ports at which a process listens."""
    with contextlib.suppress(psutil.Error):
        found = psutil.Process(pid).connections("tcp")
        return sorted({one.laddr.port for one in found if one.status == psutil.CONN_LISTEN})
    return []


@contextlib.contextmanager
def pressed(pid: int) -> Iterator[None]:
    """Opens connections to each port of a process that ask something, and keeps them open."""
    lines: list[socket.socket] = []
    with contextlib.ExitStack() as opened:
        for port in ports(pid):
            for number in range(CONNECTIONS):
                line = opened.enter_context(socket.socket())
                lines.append(line)
                line.setblocking(False)
                with contextlib.suppress(OSError):
                    line.connect(("127.0.0.1", port))
                with contextlib.suppress(OSError):
                    words = header_bytes({"topic": "/rosout", "callerid": "/x", "md5sum": "*"})
                    line.send(ASKS if number % 2 else words)
        yield
        for line in lines:
            # Read to the end: a reset makes rospy log a traceback for each connection.
            with contextlib.suppress(OSError):
                line.shutdown(socket.SHUT_WR)
            with contextlib.suppress(OSError):
                while line.recv(1 << 16):
                    continue


def processor_time(pid: int) -> float:
    with contextlib.suppress(psutil.Error):
        times = psutil.Process(pid).cpu_times()
        return times.user + times.system
    return 0.0


class Trials:
    """Tries each process of fleets, and starts another fleet when one has changed."""

    def __init__(self, start, folder: Path, **how) -> None:
        self._make = partial(Fleet, start, folder, robots=2, **how)
        self._made = 0
        self.fleet = self._next()
        words = os.environ.get("PIONEER_FAILURES", "")
        self.labels = [label for label in sorted(self.fleet.all) if re.search(words, label)]
        self.wrong: list[str] = []
        say(
            "\n| process | it | what is said | share of a processor | after [s] |\n|---|---|---|---|---|"
        )

    def _next(self) -> Fleet:
        self._made += 1
        return self._make(number=self._made)

    def tracebacks(self) -> int:
        """Returns how many tracebacks of this workspace the logs of the fleet have; rospy logs some of its own."""
        logs = [*self.fleet.running.report.rglob("*.log"), self.fleet.running.output]
        texts = (log.read_text(errors="replace") for log in logs if log.is_file())
        return sum(len(OURS.findall(text)) for text in texts)

    def run(self, number: int) -> None:
        """Tries each process: it has too little of what this limit of `resource` is about."""
        for label in self.labels:
            fleet = self.fleet
            before, position, tracebacks = fleet.labels(), fleet.position, self.tracebacks()
            if label not in before:
                self.wrong.append(f"{label} is missing before its trial")
                continue
            pid = before[label]
            is_files = number == resource.RLIMIT_NOFILE
            former = limit_descriptors(pid, LEFT) if is_files else limit_processes(pid)
            began = processor_time(pid)
            with pressed(pid):
                time.sleep(HELD)
                busy = (processor_time(pid) - began) / HELD
            with contextlib.suppress(ProcessLookupError, FileNotFoundError, CalledProcessError):
                if is_files:
                    resource.prlimit(pid, number, former)
                else:
                    limit_processes(pid, former)
            began = time.monotonic()
            with contextlib.suppress(WaitError):
                # A process that did not answer is named until it has answered again.
                wait_until(lambda b=began: time.monotonic() - b > NAMED, "its faults", 2 * NAMED)
                wait_until(partial(self._is_restored, label), "the recovery", RESTORED)
            after = time.monotonic() - began
            self._judge(label, pid, position, busy, after, self.tracebacks() - tracebacks)
            if fleet.has_ended or set(fleet.labels()) != fleet.all or fleet.faults:
                fleet.running.end()
                self.fleet = self._next()

    def _is_restored(self, label: str) -> bool:
        fleet = self.fleet
        return fleet.has_ended or (set(fleet.labels()) >= fleet.all and not fleet.faults)

    def _judge(
        self, label: str, pid: int, position: int, busy: float, after: float, tracebacks: int
    ) -> None:
        fleet = self.fleet
        now, said = fleet.labels(), fleet.said_since(position)
        keeps_running = now.get(label) == pid
        what = (
            "keeps running"
            if keeps_running
            else "is started again"
            if label in now
            else "has ended"
        )
        text = "<br>".join(f"`{line[:200]}`" for line in said[:3]) or "nothing"
        say(f"| {label} | {what} | {text} | {busy:.2f} | {after:.0f} |")
        if not keeps_running and not said:
            self.wrong.append(f"nothing is said of the end of {label}")
        if tracebacks:
            self.wrong.append(f"{tracebacks} tracebacks in the logs while {label} had too little")
        if busy > BUSY and "simulator" not in label:
            self.wrong.append(f"{label} took {busy:.2f} of a processor while it had too little")
        if not fleet.has_ended and not self._is_restored(label):
            self.wrong.append(f"after {label}: {fleet.faults}, {sorted(fleet.all - set(now))}")


def test_each_process_with_12_descriptors_left_keeps_running_or_its_end_is_said(start, tmp_path):
    trials = Trials(start, tmp_path)
    trials.run(resource.RLIMIT_NOFILE)
    assert trials.wrong == []


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder for everybody; those above `tmp_path` are closed to others."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        folder.chmod(0o777)
        yield folder


def test_each_process_that_can_start_no_thread_or_process_keeps_running_or_its_end_is_said(
    start, open_folder
):
    """The limit does not hold for root, so the fleet belongs to `nobody`."""
    prefix = [] if os.getuid() else NOBODY
    home = {"HOME": str(open_folder), "TMPDIR": str(open_folder)}
    trials = Trials(start, open_folder, prefix=prefix, below=open_folder, **home)
    trials.run(resource.RLIMIT_NPROC)
    assert trials.wrong == []


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A file system of its own, which can be filled."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def fill(disk: Path) -> Path:
    """Fills a file system; returns the file that does it."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        for size in (1 << 20, 1 << 12, 1):
            with contextlib.suppress(OSError):
                while file.write(bytes(size)):
                    continue
    return filler


def drive(fleet: Fleet) -> None:
    """Sends each robot a waypoint, so that it moves and its nodes log lines."""
    masters = fleet.masters("robot")
    for number, port in enumerate(masters, 1):
        goal = ["rostopic", "pub", "-1", f"/pioneer{number}/map_goal", "geometry_msgs/Twist"]
        subprocess.run(
            [*goal, "[3.0, 3.0, 0.0]", "[0.0, 0.0, 90.0]"],
            env={**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{port}/", "ROS_HOME": "/tmp"},
            capture_output=True,
            timeout=60,
            check=True,
        )


def test_on_a_full_disk_every_process_keeps_running_and_a_death_is_said(
    start, small_disk, monkeypatch
):
    """Logs, the recording, ROS_HOME and temporary files are on it; the folder for running programs is not."""
    home, runtime = small_disk / "home", small_disk.parent / "runtime"
    home.mkdir()
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    variables = {"ROS_HOME": str(home), "TMPDIR": str(home)}
    how = {"below": small_disk, "output": small_disk.parent / "output.txt", **variables}
    fleet = Fleet(start, small_disk, 0, robots=2, **how)
    before, position = fleet.labels(), fleet.position
    filler = fill(small_disk)
    wait_until(lambda: any("is full" in one for one in fleet.faults), "the fault in status", 20)
    drive(fleet)
    began = time.monotonic()
    wait_until(lambda: time.monotonic() - began > 10.0, "some time on a full disk", 20)
    now = fleet.labels()
    say(f"\nwith a full disk: {fleet.faults}")
    # The recorder cannot make a file. It ends, is started again some times, and the fleet says it.
    expected = {name for name in fleet.all if "recorder" not in name}
    assert {name for name in expected if now.get(name) != before[name]} == set()
    os.kill(before["robot 1: `amcl`"], signal.SIGKILL)
    wait_until(
        lambda: "pioneer1/amcl has died" in "\n".join(fleet.said_since(position)),
        "the line about a death on a full disk",
        20,
    )
    filler.unlink()

    def is_whole() -> bool:
        return set(fleet.labels()) >= expected and all("recorder" in one for one in fleet.faults)

    wait_until(is_whole, "all processes", 60)
    now, said = fleet.labels(), "\n".join(fleet.said_since(position))
    assert [one for one in sorted(expected) if now[one] != before[one]] == ["robot 1: `amcl`"]
    assert "recorder" in said
    assert fleet.running.process.poll() is None
    logs = [log.read_text(errors="replace") for log in fleet.running.report.rglob("*.log")]
    assert not [text[-2000:] for text in logs if OURS.search(text)]


def test_a_fleet_whose_output_nobody_reads_any_more_keeps_running_or_ends_with_all_its_processes(
    start, tmp_path
):
    """Each process of the fleet that writes a line to the same output meets a pipe without a reader."""
    made = tmp_path / "pipe"
    os.mkfifo(made)
    words = f'exec "$@" > {made} 2>&1'
    reader = os.open(made, os.O_RDONLY | os.O_NONBLOCK)
    running = start(
        "--robots", 2, "--world", "small_world", command="fleet",
        prefix=["sh", "-c", words, "sh"],
    )  # fmt: skip
    said = b""

    def is_ready() -> bool:
        nonlocal said
        with contextlib.suppress(BlockingIOError):
            said += os.read(reader, 1 << 16)
        assert running.process.poll() is None, said.decode(errors="replace")
        return b"ready in" in said

    wait_until(is_ready, "the fleet's start", 240)
    os.close(reader)
    victim = next(pid for pid, line in running.processes().items() if "nav_bundle/amcl" in line)
    os.kill(victim, signal.SIGKILL)
    began = time.monotonic()
    wait_until(
        lambda: running.process.poll() is not None or time.monotonic() - began > 20,
        "its end, or 20 s",
        30,
    )
    say(f"\nwith an output without reader: {running.process.poll()}")
    if running.process.poll() is None:
        running.process.send_signal(signal.SIGINT)
        running.process.wait(30)
    wait_until(lambda: not running.processes(), "the end of all its processes", 60)


def test_a_fleet_without_standard_streams_runs_and_ends(start):
    words = 'exec "$@" <&- >&- 2>&-'
    running = start(
        "--robots", 2, "--world", "small_world", command="fleet",
        prefix=["sh", "-c", words, "sh"],
    )  # fmt: skip
    wait_until(
        lambda: (
            running.process.poll() is not None
            or sum("nav_bundle/move_base" in line for line in running.processes().values()) == 2
        ),
        "two robots",
        240,
    )
    assert running.process.poll() is None
    pid = running.process.pid
    assert {os.readlink(f"/proc/{pid}/fd/{number}") for number in range(3)} == {"/dev/null"}
    running.process.send_signal(signal.SIGINT)
    assert running.process.wait(30) == 130
    assert not running.processes()
