"""Converts the records of other gateways to ROS messages."""

from gateway_msgs.msg import ConnectionStatistics, RemoteGateway

from rocon_gateway.rules.conversions import message_from_remote_rule, message_from_rule
from rocon_hub_protocol.record import Record
from rocon_relay.latency import Latency


def message_from_record(
    record: Record, silence: float, latency: Latency | None = None
) -> RemoteGateway:
    """Returns the message that describes another gateway.

    Args:
        record: its record.
        silence: time since it was last heard of [s], 0 if it is alive.
        latency: latency between our relay and its relay; None if unknown.
    """
    stats = ConnectionStatistics(
        gateway_available=silence == 0.0, time_since_last_seen=int(silence)
    )
    if latency is not None:
        stats.ping_latency_min, stats.ping_latency_max = (
            1e3 * latency.shortest,
            1e3 * latency.longest,
        )
        stats.ping_latency_avg, stats.ping_latency_mdev = (
            1e3 * latency.mean,
            1e3 * latency.deviation,
        )
    return RemoteGateway(
        name=record.name,
        ip=record.host,
        firewall=record.firewall,
        conn_stats=stats,
        public_interface=[message_from_rule(one) for one in record.advertisements],
        flipped_interface=[message_from_remote_rule(one) for one in record.flips],
        pulled_interface=[message_from_remote_rule(one) for one in record.pulls],
    )
