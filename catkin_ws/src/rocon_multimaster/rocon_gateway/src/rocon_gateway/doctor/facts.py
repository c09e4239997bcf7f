"""Collects the data for a diagnosis: name resolution, ports, clocks, interpreters, hubs on the network."""

import os
import select
import shutil
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Collection, Iterable
from concurrent.futures import ThreadPoolExecutor, wait

import rosgraph.network

from rocon_gateway.doctor.examination import (
    Contact,
    Examination,
    ExaminationError,
    examination_from_text,
)
from rocon_gateway.hub.session import HubSession
from rocon_hub_protocol.discovery import Discovery
from rocon_hub_protocol.key import EXAMINE_KEY, examined_key
from rocon_hub_protocol.sighting import Sighting

PATIENCE = 2.0
"""Timeout for one port or announcement [s]."""

LIMIT = 5.0
"""Timeout for all names and ports together [s]."""

ANSWER_LIMIT = 10.0
"""Timeout for the answers of the gateways [s]: `LIMIT` plus a first import on a slow computer."""


def address_of(host: str) -> str:
    """Returns the first address of a host; empty if its name does not resolve."""
    try:
        return str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0])
    except (OSError, ValueError):  # ValueError: a part that is empty or too long, as in `hub..lan`
        return ""


def contacts(wanted: Iterable[tuple[str, str, int]]) -> list[Contact]:
    """Tries to connect to ports in parallel, each given as description, host and port; returns within `LIMIT`."""
    wanted = list(wanted)
    pool = ThreadPoolExecutor(max_workers=max(1, min(32, len(wanted))))
    tries = [pool.submit(_contact, *one) for one in wanted]
    done, _ = wait(tries, LIMIT)
    pool.shutdown(wait=False, cancel_futures=True)
    late = f"was not found out within {LIMIT:.0f} s"
    return [
        one.result() if one in done else Contact(what, host, port, "?", late)
        for one, (what, host, port) in zip(tries, wanted, strict=True)
    ]


def _contact(what: str, host: str, port: int) -> Contact:
    address = address_of(host)
    if not address:
        return Contact(what, host, port)
    try:
        socket.create_connection((address, port), PATIENCE).close()
    except OSError as error:
        return Contact(what, host, port, address, error.strerror or "no answer")
    return Contact(what, host, port, address)


def clock_offset(session: HubSession) -> float:
    """Returns how far the hub's clock is ahead of ours [s], accurate to half the round-trip time."""
    best = (float("inf"), 0.0)
    for _ in range(5):
        before = time.time()
        seconds, microseconds = session.client.time()
        after = time.time()
        best = min(best, (after - before, seconds + microseconds / 1e6 - (before + after) / 2))
    return best[1]


def first_python() -> tuple[str, bool, str]:
    """Returns the first `python3` on the PATH, whether it imports rospy, and the interpreter that runs us."""
    first = shutil.which("python3") or ""
    if not first:
        return "", False, sys.executable
    tried = subprocess.run(
        [first, "-c", "import rospy"], capture_output=True, check=False, stdin=subprocess.DEVNULL
    )
    return first, tried.returncode == 0, sys.executable


def announced_hubs() -> list[Sighting]:
    """Returns the hubs that announce themselves by mDNS within `PATIENCE`."""
    reader, writer = os.pipe()
    discovery = Discovery(lambda: os.write(writer, b"x"))
    try:
        discovery.sightings()
        select.select([reader], [], [], PATIENCE)
        return discovery.sightings()
    except OSError:
        return []
    finally:
        discovery.rest()
        os.close(reader)
        os.close(writer)


def examination(session: HubSession, gateway: str) -> Examination:
    """Examines, from this machine, all live gateways on a hub.

    Args:
        session: the session with that hub.
        gateway: unique name of our own gateway; it is part of the answer and not tried.
    """
    name = rosgraph.network.get_host_name()
    name = name if name != "localhost" else socket.gethostname()
    alive = [
        one.record for one in session.describe(()) if not one.silence and one.record.name != gateway
    ]
    return Examination(
        gateway,
        clock_offset(session),
        name,
        address_of(name),
        *first_python(),
        tuple(contacts((one.name, one.host, one.port) for one in alive)),
    )


def ask(session: HubSession, gateways: Collection[str]) -> list[Examination]:
    """Requests an examination from all gateways on a hub; returns the answers of `gateways` within `ANSWER_LIMIT`."""
    request, seen = uuid.uuid4().hex, dict[str, Examination]()
    deadline = time.monotonic() + ANSWER_LIMIT
    with session.client.pubsub(ignore_subscribe_messages=True) as answers:
        answers.subscribe(examined_key(request))
        answers.get_message(timeout=PATIENCE)
        session.client.publish(EXAMINE_KEY, request)
        while seen.keys() != set(gateways) and time.monotonic() < deadline:
            message = answers.get_message(timeout=max(0.0, deadline - time.monotonic()))
            if message is None:
                continue
            try:
                one = examination_from_text(message["data"])
            except ExaminationError:
                continue
            if one.gateway in gateways:
                seen.setdefault(one.gateway, one)
    return list(seen.values())
