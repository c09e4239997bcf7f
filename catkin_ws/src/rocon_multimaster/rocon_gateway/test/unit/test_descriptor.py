"""Limits of open files, and waiting for files with high descriptor numbers."""

import fcntl
import os
import resource
import subprocess
import sys

import pytest

from tcpros.descriptor import readable

HIGH = 1500


def test_a_gateway_may_open_what_the_system_allows_whatever_it_was_started_with() -> None:
    code = (
        "import resource; from rocon_gateway.node import gateway\n"
        "gateway.NodeProcess = lambda *_: exit(print(*resource.getrlimit(resource.RLIMIT_NOFILE)))\n"
        "gateway.main()"
    )
    command = ["prlimit", "--nofile=200:300", sys.executable, "-c", code]
    assert subprocess.check_output(command, text=True).split() == ["300", "300"]


def test_descriptors_that_select_does_not_take_are_waited_for() -> None:
    if resource.getrlimit(resource.RLIMIT_NOFILE)[0] <= HIGH:
        pytest.skip("this process may not have so many descriptors")
    reader, writer = os.pipe()
    high = fcntl.fcntl(reader, fcntl.F_DUPFD, HIGH)
    try:
        assert readable([high], 0.01) == set()
        os.write(writer, b"x")
        assert readable([high, writer], 5.0) == {high}
    finally:
        for one in (reader, writer, high):
            os.close(one)
