"""Runs a gateway's hub discovery against hostile announcements, both in one process, and prints the result.

Run it in its own network namespace as ``announcer.py FALSE HALF``. It announces FALSE services that are not hubs and
HALF services that never give their address, then one real hub.
"""

import logging
import os
import socket
import sys
import threading
import time

from zeroconf import DNSAddress, DNSOutgoing, DNSPointer, DNSService, DNSText

from pioneer_harness.wait import wait_until
from rocon_gateway.doctor.examiner import Examiner
from rocon_gateway.hub.hubs import Hubs, HubsConfig
from rocon_hub_protocol.record import Record
from rocon_hub_protocol.sighting import SERVICE

TRUE = "10.77.77.7"
PTR, TXT, A, SRV, ANSWER, IN, TTL = 12, 16, 1, 33, 0x8400, 1, 4500


def announcement(name: str, address: str) -> bytes:
    """Returns an announcement packet; without an address it contains only the service name."""
    out, service, host = DNSOutgoing(ANSWER), f"{name}.{SERVICE}", f"{name}.local."
    out.add_answer_at_time(DNSPointer(SERVICE, PTR, IN, TTL, service), 0)
    if address:
        out.add_answer_at_time(DNSService(service, SRV, IN, TTL, 0, 0, 6380, host), 0)
        out.add_answer_at_time(DNSText(service, TXT, IN, TTL, b"\x00"), 0)
        out.add_answer_at_time(DNSAddress(host, A, IN, TTL, socket.inet_aton(address)), 0)
    return out.packets()[0]


def tried(hubs: Hubs) -> str:
    return " ".join(str(way.address) for hub in hubs._hubs for way in hub.ways)


def main() -> None:
    false, half = map(int, sys.argv[1:])
    me = Record("gateway", "instance", "127.0.0.1", 1)
    hubs = Hubs(
        HubsConfig(distant=True, discover=True),
        me,
        lambda: (),
        lambda: None,
        logging.getLogger(),
        Examiner().asked,
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as air:
        air.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))

        def announce(name: str, address: str) -> None:
            air.sendto(announcement(name, address), ("224.0.0.251", 5353))

        def is_first_seen() -> bool:
            announce("first", "10.88.88.8")
            return "10.88.88.8" in tried(hubs)

        wait_until(is_first_seen, "the search's start", 30)
        for number in range(half):
            announce(f"half{number}", "")
        for number in range(false):
            announce(f"false{number}", f"10.1.{number // 250}.{number % 250 + 1}")
        wait_until(lambda: "10.1." in tried(hubs), "a false hub", 30)
        began, most = time.monotonic(), 0

        def is_tried() -> bool:
            nonlocal most
            most = max(most, threading.active_count())
            announce("true", TRUE)
            return TRUE in tried(hubs) and time.monotonic() - began > 2.0

        wait_until(is_tried, "the true hub", 60)
    sys.stdout.write(f"threads {most}\n")
    sys.stdout.flush()
    os._exit(0)


main()
