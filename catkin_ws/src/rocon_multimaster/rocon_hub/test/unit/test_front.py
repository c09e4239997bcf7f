"""The port of a hub with a password, without a hub."""

import asyncio
import errno
import logging
import socket
from types import SimpleNamespace
from typing import Any

import pytest

from rocon_hub.front import Front
from tcpros.loop_faults import LoopFaults


@pytest.mark.parametrize("number", [errno.ENOMEM, errno.ENOBUFS, errno.EMFILE])
def test_a_port_that_cannot_accept_leaves_the_loop_to_others(number: int) -> None:
    """Without memory, accepting failed again at once, and the hub served nobody."""
    attempts = 0

    async def fail(_listening: socket.socket) -> None:
        nonlocal attempts
        attempts += 1
        if attempts > 1000:
            raise asyncio.CancelledError
        raise OSError(number, "as asked")

    front: Any = object.__new__(Front)
    front._loop = SimpleNamespace(sock_accept=fail)
    front._unproven = {}
    front._faults = LoopFaults(logging.getLogger("front"), "the hub's port")

    async def run() -> None:
        task = asyncio.ensure_future(front._accept(None))
        await asyncio.sleep(0.1)
        task.cancel()

    asyncio.run(run())
    assert attempts < 50
