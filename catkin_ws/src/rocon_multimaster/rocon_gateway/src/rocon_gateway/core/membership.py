"""Several hubs at once: who is on which of them, put together."""

import dataclasses
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field

from rocon_gateway.core.presence import HubView
from rocon_gateway.core.situation import Remote


@dataclass(frozen=True)
class Overview:
    """What all our hubs tell together."""

    hubs: tuple[HubView, ...] = ()  #: those that we are on now
    #: unique names of all gateways that are present on any of them, or were on one that is lost
    names: frozenset[str] = frozenset()
    #: those of them that our rules or their requests concern; each once, however many hubs it is on
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    namespaces: frozenset[str] = frozenset()  #: of all robots that any of them knows

    @property
    def connected(self) -> bool:
        """Whether we are on a hub."""
        return bool(self.hubs)


class Memberships:
    """Keeps what each hub tells, and makes one overview of it.

    A gateway that several hubs know is one remote, and one hub speaks for it: one that lists it as alive, and as long
    as that is so always the same, so that nothing changes when another is lost or found. What a lost hub told of
    gateways holds on, unless another hub knows them or comes to know them: then that one has the say.
    """

    def __init__(self) -> None:
        self._views: dict[Hashable, HubView] = {}
        self._way: dict[str, Hashable] = {}

    def take(self, hub: Hashable, view: HubView) -> Overview:
        """Takes what `hub` tells now."""
        self._views[hub] = view
        return self._overview()

    def drop(self, hub: Hashable) -> Overview:
        """Forgets a hub with all that it told."""
        self._views.pop(hub, None)
        return self._overview()

    def is_on(self, hub: Hashable) -> bool:
        """Whether we are on `hub`, as the last overview has it."""
        return hub in self._views and self._views[hub].connected

    def _overview(self) -> Overview:
        if len(self._views) == 1:
            ((hub, view),) = self._views.items()
            self._way = dict.fromkeys(view.names, hub)
            return Overview((view,) if view.connected else (), view.names, view.remotes, view.namespaces)
        hubs = tuple(view for view in self._views.values() if view.connected)
        present = frozenset[str]().union(*(view.names for view in hubs))
        self._views = {hub: view if view.connected else _without(view, present) for hub, view in self._views.items()}
        names = present.union(*(view.names for view in self._views.values()))
        self._way = {name: self._best(name) for name in sorted(names)}
        told = {name: self._views[hub].remotes.get(name) for name, hub in self._way.items()}
        namespaces = frozenset[str]().union(*(view.namespaces for view in self._views.values()))
        return Overview(hubs, names, {name: one for name, one in told.items() if one is not None}, namespaces)

    def _best(self, name: str) -> Hashable:
        """Returns the hub that speaks for a gateway; of equals the one that did so until now, or the first."""
        knowing = [hub for hub, view in self._views.items() if name in view.names]

        def merit(hub: Hashable) -> tuple[bool, ...]:
            view = self._views[hub]
            return view.connected, name in view.listed, name in view.remotes, hub == self._way.get(name)

        return max(knowing, key=merit)


def _without(view: HubView, names: frozenset[str]) -> HubView:
    remotes = {name: remote for name, remote in view.remotes.items() if name not in names}
    return dataclasses.replace(view, listed=view.listed - names, names=view.names - names, remotes=remotes)
