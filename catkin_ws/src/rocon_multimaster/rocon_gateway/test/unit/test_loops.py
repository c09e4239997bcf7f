"""Loops and threads of the gateway keep running after what hubs, names and other programs do."""

import itertools
import logging
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import redis

from pioneer_harness.wait import wait_until
from rocon_gateway.doctor import examiner as doctors_examiner
from rocon_gateway.doctor import facts
from rocon_gateway.doctor.examination import Examination
from rocon_gateway.doctor.examiner import Examiner
from rocon_gateway.hub import client as hub_client
from rocon_gateway.hub import hubs as hubs_module
from rocon_gateway.hub import session as hub_session
from rocon_gateway.hub.client import HubClient, HubContext
from rocon_gateway.hub.hubs import Hubs, HubsConfig
from rocon_gateway.hub.presence import Candidate, HubView
from rocon_gateway.hub.session import HubSession
from rocon_gateway.hub.state import HubState, Publication
from rocon_gateway.master import liveness
from rocon_gateway.master.liveness import NodeExaminer
from rocon_gateway.node import gateway
from rocon_gateway.node.gateway import GatewayNode
from rocon_gateway.node.program_load import ProgramLoad
from rocon_hub_protocol import discovery
from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.key import record_key
from rocon_hub_protocol.record import PROTOCOL, PeerRequest, Record, RecordError
from rocon_hub_protocol.redis_client import OPEN
from tcpros.loop_faults import LoopFaults

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
    assert caplog.text.count("internal error in the membership in the hub at") == 3


class Injector:
    """Makes functions of which one call fails: the one of this number, over all of them."""

    def __init__(self, failing: int) -> None:
        self.calls = 0
        self.has_failed = threading.Event()
        self._failing = failing

    def of(self, value: Any = None) -> Callable[..., Any]:
        """Returns a function that returns `value`."""

        def call(*_arguments: Any, **_named: Any) -> Any:
            self.calls += 1
            if self.calls == self._failing:
                self.has_failed.set()
                raise RuntimeError("as asked")
            return value

        return call


def run_gateways_loop(injector: Injector, rounds: int) -> int:
    """Runs the gateway's loop with parts of which a call fails; returns how many rounds it made."""
    made = 0

    def is_set() -> bool:
        nonlocal made
        made += 1
        return made > rounds

    call = injector.of
    node: Any = object.__new__(GatewayNode)
    node._faults = LoopFaults(logging.getLogger("loops"), "the gateway's loop")
    node._stopping = SimpleNamespace(is_set=is_set, wait=lambda _seconds: None)
    node._bell = SimpleNamespace(wait=call(False), is_due=True)
    node._reader, node._period = -1, 0.0
    node._look, node._turn = call(True), call()
    node._keyring = SimpleNamespace(refresh=call())
    node._kept = SimpleNamespace(text=call("text"))
    node._hubs = SimpleNamespace(keep=call())
    node._own = [SimpleNamespace(turn=call()), SimpleNamespace(turn=call())]
    node._diagnostics = SimpleNamespace(has_subscribers=True, publish=list)
    node._diagnostic_array, node._node = call(), SimpleNamespace(call=call())
    node._loop()
    return made


def test_the_gateways_loop_survives_an_exception_of_every_call_it_makes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(gateway, "DIAGNOSTIC_PERIOD", 0.0)
    complete = Injector(0)
    assert run_gateways_loop(complete, 1) == 2
    assert complete.calls == 10
    for failing in range(1, complete.calls + 1):
        injector = Injector(failing)
        assert run_gateways_loop(injector, 2) == 3
        assert injector.has_failed.is_set()
        assert injector.calls > complete.calls, "the second round makes every call"


class InjectedSession:
    """A session with a hub, of which one call fails."""

    identity, hub_name, salt, name, instance = "id", "hub", "", "robot", "instance"
    address = HubAddress("127.0.0.1", 6380)
    holder = None

    def __init__(self, injector: Injector, reader: int) -> None:
        call = injector.of
        self.kept, self.keep, self.join, self.leave = call(""), call(), call(), call()
        self.namespaces, self.live = call(frozenset()), call(("instance", True))
        self.present, self.records, self.requests = call(set()), call({}), call({})
        self.watch, self.unwatch, self.write = call(), call(), call()
        self.close = call()
        connection = SimpleNamespace(can_read=call(False), _sock=reader)
        self.events = SimpleNamespace(connection=connection, get_message=call())


def test_a_hubs_thread_survives_an_exception_of_every_call_it_makes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hub_client, "RETRY", 0.001)
    monkeypatch.setattr(hub_client, "HEARTBEAT", 0.001)
    reader, writer = os.pipe()

    def run(injector: Injector) -> None:
        """Runs a hub's thread until the call has failed and the hub has been joined after that."""
        call = injector.of
        joined = threading.Event()

        def take(_hub: HubClient, view: HubView | None) -> None:
            call()()
            if view is not None and view.connected and injector.calls > 40:
                joined.set()

        context = HubContext(
            open=lambda _way: call(InjectedSession(injector, reader))(),
            claim=call(),
            linked=call(()),
            take=take,
            complain=call(),
            examine=call(),
            logger=logging.getLogger("loops"),
            host="127.0.0.1",
            restore=call("text"),
            learn=call(),
        )
        way = Candidate(HubAddress("127.0.0.1", 1))
        hub = HubClient([way], True, Publication(RECORD, {}, frozenset()), context)
        wait_until(lambda: injector.calls > 40, "enough calls", PATIENCE)
        # A view is reported when it changes.
        names = itertools.count()
        while not joined.wait(0.01):
            assert hub._thread.is_alive()
            hub._shown = HubView(hub_name=str(next(names)))
        hub.stop()
        hub.join()
        assert not hub._thread.is_alive()

    for failing in range(31):
        run(Injector(failing))
    os.close(reader)
    os.close(writer)


def test_a_server_that_lets_us_join_and_then_answers_badly_counts_as_failing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sixteen of them once kept all announced hubs out for good, since each visit began with a success."""
    monkeypatch.setattr(hub_client, "RETRY", 0.001)
    reader, writer = os.pipe()

    def open_session(_way: Candidate) -> Any:
        session = InjectedSession(Injector(0), reader)
        session.live = Injector(1).of()
        return session

    context = HubContext(
        open=open_session,
        claim=lambda _hub, _session: None,
        linked=lambda: (),
        take=lambda _hub, _view: None,
        complain=lambda _about, _why: None,
        examine=lambda _session, _request: None,
        logger=logging.getLogger("loops"),
        host="127.0.0.1",
    )
    way = Candidate(HubAddress("127.0.0.1", 1))
    hub = HubClient([way], False, Publication(RECORD, {}, frozenset()), context)
    tried = hub.lost_since
    wait_until(lambda: hub.failures > 2, "failed visits", PATIENCE)
    assert hub.lost_since == tried
    hub.stop()
    hub.join()
    os.close(reader)
    os.close(writer)


def test_the_search_for_hubs_survives_an_exception_of_every_call_it_makes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Calls are: making the search, the view of the hubs, looking for hubs, resting while it is on one."""
    for name, seconds in (("RETRY", 0.001), ("REST", 0.001), ("LOOK", 0.005)):
        monkeypatch.setattr(hubs_module, name, seconds)
    for failing in range(1, 16):
        injector = Injector(failing)
        found = SimpleNamespace(
            sightings=injector.of([]), rest=injector.of(), interfaces=(), stack=""
        )
        monkeypatch.setattr(hubs_module, "Discovery", injector.of(found))
        monkeypatch.setattr(Hubs, "view", injector.of(SimpleNamespace(connected=True)))
        hubs = Hubs(
            HubsConfig(discover=True),
            RECORD,
            set,
            list,
            logging.getLogger("loops"),
            lambda *_: None,
        )
        assert injector.has_failed.wait(PATIENCE)
        before = injector.calls
        wait_until(lambda i=injector, n=before: i.calls > n + 10, "the search continues", PATIENCE)  # type: ignore[misc]
        hubs.shutdown()
        assert hubs._searcher is not None
        assert not hubs._searcher.is_alive()


def test_a_search_for_hubs_that_began_by_half_is_begun_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without the thread of its browser it found nothing, and was taken for open."""
    closed = list[object]()
    begin = Injector(1)
    fake = SimpleNamespace(
        Zeroconf=lambda *_, **__: object(),
        ServiceBrowser=begin.of(),
        IPVersion=SimpleNamespace(V4Only=4),
        DNSQuestionType=SimpleNamespace(QM=1),
    )
    monkeypatch.setitem(sys.modules, "zeroconf", fake)
    monkeypatch.setattr(discovery, "close_zeroconf", closed.append)
    monkeypatch.setattr(discovery, "REOPEN", 0.0)
    search = discovery.Discovery(list)
    with pytest.raises(RuntimeError, match="as asked"):
        search.sightings()
    assert len(closed) == 1
    assert search.sightings() == []
    assert begin.calls == 2


def test_the_examination_of_nodes_survives_an_exception_of_every_call_it_makes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also one of the gateway's own function: it was never called again, and the gateway kept the dead node's rule."""
    monkeypatch.setattr(liveness, "PERIOD", 0.001)
    for failing in range(1, 4):
        injector, told = Injector(failing), threading.Event()
        changed = injector.of()
        examiner = NodeExaminer(
            "http://127.0.0.1:9", "/gateway", lambda c=changed, t=told: (c(), t.set())
        )
        monkeypatch.setattr(examiner, "_caller", SimpleNamespace(call=injector.of("http://one:1")))
        monkeypatch.setattr(liveness, "refuses", injector.of(True))
        examiner.examine(frozenset({"/one"}))
        assert told.wait(PATIENCE)
        assert injector.has_failed.is_set()
        assert examiner.dead == {"/one"}
        examiner.examine(frozenset())


def test_the_examination_of_nodes_survives_exceptions_and_a_lack_of_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(liveness, "PERIOD", 0.001)
    examiner = NodeExaminer("http://127.0.0.1:9", "/gateway", list)
    injector = Injector(1)
    monkeypatch.setattr(examiner, "_is_dead", injector.of(True))
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", Injector(1).of())
        examiner.examine(frozenset({"/one"}))
    examiner.examine(frozenset({"/one"}))
    wait_until(lambda: examiner.dead == {"/one"}, "the examination", PATIENCE)
    assert injector.has_failed.is_set()
    examiner.examine(frozenset())


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


class AskedSession:
    """A session over which the doctor has asked."""

    name = "robot"

    def __init__(self, publish: Callable[..., Any]) -> None:
        self.client = SimpleNamespace(publish=publish)


@pytest.mark.parametrize("failing", range(1, 4))
def test_the_doctors_examiner_survives_an_exception_of_every_call_it_makes(
    monkeypatch: pytest.MonkeyPatch, failing: int
) -> None:
    injector = Injector(failing)
    session: Any = AskedSession(injector.of())
    found = Examination("robot", 0.0, "host", "", "", False, "")
    monkeypatch.setattr(facts, "examination", injector.of(found))
    monkeypatch.setattr(doctors_examiner, "text_from_examination", injector.of("text"))
    asked = Examiner()
    asked.asked(session, "0" * 32)
    assert injector.has_failed.wait(PATIENCE)
    for thread in threading.enumerate():
        if thread.name == "examination":
            thread.join(PATIENCE)
    before = injector.calls
    asked.asked(session, "1" * 32)
    wait_until(lambda: injector.calls == before + 3, "the next examination's answer", PATIENCE)


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
