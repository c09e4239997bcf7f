"""Computers, a hub and cables in one thread and simulated time, around the gateway's real control plane."""

from __future__ import annotations

import heapq
import itertools
import random
from collections.abc import Callable, Sequence
from typing import Any

import redis
from gateway_model import Fleet, publisher, service, subscriber, to
from process import Computer, Process
from redis_model import ClientModel, RedisModel, Subscription
from schedule import NAMES, Fault

from rocon_gateway.rules.matching import ALL
from rocon_gateway.rules.rulebook import RuleBook
from rocon_gateway.rules.situation import Outcome
from rocon_hub.registry import Registry
from rocon_hub_protocol.key import GATEWAYS_KEY, requests_key
from rocon_hub_protocol.record import text_from_request
from rocon_hub_protocol.rule import Connection, Kind, RemoteRule, Rule

HUB_LOOK = 0.25
PATIENCE = 60.0
CONVERGED = 20.0
"""Within which everything must be right once faults have stopped [s]: silence, then grace for who has links."""

_RULES: tuple[tuple[str, Kind, str], ...] = (
    ("flip", Kind.PUBLISHER, "/scan"),
    ("flip", Kind.SUBSCRIBER, "/tf"),
    ("flip", Kind.SERVICE, ".*/add"),
    ("pull", Kind.PUBLISHER, ALL),
    ("pull", Kind.SERVICE, ".*/add"),
)


def _nodes(name: str) -> list[Connection]:
    # A name has one server, and which one depends on the order of arrival; here each computer has names of its own.
    nodes = (
        publisher("/scan", "/laser"),
        publisher("/tf", "/localisation"),
        subscriber("/scan", "/viewer"),
    )
    return [*nodes, service(f"/{name}/add", "/adder")]


class World:
    """Everything that a fault schedule acts on."""

    def __init__(self, seed: int, faults: Sequence[Fault]) -> None:
        self.now = 0.0
        self.random = random.Random(seed)
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self.numbers = itertools.count(1)
        self.redis: RedisModel | None = None
        self.hub_runs = 0
        self.frozen = 0.0
        self.cut_from_hub: dict[str, float] = {}
        self.cut_links: dict[frozenset[str], float] = {}
        self.listening: dict[int, Process] = {}
        self.computers = {
            name: Computer(RuleBook(name), {*self.random.sample(_nodes(name), 2)}) for name in NAMES
        }
        for computer in self.computers.values():
            for _ in range(2):
                self.change_rule(computer, self.random.randrange(1000))
        self.registry = Registry(ClientModel(self.hub_server), PATIENCE)
        for fault in faults:
            self.at(fault.at, lambda fault=fault: self._begin(fault))
        self.end = max((fault.at + fault.seconds for fault in faults), default=0.0)
        self.start_hub()
        self._look()
        for computer in self.computers.values():
            self.start(computer)

    # Time

    def at(self, when: float, act: Callable[[], None]) -> None:
        heapq.heappush(self._due, (when, next(self.numbers), act))

    def soon(self, longest: float, act: Callable[[], None]) -> None:
        self.at(self.now + self.random.uniform(0.0, longest), act)

    def run(self) -> str:
        """Runs the simulation; returns what is still wrong when it should have converged, or "" if nothing is."""
        check, wrong = self.end, ""
        while True:
            while self._due[0][0] <= check:
                self.now, _, act = heapq.heappop(self._due)
                act()
            self.now = check
            wrong = self.fault()
            if not wrong or check > self.end + CONVERGED:
                return wrong
            check += 0.5

    # The hub

    def hub_server(self) -> RedisModel:
        if self.redis is None:
            raise redis.ConnectionError("Connection refused.")
        if self.now < self.frozen:
            raise redis.TimeoutError("Timeout reading from socket")
        return self.redis

    def start_hub(self) -> None:
        self.hub_runs, self.frozen = self.hub_runs + 1, 0.0
        self.redis = RedisModel(self.hub_runs, lambda: self.now, self._deliver)
        self.registry.open("Pioneer Hub")

    def _look(self) -> None:
        self.at(self.now + HUB_LOOK, self._look)
        if self.redis is not None and self.now >= self.frozen:
            for _ in self.registry.look(self.now):
                continue
            self.registry.clear(self.now)

    def _deliver(self, subscription: Subscription, message: dict[str, Any]) -> None:
        owner = next((one for one in self.listening.values() if one.events is subscription), None)
        held = max(self.now, self.frozen, self.cut_from_hub.get(owner.name, 0.0) if owner else 0.0)
        # One connection keeps the order within a channel; across channels, the model allows more than a connection.
        channel = message["channel"]
        when = max(
            held + self.random.choice((0.0, 0.001, 0.02, 0.2)), subscription.last.get(channel, 0.0)
        )
        subscription.last[channel] = when
        copies = 2 if self.random.random() < 0.1 else 1
        for _ in range(copies):
            self.at(when, lambda: self._arrive(subscription, message))

    def _arrive(self, subscription: Subscription, message: dict[str, Any]) -> None:
        owner = next((one for one in self.listening.values() if one.events is subscription), None)
        if owner is not None and subscription.is_open:
            subscription.arrived.append(message)
            owner.take()
        elif subscription.is_open:  # not yet returned to the session's creator
            subscription.arrived.append(message)

    # Processes

    def make_process(self, name: str, computer: Computer) -> Process:
        """Starts a gateway."""
        return Process(self, name, computer)

    def start(self, computer: Computer) -> None:
        if computer.process is None:
            computer.process = self.make_process(computer.name, computer)

    def restart_links(self) -> None:
        for process in self.listening.values():
            self.soon(0.3, process.check_links)

    def is_cut(self, one: str, other: str) -> bool:
        return self.now < self.cut_links.get(frozenset((one, other)), 0.0)

    # Faults

    def _begin(self, fault: Fault) -> None:
        computer, ends = self.computers[fault.gateway], self.now + fault.seconds
        if fault.kind in ("crash", "stop"):
            if computer.process:
                computer.process.end(fault.kind == "stop")
                computer.process = None
            self.at(ends, lambda: self.start(computer))
        elif fault.kind == "hub crash":
            self._crash_hub(ends)
        elif fault.kind == "hub freeze":
            self.frozen = max(self.frozen, ends)
        elif fault.kind == "cut from hub":
            self.cut_from_hub[fault.gateway] = ends
        elif fault.kind == "cut link":
            self.cut_links[frozenset((fault.gateway, fault.other))] = ends
            self.restart_links()
            self.at(ends, self.restart_links)
        elif fault.kind == "impostor":
            impostor = self.make_process(fault.gateway, Computer(RuleBook(fault.gateway)))
            self.at(ends, lambda: impostor.end(bool(fault.choice % 2)))
        elif fault.kind == "node":
            computer.local ^= {_nodes(computer.name)[fault.choice % 4]}
            self.soon(0.15, lambda: computer.process and computer.process.wake())
        else:
            self.change_rule(computer, fault.choice)
            self.soon(0.01, lambda: computer.process and computer.process.wake())

    def _crash_hub(self, ends: float) -> None:
        self.redis = None
        for process in self.listening.values():
            # A broken connection is noticed by the process that waits on it.
            self.soon(0.05, process.take)

        def restart() -> None:
            if self.redis is None:
                self.start_hub()

        self.at(ends, restart)

    def change_rule(self, computer: Computer, choice: int) -> None:
        """Adds a rule, or removes it if it exists."""
        book, (action, kind, name) = computer.book, _RULES[choice % len(_RULES)]
        others = [one for one in NAMES if one != computer.name]
        target = [*others, ".*"][choice // 7 % 3]
        if action == "flip":
            remote = to(target, kind, name)
            known = remote in book.flips.rules
            computer.book = (
                book.removed("flip", [remote]) if known else book.added("flip", [remote])
            )
            return
        remote = RemoteRule(target, Rule(kind, name))
        known = remote in book.pulls.rules
        computer.book = book.removed("pull", [remote]) if known else book.added("pull", [remote])
        advertised = Rule(kind, "/tf" if name == ALL else name)
        if advertised not in computer.book.advertisements.rules:
            computer.book = computer.book.advertised([advertised])

    # Invariants

    def fault(self) -> str:
        """Returns the first difference from the state of gateways that never failed, or "" if there is none."""
        assert self.redis is not None
        for computer in self.computers.values():
            others = {name for name in NAMES if name != computer.name}
            process = computer.process
            if process is None or process.session is None:
                return f"{computer.name} is not on the hub"
            if process.view.names != others:
                return f"{computer.name} sees {sorted(process.view.names)}"
        for computer in self.computers.values():
            computer.outcome, computer.links = Outcome(), {}
        Fleet(*self.computers.values()).settle()
        for computer in self.computers.values():
            process, wanted = computer.process, computer.outcome
            assert process is not None
            for what in ("imports", "exports", "states", "requests", "advertised"):
                have, due = getattr(process.outcome, what), getattr(wanted, what)
                if have != due:
                    return f"{computer.name}: {what} are {have}, not {due}"
        return self._hub_fault()

    def _hub_fault(self) -> str:
        assert self.redis is not None
        if self.redis.smembers(GATEWAYS_KEY) != set(NAMES):
            return f"the hub lists {self.redis.smembers(GATEWAYS_KEY)}"
        for name in NAMES:
            due = {
                other.name: text_from_request(other.outcome.requests[name])
                for other in self.computers.values()
                if name in other.outcome.requests
            }
            have = self.redis.hgetall(requests_key(name))
            if have != due:
                return f"the hub keeps the requests {have} to {name}, not {due}"
        return ""
