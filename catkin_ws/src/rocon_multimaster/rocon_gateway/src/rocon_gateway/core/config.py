"""The gateway's parameters, and the rules that they bring."""

import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rocon_gateway.core.error import ConfigError, GatewayError
from rocon_gateway.core.matching import rule_from_text
from rocon_gateway.core.option_rule import OptionRule, option_rule
from rocon_gateway.core.rulebook import RuleBook, check_gateway
from rocon_hub_protocol.core.code import Code
from rocon_hub_protocol.core.rule import RemoteRule, Rule, is_namespace
from rocon_relay.core.option import OptionError

APPENDED = ("default_flips", "default_advertisements", "default_pulls")
"""Keys of a custom rules file that add to a parameter, as its options of rules do; all others replace it."""


@dataclass(frozen=True)
class GatewayConfig:
    """Parameters of the node `gateway`, named as rocon names them where rocon has them."""

    name: str = "gateway"  #: the gateway's name for people
    disable_uuids: bool = False  #: whether that is its unique name too; otherwise 32 hexadecimal digits follow
    #: the hub's address, `http://host:port` (`rediss://` for one with TLS) or `host:port`; several divided by
    #: semicolons, or a list
    hub_uri: Any = ""
    hub_whitelist: Any = ()  #: names or addresses of the only hubs to join; empty allows all
    hub_blacklist: Any = ()  #: names or addresses of hubs never to join
    hub_password_file: str = ""  #: a file that holds the hub's password; empty for none, or the environment's
    #: a directory with the fleet's certificates, for TLS with hubs and gateways; empty for none, or the environment's
    tls_directory: str = ""
    insecure: bool = False  #: take links from other machines though there is neither password nor certificate
    disable_zeroconf: bool = False  #: do not look for hubs by mDNS, which only a gateway without `hub_uri` does
    firewall: bool = True  #: refuse flips to here
    watch_loop_period: float = 10.0  #: the longest time between two comparisons, even if nothing seems to change [s]
    default_blacklist: Any = ()  #: `{name, node, type}` of what never leaves this gateway
    default_advertisements: Any = ()  #: `{name, node, type}`
    default_flips: Any = ()  #: `{gateway, rule: {name, node, type}}`; without `rule`, everything is flipped there
    default_pulls: Any = ()  #: likewise
    #: `{name, node, gateway, rate, queue_size, compress, tf_frames, stamp_rate}`: what is asked of the links that rules
    #: bring for a topic (name), publishing node and other gateway, patterns as in rules, all by default; the first row
    #: that matches counts. See `core.option.LinkOptions`.
    rule_options: Any = ()
    advertise_all: Any = ()  #: start with everything advertised
    custom_rules_file: str = ""  #: YAML with more of these; empty for none
    #: the interface whose address is announced to other gateways; empty: the one towards the hub
    network_interface: str = ""
    #: the robot's own namespace, `pioneer1`: rules whose name is a pattern then bring nothing here out of other robots'
    #: namespaces, unless the pattern spells one out; empty: no such guard. Other robots' are those that differ from it
    #: in the number at their end only, and those that any gateway has told the hub.
    namespace: str = ""
    #: more robots' namespaces to tell the hub, `alice; bob`, so that all gateways know them before the robots' own
    #: gateways come
    robot_namespaces: Any = ()
    #: a folder of small files that the hub keeps a copy of, 64 KiB in all: a gateway of this name that starts where
    #: there are none, as on another computer, writes them there before it joins; empty for none
    kept_folder: str = ""
    relay_port: int = 0  #: TCP port for links from other gateways; 0 is any free one
    max_message_size: int = 256 * 2**20  #: the longest message that is carried [bytes]

    def __post_init__(self) -> None:
        """Raises ConfigError for invalid parameter values."""
        if not self.name.strip() or not self.name.isprintable():
            raise ConfigError(f"gateway: ~name must be a printable text, not {self.name!r}")
        if self.watch_loop_period <= 0:
            raise ConfigError("gateway: ~watch_loop_period must be greater than 0")
        if not 0 <= self.relay_port < 65536:
            raise ConfigError(f"gateway: ~relay_port must be 0 to 65535, not {self.relay_port}")
        for parameter, value in [("namespace", self.namespace)] * bool(self.namespace.strip("/")) + [
            ("robot_namespaces", one) for one in _entries("robot_namespaces", self.robot_namespaces)
        ]:
            if not is_namespace(value.removeprefix("/")):
                raise ConfigError(f"gateway: ~{parameter} must be one ROS name, not {value!r}")
        self.options()

    def options(self) -> tuple[OptionRule, ...]:
        """Returns what is asked of links. Raises ConfigError for an invalid row."""
        try:
            return tuple(option_rule(row) for row in _rows(self.rule_options))
        except (GatewayError, OptionError) as error:
            raise ConfigError(f"gateway: ~rule_options: {error}") from None

    def unique_name(self) -> str:
        """Returns a unique name; a new one with each call unless `disable_uuids`."""
        return self.name if self.disable_uuids else self.name + uuid.uuid4().hex

    @property
    def own_namespace(self) -> str:
        """The robot's namespace without a slash; "" for none."""
        return self.namespace.strip("/")

    @property
    def known_namespaces(self) -> frozenset[str]:
        """The robot's namespace and the others to announce."""
        told = (self.namespace, *_entries("robot_namespaces", self.robot_namespaces))
        return frozenset(one.removeprefix("/") for one in told) - {""}

    @property
    def discovers(self) -> bool:
        """Whether to look for hubs by mDNS: unless that is off or a hub is named."""
        return not self.hub_uris and not self.disable_zeroconf

    @property
    def hub_uris(self) -> tuple[str, ...]:
        """The hubs that are named."""
        return _entries("hub_uri", self.hub_uri)

    @property
    def hubs_allowed(self) -> tuple[str, ...]:
        """The whitelist."""
        return _entries("hub_whitelist", self.hub_whitelist)

    @property
    def hubs_refused(self) -> tuple[str, ...]:
        """The blacklist of hubs."""
        return _entries("hub_blacklist", self.hub_blacklist)


def with_custom_rules(parameters: Mapping[str, Any], custom: object) -> dict[str, Any]:
    """Returns `parameters` with what a custom rules file holds; its rows of options come first, where the first counts.

    Raises:
        ConfigError: it holds no mapping.
    """
    if custom is None:
        return dict(parameters)
    if not isinstance(custom, Mapping):
        raise ConfigError("gateway: ~custom_rules_file must hold a mapping of parameters")
    merged = dict(parameters)
    for key, value in custom.items():
        if key in APPENDED:
            merged[key] = [*(merged.get(key) or ()), *(value or ())]
        elif key == "rule_options":
            merged[key] = [*(value or ()), *(merged.get(key) or ())]
        else:
            merged[key] = value
    return merged


def book_from_config(config: GatewayConfig, name: str) -> tuple[RuleBook, tuple[str, ...]]:
    """Returns the rules to start with, for unique name `name`, and a complaint about each that cannot be had.

    One bad rule keeps no other from being taken.
    """
    blacklist, complaints = [], []
    for row in _rows(config.default_blacklist):
        try:
            blacklist.append(_rule(row))
        except GatewayError as error:
            complaints.append(f"default_blacklist: {error}")
    book = RuleBook(name, tuple(blacklist))
    if config.advertise_all:
        book = book.advertising_all(())
    changes: tuple[tuple[str, Any, Callable[[RuleBook, object], RuleBook]], ...] = (
        ("default_advertisements", config.default_advertisements, lambda book, row: book.advertised([_rule(row)])),
        ("default_flips", config.default_flips, _flipped),
        ("default_pulls", config.default_pulls, _pulled),
    )
    for parameter, rows, change in changes:
        for row in _rows(rows):
            try:
                book = change(book, row)
            except GatewayError as error:
                complaints.append(f"{parameter}: {error}")
    return book, tuple(complaints)


def _flipped(book: RuleBook, row: object) -> RuleBook:
    remote = _remote(row)
    return book.flipping_all(remote, ()) if isinstance(remote, str) else book.flipped([remote])


def _pulled(book: RuleBook, row: object) -> RuleBook:
    remote = _remote(row)
    return book.pulling_all(remote, ()) if isinstance(remote, str) else book.pulled([remote])


def _remote(row: object) -> RemoteRule | str:
    """Returns the rule of a row, or only the gateway where the row has no rule."""
    if not isinstance(row, Mapping) or not isinstance(row.get("gateway"), str):
        raise ConfigError(f"{row!r} names no gateway")
    gateway: str = row["gateway"]
    check_gateway(gateway, Code.HUB_UNKNOWN_ERROR)
    return RemoteRule(gateway, _rule(row["rule"])) if row.get("rule") else gateway


def _rule(row: object) -> Rule:
    if not isinstance(row, Mapping):
        raise ConfigError(f"{row!r} is not a rule of name, node and type")
    node = str(row.get("node") or "")
    # In YAML, people write None for no node.
    node = "" if node.lower() == "none" else node
    return rule_from_text(str(row.get("type") or ""), str(row.get("name") or ""), node, Code.HUB_UNKNOWN_ERROR)


def _rows(value: Any) -> Sequence[object]:
    return value if isinstance(value, (list, tuple)) else [value] if value else []


def _entries(name: str, value: Any) -> tuple[str, ...]:
    """Returns a list parameter; a text is taken as entries divided by semicolons, as old launch files write it."""
    if isinstance(value, str):
        value = [entry for entry in value.split(";") if entry.strip()]
    if not isinstance(value, (list, tuple)) or not all(isinstance(entry, str) for entry in value):
        raise ConfigError(f"gateway: ~{name} must be a list of texts, not {value!r}")
    return tuple(entry.strip() for entry in value)
