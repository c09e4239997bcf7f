"""A computer's fork server starts the launches of a concert as well."""

import subprocess
import sys
import textwrap
from pathlib import Path

DRIVER = """
    import os, sys
    from pioneer_launch.fork_server import start_server
    from pioneer_launch.forked_program import Program
    from pioneer_launch.launcher import launcher_starter
    from rocon_launch.roslaunch import RoslaunchProcess
    from rocon_launch.concert import launches_from_text

    server = start_server()
    if isinstance(server, Program):
        server.run()
    (launch,) = launches_from_text('<concert><launch name="any.launch"/></concert>', {}, 11311, lambda text, _: text)
    for word in ("fails", "stays"):
        shown = []
        process = RoslaunchProcess(launch, [sys.argv[1], word], os.environ, lambda _, line: shown.append(line),
            launcher_starter(server))
        if word == "stays":
            assert not process.wait(0.05)
            while not shown:
                assert process.status is None
                process.wait(0.05)
            process.interrupt()
        assert process.wait(30.0)
        process.close()
        print(process.status, *shown)
"""
ROSLAUNCH = """
    import signal, sys
    from pathlib import Path
    import os

    signal.signal(signal.SIGINT, lambda *_: os._exit(0))
    print(Path(f"/proc/{os.getppid()}/comm").read_text().strip(), flush=True)
    if sys.argv[1] == "fails":
        raise SystemExit(3)
    signal.pause()
"""


def test_concert_of_a_computer_forks_roslaunch_and_sees_its_output_and_status(
    tmp_path: Path,
) -> None:
    driver, roslaunch = tmp_path / "driver.py", tmp_path / "roslaunch"
    driver.write_text(textwrap.dedent(DRIVER))
    roslaunch.write_text(textwrap.dedent(ROSLAUNCH))
    command = [sys.executable, str(driver), str(roslaunch)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.splitlines() == ["3 fork_server", "0 fork_server"], done.stderr
