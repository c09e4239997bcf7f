"""The state known at the base station: the world, its robots, the network between them."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pioneer_fleet.monitor.report import CARRYING, QUIET
from pioneer_web.state.alerts import Alerts
from pioneer_web.state.robot import Robot

LINES = 200
"""Number of log lines kept."""
MOVED = 0.05
"""Distance after which a moved model is shown [m]."""
MOST_LINKS = 1000
"""Maximum number of gateways with links, and of each one's links."""
MOST_MODELS = 5000
"""Maximum number of models that are distinguished."""
RULE = ("action", "gateway", "type", "name", "node", "state", "reason")
_FLOW = {"rate": "rate [Hz]", "bytes": "throughput [byte/s]", "drops": "dropped"}
LEVELS = {1: "debug", 2: "info", 4: "warning", 8: "error", 16: "fatal"}
_LARGEST = 1e15
SETTLING = 3.0
"""Time after the subscriptions begin in which missing data is no alert [s]."""
_RECORDING = "recording"
"""Who has an alert that is of no robot."""
STANDS = 1.0
"""Time without a clock change after which the simulation counts as paused [s]."""


def _number(text: str) -> float:
    """Returns the number in a diagnostic value; 0 if it is none, or too large to be meant."""
    try:
        number = float(text)
    except ValueError:
        return 0.0
    return number if abs(number) <= _LARGEST else 0.0


class Station:
    """The newest data of the whole fleet."""

    def __init__(self) -> None:
        #: gateway, hub: names of the base station's, empty while unknown
        #: robots: in the order of their computers
        self.robots: Sequence[Robot] = ()
        self.gateway = self.hub = ""
        self.real_time_factor: float | None = (
            None  #: real-time factor of the simulator, None without one
        )
        self.recording = ""  #: recording file, empty while not recording
        self.recording_fault = ""  #: why the last recording has ended by itself; empty otherwise
        #: position in and length of the replayed recording [s], None without one
        self.replay: list[float] | None = None
        self.rules: list[dict[str, str]] = []
        self.door: list[dict[str, str]] = []  #: what does not cross to ROS 2, in the form of rules
        self.links: dict[str, dict[str, dict[str, float]]] = {}
        self._time, self._ticked = 0.0, -math.inf
        self._map: dict[str, Any] | None = None
        self._first: dict[str, tuple[float, float]] = {}
        self._actors: list[list[Any]] = []
        self._log: dict[str, list[Any]] = {}
        self._lines = 0
        self._alerts = Alerts()
        #: since when the topics have been subscribed (monotonic) [s]
        self.watched_since = math.inf

    def tick(self, simulated: float, now: float) -> None:
        """Records simulated time at ``now`` (monotonic) [s]."""
        if simulated != self._time:
            self._time, self._ticked = simulated, now

    def set_map(self, x: float, y: float, width: float, height: float) -> None:
        """Records a new map: the position of its lower left corner and its size [m]."""
        version = 1 if self._map is None else self._map["version"] + 1
        self._map = {"version": version, "x": x, "y": y, "width": width, "height": height}

    def set_rules(self, rules: Iterable[Mapping[str, str]]) -> None:
        """Records the gateway's rules, each with action, gateway, type, name, node, state and reason."""
        self.rules = [
            {key: rule.get(key, "") for key in RULE} for rule in rules if rule.get("action")
        ]

    def set_door(self, faults: Iterable[tuple[str, str]]) -> None:
        """Records what does not cross the door to ROS 2: names and texts, a state and its reason after a colon."""
        self.door = []
        for name, text in faults:
            state, _, reason = text.partition(": ")
            row = dict.fromkeys(RULE, "")
            row |= {
                "action": "door",
                "gateway": "ROS 2",
                "name": name,
                "state": state,
                "reason": reason,
            }
            self.door.append(row)

    def add_links(self, entries: Iterable[tuple[str, Mapping[str, str]]]) -> None:
        """Records the traffic on links from the gateway's diagnostics: name and values of each entry."""
        for name, values in entries:
            _, _, about = name.partition(": ")
            way, _, rest = about.partition(" ")
            other, _, topic = rest.partition(" ")
            if way in ("to", "from") and "throughput [byte/s]" in values:
                flow = {key: _number(values.get(name, "")) for key, name in _FLOW.items()}
                links = (
                    self.links.setdefault(other, {})
                    if len(self.links) < MOST_LINKS
                    else self.links.get(other, {})
                )
                if len(links) < MOST_LINKS:
                    links[f"{way} {topic}"] = flow

    def add_log(self, stamp: float, level: int, computer: str, node: str, text: str) -> None:
        """Adds a log line of a robot's computer, or of the base station if the name is empty."""
        line = [
            self._lines,
            round(stamp, 2),
            LEVELS.get(level, "info"),
            computer,
            node[:100],
            text[:500],
        ]
        # Overwrite the oldest entry, so that only the new line is sent to pages.
        self._log[f"log.{self._lines % LINES}"] = line
        self._lines += 1

    def set_models(self, models: Iterable[tuple[str, float, float]]) -> None:
        """Records the models' positions [m]; models that move, or appear after the first call, are shown as actors."""
        names, robots, known = [], {robot.name for robot in self.robots}, bool(self._first)
        for name, x, y in models:
            if name in robots:
                continue
            if name not in self._first:
                if len(self._first) >= MOST_MODELS:
                    continue
                self._first[name] = (math.inf, math.inf) if known else (x, y)
            if math.dist(self._first[name], (x, y)) > MOVED:
                self._first[name] = (math.inf, math.inf)
                names.append([name, round(x, 2), round(y, 2)])
        self._actors = names

    def rule_states(self) -> dict[str, list[tuple[str, str]]]:
        """Returns state and reason of each rule, by remote gateway."""
        found: dict[str, list[tuple[str, str]]] = {}
        for rule in self.rules:
            found.setdefault(rule["gateway"], []).append((rule["state"], rule["reason"]))
        return found

    def note_faults(self, now: float, wall: float) -> None:
        """Adds what is wrong to the alerts, at ``now`` (monotonic) and ``wall`` (seconds since 1970)."""
        self._alerts.update(_RECORDING, self.recording_fault, wall)
        if now - self.watched_since < SETTLING:
            return
        faults = self.robot_faults(now)
        for robot in self.robots:
            self._alerts.update(robot.name, faults[robot.name] or robot.complaint, wall)

    def robot_faults(self, now: float) -> dict[str, str]:
        """Returns what is wrong with each robot, empty if nothing is."""
        rules = self.rule_states()
        # Nothing is late while the simulation stands.
        judged_at = self._ticked if self._is_paused(now) and self._ticked > -math.inf else now
        return {robot.name: robot.fault(rules, judged_at) for robot in self.robots}

    def _is_paused(self, now: float) -> bool:
        return now - self._ticked > STANDS

    def values(self, now: float) -> dict[str, Any]:
        """Returns all values that a page shows, by name; names of a robot's values begin with ``ROBOT.``."""
        faults = self.robot_faults(now)
        shown: dict[str, Any] = {
            "map": self._map,
            "time": round(self._time, 1),
            "paused": self._is_paused(now),
            "factor": self.real_time_factor,
            "recording": self.recording,
            "replay": self.replay,
            "hub": self.hub,
            "gateway": self.gateway,
            "actors": self._actors,
            "network": self._network(),
            "rules": [
                *(rule for rule in self.rules if rule["state"] not in QUIET),
                *self.door,
            ],
            **self._log,
        }
        for robot in self.robots:
            for name, value in robot.values(faults[robot.name], now).items():
                shown[f"{robot.name}.{name}"] = value
        shown["alerts"] = self._alerts.values()
        return shown

    def _network(self) -> dict[str, dict[str, Any]]:
        """Returns the rules and the traffic of each robot's gateway."""
        found = {}
        for robot in self.robots:
            rules = [rule for rule in self.rules if rule["gateway"] == robot.gateway]
            links = self.links.get(robot.gateway, {})
            found[robot.gateway] = {
                "robot": robot.name,
                "rules": len(rules),
                "active": sum(rule["state"] in CARRYING for rule in rules),
                "rate": round(sum(link["rate"] for link in links.values())),
                "bytes": round(sum(link["bytes"] for link in links.values())),
                "drops": round(sum(link["drops"] for link in links.values())),
            }
        return found
