"""Loops and threads of the gateway keep running after what hubs, names and other programs do."""

import logging
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import redis

from rocon_gateway.doctor import facts
from rocon_gateway.doctor.examination import Examination
from rocon_gateway.doctor.examiner import Examiner
from rocon_gateway.hub import client as hub_client
from rocon_gateway.hub import session as hub_session
from rocon_gateway.hub.client import HubClient, HubContext
from rocon_gateway.hub.hubs import Hubs, HubsConfig
from rocon_gateway.hub.presence import Candidate
from rocon_gateway.hub.session import HubSession
from rocon_gateway.hub.state import HubState, Publication
from rocon_gateway.node.gateway import GatewayNode
from rocon_gateway.node.program_load import ProgramLoad
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.key import record_key
from rocon_hub_protocol.record import PROTOCOL, PeerRequest, Record, RecordError
from rocon_hub_protocol.redis_client import OPEN

PATIENCE = 20.0
RECORD = Record("robot", "instance", "127.0.0.1", 1)


@pytest.mark.parametrize("host", ["hub..lan", "x" * 64 + ".lan"])
def test_an_invalid_host_name_is_a_hub_that_cannot_be_reached(host: str) -> None:
    with pytest.raises(HubError) as caught:
        HubSession(HubAddress(host, 6380), OPEN, "robot", "instance")
    assert caught.value.code == Code.HUB_CONNECTION_UNRESOLVABLE
    assert facts.address_of(host) == ""


class NoRunId:
    """A client of a server that is like a hub, but has no id in its INFO."""

    def mget(self, *_keys: str) -> list[str]:
        return ["Pioneer Hub", str(PROTOCOL), ""]

    def info(self, _section: str) -> dict[str, Any]:
        return {"redis_version": "7.0.0"}


def test_a_server_without_run_id_is_refused_as_a_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_session, "redis_client", lambda *_: NoRunId())
    with pytest.raises(HubError, match="run_id") as caught:
        HubSession(HubAddress("127.0.0.1", 6380), OPEN, "robot", "instance")
    assert caught.value.code == Code.HUB_CONNECTION_FAILED


def test_a_hubs_thread_survives_unexpected_exceptions(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(hub_client, "RETRY", 0.001)
    errors = [
        UnicodeError("label empty"),
        KeyError("run_id"),
        KeyError("run_id"),
        RuntimeError("as asked"),
    ]
    answered = threading.Event()

    def open_session(_way: Candidate) -> HubSession:
        if errors:
            raise errors.pop(0)
        answered.set()
        raise HubError(Code.HUB_CONNECTION_UNRESOLVABLE, "no hub")

    context = HubContext(
        open=open_session,
        claim=lambda _hub, _session: None,
        linked=lambda: (),
        take=lambda _hub, _view: None,
        complain=lambda _about, _why: None,
        examine=lambda _session, _request: None,
        logger=logging.getLogger("loops"),
    )
    hub = HubClient(
        [Candidate(HubAddress("127.0.0.1", 1))], True, Publication(RECORD, {}, frozenset()), context
    )
    assert answered.wait(PATIENCE)
    hub.stop()
    hub.join()
    assert caplog.text.count("internal error with the hub at") == 3


class BusySession:
    """A session with a hub that answers nothing after the first questions."""

    identity, hub_name, salt, name = "id", "hub", "", "robot"
    address = HubAddress("127.0.0.1", 6380)

    def kept(self) -> str:
        raise redis.TimeoutError("it is busy")

    def close(self) -> None: ...


def test_a_hub_that_connect_hub_could_not_join_is_not_joined_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The service once returned error 14, and the gateway was on the hub a moment later."""
    monkeypatch.setattr(Hubs, "_open", lambda _hubs, _way: BusySession())
    left = threading.Event()
    hubs = Hubs(HubsConfig(), RECORD, set, left.set, logging.getLogger("loops"), lambda *_: None)
    with pytest.raises(HubError) as caught:
        hubs.connect("http://127.0.0.1:6380", patience=0.05)
    assert caught.value.code == Code.HUB_CONNECTION_FAILED
    assert left.wait(PATIENCE)
    assert hubs._hubs == []
    hubs.shutdown()


class Session:
    """A session that keeps what is published."""

    name = "robot"

    def __init__(self) -> None:
        self.client = self
        self.published = threading.Event()

    def publish(self, _key: str, _text: str) -> None:
        self.published.set()


def test_an_examination_that_fails_does_not_silence_the_doctor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failed = threading.Event()

    def fail(*_: Any) -> Examination:
        failed.set()
        raise RuntimeError("as asked")

    session: Any = Session()
    examiner = Examiner()
    monkeypatch.setattr(facts, "examination", fail)
    examiner.asked(session, "0" * 32)
    assert failed.wait(PATIENCE)
    for thread in threading.enumerate():
        if thread.name == "examination":
            thread.join(PATIENCE)
    found = Examination("robot", 0.0, "host", "", "", False, "")
    monkeypatch.setattr(facts, "examination", lambda *_: found)
    examiner.asked(session, "1" * 32)
    assert session.published.wait(PATIENCE)


class RecordSession:
    """A session with one other gateway, whose record the test sets."""

    name, instance, hub_name = "robot", "instance", "hub"
    address = HubAddress("127.0.0.1", 6380)
    holder = None

    def __init__(self) -> None:
        self.found: dict[str, Record | RecordError] = {}

    def join(self, *_: object) -> None: ...

    def watch(self, _names: object) -> None: ...

    def unwatch(self, _names: object) -> None: ...

    def namespaces(self) -> frozenset[str]:
        return frozenset()

    def present(self) -> set[str]:
        return {"other"}

    def requests(self, _senders: object = None) -> dict[str, PeerRequest]:
        return {"other": PeerRequest()}

    def records(self, _names: object) -> dict[str, Record | RecordError]:
        return self.found


def test_an_invalid_record_is_not_the_former_one_and_a_lost_one_is() -> None:
    state = HubState(Publication(RECORD))
    session: Any = RecordSession()
    state.enter(session, "127.0.0.1", 0.0)
    known = Record("other", "instance", "127.0.0.1", 2)

    def remotes(**found: Record | RecordError) -> set[str]:
        session.found = found
        state.take(session, [(record_key("other"), "other")], 1.0)
        state.update(session, (), 1.0)
        return set(state.view.remotes)

    assert remotes(other=known) == {"other"}
    assert remotes() == {"other"}, "a hub that restarts has no records for a while"
    assert remotes(other=RecordError("not JSON")) == set()
    assert state.faults == {"other": "not JSON"}
    assert remotes(other=known) == {"other"}
    assert state.faults == {}


def test_a_period_that_is_not_a_number_is_not_taken(caplog: pytest.LogCaptureFixture) -> None:
    node: Any = SimpleNamespace(_period=2.0, _logger=logging.getLogger("loops"))
    assert GatewayNode._set_period(node, float("nan")) == 2.0
    assert GatewayNode._set_period(node, 3.0) == 2.0
    assert node._period == 3.0
    assert "nan is no period" in caplog.text


@pytest.mark.parametrize(
    "uri", ["http://host:port", "http://host:99999", "http://[::1", "", "\xff"]
)
def test_an_invalid_master_uri_of_any_process_is_another_master(tmp_path: Path, uri: str) -> None:
    (tmp_path / "7").mkdir()
    (tmp_path / "7" / "environ").write_bytes(b"ROS_MASTER_URI=" + uri.encode() + b"\0")
    load = ProgramLoad("http://127.0.0.1:11311", tmp_path).look(1.0)
    assert load.memory == 0
