"""Exports fleet metrics in Prometheus' text format."""

from collections.abc import Iterator

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from pioneer_web.state.station import Station


def figures(station: Station, viewers: int, now: float) -> bytes:
    """Returns all metrics, without unknown values. ``now`` is monotonic [s]."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(station, viewers, now))
    return generate_latest(registry)


class _Collector(Collector):
    def __init__(self, station: Station, viewers: int, now: float) -> None:
        self._station, self._viewers, self._now = station, viewers, now

    def collect(self) -> Iterator[Metric]:
        """Yields every metric with its samples."""
        yield GaugeMetricFamily("pioneer_pages", "Pages that are open.", self._viewers)
        if self._station.real_time_factor is not None:
            yield GaugeMetricFamily(
                "pioneer_real_time_factor",
                "Simulated seconds a second.",
                self._station.real_time_factor,
            )
        yield from self._robots()
        yield from self._links()

    def _robots(self) -> Iterator[Metric]:
        faults = self._station.robot_faults(self._now)
        rows = [
            (robot, robot.robot_json(self._now), faults[robot.name])
            for robot in self._station.robots
        ]
        for name, key, text in (
            ("odometry_age_seconds", "odom_age", "Since the last odometry."),
            ("scan_age_seconds", "scan_age", "Since the last scan."),
            ("speed", "speed", "Forward speed [m/s]."),
            (
                "position_deviation",
                "deviation",
                "Standard deviation of the position that amcl estimates [m].",
            ),
            ("waypoints_waiting", "waiting", "Waypoints not reached yet."),
        ):
            gauge = GaugeMetricFamily(f"pioneer_robot_{name}", text, labels=["robot"])
            for robot, row, _ in rows:
                if row[key] is not None:
                    gauge.add_metric([robot.name], row[key])
            yield gauge
        for name in ("reached", "aborted"):
            counter = CounterMetricFamily(
                f"pioneer_robot_waypoints_{name}", f"Waypoints {name}.", labels=["robot"]
            )
            for robot, row, _ in rows:
                counter.add_metric([robot.name], row[name])
            yield counter
        for name, text in (
            ("up", "1 without a fault."),
            ("held", "1 while it is stopped from the page."),
        ):
            gauge = GaugeMetricFamily(f"pioneer_robot_{name}", text, labels=["robot"])
            for robot, _, fault in rows:
                gauge.add_metric(
                    [robot.name], float(not fault) if name == "up" else float(robot.held)
                )
            yield gauge

    def _links(self) -> Iterator[Metric]:
        labels = ["gateway", "topic"]
        metrics: dict[str, GaugeMetricFamily | CounterMetricFamily] = {
            "rate": GaugeMetricFamily(
                "pioneer_link_messages_per_second", "Messages on a link.", labels=labels
            ),
            "bytes": GaugeMetricFamily(
                "pioneer_link_bytes_per_second", "Bytes on a link.", labels=labels
            ),
            "drops": CounterMetricFamily(
                "pioneer_link_dropped", "Messages dropped on a link.", labels=labels
            ),
        }
        for gateway, topics in self._station.links.items():
            for topic, flow in topics.items():
                for key, metric in metrics.items():
                    metric.add_metric([gateway, topic], flow[key])
        yield from metrics.values()
        rules = GaugeMetricFamily(
            "pioneer_rules", "Rules of the base station's gateway.", labels=["gateway", "state"]
        )
        counts: dict[tuple[str, str], int] = {}
        for rule in self._station.rules:
            which = rule["gateway"], rule["state"]
            counts[which] = counts.get(which, 0) + 1
        for which, count in counts.items():
            rules.add_metric(which, count)
        yield rules
