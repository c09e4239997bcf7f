"""The node `gateway`."""

import contextlib
import logging
import math
import os
import sys
import threading
import time
import uuid
from collections.abc import Callable
from functools import partial
from pathlib import Path

import rosgraph
from diagnostic_msgs.msg import DiagnosticArray
from gateway_msgs.msg import GatewayInfo, RemoteRuleWithStatus
from std_msgs.msg import Empty

from pioneer_node.adapters.node_handle import LOGGER, NodeHandle
from pioneer_node.adapters.node_process import NodeProcess
from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes.node_host import leave
from rocon_gateway.doctor.examiner import Examiner
from rocon_gateway.error import GatewayError
from rocon_gateway.hub.address import interface_address, own_address
from rocon_gateway.hub.hubs import Hubs, HubsConfig
from rocon_gateway.hub.kept_folder import KeptFolder
from rocon_gateway.hub.membership import Overview
from rocon_gateway.master.bell import LOOK_PERIOD, MasterBell
from rocon_gateway.master.leftovers import remove_leftovers
from rocon_gateway.master.line import MasterError
from rocon_gateway.master.liveness import NodeExaminer
from rocon_gateway.master.watch import MasterWatch
from rocon_gateway.node.computer import ComputerTopic, LogTopic
from rocon_gateway.node.config import GatewayConfig, book_from_config
from rocon_gateway.node.conversions import diagnostic_from_link
from rocon_gateway.node.custom_rules import with_rules_file
from rocon_gateway.node.service_handlers import ServiceHandlers
from rocon_gateway.rules import verdict
from rocon_gateway.rules.conversions import (
    diagnostic_from_state,
    message_from_remote_rule,
    message_from_rule,
)
from rocon_gateway.rules.reconcile import reconcile
from rocon_gateway.rules.situation import Outcome, Situation
from rocon_hub_protocol.code import HubProtocolError
from rocon_hub_protocol.password import password_from
from rocon_hub_protocol.record import Record
from rocon_hub_protocol.redis_client import OPEN, Access
from rocon_hub_protocol.sighting import LOOPBACK
from rocon_relay.connection import Export, Import, LinkState, LinkStatus, RelayConfig, Subject
from rocon_relay.keyring import PasswordKeyring
from rocon_relay.relay import TcpRelay
from rocon_relay.traffic import Traffic
from tcpros.descriptor import raise_limit
from tcpros.error import CertificateError
from tcpros.loop_faults import LoopFaults
from tcpros.reactor import Reactor
from tcpros.tls import Certificates, certificates_from

_HUB = "/hub"
SETTLE = 1.0
"""How long a service waits until topics report its changes [s]; limited, because the master may delay that."""

_AFTER_FAULT = 1.0
"""Pause after a step of the loop that has failed [s]."""

_REST, _LONGEST_REST = 3.0, 0.25
"""Pause after a turn, as a multiple of its duration, and its limit [s]. Turns of a large fleet take about 0.02 s."""

DIAGNOSTIC_PERIOD = 1.0
"""Time between two messages on `/diagnostics` [s]."""


class GatewayNode:
    """Connects this master's topics, services and actions with those of other masters, by rules.

    Subscribes: `~force_update` (Empty): reconciles immediately. The relay subscribes to exported topics while another
    gateway fetches them.

    Publishes: `~gateway_info` (GatewayInfo, latched, on change), `~rules` (DiagnosticArray, latched, on change: one
    status per rule, with state and reason), `/diagnostics` (the same, plus one status per connection with its data
    rates, every second while there are subscribers), a robot's `/NAMESPACE/computer` (`ComputerTopic`)
    and `/NAMESPACE/rosout_agg` (`LogTopic`).

    Services: see `ServiceHandlers`.

    Parameters: the fields of `GatewayConfig`, private.

    Threads: the main thread runs the node and the relay; another one reconciles. Each hub and each service call has
    its own thread.

    On error: an invalid parameter ends the node with one line. An invalid default rule is logged and skipped. A lost
    hub or master is logged once; the node waits for it to return.
    """

    def __init__(self, node: NodeHandle, reactor: Reactor, failed: Callable[[], object]) -> None:
        """Takes the node, its event loop, and a callback for an internal error that ends the reconciling thread."""
        self._node, self._logger, self._failed = node, logging.getLogger(LOGGER), failed
        self._config = config_from_mapping(
            GatewayConfig, with_rules_file(node.parameters(), self._logger), node.name
        )
        self._period = self._config.watch_loop_period
        self._options = self._config.options()
        self._name, self._instance = self._config.unique_name(), uuid.uuid4().hex
        book, complaints = book_from_config(self._config, self._name)
        for complaint in complaints:
            self._logger.error("rule left out: %s", complaint)
        self._reader, self._writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._registered, self._stopping, self._opened = threading.Event(), threading.Event(), False
        access = Access(password_from(self._config.hub_password_file), self._certificates())
        self._keyring = PasswordKeyring(access.password) if access.password else None
        self._is_open = access != OPEN or self._config.insecure
        interface = self._config.network_interface
        self._fixed_host = (
            LOOPBACK if not self._is_open else interface_address(interface) if interface else ""
        )
        self._warn(access)
        self._host = self._fixed_host or own_address("")
        self._info = node.advertise("~gateway_info", GatewayInfo, latch=True)
        self._rules = node.advertise("~rules", DiagnosticArray, latch=True)
        self._diagnostics = node.advertise("/diagnostics", DiagnosticArray)
        namespace, master_uri = self._config.own_namespace, rosgraph.get_master_uri()
        self._own: list[ComputerTopic | LogTopic] = []
        if namespace:
            self._own = [
                ComputerTopic(node, master_uri, self._name, namespace),
                LogTopic(node, namespace),
            ]
        crossing = {one.topic for one in self._own}
        self._master = MasterWatch(master_uri, node.name, crossing)
        self._bell = MasterBell(master_uri, node.name)
        self._examiner = NodeExaminer(master_uri, node.name, self._wake)
        self._reported_dead: frozenset[str] = frozenset()
        self._master_lost = self._master_forgot = False
        self._traffic = Traffic()
        self._outcome = Outcome()
        self._said: tuple[object, object] = (None, None)
        self._uncovered: set[tuple[str, str]] = set()
        self._kept = (
            KeptFolder(Path(self._config.kept_folder), self._logger)
            if self._config.kept_folder
            else None
        )
        self._relay = TcpRelay(
            self._relay_config(), self._wake, self._logger, access.certificates, reactor
        )
        self._hubs = Hubs(
            self._hub_config(access),
            self._record(),
            self._linked,
            self._wake,
            self._logger,
            Examiner().asked,
        )
        self._faults = LoopFaults(self._logger, "the gateway's loop")
        self._turned, self._begun, self._done = threading.Condition(), 0, 0
        self._handlers = ServiceHandlers(
            node, book, self._hubs, self._relay, self._settle, self._set_period
        )
        node.subscribe("~force_update", Empty, lambda _message, _sender: self._wake())
        self._ended: Callable[[], object] = lambda: None
        self._thread = threading.Thread(target=self._run, name="compare", daemon=True)
        node.call(self._thread.start)  # started by the running loop, because the thread uses it

    def _certificates(self) -> Certificates | None:
        found = certificates_from(self._config.tls_directory)
        fault = found.fault() if found else ""
        if fault:
            # Not fatal: the reason may be a clock that is not set yet.
            self._logger.error(
                "no other gateway accepts our certificate (%s in %s)",
                fault,
                found and found.directory,
            )
        return found

    def _warn(self, access: Access) -> None:
        if access == OPEN and self._is_open:
            self._logger.warning(
                "INSECURE: any host on the network can link to this gateway. "
                "Use it on a network of your own only, or set a password"
            )
        elif not self._is_open:
            self._logger.info(
                "neither password nor certificate is set, so only gateways on this machine can link to this one. For "
                "others set ROCON_HUB_PASSWORD_FILE or ROCON_TLS_DIRECTORY here and there, or gateway_insecure:=true"
            )

    def _relay_config(self) -> RelayConfig:
        return RelayConfig(
            gateway=self._name,
            node=self._node.name,
            master_uri=rosgraph.get_master_uri(),
            host=rosgraph.network.get_host_name(),
            # As for every node: with a loopback ROS_IP, other machines can reach only the links.
            node_bind=rosgraph.network.get_bind_address(),
            port=self._config.relay_port,
            bind="" if self._is_open else LOOPBACK,
            # Only gateways that may join the hub may open links.
            keyring=self._keyring,
            max_message_size=self._config.max_message_size,
        )

    def _hub_config(self, access: Access) -> HubsConfig:
        return HubsConfig(
            uris=self._config.hub_uris,
            whitelist=self._config.hubs_allowed,
            blacklist=self._config.hubs_refused,
            discover=self._config.discovers,
            distant=self._is_open,
            access=access,
            host=self._fixed_host,
            namespaces=self._config.known_namespaces,
            restore=self._kept.restore if self._kept else lambda text: text,
            **({"learn": self._keyring.learn} if self._keyring else {}),
        )

    def end(self, done: Callable[[], object]) -> None:
        """Starts the shutdown; calls ``done`` when everything is unregistered, from any thread."""
        self._ended = done
        self._stopping.set()
        self._registered.set()
        with self._turned:
            self._turned.notify_all()
        self._wake()

    def _run(self) -> None:
        try:
            with self._faults:
                self._remove_leftovers()
            with self._faults:
                self._turn()
            self._node.call(self._handlers.open)
            self._node.call(partial(self._node.when_registered, self._registered.set))
            self._registered.wait()
            self._opened = True
            self._logger.info("gateway '%s', relay on port %d", self._name, self._relay.port)
            with self._faults:
                _warn_on_the_hubs_master(self._node)
            self._loop()
        except Exception:  # top level of this thread: any exception here is a bug
            self._logger.critical("the gateway ended by an error", exc_info=True)
            self._failed()
        finally:
            ends: tuple[Callable[[], object], ...] = (
                self._hubs.shutdown,
                self._relay.shutdown,
                self._master.close,
                self._bell.close,
                partial(self._examiner.examine, frozenset()),
            )
            for end in ends:
                with self._faults:
                    end()
            self._stopping.wait()
            self._ended()

    def _remove_leftovers(self) -> None:
        try:
            removed = remove_leftovers(rosgraph.get_master_uri(), self._node.name, self._name)
        except MasterError:
            return  # `_look` reports an unreachable master
        if removed:
            self._logger.warning(
                "removed proxies of a killed gateway of our name from this master: %s",
                ", ".join(removed),
            )

    def _loop(self) -> None:
        full = diagnose = 0.0
        steps = self._faults
        while not self._stopping.is_set():
            woken = changed = False
            with steps:
                woken = self._is_woken(diagnose - time.monotonic())
            failed = steps.has_failed
            now = time.monotonic()
            with steps:
                changed = self._bell.is_due and self._look()
            failed = failed or steps.has_failed
            if changed or woken or now >= full:
                full = now + self._period
                with steps:
                    self._turn()
                failed = failed or steps.has_failed
                # Changes come in bursts; the next turn handles all that arrive during the pause.
                self._stopping.wait(min(_REST * (time.monotonic() - now), _LONGEST_REST))
            if now >= diagnose:
                diagnose = now + DIAGNOSTIC_PERIOD
                for step in (self._refresh_keys, self._keep, *self._own_turns(), self._diagnose):
                    with steps:
                        step()
            if failed:
                self._stopping.wait(_AFTER_FAULT)

    def _is_woken(self, limit: float) -> bool:
        """Waits until a poll of the master is due or something has changed; returns whether the latter."""
        woken = self._bell.wait(self._reader, limit)
        if woken:
            with contextlib.suppress(BlockingIOError):
                os.read(self._reader, 4096)
        return woken

    def _refresh_keys(self) -> None:
        if self._keyring:
            self._keyring.refresh()

    def _keep(self) -> None:
        if self._kept and (kept := self._kept.text()) is not None:
            self._hubs.keep(kept)

    def _own_turns(self) -> list[Callable[[], object]]:
        return [topic.turn for topic in self._own]

    def _diagnose(self) -> None:
        if self._diagnostics.has_subscribers:
            array = self._diagnostic_array(with_links=True)
            self._node.call(partial(self._diagnostics.publish, array))

    def _look(self) -> bool:
        try:
            changed = self._master.changed()
            self._register_again_if_forgotten()
        except (MasterError, OSError) as error:
            if not self._master_lost:
                self._logger.warning("%s; running links stay up", error)
            self._master_lost = True
            return False
        if self._master_lost:
            self._master_lost = False
            self._logger.warning("the ROS master answers again")
            self._relay.refresh()
        return changed

    def _register_again_if_forgotten(self) -> None:
        """Registers everything again at a restarted master; repeated at each look until the master knows us."""
        if not self._opened or self._stopping.is_set():
            return
        forgot, self._master_forgot = self._master_forgot, not self._master.knows_us
        if not self._master_forgot:
            return
        self._node.call(self._node.register_again)
        if forgot:
            self._relay.refresh()
        else:
            # Parameters only once: later, they would replace what has been set at the new master.
            self._relay.restore()
            self._logger.warning("the ROS master was restarted; registered again")

    def _turn(self) -> None:
        """Reconciles once: compares the desired with the actual state, applies the difference and publishes it."""
        with self._turned:
            self._begun += 1
        view = self._hubs.view()
        book = self._handlers.book
        status = self._relay.status()
        if any(link.state is LinkState.TYPE_MISMATCH for link in status.exports.values()):
            self._master.read_types()
            self._bell.look_again()
        situation = Situation(
            book=book,
            firewall=self._config.firewall,
            local=self._master.local,
            connected=view.connected,
            names=view.names,
            remotes=view.remotes,
            links=status.imports,
            options=self._options,
            namespace=self._config.own_namespace,
            robots=view.namespaces,
            dead=self._examiner.dead,
        )
        self._outcome = outcome = reconcile(situation)
        self._examiner.examine(outcome.barring)
        if situation.dead:
            # A proxy may take the name of a dead node.
            self._master.look_up_again(situation.dead)
            self._bell.look_again()
        self._report_dead(situation.dead)
        self._relay.apply(outcome.exports, outcome.imports)
        interest = frozenset(remote.gateway for remote in (*book.flips.rules, *book.pulls.rules))
        self._hubs.publish(self._record(outcome), outcome.requests, interest)
        self._tell(view)
        with self._turned:
            self._done = self._begun
            self._turned.notify_all()

    def _settle(self) -> None:
        """Triggers a reconciliation and waits until its result is published, up to `SETTLE`."""
        with self._turned:
            # A turn in progress may have read the rules before the change.
            due = self._begun + 1
        self._wake()
        with self._turned:
            self._turned.wait_for(lambda: self._done >= due or self._stopping.is_set(), SETTLE)

    def _record(self, outcome: Outcome | None = None) -> Record:
        book = self._handlers.book if outcome else None
        return Record(
            name=self._name,
            instance=self._instance,
            host=self._host,
            port=self._relay.port,
            firewall=self._config.firewall,
            advertisements=outcome.advertised if outcome else (),
            flips=book.flips.rules if book else (),
            pulls=book.pulls.rules if book else (),
            namespace=self._config.own_namespace,
        )

    def _linked(self) -> set[str]:
        """Returns the gateways with open links; parameters have no permanent link."""
        status = self._relay.status()
        up = {
            LinkState.ACTIVE,
            LinkState.RATE_LIMITED,
            LinkState.MTU,
            LinkState.NO_PUBLISHER,
            LinkState.NO_SERVER,
        }
        links: list[tuple[Export | Import, LinkStatus]] = [
            *status.imports.items(),
            *status.exports.items(),
        ]
        return {
            one.key.gateway
            for one, link in links
            if link.state in up and one.subject is not Subject.PARAMETER
        }

    def _tell(self, view: Overview) -> None:
        info = self._gateway_info(view)
        if info != self._said[0]:
            self._node.call(partial(self._info.publish, info))
        if self._outcome.states != self._said[1]:
            self._node.call(partial(self._rules.publish, self._diagnostic_array()))
            self._report_uncovered()
        self._said = (info, self._outcome.states)

    def _report_uncovered(self) -> None:
        """Logs, once per rule, that a local subscriber gets no data because the rule is for another node only."""
        for state in self._outcome.states:
            key = (state.gateway, state.rule.name)
            if verdict.UNCOVERED in state.verdict.reason and key not in self._uncovered:
                self._uncovered.add(key)
                self._logger.warning(
                    "%s comes from %s %s", state.rule.name, state.gateway, state.verdict.reason
                )

    def _report_dead(self, dead: frozenset[str]) -> None:
        """Logs each dead node once, as long as it stays dead."""
        for node in sorted(dead - self._reported_dead):
            self._logger.warning(
                "%s is registered on this master, but nothing listens at its address any more; "
                "what it barred is relayed ('rosnode cleanup' removes dead nodes)",
                node,
            )
        self._reported_dead = dead

    def _gateway_info(self, view: Overview) -> GatewayInfo:
        book, outcome = self._handlers.book, self._outcome
        rules = partial(map, message_from_rule)
        remotes = partial(map, message_from_remote_rule)
        return GatewayInfo(
            name=self._name,
            discover_hubs_by_zeroconf=self._config.discovers,
            discover_hubs_by_uri=list(self._config.hub_uris),
            connected=view.connected,
            ip=view.hubs[0].host if view.connected else self._host,
            hub_names=[hub.hub_name for hub in view.hubs],
            hub_uris=[hub.hub_uri for hub in view.hubs],
            firewall=self._config.firewall,
            public_watchlist=[*rules(book.advertisements.rules)],
            public_interface=[*rules(outcome.advertised)],
            flipped_connections=[
                RemoteRuleWithStatus(rule, one.status)
                for rule, one in zip(remotes(outcome.flipped), outcome.flipped, strict=True)
            ],
            flip_watchlist=[*remotes(book.flips.rules)],
            flipped_in_connections=[*remotes(outcome.flipped_in)],
            pull_watchlist=[*remotes(book.pulls.rules)],
            pulled_connections=[*remotes(outcome.pulled)],
        )

    def _diagnostic_array(self, with_links: bool = False) -> DiagnosticArray:
        array = DiagnosticArray(
            status=[diagnostic_from_state(state, self._name) for state in self._outcome.states]
        )
        if with_links:
            status = self._relay.status()
            rows: list[tuple[Export | Import, LinkStatus]] = [
                *status.exports.items(),
                *status.imports.items(),
            ]
            links = dict(rows)
            flows = self._traffic.look(time.monotonic(), links)
            array.status += [
                diagnostic_from_link(one, link, flows[one], status.latencies, self._name)
                for one, link in links.items()
            ]
        array.header.stamp = self._node.stamp()
        return array

    def _set_period(self, period: float) -> float:
        last = self._period
        if math.isnan(period):
            self._logger.warning("set_watcher_period: nan is no period; %g s is kept", last)
        else:
            self._period = max(float(period), LOOK_PERIOD)
        return last

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._writer, b"x")


def _warn_on_the_hubs_master(node: NodeHandle) -> None:
    uri = rosgraph.get_master_uri()
    try:
        rosgraph.Master(node.name).lookupNode(_HUB)
    except (rosgraph.MasterError, OSError):
        return  # `MasterWatch` detects an unreachable master
    node.logger.warning(
        "%s is the hub's own ROS master; a gateway needs one of its own. End this one, then: "
        "export ROS_MASTER_URI=http://localhost:11313; roslaunch pioneer_networking pioneer_gateway.launch", uri
    )  # fmt: skip


def main() -> int:
    """Entry point of the executables `gateway` and `gateway.py`."""
    raise_limit()
    process = NodeProcess(sys.argv, (GatewayError, HubProtocolError, CertificateError))
    reactor = process.context.reactor
    if not process.add(
        process.own_name("gateway"), lambda node: GatewayNode(node, reactor, process.fail)
    ):
        process.fail()
    leave(process.run())
