"""All rules of a gateway as one immutable value. Every change returns a new value or raises, so requests are atomic."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace

from rocon_gateway.error import RequestError
from rocon_gateway.rules.matching import (
    ALL,
    absolute_name,
    base_name,
    blacklisting,
    check_pattern,
    is_literal,
)
from rocon_hub_protocol.code import Code
from rocon_hub_protocol.rule import CONNECTIONS, Connection, Kind, RemoteRule, Rule

MOST_RULES = 4096
"""Maximum number of advertisements, of flips and of pulls: any client of the ROS master can add some."""

_EXISTS = {"flip": Code.FLIP_RULE_ALREADY_EXISTS, "pull": Code.PULL_RULE_ALREADY_EXISTS}


@dataclass(frozen=True)
class Advertisements:
    """Connections that other gateways may pull."""

    rules: tuple[
        Rule, ...
    ] = ()  #: explicit rules in order of arrival; in advertise-all mode, a `.*` rule per kind
    everything: bool = False  #: whether advertise-all mode is on
    blacklist: tuple[
        Rule, ...
    ] = ()  #: excluded by the caller of advertise_all, in addition to the gateway's blacklist


@dataclass(frozen=True)
class Targets:
    """Flip or pull rules."""

    rules: tuple[RemoteRule, ...] = ()  #: all rules, in order of arrival
    #: by gateway pattern, the exclusions given by the caller of flip_all or pull_all
    everything: tuple[tuple[str, tuple[Rule, ...]], ...] = ()

    def excluded(self, remote: RemoteRule) -> tuple[Rule, ...]:
        """Returns the caller's blacklist for a `.*` rule of flip_all or pull_all; empty for every other rule."""
        return dict(self.everything).get(remote.gateway, ()) if remote.rule.name == ALL else ()


@dataclass(frozen=True)
class RuleBook:
    """All rules, with the data needed to check changes."""

    name: str  #: our unique name
    blacklist: tuple[Rule, ...] = ()  #: connections that never leave this gateway
    advertisements: Advertisements = field(default_factory=Advertisements)
    flips: Targets = field(default_factory=Targets)
    pulls: Targets = field(default_factory=Targets)

    def advertised(self, rules: Iterable[Rule]) -> "RuleBook":
        """Adds advertisements.

        Raises:
            RequestError: 31 for an existing rule, 39 for a blacklisted one or a parameter given by a pattern.
        """
        known = dict.fromkeys(self.advertisements.rules)
        for rule in rules:
            if rule in known:
                raise RequestError(
                    Code.ADVERTISEMENT_EXISTS, f"this advertisement exists already: {rule}"
                )
            _check_parameter(rule, Code.UNKNOWN_ADVERTISEMENT_ERROR)
            self._refuse_blacklisted(rule, Code.UNKNOWN_ADVERTISEMENT_ERROR)
            known[rule] = None
        _check_number(known, "advertisements")
        return replace(self, advertisements=replace(self.advertisements, rules=tuple(known)))

    def unadvertised(self, rules: Iterable[Rule]) -> "RuleBook":
        """Removes advertisements; one without node removes all of its kind and name. Raises RequestError 32 if none."""
        known = dict.fromkeys(self.advertisements.rules)
        by_name: dict[tuple[str, str], list[Rule]] = {}
        for rule in known:
            by_name.setdefault((rule.kind, rule.name), []).append(rule)
        for rule in rules:
            candidates = [rule] if rule.node else by_name.get((rule.kind, rule.name), [])
            found = [one for one in candidates if one in known]
            if not found:
                raise RequestError(
                    Code.ADVERTISEMENT_NOT_FOUND, f"there is no such advertisement: {rule}"
                )
            for one in found:
                del known[one]
        return replace(self, advertisements=replace(self.advertisements, rules=tuple(known)))

    def advertising_all(self, blacklist: Iterable[Rule]) -> "RuleBook":
        """Turns advertise-all mode on, replacing all advertisements. Raises RequestError 31 if it is on already."""
        if self.advertisements.everything:
            raise RequestError(Code.ADVERTISEMENT_EXISTS, "everything is advertised already")
        rules = tuple(Rule(kind, ALL) for kind in CONNECTIONS)
        return replace(self, advertisements=Advertisements(rules, True, _unique(blacklist)))

    def advertising_nothing(self) -> "RuleBook":
        """Turns advertise-all mode off and removes all advertisements."""
        return replace(self, advertisements=Advertisements())

    def added(self, action: str, remotes: Iterable[RemoteRule]) -> "RuleBook":
        """Adds flips or pulls; `action` is "flip" or "pull", as in all methods below.

        Raises:
            RequestError: 22 for an existing flip, 41 for an existing pull, 52 for our own gateway, 19 for a blacklisted
                flip, the flip of a parameter, or the pull of one given by a pattern.
        """
        remotes = tuple(remotes)
        for rule in (remote.rule for remote in remotes):
            if action == "pull":
                _check_parameter(rule, Code.HUB_UNKNOWN_ERROR)
                continue
            if rule.kind == Kind.PARAMETER:
                raise RequestError(
                    Code.HUB_UNKNOWN_ERROR, f"a parameter is pulled, not flipped: {rule.name}"
                )
            self._refuse_blacklisted(rule, Code.HUB_UNKNOWN_ERROR)
        targets = self.targets(action)
        known = dict.fromkeys(targets.rules)
        for remote in remotes:
            self._refuse_self(remote.gateway)
            if remote in known:
                raise RequestError(_EXISTS[action], f"this {action} rule exists already: {remote}")
            known[remote] = None
        _check_number(known, f"{action} rules")
        return self._with_targets(action, Targets(tuple(known), targets.everything))

    def removed(self, action: str, remotes: Iterable[RemoteRule]) -> "RuleBook":
        """Removes flips or pulls; one without node removes all of its kind and name. Ignores unknown rules."""
        asked = set(remotes)
        of_any_node = {
            (one.gateway, one.rule.kind, one.rule.name) for one in asked if not one.rule.node
        }
        targets = self.targets(action)
        kept = tuple(
            one
            for one in targets.rules
            if one not in asked and (one.gateway, one.rule.kind, one.rule.name) not in of_any_node
        )
        return self._with_targets(action, Targets(kept, targets.everything))

    def with_all(self, action: str, gateway: str, blacklist: Iterable[Rule]) -> "RuleBook":
        """Replaces all flips to, or pulls from, `gateway` by `.*` rules.

        Raises:
            RequestError: 22 (for pulls too) if that was done already, 52 for our own gateway.
        """
        self._refuse_self(gateway)
        if gateway in dict(self.targets(action).everything):
            what = "flipped to" if action == "flip" else "pulled from"
            raise RequestError(
                Code.FLIP_RULE_ALREADY_EXISTS, f"everything is {what} '{gateway}' already"
            )
        emptied = self.without(action, gateway).targets(action)
        added = Targets(
            (*emptied.rules, *(RemoteRule(gateway, Rule(kind, ALL)) for kind in CONNECTIONS)),
            (*emptied.everything, (gateway, _unique(blacklist))),
        )
        _check_number(added.rules, f"{action} rules")
        return self._with_targets(action, added)

    def without(self, action: str, gateway: str) -> "RuleBook":
        """Removes all flips to, or pulls from, `gateway`."""
        targets = self.targets(action)
        kept = Targets(
            tuple(one for one in targets.rules if one.gateway != gateway),
            tuple(one for one in targets.everything if one[0] != gateway),
        )
        return self._with_targets(action, kept)

    def targets(self, action: str) -> Targets:
        """Returns the flips or the pulls."""
        return self.flips if action == "flip" else self.pulls

    def _with_targets(self, action: str, targets: Targets) -> "RuleBook":
        return replace(self, flips=targets) if action == "flip" else replace(self, pulls=targets)

    def _refuse_self(self, gateway: str) -> None:
        if gateway in (self.name, base_name(self.name)):
            raise RequestError(
                Code.REMOTE_GATEWAY_SELF_IS_NOT, f"'{gateway}' is this gateway itself"
            )

    def _refuse_blacklisted(self, rule: Rule, code: Code) -> None:
        """Refuses a plain name on the blacklist, because it could never be connected."""
        if not is_literal(rule.name):
            return
        node = rule.node if is_literal(rule.node) else ""
        barrier = blacklisting(
            self.blacklist, Connection(rule.kind, absolute_name(rule.name), "*", node)
        )
        if barrier:
            raise RequestError(code, f"{rule} is blacklisted by {barrier}")


def check_gateway(gateway: str, code: Code) -> None:
    """Raises RequestError with `code` if the text is neither a gateway's name nor a pattern."""
    if not gateway.strip():
        raise RequestError(code, "the request names no gateway")
    if not gateway.isprintable():
        raise RequestError(
            code, f"{gateway!r} is no gateway's name: it has characters that cannot be printed"
        )
    check_pattern("gateway", gateway, code)


def _check_parameter(rule: Rule, code: Code) -> None:
    """Raises RequestError for a parameter that is not given by its plain name without node."""
    if rule.kind == Kind.PARAMETER and (rule.node or not is_literal(rule.name)):
        raise RequestError(
            code, f"a parameter is given by its plain name, without node, not as '{rule}'"
        )


def _check_number(rules: Collection[object], what: str) -> None:
    """Raises RequestError if a list of rules is too long."""
    if len(rules) > MOST_RULES:
        raise RequestError(
            Code.HUB_UNKNOWN_ERROR, f"a gateway may have {MOST_RULES} {what}: cancel some first"
        )


def _unique(rules: Iterable[Rule]) -> tuple[Rule, ...]:
    return tuple(dict.fromkeys(rules))
