"""A hub with a password: gateways that have it connect, others get one line, and it never leaves a machine."""

import itertools
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pioneer_harness.wait import START, wait_until
from rocon_hub.announcement import Announcement
from rocon_hub_protocol.admission import HubSide

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

SECRET, OTHER = "open sesame", "open barley"


def variables(folder: Path, password: str) -> dict[str, str]:
    path = folder / password.replace(" ", "-")
    path.write_text(password + "\n")
    return {"ROCON_HUB_PASSWORD_FILE": str(path)}


def test_a_changed_password_file_applies_at_once_and_keeps_links(fleet, tmp_path) -> None:
    """Gateways with the hub's current password connect; no log contains the old one or the new one."""
    right = variables(tmp_path, SECRET)
    fleet.start_hub(right)
    base, robot = (fleet.site(name).start(right).connected() for name in ("base", "robot"))
    robot.talk("/scan")
    ear = base.hear("/scan")
    assert base.flip("robot", "subscriber", "/scan") == 0
    ear.first_after(0.0)
    changed = time.monotonic()
    Path(right["ROCON_HUB_PASSWORD_FILE"]).write_text(OTHER + "\n")
    late = fleet.site("late").start(right).connected()  # after the hub's password has changed
    late.talk("/late")
    assert base.flip("late", "subscriber", "/late") == 0  # links use the new password, too
    wait_until(lambda: base.states()["flip /late"] == "active", "a link of the new password", 10)
    ear.first_after(time.monotonic())
    times = [time for time in ear.times() if time > changed]
    assert max(later - sooner for sooner, later in itertools.pairwise(times)) < 1.0
    assert not any("lost" in site.log.read_text() for site in (base, robot))
    assert not [
        log for log in tmp_path.glob("*.log") if re.search(f"{SECRET}|{OTHER}", log.read_text())
    ]


@pytest.mark.parametrize(
    ("hubs", "ours", "said"),
    [
        (SECRET, OTHER, "wants another password"),
        (SECRET, "", "wants a password"),
        ("", OTHER, "has no password"),
    ],
    ids=["wrong", "missing", "needless"],
)
def test_a_password_that_does_not_fit_is_one_line(fleet, tmp_path, hubs, ours, said) -> None:
    fleet.start_hub(variables(tmp_path, hubs) if hubs else None)
    site = fleet.site("base").start(variables(tmp_path, ours) if ours else None)
    wait_until(lambda: said in site.log.read_text(), said, START)
    # It retries twice a second.
    told = time.monotonic()
    wait_until(lambda: time.monotonic() - told > 2.5, "some more tries", 5)
    lines = [line for line in site.log.read_text().splitlines() if f":{fleet.hub_port}" in line]
    # The gateway may have started before the hub.
    (line,) = [line for line in lines if "refused" not in line]
    assert "ROCON_HUB_PASSWORD_FILE" in line
    assert not site.info().connected


class Rogue:
    """A host without the password that announces a hub by mDNS and answers the clients that connect."""

    def __init__(self, name: str, answers: Callable[[bytes], bytes]) -> None:
        self.heard: list[bytes] = []  #: all data that it has received
        self._answers = answers
        self._listener = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._serve, daemon=True).start()
        self.port = self._listener.getsockname()[1]  #: its listening port
        self._announcement = Announcement(name, self.port, everywhere=False, tls=False)
        self._announcement.refresh()

    def _serve(self) -> None:
        try:
            while True:
                self._hear(self._listener.accept()[0])
        except OSError:  # the listener was closed
            return

    def _hear(self, connection: socket.socket) -> None:
        with connection:
            connection.settimeout(3.0)
            try:
                while data := connection.recv(65536):
                    self.heard.append(data)
                    connection.sendall(self._answers(data))
            except OSError:
                return

    def close(self) -> None:
        self._announcement.close()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()


def as_redis(_data: bytes) -> bytes:
    """Answers an unauthenticated client like a Redis with a password."""
    return b"-NOAUTH Authentication required.\r\n"


class AsHub:
    """Answers like a real hub with a different password, as far as possible without knowing the right one."""

    def __init__(self) -> None:
        self._side: HubSide | None = None

    def __call__(self, data: bytes) -> bytes:
        if data.startswith(b"ROCON-PROVE"):
            self._side = HubSide(OTHER, data)
            return self._side.answer
        self._side.verdict(data)
        return b"+" + b"00" * 64 + b"\r\n"


@pytest.fixture(params=[as_redis, AsHub], ids=["as a Redis", "as a hub"])
def rogue(request, fleet) -> Iterator[Rogue]:
    name = f"Rogue {fleet.hub_port}"
    made = Rogue(name, request.param() if request.param is AsHub else request.param)
    yield made
    made.close()


@pytest.mark.parametrize("how", ["without a hub", "on its hub", "by URI"])
def test_a_host_that_is_taken_for_a_hub_learns_nothing_of_the_password(
    fleet, tmp_path, rogue, how
) -> None:
    """A gateway on its real hub once sent the password to such a host in clear text, within half a minute."""
    right, has_hub = variables(tmp_path, SECRET), how == "on its hub"
    if has_hub:
        fleet.start_hub(right, zeroconf=True)
    uri = f"http://127.0.0.1:{rogue.port}" if how == "by URI" else ""
    site = fleet.site("base").start(
        right, hub_uri=uri, hub_whitelist=[fleet.hub_name, f"Rogue {fleet.hub_port}"]
    )
    if has_hub:
        site.connected()
    wait_until(
        lambda: rogue.heard and re.search("clear|know|no hub of ours", site.log.read_text()),
        "its refusal",
        60,
    )
    # Only shares and tags, which look random to any client that does not know the password.
    word = rb"ROCON-PROVE 1 [0-9a-f]{32}\r\n|[0-9a-f]{64} [0-9a-f]{128}\r\n"
    assert [data for data in rogue.heard if not re.fullmatch(word, data)] == []
    assert site.info().hub_names == ([fleet.hub_name] if has_hub else [])
