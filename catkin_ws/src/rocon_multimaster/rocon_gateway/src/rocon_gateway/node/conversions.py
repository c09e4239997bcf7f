"""Converts the status of the relay's connections to ROS messages."""

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from rocon_gateway.rules.situation import WORKING
from rocon_relay.connection import Export, Import, LinkState, LinkStatus
from rocon_relay.latency import Latency
from rocon_relay.traffic import Flow


def diagnostic_from_link(
    one: Export | Import,
    link: LinkStatus,
    flow: Flow,
    latencies: Mapping[str, Latency],
    gateway: str,
) -> DiagnosticStatus:
    """Returns status and data rates of one connection of our gateway `gateway`, for `/diagnostics`."""
    way, other = "to" if isinstance(one, Export) else "from", one.key.gateway
    latency = latencies.get(other)
    values = {
        "state": str(link.state),
        "reason": link.reason,
        "subscribers": link.subscribers,
        "messages": link.messages,
        "bytes": link.bytes,
        "rate [Hz]": f"{flow.messages:.1f}",
        "throughput [byte/s]": f"{flow.bytes:.0f}",
        "dropped": link.drops,
        "left out": link.left_out,
        "saved by compression [byte]": link.saved,
        "latency [ms]": f"{1e3 * latency.mean:.2f}" if latency else "",
    }
    node = f" of {one.key.source_node}" if one.key.source_node else ""
    working = str(link.state) in WORKING
    if link.state is LinkState.MTU:
        level = DiagnosticStatus.WARN
    else:
        level = DiagnosticStatus.OK if working else DiagnosticStatus.STALE
    return DiagnosticStatus(
        level=level,
        name=f"{gateway}: {way} {other} {one.key.topic}{node}",
        message=f"{link.state}, {flow.messages:.1f} messages a second"
        if working
        else f"{link.state}: {link.reason}",
        hardware_id=gateway,
        values=[KeyValue(key, str(value)) for key, value in values.items()],
    )
