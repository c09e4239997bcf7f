"""Base classes of imports: a link with automatic reconnection, and a proxy registered while the link is up."""

from collections.abc import Callable

from rocon_relay.adapters.context import Context, Pause
from rocon_relay.adapters.dialled_link import DialledLink
from rocon_relay.adapters.registration import Registration
from rocon_relay.core.connection import Import, LinkState
from tcpros.adapters.reactor import Timer


class DialledImport:
    """Opens the link and retries after each failure. Subclasses provide the link.

    Args:
        context: shared by all parts of the relay.
        wanted: the import; may be replaced by one with the same key.
        ended: called once after `end`, when everything is unregistered and closed.
    """

    def __init__(self, context: Context, wanted: Import, ended: Callable[[], None]) -> None:
        self.wanted = wanted
        self._context = context
        self._ended = ended
        self._link: DialledLink | None = None
        self._timer: Timer | None = None
        self._pause = Pause(context.config)
        self._is_ending = False
        self._state = LinkState.PENDING
        self._reason = "dialling"

    def link(self) -> DialledLink:
        """Returns a link to the far relay, not connected yet."""
        raise NotImplementedError

    def start(self) -> None:
        """Connects, retrying after each failure until `end`."""
        self._timer = None
        if self._is_ending:
            return
        self._context.resolver.resolve(
            self.wanted.address.host, self._dial, lambda reason: self.link_lost(LinkState.UNREACHABLE, reason)
        )

    def end(self) -> None:
        """Stops connecting."""
        self._is_ending = True
        if self._timer is not None:
            self._timer.cancel()

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
            self._link = self.link()
            self._link.connect(host, self.wanted.address.port)

    def _set(self, state: LinkState, reason: str) -> None:
        if (state, reason) != (self._state, self._reason):
            self._state, self._reason = state, reason
            self._context.changed()


class StandingImport(DialledImport):
    """Keeps a link open and registers the proxy while it is up. Subclasses provide the registration."""

    registration: Registration  #: the proxy's topic or service

    def end(self) -> None:
        """Unregisters and closes; `ended` is called when this is done."""
        super().end()
        self.registration.hide()

    def refresh(self) -> None:
        """Registers again, for a restarted master."""
        self.registration.refresh()

    def redial(self, reason: str) -> None:
        """Replaces the link by a new one immediately."""
        self._pause.reset()
        if self._link is not None:
            self._link.close(reason)
        elif self._timer is not None:
            self._timer.cancel()
            self.start()

    def link_up(self) -> None:
        """Called when the link is up."""
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
        self._set(LinkState.ACTIVE, "")

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
