"""The handler of outermost loops."""

import errno
import logging
import os
import socket

import pytest

from tcpros.loop_faults import MAX_REMEMBERED, LoopFaults


def fail(text: str) -> None:
    raise RuntimeError(text)


def test_each_fault_is_logged_once_with_its_traceback(caplog: pytest.LogCaptureFixture) -> None:
    faults = LoopFaults(logging.getLogger("loop"), "a loop")
    for _ in range(3):
        with faults:
            fail("as asked")
        assert faults.has_failed
    with faults:
        assert not faults.has_failed
    assert not faults.has_failed
    assert caplog.text.count("internal error in a loop") == 1
    assert "in fail\n    raise RuntimeError(text)" in caplog.text


def test_the_number_of_logged_faults_is_bounded(caplog: pytest.LogCaptureFixture) -> None:
    faults = LoopFaults(logging.getLogger("loop"), "a loop")
    for number in range(100):
        with faults:
            fail(str(number))
    assert len(caplog.records) == MAX_REMEMBERED


def test_what_ends_a_process_is_not_taken() -> None:
    with pytest.raises(KeyboardInterrupt), LoopFaults(logging.getLogger("loop"), "a loop"):
        raise KeyboardInterrupt


def test_a_lack_of_descriptors_memory_or_disk_is_one_line_without_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    faults = LoopFaults(logging.getLogger("loops"), "the loop")
    for number in (errno.EMFILE, errno.ENOMEM, errno.ENOSPC, errno.EMFILE):
        with faults:
            raise OSError(number, os.strerror(number), "/proc")
        assert faults.has_failed
    lines = caplog.text.splitlines()
    assert len(lines) == 3
    assert "the loop lacks something and continues: [Errno 24] Too many open files" in lines[0]


def test_a_socket_that_is_read_too_early_is_a_bug_with_its_traceback(
    caplog: pytest.LogCaptureFixture,
) -> None:
    faults = LoopFaults(logging.getLogger("loops"), "the loop")
    here, there = socket.socketpair()
    with here, there:
        here.setblocking(False)
        with faults:
            here.recv(1)
    assert "internal error in the loop" in caplog.text
    assert "here.recv(1)" in caplog.text
