"""Services and parameters between gateways: what is asked of the relay besides topics.

As with topics, an export is what another gateway may have and an import what we have from another; the importing
side dials. Both answer the state and reason of a link in `RelayStatus`.
"""

from dataclasses import dataclass

from rocon_relay.core.connection import Address, Export, Import, Key, proxy_name

MAX_PARAMETER = 2**20
"""The most that a parameter's value may take as XML-RPC text [bytes]."""


@dataclass(frozen=True, slots=True)
class ServiceExport:
    """Gateway `to_gateway` may call what our node `source_node` serves as `service`."""

    service: str
    source_node: str
    to_gateway: str

    @property
    def key(self) -> Key:
        """What may occur once in a call of `Relay.apply`."""
        return Key(self.service, self.to_gateway, self.source_node)


@dataclass(frozen=True, slots=True)
class ServiceImport:
    """Our master shall show a node `proxy` that serves what a node of another gateway serves.

    Attributes:
        service: resolved name of the service, the same on both masters; once in a call of `Relay.apply`.
        source_gateway: unique name of the gateway that exports.
        source_node: resolved name of the serving node on that gateway's master.
        address: where that gateway's relay listens.
    """

    service: str
    source_gateway: str
    source_node: str
    address: Address

    @property
    def key(self) -> Key:
        """What may occur once in a call of `Relay.apply`."""
        return Key(self.service, self.source_gateway, self.source_node)

    @property
    def proxy(self) -> str:
        """The name of the node that stands for the server on our master."""
        return proxy_name(self.source_gateway, self.source_node)


@dataclass(frozen=True, slots=True)
class ParameterExport:
    """Gateway `to_gateway` may read parameter `name` of our master; a namespace is one with all that is in it."""

    name: str
    to_gateway: str

    @property
    def key(self) -> Key:
        """What may occur once in a call of `Relay.apply`."""
        return Key(self.name, self.to_gateway, "")


@dataclass(frozen=True, slots=True)
class ParameterImport:
    """Our master shall be given parameter `name` as it is at `source_gateway` when we read it: once.

    Attributes:
        name: resolved name, the same on both masters.
        source_gateway: unique name of the gateway that exports.
        address: where that gateway's relay listens.
    """

    name: str
    source_gateway: str
    address: Address

    @property
    def key(self) -> Key:
        """What may occur once in a call of `Relay.apply`."""
        return Key(self.name, self.source_gateway, "")


AnyExport = Export | ServiceExport | ParameterExport
"""What may be in a relay's exports."""

AnyImport = Import | ServiceImport | ParameterImport
"""What may be in a relay's imports."""
