"""The fork server with real processes. Each test executes a driver, because pytest itself has threads."""

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

START = """
import json, os, select, signal, sys, time
from pioneer_launch.fork_server import ForkServerError, start_server
from pioneer_launch.forked_program import Program
server = start_server()
if isinstance(server, Program):
    server.run()
    sys.exit()

def start(*words, **variables):
    return server.start([PROGRAM, *words], {**os.environ, **variables}, FOLDER, 1, 2)

def status(process):
    deadline = time.monotonic() + 20
    while process.poll() is None:
        assert time.monotonic() < deadline, "timed out waiting for the program's end"
        select.select([], [], [], 0.01)
    return process.poll()
"""


def drive(folder: Path, program: str, steps: str, start: str = START) -> str:
    """Runs ``start`` and ``steps`` next to a fork server that starts ``program``; returns all output."""
    script, driver = folder / "program", folder / "driver.py"
    script.write_text(textwrap.dedent(program))
    driver.write_text(
        f"PROGRAM, FOLDER = {str(script)!r}, {str(folder)!r}\n{start}{textwrap.dedent(steps)}"
    )
    done = subprocess.run(
        [sys.executable, str(driver)],
        capture_output=True,
        text=True,
        timeout=40,
        env=None,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_program_sees_its_own_arguments_environment_and_folder(tmp_path: Path) -> None:
    program = """
        import os, sys
        print(__name__, sys.argv[1:], os.environ["WORD"], "HOME" in os.environ, os.getcwd(), sys.path[0])
    """
    seen = drive(tmp_path, program, 'assert status(start("a b", "c:=d", WORD="of its own")) == 0')
    assert seen == f"__main__ ['a b', 'c:=d'] of its own True {tmp_path} {tmp_path}\n"


def test_ps_shows_a_program_as_if_it_had_been_executed(tmp_path: Path) -> None:
    program = """
        from pathlib import Path
        own = Path("/proc/self")
        words = (own / "cmdline").read_bytes().decode().split("\\0")
        print(words[1:], (own / "comm").read_text().strip(), b"WORD=seen" in (own / "environ").read_bytes())
    """
    seen = drive(tmp_path, program, 'assert status(start("one", "two", WORD="seen")) == 0')
    assert seen == f"['{tmp_path}/program', 'one', 'two', ''] program True\n"


@pytest.mark.parametrize(
    ("ending", "expected"),
    [
        ("raise SystemExit(7)", 7),
        ("raise ValueError", 1),
        ("pass", 0),
        ("os.kill(os.getpid(), signal.SIGSEGV)", -11),
        ("os._exit(3)", 3),
    ],
)
def test_exit_status_is_reported(tmp_path: Path, ending: str, expected: int) -> None:
    drive(tmp_path, f"import os, signal\n{ending}\n", f"assert status(start()) == {expected}")


def test_program_leads_a_session_and_has_no_files_of_the_server(tmp_path: Path) -> None:
    program = """
        import os
        files = {os.readlink(f"/proc/self/fd/{one}") for one in os.listdir("/proc/self/fd")[3:-1]}
        print(os.getsid(0) == os.getpid() == os.getpgrp(), files - {os.devnull})
    """
    assert drive(tmp_path, program, "assert status(start()) == 0") == "True set()\n"


def test_program_ends_on_the_signals_of_roslaunch(tmp_path: Path) -> None:
    program = (
        "import os, select\nopen(os.environ['READY'], 'w').close()\nselect.select([], [], [])\n"
    )
    steps = """
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            ready = os.path.join(FOLDER, number.name)
            process = start(READY=ready)
            while not os.path.exists(ready):
                select.select([], [], [], 0.01)
            assert process.poll() is None
            os.killpg(os.getpgid(process.pid), number)
            assert status(process) == -number, number
    """
    drive(tmp_path, program, steps)


def test_programs_go_on_without_the_server_and_no_more_start(tmp_path: Path) -> None:
    program = "import sys\nsys.stdin.read()\nimport select\nselect.select([], [], [])\n"
    steps = """
        first = start()
        os.kill(server._pid, signal.SIGKILL)
        while not server.is_lost:
            assert first.poll() is None
        try:
            start()
        except ForkServerError:
            print("refused")
        assert first.poll() is None
        os.kill(first.pid, signal.SIGTERM)
        assert status(first) == -signal.SIGKILL
    """
    assert drive(tmp_path, program, steps) == "refused\n"


def test_server_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    program = "import select\nselect.select([], [], [])\n"
    steps = """
        handle, left = os.pidfd_open(server._pid), start()
        kept = os.pidfd_open(left.pid)
        server._line.close()
        assert select.select([handle], [], [], 20)[0], "the server still runs"
        assert not select.select([kept], [], [], 0)[0], "a program ended with its launcher"
        os.kill(left.pid, signal.SIGKILL)
    """
    drive(tmp_path, program, steps)


def test_a_program_ends_while_its_daemon_thread_still_works_and_runs_its_exit_functions(
    tmp_path: Path,
) -> None:
    program = """
        import atexit, sys, threading
        def work():
            while True:
                len("work")
        threading.Thread(target=work, daemon=True).start()
        threading.Thread(target=lambda: print("a last line")).start()
        atexit.register(print, "exit function")
        sys.exit("a reason")
    """
    seen = drive(tmp_path, program, "assert status(start()) == 1")
    assert sorted(seen.splitlines()) == ["a last line", "exit function"]


def test_an_interrupted_program_ends_by_the_signal_as_an_executed_one(tmp_path: Path) -> None:
    program = """
        import sys, time
        open(sys.argv[1], "w").close()
        time.sleep(30)
    """
    steps = """
        process, deadline = start(FOLDER + "/up"), time.monotonic() + 20
        while not os.path.exists(FOLDER + "/up"):
            assert time.monotonic() < deadline, "timed out waiting for the program"
            select.select([], [], [], 0.01)
        os.kill(process.pid, signal.SIGINT)
        assert status(process) == -signal.SIGINT
    """
    assert drive(tmp_path, program, steps) == ""


def test_a_refused_fork_is_an_error_and_a_later_one_starts(tmp_path: Path) -> None:
    """It ended the server. `fork` is replaced: root, who runs the tests in a container, may always fork."""
    driver = START.replace(
        "server = start_server()",
        "real, refusals = os.fork, [BlockingIOError(11, 'no more processes')] * 2\n"
        "def fork():\n"
        "    if os.getpid() != OURS and refusals:\n"
        "        raise refusals.pop()\n"
        "    return real()\n"
        "OURS, os.fork = os.getpid(), fork\n"
        "server = start_server()",
    )
    seen = drive(
        tmp_path,
        "print('it runs')",
        """
        for _ in range(2):
            try:
                start()
            except ForkServerError as error:
                print(error, flush=True)
        print(status(start()), flush=True)
        """,
        driver,
    )
    assert seen == "it cannot fork: no more processes\n" * 2 + "it runs\n0\n"


INJECTS = """
from pioneer_launch import fork_server
OURS, calls, failing = os.getpid(), 0, int(os.environ["FAILING"])

def injected(function):
    def call(*arguments, **named):
        global calls
        calls += os.getppid() == OURS and os.getpid() != OURS
        if calls == failing and os.getppid() == OURS:
            calls += 1
            raise RuntimeError("as asked")
        return function(*arguments, **named)
    return call

fork_server.readable = injected(fork_server.readable)
os.read, os.waitpid = injected(os.read), injected(os.waitpid)
fork_server.socket.recv_fds = injected(fork_server.socket.recv_fds)
server = start_server()
"""


@pytest.mark.parametrize("failing", range(1, 12))
def test_the_server_survives_an_exception_of_every_call_it_makes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: int
) -> None:
    """Calls are: waiting, reading a request, waiting for the new process, noticing ends. Two programs make eleven."""
    monkeypatch.setenv("FAILING", str(failing))
    seen = drive(
        tmp_path,
        "print('it runs', flush=True)",
        """
        print(status(start()), flush=True)
        print(status(start()), flush=True)
        """,
        START.replace("server = start_server()", INJECTS),
    )
    assert seen == "it runs\n0\n" * 2


@pytest.mark.parametrize(
    "request_text", ["[" * 100_000, "[[1, 2, 3], 4]", "[[[], {}, 5], 6]", "{}", "é"]
)
def test_an_invalid_request_of_a_client_costs_its_connection_only(
    tmp_path: Path, request_text: str
) -> None:
    guarded = START.replace(
        "server = start_server()",
        "import socket\n"
        "from pioneer_launch.fork_server import Guard, listen\n"
        "path = os.path.join(FOLDER, 'socket')\n"
        "server = start_server(Guard(listen(path), lambda program: bool(program.arguments[0].upper())))",
    )
    seen = drive(
        tmp_path,
        "print('it runs', flush=True)",
        f"""
        guest = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        guest.connect(path)
        request = {request_text!r}.encode(errors="replace")
        socket.send_fds(guest, [request], [0, 1, 2])
        print(guest.recv(100), flush=True)
        print(status(start()), flush=True)
        """,
        guarded,
    )
    assert seen == "b''\nit runs\n0\n"
