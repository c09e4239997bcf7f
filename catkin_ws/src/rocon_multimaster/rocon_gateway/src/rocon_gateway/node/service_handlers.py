"""The gateway's services: validate requests, change the rules atomically, and respond once the change is published."""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from gateway_msgs import srv

from pioneer_node.adapters.node_handle import NodeHandle
from rocon_gateway.error import GatewayError, RequestError
from rocon_gateway.hub.conversions import message_from_record
from rocon_gateway.hub.hubs import Hubs
from rocon_gateway.rules.conversions import (
    message_from_rule,
    remote_rules_from_messages,
    rules_from_messages,
)
from rocon_gateway.rules.rulebook import RuleBook, check_gateway
from rocon_hub_protocol.code import Code, HubError
from rocon_relay.relay import TcpRelay


class ServiceHandlers:
    """Holds the rules and serves requests to change them.

    Args:
        node: the gateway's node.
        book: the initial rules.
        hubs: our hubs.
        relay: provides the latencies to other gateways.
        settle: called after each change, from a service's thread; returns once topics report the result.
        set_period: sets the longest time between reconciliations [s] and returns the old value.
    """

    def __init__(
        self,
        node: NodeHandle,
        book: RuleBook,
        hubs: Hubs,
        relay: TcpRelay,
        settle: Callable[[], None],
        set_period: Callable[[float], float],
    ) -> None:
        self._node = node
        self._book = book
        self._hubs = hubs
        self._relay = relay
        self._settle = settle
        self._set_period = set_period
        self._lock = threading.Lock()

    def open(self) -> None:
        """Offers the services."""
        services: tuple[tuple[str, Any, Callable[[Any], Any]], ...] = (
            ("advertise", srv.Advertise, self._advertise),
            ("advertise_all", srv.AdvertiseAll, self._advertise_all),
            ("flip", srv.Remote, partial(self._remote, "flip")),
            ("flip_all", srv.RemoteAll, partial(self._remote_all, "flip")),
            ("pull", srv.Remote, partial(self._remote, "pull")),
            ("pull_all", srv.RemoteAll, partial(self._remote_all, "pull")),
            ("connect_hub", srv.ConnectHub, self._connect_hub),
            ("remote_gateway_info", srv.RemoteGatewayInfo, self._remote_gateway_info),
            ("set_watcher_period", srv.SetWatcherPeriod, self._set_watcher_period),
        )
        for name, kind, handler in services:
            self._node.serve(f"~{name}", kind, handler, may_wait=True)

    @property
    def book(self) -> RuleBook:
        """The current rules."""
        return self._book

    def _change(self, change: Callable[[RuleBook], RuleBook]) -> tuple[int, str]:
        """Applies a change; returns result and error message. After an error, the rules are unchanged."""
        try:
            with self._lock:
                self._book = change(self._book)
        except GatewayError as error:
            self._node.logger.warning("refused: %s", error)
            return int(
                error.code if isinstance(error, RequestError) else Code.HUB_UNKNOWN_ERROR
            ), str(error)
        self._settle()
        return int(Code.SUCCESS), ""

    def _need_hub(self) -> None:
        if not self._hubs.view().connected:
            raise RequestError(
                Code.NO_HUB_CONNECTION, "there is no hub connection yet; see connect_hub"
            )

    def _advertise(self, request: srv.AdvertiseRequest) -> srv.AdvertiseResponse:
        def change(book: RuleBook) -> RuleBook:
            rules = rules_from_messages(request.rules, Code.UNKNOWN_ADVERTISEMENT_ERROR)
            return book.unadvertised(rules) if request.cancel else book.advertised(rules)

        result, message = self._change(change)
        watchlist = [message_from_rule(rule) for rule in self._book.advertisements.rules]
        return srv.AdvertiseResponse(result, message, watchlist)

    def _advertise_all(self, request: srv.AdvertiseAllRequest) -> srv.AdvertiseAllResponse:
        def change(book: RuleBook) -> RuleBook:
            rules = rules_from_messages(request.blacklist, Code.UNKNOWN_ADVERTISEMENT_ERROR)
            return book.advertising_nothing() if request.cancel else book.advertising_all(rules)

        result, message = self._change(change)
        book = self._book
        in_force = dict.fromkeys((*book.blacklist, *book.advertisements.blacklist))
        return srv.AdvertiseAllResponse(
            result, message, [message_from_rule(rule) for rule in in_force]
        )

    def _remote(self, action: str, request: srv.RemoteRequest) -> srv.RemoteResponse:
        def change(book: RuleBook) -> RuleBook:
            if action == "pull" and not request.cancel:
                self._need_hub()
            remotes = remote_rules_from_messages(request.remotes, Code.HUB_UNKNOWN_ERROR)
            return book.removed(action, remotes) if request.cancel else book.added(action, remotes)

        return srv.RemoteResponse(*self._change(change))

    def _remote_all(self, action: str, request: srv.RemoteAllRequest) -> srv.RemoteAllResponse:
        def change(book: RuleBook) -> RuleBook:
            if request.cancel:
                return book.without(action, request.gateway)
            self._need_hub()
            check_gateway(request.gateway, Code.HUB_UNKNOWN_ERROR)
            rules = rules_from_messages(request.blacklist, Code.HUB_UNKNOWN_ERROR)
            return book.with_all(action, request.gateway, rules)

        return srv.RemoteAllResponse(*self._change(change))

    def _connect_hub(self, request: srv.ConnectHubRequest) -> srv.ConnectHubResponse:
        try:
            self._hubs.connect(request.uri)
        except HubError as error:
            return srv.ConnectHubResponse(int(error.code), str(error))
        self._settle()
        return srv.ConnectHubResponse(int(Code.SUCCESS), "")

    def _remote_gateway_info(
        self, request: srv.RemoteGatewayInfoRequest
    ) -> srv.RemoteGatewayInfoResponse:
        found = self._hubs.describe(request.gateways)
        for name in set(request.gateways) - {one.record.name for one in found}:
            self._node.logger.warning("there is no gateway '%s' on our hubs", name)
        latencies = self._relay.status().latencies
        return srv.RemoteGatewayInfoResponse(
            [
                message_from_record(one.record, one.silence, latencies.get(one.record.name))
                for one in found
            ]
        )

    def _set_watcher_period(
        self, request: srv.SetWatcherPeriodRequest
    ) -> srv.SetWatcherPeriodResponse:
        return srv.SetWatcherPeriodResponse(self._set_period(request.period))
