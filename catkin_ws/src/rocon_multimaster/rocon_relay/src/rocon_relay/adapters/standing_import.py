"""What every import that is shown has: a link that is dialled again and again, and a registration while it stands."""

from collections.abc import Callable

from rocon_relay.adapters.context import Context, Pause
from rocon_relay.adapters.dialled_link import DialledLink
from rocon_relay.adapters.registration import Registration
from rocon_relay.core.connection import Address, LinkState
from tcpros.adapters.reactor import Timer


class StandingImport:
    """The link is dialled at once and kept; the proxy is registered while the link stands.

    Subclasses say what to dial and what to show.

    Args:
        context: what all parts share.
        ended: called once after `end`, when everything is unregistered and closed.
    """

    registration: Registration

    def __init__(self, context: Context, ended: Callable[[], None]) -> None:
        self._context = context
        self._ended = ended
        self._link: DialledLink | None = None
        self._timer: Timer | None = None
        self._pause = Pause(context.config)
        self._is_ending = False
        self._state = LinkState.PENDING
        self._reason = "dialling"

    @property
    def address(self) -> Address:
        """Where the far relay listens."""
        raise NotImplementedError

    def link(self) -> DialledLink:
        """Returns a link to the far relay, not dialled yet."""
        raise NotImplementedError

    def start(self) -> None:
        """Dials; repeated after each failure until `end`."""
        self._timer = None
        if self._is_ending:
            return
        self._context.resolver.resolve(
            self.address.host, self._dial, lambda reason: self.link_lost(LinkState.UNREACHABLE, reason)
        )

    def end(self) -> None:
        """Unregisters, closes; `ended` is called when that is done."""
        self._is_ending = True
        if self._timer is not None:
            self._timer.cancel()
        self.registration.hide()

    def refresh(self) -> None:
        """Registers once more, for a master that has forgotten it."""
        self.registration.refresh()

    def redial(self, reason: str) -> None:
        """Leaves the link for another one, at once."""
        self._pause.reset()
        if self._link is not None:
            self._link.close(reason)
        elif self._timer is not None:
            self._timer.cancel()
            self.start()

    def _dial(self, host: str) -> None:
        if not self._is_ending:
            self._link = self.link()
            self._link.connect(host, self.address.port)

    def link_up(self) -> None:
        """Called when the link stands."""
        self._pause.reset()
        if not self._is_ending:
            self._set(LinkState.PENDING, "being registered with the master")
            self.registration.show()

    def link_lost(self, state: LinkState, reason: str) -> None:
        """Forgets the source and schedules the next attempt."""
        self._link = None
        if self._is_ending:
            return
        self._set(state, reason)
        self._timer = self._context.reactor.call_later(self._pause.take(), self.start)
        self.registration.hide()

    def shown(self) -> None:
        """Called when the proxy is registered."""
        self._set(LinkState.ACTIVE, "")

    def not_shown(self, reason: str) -> None:
        """Called when the master did not register the proxy."""
        self._set(LinkState.PENDING, f"our master does not register it: {reason}")

    def hidden(self) -> None:
        """Called when the proxy is unregistered."""
        if not self._is_ending:
            return
        if self._link is not None:
            self._link.close("")
        self._ended()

    def _set(self, state: LinkState, reason: str) -> None:
        if (state, reason) != (self._state, self._reason):
            self._state, self._reason = state, reason
            self._context.changed()
