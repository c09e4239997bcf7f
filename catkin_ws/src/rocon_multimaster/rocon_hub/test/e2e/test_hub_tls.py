"""A hub's Redis with TLS: it accepts certificates of its fleet and refuses other clients, giving the reason."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from pioneer_harness.port import PortReservation
from rocon_gateway.hub.session import HubSession
from rocon_hub.config import HubConfig
from rocon_hub.redis_server import RedisServer
from rocon_hub.registry import Registry
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.redis_client import OPEN, Access
from tcpros.authority import Authority
from tcpros.tls import certificates_from


class Servers:
    """A hub's Redis without TLS and one with TLS, and the credentials that gateways may use."""

    def __init__(self, folder: Path) -> None:
        authorities = (
            Authority(folder / "ours"),
            Authority(folder / "theirs"),
            Authority(folder / "ours", -1),
        )
        directories = (
            authority.certify(f"robot{number}") for number, authority in enumerate(authorities)
        )
        ours, foreign, expired = (Access(None, certificates_from(str(one))) for one in directories)
        with_password = Access(lambda: "open sesame", ours.certificates)
        self.accesses = {
            "none": OPEN,
            "ours": ours,
            "foreign": foreign,
            "expired": expired,
            "secret": with_password,
        }
        self._ports = PortReservation()
        self._servers: dict[str, RedisServer] = {}
        self._addresses: dict[str, HubAddress] = {}
        for name in ("none", "ours", "secret"):
            port = self._ports.take(17480)
            self._addresses[name] = HubAddress("127.0.0.1", port)
            server = RedisServer(HubConfig(port=port), folder / "redis" / name, self.accesses[name])
            self._servers[name] = server
        for server in self._servers.values():
            server.start()
            Registry(server.client, 30.0).open("Test Hub")

    def session(self, hub: str, access: str) -> HubSession:
        """Opens a session; raises HubError on failure."""
        return HubSession(self._addresses[hub], self.accesses[access], "robot", "instance")

    def close(self) -> None:
        for server in self._servers.values():
            server.client.close()
            server.stop()
        self._ports.release()


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    made = Servers(tmp_path_factory.mktemp("servers"))
    yield made
    made.close()


@pytest.mark.parametrize("hub", ["ours", "secret"])
def test_who_has_a_certificate_of_the_fleet_is_let_in_and_hears_events(
    servers: Servers, hub: str
) -> None:
    with contextlib.closing(servers.session(hub, hub)) as session:
        assert session.hub_name == "Test Hub"
        assert str(session.address).startswith("rediss://127.0.0.1:")
        session.events.subscribe("rocon:examined:1")
        text = "x" * 100_000
        session.client.publish("rocon:examined:1", text)
        messages = (session.events.get_message(timeout=2.0) for _ in range(10))
        assert next(one["data"] for one in messages if one and one["type"] == "message") == text


@pytest.mark.parametrize(
    ("hub", "access", "said"),
    [
        (
            "ours",
            "none",
            "speaks TLS only: set ROCON_TLS_DIRECTORY to a directory with a certificate of its fleet",
        ),
        (
            "ours",
            "foreign",
            "TLS: its certificate is not good: self-signed certificate in certificate chain",
        ),
        ("ours", "expired", "TLS: it refuses our certificate: certificate expired"),
        (
            "none",
            "ours",
            "it speaks no TLS, but we have a certificate (ROCON_TLS_DIRECTORY): it is no hub of ours",
        ),
        ("secret", "ours", "wants a password: set ROCON_HUB_PASSWORD_FILE"),
    ],
)
def test_who_does_not_fit_gets_the_reason(
    servers: Servers, hub: str, access: str, said: str
) -> None:
    with pytest.raises(HubError) as caught:
        servers.session(hub, access)
    assert said in str(caught.value)
    assert caught.value.code == Code.HUB_CONNECTION_FAILED
    assert "sesame" not in str(caught.value)
