"""Services, actions and parameters between gateways, without hub, relay or master."""

import dataclasses

import pytest
from gateway_model import FakeGateway, Fleet, fleet_of, gateway, publisher, service, subscriber, to

from rocon_gateway.error import RequestError
from rocon_gateway.rules.action import actions, parts
from rocon_gateway.rules.matching import ALL
from rocon_gateway.rules.reconcile import reconcile
from rocon_gateway.rules.rulebook import RuleBook
from rocon_gateway.rules.situation import State
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.rule import Connection, Kind, RemoteRule, Rule
from rocon_relay.connection import LinkState, proxy_name

FIBONACCI = "actionlib_tutorials/Fibonacci"
SERVER = Connection(Kind.ACTION_SERVER, "/fib", FIBONACCI, "/fib_server")
CLIENT = Connection(Kind.ACTION_CLIENT, "/fib", FIBONACCI, "/fib_client")


def test_a_flipped_service_is_served_at_the_other_gateway() -> None:
    hub, robot = gateway("hub", service("/add")), gateway("robot")
    hub.book = hub.book.added("flip", [to("robot", Kind.SERVICE, "add")])
    fleet_of(hub, robot)
    assert robot.imported() == {("/add", "hub", "/server")}
    assert hub.states() == {"flip add": State.ACTIVE}
    assert [one.status for one in hub.outcome.flipped] == ["accepted"]
    assert [one.connection for one in robot.outcome.flipped_in] == [service("/add")]


def test_an_advertised_service_is_pulled() -> None:
    hub, robot = gateway("hub", service("/add"), service("/secret")), gateway("robot")
    hub.book = hub.book.advertised([Rule(Kind.SERVICE, "/add")])
    robot.book = robot.book.added(
        "pull", [to("hub", Kind.SERVICE, ALL), to("hub", Kind.SERVICE, "/secret")]
    )
    fleet_of(hub, robot)
    assert robot.imported() == {("/add", "hub", "/server")}
    assert robot.states() == {"pull .*": State.ACTIVE, "pull /secret": State.NO_SERVICE}


def test_a_firewall_refuses_a_flipped_service() -> None:
    hub, robot = gateway("hub", service("/add")), gateway("robot", firewall=True)
    hub.book = hub.book.added("flip", [to("robot", Kind.SERVICE, "/add")])
    fleet_of(hub, robot)
    assert (robot.imported(), hub.states()) == (set(), {"flip /add": State.FIREWALLED})


def test_a_local_server_keeps_its_name_and_the_rule_is_refused_not_accepted() -> None:
    hub, robot = gateway("hub", service("/add")), gateway("robot", service("/add", "/mine"))
    hub.book = hub.book.added("flip", [to("robot", Kind.SERVICE, "/add")])
    fleet = fleet_of(hub, robot)
    assert robot.imported() == set()
    assert hub.states() == {"flip /add": State.REFUSED}
    assert hub.reason("/add") == "/add is served by /mine here already"
    assert [one.status for one in hub.outcome.flipped] == ["blocked"]
    robot.local.clear()
    fleet.settle()
    assert hub.states() == {"flip /add": State.ACTIVE}


def test_of_two_remote_servers_of_one_name_the_running_one_stays_until_it_goes() -> None:
    robot, late, early = gateway("robot"), gateway("a"), gateway("b", service("/add"))
    robot.book = RuleBook("robot").added("pull", [to("[ab]", Kind.SERVICE, "/add")])
    for one in (late, early):
        one.book = one.book.advertised([Rule(Kind.SERVICE, "/add")])
    fleet = Fleet(robot, late, early).settle()
    late.local.add(service("/add"))
    fleet.settle()
    assert robot.imported() == {("/add", "b", "/server")}
    assert robot.states() == {"pull /add": State.ACTIVE}
    early.local.clear()
    fleet.settle()
    assert robot.imported() == {("/add", "a", "/server")}


def test_a_name_may_be_a_topics_and_a_services() -> None:
    hub, robot = gateway("hub", publisher("/map", "/server"), service("/map")), gateway("robot")
    hub.book = hub.book.with_all("flip", "robot", [])
    fleet_of(hub, robot)
    assert len(robot.outcome.imports) == len(hub.outcome.exports) == 2


def test_five_topics_of_one_node_are_an_action() -> None:
    local = {*parts(SERVER), *parts(CLIENT), subscriber("/fib/status", "/echo")}
    assert actions(local) == {SERVER, CLIENT}
    assert actions(set(list(parts(SERVER))[1:])) == frozenset()
    scattered = {dataclasses.replace(one, node=f"/n{i}") for i, one in enumerate(parts(SERVER))}
    assert actions(scattered) == frozenset()
    assert actions({publisher("/goal"), subscriber("/goal")}) == frozenset()


def test_everything_lists_an_action_once_and_its_topics_not() -> None:
    hub, robot = (
        gateway("hub", *parts(SERVER), publisher("/chatter")),
        gateway("robot", *parts(CLIENT)),
    )
    hub.book = hub.book.advertising_all([]).with_all("flip", "robot", [])
    robot.book = robot.book.with_all("pull", "hub", [])
    fleet_of(hub, robot)
    assert set(hub.outcome.advertised) == {SERVER, publisher("/chatter")}
    assert {one.connection for one in hub.outcome.flipped} == {SERVER, publisher("/chatter")}
    assert {one.connection for one in robot.outcome.pulled} == {SERVER, publisher("/chatter")}


def flip_server(server: FakeGateway, client: FakeGateway) -> RemoteRule:
    rule = to(client.name, Kind.ACTION_SERVER, "/fib")
    server.book = server.book.added("flip", [rule])
    return rule


def flip_client(server: FakeGateway, client: FakeGateway) -> RemoteRule:
    rule = to(server.name, Kind.ACTION_CLIENT, "/fib")
    client.book = client.book.added("flip", [rule])
    return rule


def pull_server(server: FakeGateway, client: FakeGateway) -> RemoteRule:
    server.book = server.book.advertised([Rule(Kind.ACTION_SERVER, "/fib")])
    rule = to(server.name, Kind.ACTION_SERVER, "/fib")
    client.book = client.book.added("pull", [rule])
    return rule


def pull_client(server: FakeGateway, client: FakeGateway) -> RemoteRule:
    client.book = client.book.advertised([Rule(Kind.ACTION_CLIENT, "/fib")])
    rule = to(client.name, Kind.ACTION_CLIENT, "/fib")
    server.book = server.book.added("pull", [rule])
    return rule


@pytest.mark.parametrize("connect", [flip_server, flip_client, pull_server, pull_client])
def test_one_rule_brings_all_five_topics_of_an_action_and_the_client_sees_its_server(
    connect,
) -> None:
    server, client = gateway("server", *parts(SERVER)), gateway("client", *parts(CLIENT))
    connect(server, client)
    fleet_of(server, client)
    assert client.imported() == {
        (f"/fib/{one}", "server", "/fib_server") for one in ("status", "feedback", "result")
    }
    assert server.imported() == {
        (f"/fib/{one}", "client", "/fib_client") for one in ("goal", "cancel")
    }
    assert {one.subscriber for one in client.outcome.exports} == {
        proxy_name("server", "/fib_server")
    }
    assert {one.subscriber for one in server.outcome.exports} == {""}
    assert set({**server.states(), **client.states()}.values()) == {State.ACTIVE}


def test_an_action_server_alone_is_active_and_a_client_alone_is_reported() -> None:
    server, nobody = gateway("server", *parts(SERVER)), gateway("nobody")
    flip_server(server, nobody)
    fleet_of(server, nobody)
    assert server.states() == {"flip /fib": State.ACTIVE}
    client, nobody = gateway("client", *parts(CLIENT)), gateway("nobody")
    flip_client(nobody, client)
    fleet_of(client, nobody)
    assert client.states() == {"flip /fib": State.NO_ACTION}
    assert client.reason("/fib") == "no server of /fib at nobody"
    assert [one.status for one in client.outcome.flipped] == ["accepted"]


def test_an_action_is_as_good_as_the_worst_of_its_topics() -> None:
    server, client = gateway("server", *parts(SERVER)), gateway("client", *parts(CLIENT))
    pull_server(server, client)
    fleet = fleet_of(server, client)
    broken = next(one for one in client.links if one.key.topic == "/fib/result")
    client.links[broken] = dataclasses.replace(client.links[broken], state=LinkState.UNREACHABLE)
    (state,) = reconcile(fleet.situation(client)).states
    assert state.verdict.state == State.UNREACHABLE


def test_an_action_with_a_blacklisted_topic_stays_here_whole() -> None:
    hub = FakeGateway(RuleBook("hub", (Rule(Kind.PUBLISHER, "/fib/res.*"),)), set(parts(SERVER)))
    robot = gateway("robot")
    hub.book = hub.book.added("flip", [to("robot", Kind.ACTION_SERVER, "/f.*")])
    fleet_of(hub, robot)
    assert (robot.imported(), hub.states()) == (
        set(),
        {"flip /f.*": "blacklisted by publisher /fib/res.*"},
    )


def test_an_advertised_parameter_is_copied_where_it_is_pulled_and_all_never_means_it() -> None:
    hub, robot = gateway("hub"), gateway("robot")
    hub.book = hub.book.advertising_all([]).advertised([Rule(Kind.PARAMETER, "robot_description")])
    robot.book = robot.book.with_all("pull", "hub", [])
    fleet = fleet_of(hub, robot)
    assert robot.imported() == set()
    robot.book = robot.book.added(
        "pull", [to("hub", Kind.PARAMETER, "/robot_description"), to("hub", Kind.PARAMETER, "/x")]
    )
    fleet.settle()
    assert robot.imported() == {("/robot_description", "hub", "")}
    assert robot.states()["pull /robot_description"] == State.ACTIVE
    assert robot.states()["pull /x"] == State.NO_PARAMETER


def test_a_parameter_is_pulled_by_its_plain_name_and_never_flipped() -> None:
    for name, node in (("/a.*", ""), ("/a", "/node")):
        with pytest.raises(RequestError):
            RuleBook("hub").added("pull", [to("robot", Kind.PARAMETER, name, node)])
        with pytest.raises(RequestError) as refused:
            RuleBook("hub").advertised([Rule(Kind.PARAMETER, name, node)])
        assert refused.value.code == Code.UNKNOWN_ADVERTISEMENT_ERROR
    with pytest.raises(RequestError, match="pulled, not flipped"):
        RuleBook("hub").added("flip", [to("robot", Kind.PARAMETER, "/a")])


def test_a_dead_server_does_not_bar_a_service() -> None:
    hub, robot = gateway("hub", service("/add", "/ghost")), gateway("robot", service("/add"))
    hub.book = hub.book.added("pull", [to("robot", Kind.SERVICE, "/add")])
    robot.book = robot.book.advertised([Rule(Kind.SERVICE, "/add")])
    fleet = fleet_of(hub, robot)
    assert hub.states() == {"pull /add": State.REFUSED}
    hub.dead = frozenset({"/ghost"})
    fleet.settle()
    assert hub.states() == {"pull /add": State.ACTIVE}
