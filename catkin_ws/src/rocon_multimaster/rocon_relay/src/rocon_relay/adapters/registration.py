"""Registers and unregisters a proxy's topic or service on our master, one call at a time, so the last request wins."""

import enum
from collections.abc import Callable
from typing import Protocol

from rocon_relay.adapters.context import Context, Pause
from tcpros.adapters.reactor import Timer

CLOSE_AFTER = 0.5
"""Delay between an unregistration and closing the users, if the master does not answer earlier [s]."""


class Node(Protocol):
    """The proxy node, as seen by its registrations."""

    name: str
    uri: str
    port: int


class Nodes(Protocol):
    """The proxy nodes of a relay."""

    def open(self, shown: "Registration") -> Node:
        """Returns the listening node that offers `shown`."""

    def release(self, shown: "Registration") -> None:
        """Removes `shown` from its node, and closes the node if it offers nothing else."""


class Owner(Protocol):
    """The importing end behind a registration."""

    def shown(self) -> None:
        """Called when the master has registered it."""

    def not_shown(self, reason: str) -> None:
        """Called when the registration failed; it is retried."""

    def hidden(self) -> None:
        """Called when it is unregistered, its users are closed and no new registration is pending."""


class _Phase(enum.Enum):
    ABSENT = enum.auto()
    REGISTERING = enum.auto()
    PRESENT = enum.auto()
    UNREGISTERING = enum.auto()


class Registration:
    """A topic or service of a proxy node.

    Its users are closed only after it is unregistered, because a rospy subscriber does not reconnect by itself.
    """

    def __init__(self, context: Context, nodes: Nodes, owner: Owner, proxy: str) -> None:
        self.proxy = proxy  #: the node's name
        self.is_serving = False  #: whether it accepts users
        self._context = context
        self._nodes = nodes
        self._owner = owner
        self._node: Node | None = None
        self._phase = _Phase.ABSENT
        self._shall_show = False
        self._must_hide = False
        self._pause = Pause(context.config)
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
        if self._phase is _Phase.PRESENT:
            self._context.reactor.call_later(CLOSE_AFTER, self._close_hidden)
        self._step()

    def refresh(self) -> None:
        """Registers it again if it is registered, for a restarted master."""
        if self._phase is _Phase.PRESENT:
            self._phase = _Phase.ABSENT
            self._step()

    def registering(self, node: Node) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method that registers it, and the arguments after the node's name."""
        raise NotImplementedError

    def unregistering(self, node: Node) -> tuple[str, tuple[str, ...]]:
        """Returns the master's method that unregisters it, and the arguments after the node's name."""
        raise NotImplementedError

    def close_users(self) -> None:
        """Closes the connections of all users."""
        raise NotImplementedError

    def _close_hidden(self) -> None:
        if not self.is_serving:
            self.close_users()

    def _step(self) -> None:
        if self._phase is _Phase.ABSENT and self._must_hide:
            self._hidden()
        elif self._phase is _Phase.ABSENT and self._shall_show:
            self._register()
        elif self._phase is _Phase.PRESENT and self._must_hide and self._node is not None:
            self._phase = _Phase.UNREGISTERING
            self._call(self.unregistering(self._node), self._unregistered)

    def _hidden(self) -> None:
        self._must_hide = False
        self._close_hidden()
        if self._node is not None:
            self._node = None
            self._nodes.release(self)
        if self._shall_show:
            self._register()
        else:
            self._owner.hidden()

    def _register(self) -> None:
        self._retry = None
        try:
            self._node = self._node or self._nodes.open(self)
        except OSError as error:
            self._registered(f"its port cannot be opened: {error.strerror}")
            return
        self._phase = _Phase.REGISTERING
        self.is_serving = True
        self._call(self.registering(self._node), self._registered)

    def _call(self, asked: tuple[str, tuple[str, ...]], done: Callable[[str], None]) -> None:
        method, arguments = asked
        self._context.master.call(method, (self.proxy, *arguments), lambda _value: done(""), done)

    def _registered(self, reason: str) -> None:
        self._phase = _Phase.ABSENT if reason and not self._must_hide else _Phase.PRESENT
        if self._phase is _Phase.PRESENT:
            self._pause.reset()
            if not self._must_hide:
                self._owner.shown()
        elif self._shall_show:
            self._owner.not_shown(reason)
            self._retry = self._context.reactor.call_later(self._pause.take(), self._again)
            return
        self._step()

    def _again(self) -> None:
        self._retry = None
        self._step()

    def _unregistered(self, _reason: str) -> None:
        self._phase = _Phase.ABSENT
        self._step()
