"""Random nodes, rules and faults at three gateways, against an independent model: each message comes exactly once.

Each round starts a fleet of its own from a seed, takes random steps, and compares after each one: what every master
lists, what every node receives, who answers each service, and the states of rules. `PIONEER_SOAK_MINUTES` and
`PIONEER_SOAK_SEED` set the duration and the first round's seed; `./pioneer test --soak` sets both. To repeat a failed
round, pass its seed.
"""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest
from gateway_msgs import msg, srv
from reference_model import Model, Node, Rule
from std_srvs.srv import Trigger

from pioneer_harness.masters import MasterProcess
from pioneer_harness.proc import process_state
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import WaitError, wait_until
from tcpros.client import Client, ClientError

pytestmark = pytest.mark.soak

STEPS = 35
"""Steps in a round."""

SETTLED = 60.0
"""Within which the fleet must agree with the model after a step [s]; generous, as the machine may be loaded."""

WINDOW = 1.5
"""How long the messages are observed once all publishers are heard [s]."""

UNDER_WAY = 1.0
"""Within which messages stop after the fleet agrees with the model [s]."""

NAMES = ["g1", "g2", "g3"]
TOPICS = ["/t0", "/t1", "/t2"]
LATCHED = ["/l0", "/l1"]
SERVICES = ["/s0", "/s1"]
NODES = ["/n0", "/n1", "/n2"]


class Nursery:
    """Starts nodes by forking a process that has imported rospy."""

    def __init__(self, folder: Path) -> None:
        self._log = (folder / "nodes.log").open("wb")
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("random_nodes.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env={**os.environ, "ROS_IP": "127.0.0.1", "ROS_LOG_DIR": str(folder / "log")},
        )

    def start(self, order: dict[str, object]) -> int:
        """Starts a node; returns its PID."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    def close(self) -> None:
        """Ends all nodes."""
        self._process.communicate()
        self._log.close()


class Ear:
    """What one run of a node has received."""

    def __init__(self, log: Path) -> None:
        self._log = log
        self._position = 0
        #: by topic and run: times [s] and numbers of the messages
        self.heard: dict[tuple[str, str], list[tuple[float, int]]] = defaultdict(list)

    def read(self) -> None:
        """Reads what has arrived since the last call."""
        if not self._log.exists():
            return
        with self._log.open("rb") as file:
            file.seek(self._position)
            data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self._position += len(whole)
        for line in whole.decode().splitlines():
            moment, topic, run, number = line.split()
            self.heard[topic, run].append((float(moment), int(number)))


class Round:
    """A fleet with its model, its running nodes and its history."""

    def __init__(self, fleet, seed: int) -> None:
        self.random = random.Random(seed)
        self.seed = seed
        self.history: list[str] = []
        self.checks = 0
        self.slowest = 0.0
        self.model = Model(NAMES)
        self.fleet = fleet
        self.nursery = Nursery(fleet.folder)
        self.masters: dict[str, MasterProcess] = {}
        self.sites = {}
        self.group = ProcessGroup()
        self.pids: dict[tuple[str, str], int] = {}
        self.ears: dict[tuple[str, str], Ear] = {}
        self._runs = 0

    def start(self) -> None:
        """Starts hub, masters and gateways."""
        self.fleet.start_hub()
        for name in NAMES:
            folder = self.fleet.folder / name
            folder.mkdir()
            port = self.fleet.ports.take(15311)
            self.masters[name] = MasterProcess(self.group, port, folder)
            self.sites[name] = self.fleet.site(name, self.masters[name])
            self.sites[name].start()

    def close(self) -> None:
        """Ends everything."""
        self.nursery.close()
        self.fleet.close()
        self.group.stop()

    # Steps

    def step(self) -> None:
        """Takes a random step."""
        steps: list[tuple[Callable[[], str], int]] = [
            (self.start_node, 8),
            (self.end_node, 3),
            (self.kill_node, 3),
            (self.add_rule, 10),
            (self.cancel_rule, 4),
            (self.kill_gateway, 1),
            (self.freeze_gateway, 1),
            (self.kill_hub, 1),
            (self.restart_master, 1),
        ]
        while True:
            act = self.random.choices(
                [one for one, _ in steps], weights=[weight for _, weight in steps]
            )[0]
            if done := act():
                self.history.append(done)
                return

    def start_node(self) -> str:
        here, name = self.random.choice(NAMES), self.random.choice(NODES)
        listed = self.model.gateways[here].nodes.get(name)
        if listed is not None and listed.lives:
            return ""
        node = Node(
            publishes=self._some(TOPICS),
            latches=self._some(LATCHED),
            subscribes=self._some([*TOPICS, *LATCHED]),
            serves=self._some(SERVICES, 0.25),
        )
        if not (node.sends or node.subscribes or node.serves):
            return ""
        self._start(here, name, node)
        sets = {"publishes": node.sends, "subscribes": node.subscribes, "serves": node.serves}
        shown = " ".join(f"{what} {sorted(which)}" for what, which in sets.items() if which)
        return f"{here}: node {name} starts, {shown}"

    def _some(self, names: list[str], share: float = 0.4) -> frozenset[str]:
        return frozenset(one for one in names if self.random.random() < share)

    def _start(self, here: str, name: str, node: Node) -> None:
        # A new server of a service replaces the one that its master lists.
        for other in self.model.gateways[here].nodes.values():
            other.serves -= node.serves
        self._runs += 1
        node.run, node.lives = f"{here}{name}:{self._runs}", True
        self.model.gateways[here].nodes[name] = node
        log = self.fleet.folder / f"heard-{self._runs}.log"
        ready = self.fleet.folder / f"ready-{self._runs}"
        order = {
            "name": name.lstrip("/"),
            "master": self.masters[here].uri,
            "run": node.run,
            "publishes": sorted(node.publishes),
            "latches": sorted(node.latches),
            "subscribes": sorted(node.subscribes),
            "serves": sorted(node.serves),
            "log": str(log),
            "ready": str(ready),
        }
        self.pids[here, name] = self.nursery.start(order)
        self.ears[here, name] = Ear(log)
        # The master may still list a killed node of this name, so its list alone does not show that this one has begun.
        wait_until(ready.exists, f"{name} of {here}", SETTLED)
        wait_until(lambda: self._lists(here, name, node), f"{name} on {here}'s master", SETTLED)

    def _lists(self, here: str, name: str, node: Node) -> bool:
        publishers, subscribers, services = self.masters[here].system_state()
        return all(
            name in rows.get(topic, [])
            for rows, topics in (
                (publishers, node.sends),
                (subscribers, node.subscribes),
                (services, node.serves),
            )
            for topic in topics
        )

    def _living(self) -> tuple[str, str] | None:
        found = [
            (here, name)
            for here, gateway in self.model.gateways.items()
            for name, node in gateway.nodes.items()
            if node.lives
        ]
        return self.random.choice(found) if found else None

    def end_node(self) -> str:
        if (found := self._living()) is None:
            return ""
        here, name = found
        self._end(here, name, signal.SIGINT)
        del self.model.gateways[here].nodes[name]
        return f"{here}: node {name} ends"

    def kill_node(self) -> str:
        if (found := self._living()) is None:
            return ""
        here, name = found
        self._end(here, name, signal.SIGKILL)
        self.model.gateways[here].nodes[name].lives = False
        return f"{here}: node {name} is killed"

    def _end(self, here: str, name: str, how: signal.Signals) -> None:
        pid = self.pids.pop((here, name))
        del self.ears[here, name]
        os.kill(pid, how)
        wait_until(lambda: process_state(pid) is None, f"the end of {name} at {here}", SETTLED)

    def add_rule(self) -> str:
        here = self.random.choice(NAMES)
        others = [name for name in NAMES if name != here]
        kind, names = self.random.choice(
            [
                ("publisher", [*TOPICS, *LATCHED, "/t.*", "/[tl]0", "/t[12]"]),
                ("subscriber", [*TOPICS, *LATCHED, "/t.*", "/[tl]0", "/t[12]"]),
                ("service", [*SERVICES, "/s.*"]),
            ]
        )
        action = self.random.choice(["advertise", "flip", "flip", "pull", "pull"])
        if (action, kind) == ("flip", "service") and self.random.random() < 0.5:
            action = "advertise"
        rule = Rule(
            action,
            "" if action == "advertise" else self.random.choice([*others, "g.*"]),
            kind,
            self.random.choice(names),
            self.random.choice(["", "", "", *NODES, "/n[01]"]),
        )
        if rule in self.model.gateways[here].rules:
            return ""
        self._set(here, rule)
        self.model.gateways[here].rules.append(rule)
        return f"{here}: {_text(rule)}"

    def cancel_rule(self) -> str:
        found = [(here, rule) for here, one in self.model.gateways.items() for rule in one.rules]
        if not found:
            return ""
        here, rule = self.random.choice(found)
        self._set(here, rule, cancel=True)
        self.model.gateways[here].rules.remove(rule)
        return f"{here}: cancel {_text(rule)}"

    def _set(self, here: str, rule: Rule, cancel: bool = False) -> None:
        sent = msg.Rule(rule.kind, rule.name, rule.node)
        if rule.action == "pull":
            self.sites[here].connected()  # a pull needs the hub
        if rule.action == "advertise":
            answer = self.sites[here].call("advertise", srv.Advertise, rules=[sent], cancel=cancel)
        else:
            answer = self.sites[here].remote(
                rule.action, rule.gateway, rule.kind, rule.name, rule.node, cancel
            )
        assert answer.result == 0, f"{here}: {_text(rule)}: {answer}"

    def kill_gateway(self) -> str:
        here = self.random.choice(NAMES)
        how = self.random.choice([signal.SIGKILL, signal.SIGINT])
        site = self.sites[here]
        os.kill(site.pid, how)
        wait_until(lambda: not self.fleet.group.is_running(here), "the gateway's end", SETTLED)
        site.start()
        for rule in self.model.gateways[here].rules:
            self._set(here, rule)
        return f"{here}: the gateway gets {how.name} and starts again"

    def freeze_gateway(self) -> str:
        here = self.random.choice(NAMES)
        seconds = self.random.choice([1.5, 11.0])
        pids = self.fleet.family(self.sites[here].pid)
        self.fleet.signal(pids, signal.SIGSTOP)
        time.sleep(seconds)
        self.fleet.signal(pids, signal.SIGCONT)
        return f"{here}: the gateway is frozen for {seconds} s"

    def kill_hub(self) -> str:
        for pid in self.fleet.family(self.fleet.hub_pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        wait_until(lambda: not self.fleet.group.is_running("hub"), "the hub's end", SETTLED)
        self.fleet.start_hub()
        wait_until(self.fleet.redis_pid, "the new hub's Redis", SETTLED)
        return "the hub is killed and starts again"

    def restart_master(self) -> str:
        here = self.random.choice(NAMES)
        nodes = self.model.gateways[here].nodes
        living = {name: node for name, node in nodes.items() if node.lives}
        for name in living:
            self._end(here, name, signal.SIGKILL)
        nodes.clear()
        parameters = self.masters[here].get_param("/gateway")
        self.masters[here].restart()
        self.masters[here].set_param("/gateway", parameters)
        for name, node in living.items():
            self._start(here, name, node)
        wait_until(
            lambda: "/gateway/flip" in self.masters[here].system_state()[2],
            f"{here}'s gateway on its new master",
            SETTLED,
        )
        return f"{here}: the master is killed and starts again, with its nodes"

    # Checks

    def check(self) -> None:
        """Compares the fleet with the model. Raises AssertionError."""
        began = time.monotonic()
        self._await(self._wrong_registrations, began)
        agreed = time.monotonic()
        self._await(lambda: self._unheard(agreed), began)
        self._await(self._wrong_answers, began)
        self._await(self._wrong_states, began)
        self.slowest = max(self.slowest, time.monotonic() - began)
        # What was under way when the registrations changed may still arrive.
        time.sleep(UNDER_WAY)
        observed = time.monotonic()
        time.sleep(WINDOW)
        assert not (found := self._wrong_messages(observed)), found
        assert not (found := self._wrong_registrations()), found
        self.checks += 1

    def _await(self, wrong: Callable[[], str], began: float) -> None:
        with contextlib.suppress(WaitError):
            wait_until(lambda: not wrong(), "agreement", began + SETTLED - time.monotonic())
            return
        assert not (found := wrong()), f"after {SETTLED:g} s: {found}"

    def _wrong_registrations(self) -> str:
        for here in NAMES:
            publishers, _, services = self.masters[here].system_state()
            for topic in (*TOPICS, *LATCHED):
                expected = {
                    name if there == here else f"/{there}{name}"
                    for there, name in self.model.senders(here, topic)
                }
                found = set(publishers.get(topic, []))
                if found != expected:
                    return f"{here} lists as publishers of {topic} {found}, not {expected}"
            self.model.forget_replaced(here, services)
            for service in SERVICES:
                if bool(self.model.servers(here, service)) != (service in services):
                    return f"{here} lists {services.get(service)} as server of {service}"
        return ""

    def _expected(self) -> dict[tuple[str, str, str], set[str]]:
        """Returns, for each subscriber and topic, the runs that it must hear."""
        return {
            (here, name, topic): self.model.runs(here, name, topic)
            for here, gateway in self.model.gateways.items()
            for name, node in gateway.nodes.items()
            if node.lives
            for topic in node.subscribes
        }

    def _unheard(self, since: float) -> str:
        for ear in self.ears.values():
            ear.read()
        for (here, name, topic), runs in self._expected().items():
            heard = self.ears[here, name].heard
            for run in runs:
                rows = heard.get((topic, run), [])
                if not rows or (topic not in LATCHED and rows[-1][0] < since):
                    return f"{name} of {here} hears nothing of {run} on {topic}"
        return ""

    def _wrong_messages(self, observed: float) -> str:
        """Looks for losses, duplicates and unexpected senders in the messages since `observed`."""
        for ear in self.ears.values():
            ear.read()
        expected = self._expected()
        for (here, name), ear in self.ears.items():
            for (topic, run), rows in ear.heard.items():
                late = [number for moment, number in rows if moment >= observed]
                who = f"{name} of {here} on {topic}"
                if late and run not in expected.get((here, name, topic), set()):
                    return f"{who} hears {run}, which no rule brings"
                if topic in LATCHED:
                    continue
                numbers = [number for _, number in rows]
                if numbers != sorted(set(numbers)):
                    return f"{who} hears messages of {run} twice or out of order: {numbers[-50:]}"
                if late and late != list(range(late[0], late[0] + len(late))):
                    return f"{who} misses messages of {run}: {late}"
        for (here, name, topic), runs in expected.items():
            if topic not in LATCHED:
                for run in runs:
                    rows = self.ears[here, name].heard[topic, run]
                    if rows[-1][0] < observed:
                        return f"{name} of {here} hears {run} on {topic} no more"
        return ""

    def _wrong_answers(self) -> str:
        for here in NAMES:
            for service in SERVICES:
                servers = self.model.servers(here, service)
                answers = {node.run for _, node in servers if node.lives}
                try:
                    answer = self._ask(here, service)
                except (ClientError, OSError) as error:
                    answer = "" if len(answers) < len(servers) or not servers else str(error)
                if answer and answer not in answers:
                    return f"{service} at {here} answers {answer!r}, not one of {answers}"
        return ""

    def _ask(self, here: str, service: str) -> str:
        client = Client(self.masters[here].uri, "/test")
        return str(client.call(service, Trigger).message)

    def _wrong_states(self) -> str:
        for here, gateway in self.model.gateways.items():
            try:
                states = self.sites[here].states()
            except (ClientError, OSError) as error:
                return f"{here}'s gateway does not answer: {error}"
            for rule in gateway.rules:
                if (rule.action, rule.kind) == ("flip", "subscriber") and rule.is_plain:
                    alike = [one for one in gateway.rules if one.action == "flip"]
                    if [one.name for one in alike].count(rule.name) > 1:
                        continue  # `states` does not tell them apart
                    is_active = states[f"flip {rule.name}"].startswith("active")
                    if is_active not in self.model.may_be_active(here, rule):
                        return f"{here}: {_text(rule)} is {states[f'flip {rule.name}']!r}"
        return ""


def _text(rule: Rule) -> str:
    of = f" of {rule.node}" if rule.node else ""
    return f"{rule.action} {rule.gateway} {rule.kind} {rule.name}{of}".replace("  ", " ")


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def test_random_steps_agree_with_the_model(fleets, tmp_path: Path) -> None:
    minutes = float(os.environ.get("PIONEER_SOAK_MINUTES", "2"))
    seed = int(os.environ.get("PIONEER_SOAK_SEED", "1"))
    end = time.monotonic() + 60 * minutes
    rounds = steps = checks = 0
    while time.monotonic() < end:
        folder = tmp_path / str(seed)
        folder.mkdir()
        one = Round(fleets(folder), seed)
        try:
            one.start()
            while len(one.history) < STEPS and time.monotonic() < end:
                for _ in range(one.random.choice([1, 1, 2, 3])):
                    one.step()
                one.check()
        except BaseException:
            say("\n".join([f"seed {seed}, {len(one.history)} steps:", *one.history]))
            raise
        finally:
            one.close()
        for log in folder.glob("*.log"):
            assert "Traceback" not in log.read_text(errors="replace"), log
        rounds, steps, checks = rounds + 1, steps + len(one.history), checks + one.checks
        say(
            f"seed {seed}: {len(one.history)} steps, {one.checks} checks, slowest agreement after "
            f"{one.slowest:.1f} s; in all {rounds} seeds, {steps} steps, {checks} checks, "
            f"{max(0.0, end - time.monotonic()) / 60:.0f} minutes left"
        )
        seed += 1
