from diagnostic_msgs.msg import DiagnosticStatus

from rocon_gateway.hub.conversions import message_from_record
from rocon_gateway.node.conversions import diagnostic_from_link
from rocon_hub_protocol.record import Record
from rocon_relay.connection import Address, Export, Import, LinkState, LinkStatus
from rocon_relay.latency import Latency
from rocon_relay.traffic import Flow

LATENCY = Latency(0.001, 0.004, 0.002, 0.0005)


def test_a_connection_says_what_flows_on_it_and_how_long_the_way_takes():
    wanted = Import("/scan", "*", "*", "robot", "/laser", Address("10.0.0.2", 1))
    link = LinkStatus(LinkState.ACTIVE, "", 2, 100, 5000, 3, 0, 40)
    status = diagnostic_from_link(wanted, link, Flow(12.5, 625.0), {"robot": LATENCY}, "base")
    assert (status.level, status.name) == (DiagnosticStatus.OK, "base: from robot /scan of /laser")
    values = {one.key: one.value for one in status.values}
    assert (values["rate [Hz]"], values["throughput [byte/s]"], values["dropped"]) == (
        "12.5",
        "625",
        "3",
    )
    assert (values["messages"], values["bytes"]) == ("100", "5000")
    assert (values["latency [ms]"], values["saved by compression [byte]"]) == ("2.00", "40")


def test_a_connection_that_does_not_work_says_why():
    export = Export("/scan", "*", "/laser", "robot")
    link = LinkStatus(LinkState.PENDING, "not dialled by the far gateway")
    status = diagnostic_from_link(export, link, Flow(), {}, "base")
    assert (status.level, status.name) == (DiagnosticStatus.STALE, "base: to robot /scan of /laser")
    assert status.message == "pending: not dialled by the far gateway"
    assert {one.key: one.value for one in status.values}["latency [ms]"] == ""


def test_a_gateways_statistics_are_milliseconds_as_rocon_has_them():
    stats = message_from_record(Record("robot", "i", "10.0.0.2", 1), 0.0, LATENCY).conn_stats
    found = (
        stats.ping_latency_min,
        stats.ping_latency_max,
        stats.ping_latency_avg,
        stats.ping_latency_mdev,
    )
    assert found == (1.0, 4.0, 2.0, 0.5)
    assert stats.gateway_available
    assert (
        message_from_record(Record("robot", "i", "10.0.0.2", 1), 3.0).conn_stats.ping_latency_avg
        == 0
    )
