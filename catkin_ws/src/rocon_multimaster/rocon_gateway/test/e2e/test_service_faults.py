"""A call never hangs: what a client receives when the gateway behind the service stops or dies during the call."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

SERVER = Path(__file__).parents[3] / "rocon_relay/test/node/server.py"


def begin_call(site) -> subprocess.Popen:
    return subprocess.Popen(
        ["rosservice", "call", "/echo", "wait 100"],
        env=site.master.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_callers_get_an_error_from_a_frozen_gateway_and_service_resumes(fleet, pair, report):
    base, robot = pair
    log = fleet.folder / "server.log"
    fleet.group.start("server", [sys.executable, str(SERVER)], base.master.environment, log)
    wait_until(lambda: "/echo" in base.master.system_state()[2], "the server", START)
    endings = ((signal.SIGSTOP, signal.SIGCONT, 15), (signal.SIGKILL, None, 5))
    for number, (ending, back, bound) in enumerate(endings, 1):
        assert base.flip("robot", "service", "/echo") == 0
        wait_until(lambda: base.states()["flip /echo"] == "active", "active", 10)
        called = begin_call(robot)
        wait_until(
            lambda n=number: log.read_text().count("waiting") == n, "the call under way", START
        )
        os.kill(base.pid, ending)
        ended = time.monotonic()
        said, _ = called.communicate(timeout=60)
        report(f"{ending.name}: the client heard after", time.monotonic() - ended)
        assert time.monotonic() - ended < bound
        assert "ERROR" in said, said
        wait_until(lambda: "/echo" not in robot.master.system_state()[2], "unregistered", 5)
        if back:
            os.kill(base.pid, back)
            wait_until(
                lambda: robot.master.system_state()[2].get("/echo") == ["/base/server"], "back", 10
            )
            base.flip("robot", "service", "/echo", cancel=True)
