"""Merges the views of several hubs into one overview."""

import dataclasses
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field

from rocon_gateway.hub.presence import HubView
from rocon_gateway.rules.situation import Remote


@dataclass(frozen=True)
class Overview:
    """The merged view of all our hubs."""

    hubs: tuple[HubView, ...] = ()  #: the hubs we are connected to
    #: unique names of all gateways present on any hub, or last seen on a lost one
    names: frozenset[str] = frozenset()
    #: those of them concerned by our rules or their requests, each once, however many hubs it is on
    remotes: Mapping[str, Remote] = field(default_factory=dict)
    namespaces: frozenset[str] = frozenset()  #: robot namespaces known to any hub

    @property
    def connected(self) -> bool:
        """Whether we are on a hub."""
        return bool(self.hubs)


class Memberships:
    """Keeps the view of each hub and merges them.

    A gateway known to several hubs is one remote. Its data come from one hub that lists it as alive. The choice is
    sticky, so losing or finding another hub changes nothing. Data from a lost hub remain valid until another hub knows
    the gateway.
    """

    def __init__(self) -> None:
        self._views: dict[Hashable, HubView] = {}
        self._way: dict[str, Hashable] = {}

    def take(self, hub: Hashable, view: HubView) -> Overview:
        """Sets the view of `hub`; returns the new overview."""
        self._views[hub] = view
        return self._overview()

    def drop(self, hub: Hashable) -> Overview:
        """Removes a hub and its data; returns the new overview."""
        self._views.pop(hub, None)
        return self._overview()

    def is_on(self, hub: Hashable) -> bool:
        """Returns whether we are on `hub` according to the last overview."""
        return hub in self._views and self._views[hub].connected

    def _overview(self) -> Overview:
        if len(self._views) == 1:
            ((hub, view),) = self._views.items()
            self._way = dict.fromkeys(view.names, hub)
            return Overview(
                (view,) if view.connected else (), view.names, view.remotes, view.namespaces
            )
        hubs = tuple(view for view in self._views.values() if view.connected)
        present = frozenset[str]().union(*(view.names for view in hubs))
        self._views = {
            hub: view if view.connected else _without(view, present)
            for hub, view in self._views.items()
        }
        names = present.union(*(view.names for view in self._views.values()))
        self._way = {name: self._best(name) for name in sorted(names)}
        told = {name: self._views[hub].remotes.get(name) for name, hub in self._way.items()}
        namespaces = frozenset[str]().union(*(view.namespaces for view in self._views.values()))
        return Overview(
            hubs, names, {name: one for name, one in told.items() if one is not None}, namespaces
        )

    def _best(self, name: str) -> Hashable:
        """Returns the hub to use for a gateway's data; among equals the previous one, or the first."""
        knowing = [hub for hub, view in self._views.items() if name in view.names]

        def merit(hub: Hashable) -> tuple[bool, ...]:
            view = self._views[hub]
            return (
                view.connected,
                name in view.listed,
                name in view.remotes,
                hub == self._way.get(name),
            )

        return max(knowing, key=merit)


def _without(view: HubView, names: frozenset[str]) -> HubView:
    remotes = {name: remote for name, remote in view.remotes.items() if name not in names}
    return dataclasses.replace(
        view, listed=view.listed - names, names=view.names - names, remotes=remotes
    )
