"""``forked`` runs programs as forks of a computer's interpreter, or executes them if there is no such interpreter."""

import contextlib
import os
import resource
import select
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from pioneer_harness.wait import wait_until

FORKED = str(Path(__file__).parents[2] / "scripts" / "forked")
PATIENCE = 60.0
PARENT = "open(f'/proc/{os.getppid()}/comm').read().strip()"
# Prints its PID and its parent's name, then waits for the end of its input.
WAITS = (
    f"import os, sys\nprint(os.getpid(), {PARENT}, flush=True)\nsys.exit(len(sys.stdin.read()))\n"
)


def installed(folder: Path, package: str, text: str) -> Path:
    """Installs a Python program below ``folder``, laid out as by catkin, and returns its path."""
    path = folder / "lib" / package / "program"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{sys.executable}\n{textwrap.dedent(text)}")
    path.chmod(0o755)
    return path


class Machine:
    """A folder with programs, and a computer with one step that runs until the end of the test."""

    def __init__(self, folder: Path, prefix: Sequence[str] = ()) -> None:
        """Takes the folder, and a command that runs other commands, for everything that this machine starts."""
        self.folder, self.socket = folder, folder / "socket"
        self._prefix = prefix
        # No locale is set, as in a container: each interpreter then adds one to its environment.
        others = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("LC_", "LANG"))
        }
        self.environment = {**others, "PIONEER_FORK_SOCKET": str(self.socket)}
        main = "from pioneer_launch.computer import main\nraise SystemExit(main())"
        self._computer = installed(folder, "pioneer_node", main)

    def start(self) -> "subprocess.Popen[str]":
        """Starts the computer, which prints a line once its step runs."""
        command = [*self._prefix, str(self._computer), "sh -c 'echo runs; exec sleep 600'"]
        return subprocess.Popen(command, env=self.environment, stdout=subprocess.PIPE, text=True)

    def server_pid(self, program: str) -> int:
        """Returns the PID of the fork server, as the parent of a program."""
        Path(program).write_text(f"#!{sys.executable}\nimport os\nprint(os.getppid())\n")
        pid = int(self.run(program).stdout)
        Path(program).write_text(f"#!{sys.executable}\nimport os\nprint({PARENT})\n")
        return pid

    def program(self, text: str) -> str:
        """Creates a program of the workspace and returns its path."""
        return str(installed(self.folder, "programs", text))

    def run(
        self, *words: str, folder: Path | None = None, **variables: str
    ) -> "subprocess.CompletedProcess[str]":
        """Runs ``forked`` with these arguments and waits until it exits."""
        return subprocess.run(
            [*self._prefix, FORKED, *words],
            env={**self.environment, **variables},
            cwd=folder,
            input="of its input",
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )

    @contextlib.contextmanager
    def running(self, text: str) -> "Iterator[subprocess.Popen[str]]":
        """Runs ``forked`` with a program of the workspace for the duration of the context."""
        # The tests may run in the background of a shell, where interrupts are ignored.
        command, pipe = ["env", "--default-signal=INT", FORKED, self.program(text)], subprocess.PIPE
        with subprocess.Popen(
            command, env=self.environment, stdin=pipe, stdout=pipe, stderr=pipe, text=True
        ) as process:
            try:
                yield process
            finally:
                process.kill()


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """Yields a machine whose computer is running."""
    made = Machine(tmp_path_factory.mktemp("machine"))
    with made.start() as computer:
        assert computer.stdout is not None
        assert computer.stdout.readline() == "runs\n"
        yield made
        computer.terminate()


def as_nobody() -> list[str]:
    """Returns a command that runs others as a user for whom the number of processes is limited; it is not for root."""
    if os.getuid():
        return []
    words = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups"]
    # The folders of the tests may be closed to others.
    return [*words, "--inh-caps=+dac_override", "--ambient-caps=+dac_override"]


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that every user may use."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o777)
        yield Path(folder)


def line_of(process: "subprocess.Popen[str]") -> list[str]:
    """Returns the words of the next line that a program prints."""
    assert process.stdout is not None
    return process.stdout.readline().split()


def ends(program: int) -> bool:
    """Waits for a process to end, given its pidfd; returns False if it is still running."""
    return bool(select.select([program], [], [], PATIENCE)[0])


def test_program_has_the_arguments_environment_folder_and_streams_of_its_caller(
    machine: Machine, tmp_path: Path
) -> None:
    path = machine.program(f"""
        import os, sys
        print({PARENT}, sys.argv, os.environ["WORD"], os.getcwd(), sys.stdin.read())
        print("an error", file=sys.stderr)
    """)
    done = machine.run(path, "a b", "c:=d", folder=tmp_path, WORD="ä €")
    assert done.stdout == f"fork_server {[path, 'a b', 'c:=d']} ä € {tmp_path} of its input\n"
    assert (done.stderr, done.returncode) == ("an error\n", 0)


def test_program_is_found_from_the_folder_of_its_caller(machine: Machine) -> None:
    path = Path(machine.program(f"import os\nprint({PARENT})"))
    assert (
        machine.run(f"../{path.parent.name}/{path.name}", folder=path.parent).stdout
        == "fork_server\n"
    )


@pytest.mark.parametrize(
    ("ending", "status"),
    [
        ("raise SystemExit(7)", 7),
        ("raise SystemExit('a reason')", 1),
        ("raise ValueError('a reason')", 1),
        ("os.kill(os.getpid(), signal.SIGTERM)", -signal.SIGTERM),
        ("os.kill(os.getpid(), signal.SIGKILL)", -signal.SIGKILL),
    ],
)
def test_exit_status_is_the_programs(machine: Machine, ending: str, status: int) -> None:
    done = machine.run(machine.program(f"import os, signal\n{ending}\n"))
    assert done.returncode == status
    assert ("a reason" in done.stderr) == ("a reason" in ending)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_reach_the_program(machine: Machine, number: signal.Signals) -> None:
    text = """
        import signal, sys
        numbers = signal.SIGTERM, signal.SIGINT
        signal.pthread_sigmask(signal.SIG_BLOCK, numbers)  # a handler could come just before an endless wait
        print("ready", flush=True)
        sys.exit(signal.sigwait(numbers))
    """
    with machine.running(text) as process:
        assert line_of(process) == ["ready"]
        process.send_signal(number)
        assert process.wait(PATIENCE) == number


def test_program_that_is_interrupted_ends_its_caller_by_the_signal(machine: Machine) -> None:
    # In turns of 0.1 s: Python would not run the handler of a signal that comes just before an endless read begins.
    waits = "import select\nprint('runs', flush=True)\nwhile not select.select([0], [], [], 0.1)[0]:\n    pass\n"
    with machine.running(waits) as process:
        line_of(process)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == -signal.SIGINT  # its stdin stays open until then
        assert process.stderr is not None
        assert "KeyboardInterrupt" in process.stderr.read()


@pytest.mark.parametrize(
    "starts", [True, False], ids=["it is passed on", "it ends the caller of a refused program"]
)
def test_signal_that_comes_before_the_program_starts(tmp_path: Path, starts: bool) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(tmp_path / "socket"))
        listener.listen()
        listener.settimeout(PATIENCE)
        environment = {**os.environ, "PIONEER_FORK_SOCKET": str(tmp_path / "socket")}
        with (
            subprocess.Popen([FORKED, "/bin/true"], env=environment) as caller,
            listener.accept()[0] as line,
        ):
            line.recv(1 << 16)
            caller.terminate()
            if starts:
                with subprocess.Popen(["sleep", "600"]) as program:
                    line.send(b"[%d, null]" % program.pid)
                    line.send(b"[%d, %d]" % (program.pid, program.wait(PATIENCE)))
            else:
                line.close()
            assert caller.wait(PATIENCE) == -signal.SIGTERM


def test_program_ends_when_its_caller_is_killed(machine: Machine) -> None:
    with machine.running(
        "import os, signal\nprint(os.getpid(), flush=True)\nsignal.pause()"
    ) as process:
        program = os.pidfd_open(int(line_of(process)[0]))
        process.kill()
        assert ends(program)


def test_programs_run_side_by_side_and_end_in_any_order(machine: Machine) -> None:
    with contextlib.ExitStack() as stack:
        processes = [stack.enter_context(machine.running(WAITS)) for _ in range(4)]
        seen = [line_of(process) for process in processes]
        assert [parent for _, parent in seen] == ["fork_server"] * 4
        for index in (2, 0, 3, 1):
            processes[index].communicate("x" * index, timeout=PATIENCE)
            assert processes[index].returncode == index


def test_only_the_computers_user_can_connect(machine: Machine) -> None:
    mode = machine.socket.stat().st_mode
    assert stat.S_ISSOCK(mode)
    assert stat.S_IMODE(mode) == 0o600


@pytest.mark.parametrize("sent", [b"no JSON", b"1", b'[["too short"], false]'])
def test_malformed_sentends_its_connection_only(machine: Machine, sent: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as line:
        line.settimeout(PATIENCE)
        line.connect(str(machine.socket))
        line.send(sent)
        assert line.recv(1) == b""
    assert machine.run(machine.program(f"import os\nprint({PARENT})")).stdout == "fork_server\n"


@pytest.mark.parametrize("variables", [{"PYTHONHASHSEED": "1"}, {"LC_ALL": "C"}, {"TZ": "UTC"}])
def test_program_is_executed_where_a_fork_would_behave_differently(
    machine: Machine, variables: dict[str, str]
) -> None:
    done = machine.run(
        machine.program(f"import os, sys\nprint({PARENT}, sys.stdin.read())\nsys.exit(3)"),
        **variables,
    )
    assert (done.stdout, done.returncode) == (f"{own_name()} of its input\n", 3)


def own_name() -> str:
    """Returns the name of this process, which is the parent of a program that is executed and not forked."""
    return Path("/proc/self/comm").read_text().strip()


def test_program_of_another_folder_is_executed(machine: Machine, tmp_path: Path) -> None:
    path = installed(tmp_path, "programs", f"import os\nprint({PARENT})")
    assert machine.run(str(path)).stdout == f"{own_name()}\n"


@pytest.mark.parametrize(
    "left", ["no folder", "plain file", "socket of a computer that has ended", "no variable"]
)
def test_program_is_executed_where_no_computer_listens(
    machine: Machine, tmp_path: Path, left: str
) -> None:
    path = tmp_path / "socket"
    if left.startswith("socket"):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(str(path))
    if left == "plain file":
        path.touch()
    there = {"no folder": str(path / "below"), "no variable": ""}.get(left, str(path))
    program = machine.program(f"import os, sys\nprint({PARENT}, sys.argv[1:])\nsys.exit(3)")
    done = machine.run(program, "a b", PIONEER_FORK_SOCKET=there)
    assert (done.stdout, done.returncode) == (f"{own_name()} ['a b']\n", 3)


def test_executed_program_ignores_no_signals_of_the_client(machine: Machine) -> None:
    seen = int(machine.run("/bin/sh", "-c", "grep SigIgn /proc/$$/status").stdout.split()[1], 16)
    assert not seen & (1 << signal.SIGPIPE - 1 | 1 << signal.SIGXFSZ - 1)


@pytest.mark.parametrize(("path", "status"), [("/does/not/exist", 127), ("/etc", 126)])
def test_program_that_cannot_be_run_is_an_error(machine: Machine, path: str, status: int) -> None:
    done = machine.run(path)
    assert (done.returncode, done.stdout) == (status, "")
    assert done.stderr.startswith(f"forked: cannot run {path}: ")


def test_no_program_is_a_usage_error(machine: Machine) -> None:
    done = machine.run()
    assert (done.returncode, done.stderr) == (
        2,
        "usage: forked PROGRAM ARGUMENT …, PROGRAM being a path\n",
    )


@pytest.mark.parametrize("when", ["before the computer", "while the computer imports"])
def test_caller_waits_for_a_computer_that_starts(tmp_path: Path, when: str) -> None:
    machine = Machine(tmp_path)
    with machine.running(WAITS) if when.startswith("before") else contextlib.nullcontext() as early:
        (tmp_path / "another file").touch()
        with machine.start() as computer:
            if early:
                assert line_of(early)[1:] == ["fork_server"]
            else:
                wait_until(machine.socket.exists, "the socket of the computer", PATIENCE)
                with machine.running(WAITS) as process:
                    assert line_of(process)[1:] == ["fork_server"]
            computer.terminate()


def test_caller_executes_the_program_when_no_computer_starts(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    assert machine.run(machine.program(f"import os\nprint({PARENT})")).stdout == f"{own_name()}\n"


def test_computer_takes_the_place_of_what_an_earlier_one_left(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    for _ in range(2):
        with machine.start() as computer:
            assert computer.stdout is not None
            assert computer.stdout.readline() == "runs\n"
            assert (
                machine.run(machine.program(f"import os\nprint({PARENT})")).stdout
                == "fork_server\n"
            )
            computer.terminate()
        assert machine.socket.is_socket()


def test_programs_outlive_computer_and_server_and_their_status_is_unknown(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    with machine.start() as computer:
        assert computer.stdout is not None
        assert computer.stdout.readline() == "runs\n"
        text = "import os, sys\nprint(os.getpid(), os.getppid(), flush=True)\nprint(sys.stdin.read(), flush=True)"
        with machine.running(text) as process:
            pid, server = (int(word) for word in line_of(process))
            program = os.pidfd_open(pid)
            computer.terminate()
            assert computer.wait(PATIENCE) == 0
            assert not select.select([program], [], [], 0)[0]
            os.kill(server, signal.SIGKILL)
            said = process.communicate("still runs", timeout=PATIENCE)
            assert (*said, process.returncode) == (
                "still runs\n",
                "forked: the fork server has ended: the program's exit status is unknown\n",
                1,
            )


def test_without_forks_a_computer_does_not_listen(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    machine.environment["PIONEER_FORK"] = "0"
    with machine.start() as computer:
        assert computer.stdout is not None
        assert computer.stdout.readline() == "runs\n"
        assert not machine.socket.exists()
        assert (
            machine.run(machine.program(f"import os\nprint({PARENT})")).stdout == f"{own_name()}\n"
        )
        computer.terminate()


def test_program_has_the_umask_niceness_processors_and_limits_of_its_caller(
    machine: Machine,
) -> None:
    """With umask 077, a program's files were readable for all."""
    path = machine.program(f"""
        import os, resource
        umask = os.umask(0)
        limits = resource.getrlimit(resource.RLIMIT_NOFILE), resource.getrlimit(resource.RLIMIT_CORE)
        print({PARENT}, oct(umask), os.nice(0), len(os.sched_getaffinity(0)), limits)
    """)
    steps = f"umask 077; ulimit -n 300; ulimit -c 0; exec nice -n 7 taskset -c 0 {FORKED} {path}"
    own = os.nice(0)
    done = subprocess.run(
        ["sh", "-c", steps],
        env=machine.environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.stdout == f"fork_server 0o77 {min(19, own + 7)} 1 ((300, 300), (0, 0))\n", (
        done.stderr
    )


def test_a_server_without_descriptors_or_processes_serves_again_once_it_has_some(
    tmp_path: Path,
) -> None:
    """Any of these ended the server, and with it the exit statuses of all programs."""
    made = Machine(tmp_path)
    path = made.program("")
    with made.start() as computer, contextlib.ExitStack() as at_end:
        at_end.callback(computer.terminate)
        assert computer.stdout is not None
        assert computer.stdout.readline() == "runs\n"
        server = made.server_pid(path)
        limit = resource.prlimit(server, resource.RLIMIT_NOFILE)
        open_files = len(os.listdir(f"/proc/{server}/fd"))
        found = []
        for room in range(8):
            resource.prlimit(server, resource.RLIMIT_NOFILE, (open_files + room, limit[1]))
            process = subprocess.Popen(
                [FORKED, path], env=made.environment, stdout=subprocess.PIPE, text=True
            )
            with process:
                # Without room to accept it, the client waits for the server.
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(0.3)
                resource.prlimit(server, resource.RLIMIT_NOFILE, limit)
                text, _ = process.communicate(timeout=PATIENCE)
            found.append(text.strip() != "")
        assert all(found), "each program was forked or executed"
        assert made.run(path).stdout == "fork_server\n"
        assert made.server_pid(path) == server


def test_a_refused_fork_is_answered_and_the_server_forks_again_once_it_may(
    open_folder: Path,
) -> None:
    """A refused fork ended the server, and with it the exit statuses of all programs."""
    made = Machine(open_folder, as_nobody())
    path = made.program("")

    def limit(processes: str) -> None:
        command = [*as_nobody(), "prlimit", "--pid", str(server), f"--nproc={processes}:"]
        subprocess.run(command, check=True)

    with made.start() as computer, contextlib.ExitStack() as at_end:
        at_end.callback(computer.terminate)
        assert computer.stdout is not None
        assert computer.stdout.readline() == "runs\n"
        server = made.server_pid(path)
        limit("1")
        done = made.run(path)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout != "fork_server\n", "it was executed"
        own, _ = resource.getrlimit(resource.RLIMIT_NPROC)
        limit("unlimited" if own == resource.RLIM_INFINITY else str(own))
        assert made.run(path).stdout == "fork_server\n"
        assert made.server_pid(path) == server


UNREADABLE: dict[str, Callable[[Path], object]] = {
    "it is gone": Path.unlink,
    "it is a folder": lambda path: (path.unlink(), path.mkdir()),
    "it leads nowhere": lambda path: (path.unlink(), path.symlink_to(path)),
    "it has no text": lambda path: path.write_bytes(b"\xff\x00\xfe" * 1000),
    "it is empty": lambda path: path.write_bytes(b""),
    "it names no interpreter": lambda path: path.write_bytes(b"#!\xff\n"),
    "nobody may read it": lambda path: path.chmod(0),
}


@pytest.mark.parametrize("how", UNREADABLE)
def test_an_unreadable_program_is_an_error_of_its_own_and_the_server_goes_on(
    tmp_path: Path, how: str
) -> None:
    made = Machine(tmp_path)
    path = made.program("")
    with made.start() as computer, contextlib.ExitStack() as at_end:
        at_end.callback(computer.terminate)
        assert computer.stdout is not None
        assert computer.stdout.readline() == "runs\n"
        server = made.server_pid(path)
        broken = installed(tmp_path / "broken", "programs", "print('it runs')")
        UNREADABLE[how](broken)
        done = made.run(str(broken))
        assert (done.returncode == 0) == (done.stderr == ""), done
        assert "Traceback" not in done.stderr
        assert len(done.stderr.splitlines()) <= 1
        assert made.run(path).stdout == "fork_server\n"
        assert made.server_pid(path) == server
