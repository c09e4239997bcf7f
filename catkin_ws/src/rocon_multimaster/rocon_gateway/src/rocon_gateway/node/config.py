"""The gateway's parameters and the initial rules they define."""

import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from rocon_gateway.error import ConfigError, GatewayError
from rocon_gateway.rules.matching import rule_from_text
from rocon_gateway.rules.option_rule import OptionRule, option_rule
from rocon_gateway.rules.rulebook import RuleBook, check_gateway
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.rule import LONGEST_NAME, RemoteRule, Rule, is_namespace
from rocon_relay.option import OptionError

APPENDED = ("default_flips", "default_advertisements", "default_pulls")
"""Keys of a custom rules file that extend a parameter, like `rule_options`; all others replace it."""


@dataclass(frozen=True)
class GatewayConfig:
    """Parameters of the node `gateway`. Those that rocon has too keep rocon's names."""

    name: str = "gateway"  #: the gateway's readable name
    disable_uuids: bool = (
        False  #: use `name` as the unique name; otherwise 32 hexadecimal digits are appended
    )
    #: the hub's address, `http://host:port` (`rediss://` with TLS) or `host:port`; several separated by semicolons, or
    #: a list
    hub_uri: Any = ""
    hub_whitelist: Any = ()  #: names or addresses of the only hubs to join; empty allows all
    hub_blacklist: Any = ()  #: names or addresses of hubs never to join
    hub_password_file: str = (
        ""  #: file with the hub's password; empty: use the environment, or none
    )
    #: directory with the fleet's certificates, for TLS with hubs and gateways; empty: use the environment, or none
    tls_directory: str = ""
    insecure: bool = False  #: accept links from other machines without password and certificate
    disable_zeroconf: bool = (
        False  #: do not search for hubs by mDNS; the search only runs without `hub_uri`
    )
    firewall: bool = True  #: refuse flips to this gateway
    watch_loop_period: float = (
        10.0  #: longest time between two reconciliations, even without visible changes [s]
    )
    default_blacklist: Any = ()  #: `{name, node, type}` of connections that never leave this gateway
    default_advertisements: Any = ()  #: `{name, node, type}`
    default_flips: Any = ()  #: `{gateway, rule: {name, node, type}}`; without `rule`, everything is flipped there
    default_pulls: Any = ()  #: likewise
    #: `{name, node, gateway, rate, queue_size, compress, tf_frames, stamp_rate}`: link options for topics by name,
    #: publishing node and other gateway, with patterns as in rules, default all; the first matching row applies. See
    #: `core.option.LinkOptions`.
    rule_options: Any = ()
    advertise_all: Any = ()  #: start with everything advertised
    custom_rules_file: str = ""  #: YAML file with more of these parameters; empty for none
    #: interface whose address is announced to other gateways; empty: the one on the route to the hub
    network_interface: str = ""
    #: the robot's own namespace, such as `pioneer1`: pattern rules then import nothing from other robots' namespaces
    #: unless the pattern spells one out; empty disables this guard. A namespace belongs to another robot if it differs
    #: only in its trailing number, or if any gateway has announced it on the hub.
    namespace: str = ""
    #: further robot namespaces to announce on the hub, such as `alice; bob`, so that all gateways know them before the
    #: robots' own gateways connect
    robot_namespaces: Any = ()
    #: folder of small files backed up on the hub, 64 KiB in all. A gateway of this name whose folder is empty, for
    #: example on another computer, restores them before it joins; empty for none
    kept_folder: str = ""
    relay_port: int = 0  #: TCP port for links from other gateways; 0 is any free one
    max_message_size: int = 256 * 2**20  #: maximum message size [bytes]

    def __post_init__(self) -> None:
        """Raises ConfigError for invalid parameter values."""
        if not self.name.strip() or not self.name.isprintable():
            raise ConfigError(f"gateway: ~name must be a printable text, not {self.name!r}")
        if len(self.unique_name()) > LONGEST_NAME:
            room = LONGEST_NAME - len(self.unique_name()) + len(self.name)
            text = f"gateway: ~name must have at most {room} characters, not {len(self.name)}"
            raise ConfigError(text)
        if not self.watch_loop_period > 0:
            raise ConfigError("gateway: ~watch_loop_period must be greater than 0")
        if not 0 <= self.relay_port < 65536:
            raise ConfigError(f"gateway: ~relay_port must be 0 to 65535, not {self.relay_port}")
        for parameter, value in [("namespace", self.namespace)] * bool(
            self.namespace.strip("/")
        ) + [
            ("robot_namespaces", one) for one in _entries("robot_namespaces", self.robot_namespaces)
        ]:
            if not is_namespace(value.removeprefix("/")):
                raise ConfigError(f"gateway: ~{parameter} must be one ROS name, not {value!r}")
        self.options()

    def options(self) -> tuple[OptionRule, ...]:
        """Returns the rules for link options. Raises ConfigError for an invalid row."""
        try:
            return tuple(option_rule(row) for row in _rows(self.rule_options))
        except (GatewayError, OptionError) as error:
            raise ConfigError(f"gateway: ~rule_options: {error}") from None

    def unique_name(self) -> str:
        """Returns a unique name, a new one for each call unless `disable_uuids` is set."""
        return self.name if self.disable_uuids else self.name + uuid.uuid4().hex

    @property
    def own_namespace(self) -> str:
        """The robot's namespace without a slash; "" for none."""
        return self.namespace.strip("/")

    @property
    def known_namespaces(self) -> frozenset[str]:
        """The robot namespaces to announce, including our own."""
        told = (self.namespace, *_entries("robot_namespaces", self.robot_namespaces))
        return frozenset(one.removeprefix("/") for one in told) - {""}

    @property
    def discovers(self) -> bool:
        """Whether to search for hubs by mDNS: not if it is disabled or a hub is configured."""
        return not self.hub_uris and not self.disable_zeroconf

    @property
    def hub_uris(self) -> tuple[str, ...]:
        """The configured hubs."""
        return _entries("hub_uri", self.hub_uri)

    @property
    def hubs_allowed(self) -> tuple[str, ...]:
        """The whitelist of hubs."""
        return _entries("hub_whitelist", self.hub_whitelist)

    @property
    def hubs_refused(self) -> tuple[str, ...]:
        """The blacklist of hubs."""
        return _entries("hub_blacklist", self.hub_blacklist)


def with_custom_rules(parameters: Mapping[str, Any], custom: object) -> dict[str, Any]:
    """Returns `parameters` merged with a custom rules file, whose `rule_options` come first and so take precedence.

    Raises:
        ConfigError: the file is not a mapping.
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
    """Returns the initial rules for unique name `name`, and an error message for each invalid one.

    An invalid rule does not affect the others.
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
        (
            "default_advertisements",
            config.default_advertisements,
            lambda book, row: book.advertised([_rule(row)]),
        ),
        ("default_flips", config.default_flips, partial(_with_remote, "flip")),
        ("default_pulls", config.default_pulls, partial(_with_remote, "pull")),
    )
    for parameter, rows, change in changes:
        for row in _rows(rows):
            try:
                book = change(book, row)
            except GatewayError as error:
                complaints.append(f"{parameter}: {error}")
    return book, tuple(complaints)


def _with_remote(action: str, book: RuleBook, row: object) -> RuleBook:
    """Adds the flip or pull of a row; a row without rule flips or pulls everything."""
    if not isinstance(row, Mapping) or not isinstance(row.get("gateway"), str):
        raise ConfigError(f"{row!r} names no gateway")
    gateway: str = row["gateway"]
    check_gateway(gateway, Code.HUB_UNKNOWN_ERROR)
    if not row.get("rule"):
        return book.with_all(action, gateway, ())
    return book.added(action, [RemoteRule(gateway, _rule(row["rule"]))])


def _rule(row: object) -> Rule:
    if not isinstance(row, Mapping):
        raise ConfigError(f"{row!r} is not a rule of name, node and type")
    node = str(row.get("node") or "")
    # In YAML, people write None for no node.
    node = "" if node.lower() == "none" else node
    return rule_from_text(
        str(row.get("type") or ""), str(row.get("name") or ""), node, Code.HUB_UNKNOWN_ERROR
    )


def _rows(value: Any) -> Sequence[object]:
    return value if isinstance(value, (list, tuple)) else [value] if value else []


def _entries(name: str, value: Any) -> tuple[str, ...]:
    """Returns a list parameter; splits a string at semicolons, as in old launch files."""
    if isinstance(value, str):
        value = [entry for entry in value.split(";") if entry.strip()]
    if not isinstance(value, (list, tuple)) or not all(isinstance(entry, str) for entry in value):
        raise ConfigError(f"gateway: ~{name} must be a list of texts, not {value!r}")
    return tuple(entry.strip() for entry in value)
