"""Base classes of imports: a link with automatic reconnection, and a proxy registered while the link is up."""

import enum
import secrets
from collections.abc import Callable
from typing import Any

from rocon_relay.connection import ANY, Import, LinkState
from rocon_relay.context import Context
from rocon_relay.dialled_link import DialledLink
from rocon_relay.link import Hello
from rocon_relay.path import advice
from rocon_relay.proxy_node import ProxyNode, ProxyNodes
from tcpros.reactor import Timer
from tcpros.xmlrpc_client import NoAnswer

UNREGISTER_ATTEMPTS = 3
"""Number of attempts to unregister at a master that does not answer; afterwards a dead entry may stay there."""

CLOSE_AFTER = 0.5
"""Delay between an unregistration and closing the users, if the master does not answer earlier [s]."""


class DialledImport:
    """Opens the link and retries after each failure.

    Args:
        context: shared by all parts of the relay.
        wanted: the import; may be replaced by one with the same key.
        ended: called once after `end`, when everything is unregistered and closed.
    """

    link_class: type[DialledLink] = DialledLink  #: the kind of link

    def __init__(self, context: Context, wanted: Import, ended: Callable[[], None]) -> None:
        self.wanted = wanted
        self._context = context
        self._ended = ended
        self._link: DialledLink | None = None
        self._timer: Timer | None = None
        self._pause = context.pause()
        self._is_ending = False
        self._state = LinkState.PENDING
        self._reason = "dialling"

    def hello(self) -> Hello:
        """Returns the hello of a link for this import."""
        config, wanted = self._context.config, self.wanted
        keys = config.keyring.names() if config.keyring else ()
        source, sink, nonce = wanted.source_gateway, config.gateway, secrets.token_hex(16)
        return Hello(
            wanted.topic,
            ANY,
            ANY,
            wanted.source_node,
            source,
            sink,
            (sink,),
            nonce,
            wanted.subject,
            keys,
        )

    def start(self) -> None:
        """Connects, retrying after each failure until `end`."""
        self._timer = None
        if self._is_ending:
            return
        self._context.resolver.resolve(
            self.wanted.address.host,
            self._dial,
            lambda reason: self.link_lost(LinkState.UNREACHABLE, reason),
        )

    def end(self) -> None:
        """Stops connecting."""
        self._is_ending = True
        if self._timer is not None:
            self._timer.cancel()

    def link_up(self, _fields: dict[str, str]) -> None:
        """Called with the welcome when the link is up."""

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Schedules the next attempt."""
        self._link = None
        self._retry(state, reason)

    def _retry(self, state: LinkState, reason: str) -> None:
        if not self._is_ending:
            self._set(state, reason)
            self._timer = self._context.reactor.call_later(self._pause.take(), self.start)

    def _dial(self, host: str) -> None:
        if not self._is_ending:
            self._link = self.link_class(self._context, self, self.wanted.address, self.hello())
            self._link.connect(host, self.wanted.address.port)

    def _set(self, state: LinkState, reason: str) -> None:
        if (state, reason) != (self._state, self._reason):
            self._state, self._reason = state, reason
            self._context.changed()


class StandingImport(DialledImport):
    """Keeps a link open and registers the proxy's topic or service while it is up."""

    def __init__(
        self, context: Context, nodes: ProxyNodes, wanted: Import, ended: Callable[[], None]
    ) -> None:
        super().__init__(context, wanted, ended)
        self.registration = Registration(context, nodes, self)

    def offered_by(self, node: ProxyNode) -> dict[str, Any]:
        """Returns the topics or services of the proxy node, to which this import belongs."""
        raise NotImplementedError

    def registering(self, node: ProxyNode) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method that registers it, and the arguments after the node's name."""
        raise NotImplementedError

    def unregistering(self, node: ProxyNode) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method that unregisters it, and the arguments after the node's name."""
        raise NotImplementedError

    def close_users(self) -> None:
        """Closes the connections of all users."""
        raise NotImplementedError

    def end(self) -> None:
        """Unregisters and closes; `ended` is called when this is done."""
        super().end()
        self.registration.hide()

    def refresh(self) -> None:
        """Registers again."""
        self.registration.refresh()

    def restore(self) -> None:
        """Registers again, for a restarted master."""
        self.registration.refresh()

    @property
    def path_advice(self) -> str:
        """What to do about a path that swallows full packets; "" for any other path."""
        return advice(self._link.path) if self._link else ""

    @property
    def working_state(self) -> LinkState:
        """The state while the link is up and the proxy registered."""
        is_small = self._link is not None and self._link.path.is_proved
        return LinkState.MTU if is_small else LinkState.ACTIVE

    def redial(self, reason: str) -> None:
        """Replaces the link by a new one immediately."""
        self._pause.reset()
        if self._link is not None:
            self._link.close(reason)
        elif self._timer is not None:
            self._timer.cancel()
            self.start()

    def link_up(self, _fields: dict[str, str]) -> None:
        """Called with the welcome when the link is up."""
        self._pause.reset()
        if not self._is_ending:
            self._set(LinkState.PENDING, "being registered with the master")
            self.registration.show()

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Schedules the next attempt and unregisters the proxy."""
        super().link_lost(state, reason)
        if not self._is_ending:
            self.registration.hide()

    def shown(self) -> None:
        """Called when the proxy is registered."""
        self._set(self.working_state, self.path_advice)

    def not_shown(self, reason: str) -> None:
        """Called when the master failed to register the proxy."""
        self._set(LinkState.PENDING, f"our master does not register it: {reason}")

    def hidden(self) -> None:
        """Called when the proxy is unregistered."""
        if not self._is_ending:
            return
        if self._link is not None:
            self._link.close("")
        self._ended()


class _Phase(enum.Enum):
    ABSENT = enum.auto()
    REGISTERING = enum.auto()
    PRESENT = enum.auto()
    UNREGISTERING = enum.auto()


class Registration:
    """Registers and unregisters a proxy's topic or service on our master, one call at a time: the last request wins.

    Its users are closed only after it is unregistered, because a rospy subscriber does not reconnect by itself.
    """

    def __init__(self, context: Context, nodes: ProxyNodes, owner: StandingImport) -> None:
        self.is_serving = False  #: whether it accepts users
        self._context = context
        self._nodes = nodes
        self._owner = owner
        self._node: ProxyNode | None = None
        self._phase = _Phase.ABSENT
        self._shall_show = False
        self._must_hide = False
        self._must_repeat = False
        # Whether the master may list it: also after a registration whose answer was lost, or a refused renewal.
        self._may_be_listed = False
        self._unregister_attempts = 0
        self._pause = context.pause()
        self._retry: Timer | None = None

    def show(self) -> None:
        """Registers it, retrying until the master accepts."""
        self._shall_show = True
        self._step()

    def hide(self) -> None:
        """Unregisters it, then closes its users; the owner's `hidden` follows."""
        self._shall_show = False
        self._must_hide = True
        self.is_serving = False
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        if self._may_be_listed:
            self._context.reactor.call_later(CLOSE_AFTER, self._close_hidden)
        self._step()

    def refresh(self) -> None:
        """Registers it again if it is or is being registered: the master then notifies all subscribers."""
        if self._phase is _Phase.PRESENT:
            self._phase = _Phase.ABSENT
            self._step()
        elif self._phase is _Phase.REGISTERING:
            self._must_repeat = True

    def _close_hidden(self) -> None:
        if not self.is_serving:
            self._owner.close_users()

    def _step(self) -> None:
        if self._phase in (_Phase.REGISTERING, _Phase.UNREGISTERING):
            return
        if self._must_hide and self._may_be_listed:
            self._phase = _Phase.UNREGISTERING
            self._unregister_attempts = 0
            self._unregister()
        elif self._must_hide:
            self._hidden()
        elif self._phase is _Phase.ABSENT and self._shall_show:
            self._register()

    def _hidden(self) -> None:
        self._must_hide = False
        self._close_hidden()
        if self._node is not None:
            offered, topic = self._owner.offered_by(self._node), self._owner.wanted.topic
            if offered.get(topic) is self._owner:
                del offered[topic]
            self._nodes.close_unused(self._node)
            self._node = None
        if self._shall_show:
            self._register()
        else:
            self._owner.hidden()

    def _register(self) -> None:
        self._retry = None
        try:
            self._node = self._node or self._nodes.open(self._owner.wanted.proxy)
        except OSError as error:
            self._registered(f"its port cannot be opened: {error.strerror}")
            return
        self._owner.offered_by(self._node)[self._owner.wanted.topic] = self._owner
        self._phase = _Phase.REGISTERING
        self._must_repeat = False
        self.is_serving = True
        self._call(*self._owner.registering(self._node), self._registered)

    def _call(self, method: str, arguments: tuple[str, ...], done: Callable[[str], None]) -> None:
        arguments = (self._owner.wanted.proxy, *arguments)
        self._context.master.call(method, arguments, lambda _value: done(""), done)

    def _registered(self, reason: str) -> None:
        if not reason or isinstance(reason, NoAnswer):
            self._may_be_listed = True
        self._phase = _Phase.ABSENT if reason else _Phase.PRESENT
        if not reason:
            self._pause.reset()
        if self._must_hide:
            self._step()
        elif reason:
            self._owner.not_shown(reason)
            self._retry = self._context.reactor.call_later(self._pause.take(), self._again)
        else:
            self._owner.shown()
            if self._must_repeat:
                self._phase = _Phase.ABSENT
            self._step()

    def _again(self) -> None:
        self._retry = None
        self._step()

    def _unregister(self) -> None:
        assert self._node is not None, "it was registered"
        self._unregister_attempts += 1
        self._call(*self._owner.unregistering(self._node), self._unregistered)

    def _unregistered(self, reason: str) -> None:
        if isinstance(reason, NoAnswer) and self._unregister_attempts < UNREGISTER_ATTEMPTS:
            self._context.reactor.call_later(self._pause.take(), self._unregister)
            return
        self._pause.reset()
        self._phase = _Phase.ABSENT
        self._may_be_listed = False
        self._step()
