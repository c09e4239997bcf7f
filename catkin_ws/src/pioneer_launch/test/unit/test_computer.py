"""The steps of one computer start and end together."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

COMMAND = [
    sys.executable,
    "-c",
    "from pioneer_launch.computer import main; raise SystemExit(main())",
]
WAITS = (
    """sh -c 'trap "echo interrupted; exit 0" INT; echo started; while :; do sleep 0.05; done'"""
)


@pytest.mark.parametrize(
    ("status", "expected"), [(3, 3), (0, 1)], ids=["by its status", "success is a failure, too"]
)
def test_end_of_a_step_interrupts_the_others(tmp_path: Path, status: int, expected: int) -> None:
    ready = tmp_path / "ready"
    waits = WAITS.replace("echo started", f"touch {ready}")
    ends = f"sh -c 'until test -e {ready}; do sleep 0.05; done; exit {status}'"
    done = subprocess.run([*COMMAND, waits, ends], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (expected, "interrupted\n")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_ends_all_steps_with_success(number: signal.Signals) -> None:
    process = subprocess.Popen([*COMMAND, WAITS, WAITS], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert [process.stdout.readline() for _ in range(2)] == ["started\n"] * 2
    process.send_signal(number)
    assert process.communicate(timeout=60)[0] == "interrupted\n" * 2
    assert process.returncode == 0


def test_a_later_step_that_is_missing_ends_the_earlier_ones(tmp_path: Path) -> None:
    """The earlier ones were left running."""
    ready = tmp_path / "ready"
    waits = WAITS.replace("echo started", f"touch {ready}")
    done = subprocess.run(
        [*COMMAND, waits, "/nonexistent --option"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 127
    line = "computer: cannot run /nonexistent --option: No such file or directory\n"
    assert done.stderr.endswith(line)
    # The first step may have been interrupted before its trap was set.
    assert done.stdout in ("", "interrupted\n")


def test_a_terminal_that_closes_ends_all_steps() -> None:
    process = subprocess.Popen([*COMMAND, WAITS, WAITS], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert [process.stdout.readline() for _ in range(2)] == ["started\n"] * 2
    process.send_signal(signal.SIGHUP)
    assert process.communicate(timeout=60)[0] == "interrupted\n" * 2


def test_no_steps_are_a_usage_error() -> None:
    done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "usage" in done.stderr


def _installed(folder: Path, package: str, program: str, text: str) -> Path:
    path = folder / "lib" / package / program
    path.parent.mkdir(parents=True)
    path.write_text(f"#!{sys.executable}\n{textwrap.dedent(text)}")
    path.chmod(0o755)
    return path


@pytest.mark.parametrize("folder", ["missing", "file"])
def test_steps_run_also_where_the_socket_cannot_be_made(tmp_path: Path, folder: str) -> None:
    (tmp_path / "file").touch()
    environment = {**os.environ, "PIONEER_FORK_SOCKET": str(tmp_path / folder / "socket")}
    done = subprocess.run(
        [*COMMAND, "sh -c 'echo runs; exit 3'"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout) == (3, "runs\n")
    assert done.stderr.startswith(f"cannot listen at {tmp_path / folder / 'socket'} (")


def test_computer_run_by_a_path_with_dots_forks_launchers_and_their_nodes_from_one_server(
    tmp_path: Path,
) -> None:
    main = "from pioneer_launch.computer import main\nraise SystemExit(main())"
    _installed(tmp_path, "pioneer_node", "computer", main)
    node = _installed(tmp_path, "nodes", "node", "import os\nprint('node', os.getppid())")
    launcher = """
        import os, signal, sys
        from pioneer_launch import launcher

        print("launcher", os.getppid(), flush=True)
        server = launcher.shared_server()
        if not hasattr(server, "start"):
            server.run()
        how = {"env": dict(os.environ), "cwd": os.getcwd(), "stdout": None, "stderr": None}
        process = launcher.starter(server)([sys.argv[1]], **how)
        while process.poll() is None:
            signal.sigtimedwait((), 0.05)
        signal.pause()
    """
    step = _installed(tmp_path, "launchers", "launcher", launcher)
    (tmp_path / "docker").mkdir()
    command = [tmp_path / "docker" / ".." / "lib" / "pioneer_node" / "computer", f"{step} {node}"]
    environment = {**os.environ, "CMAKE_PREFIX_PATH": str(tmp_path)}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    first = [process.stdout.readline().split() for _ in range(2)]
    process.terminate()
    process.communicate(timeout=60)
    assert [name for name, _ in first] == ["launcher", "node"]
    assert first[0][1] == first[1][1] != str(process.pid)
