"""One connection to one hub, from registration to deregistration.

Every call may block for up to `redis_client.TIMEOUT`. Only the first one may take longer: if it fails, it makes up to
two more attempts to find out why.
"""

import dataclasses
import json
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import redis

from rocon_hub_protocol.address import HubAddress
from rocon_hub_protocol.code import Code, HubError
from rocon_hub_protocol.key import (
    EXAMINE_KEY,
    GATEWAYS_KEY,
    NAME_KEY,
    NAMESPACES_KEY,
    PROTOCOL_KEY,
    SALT_KEY,
    alive_key,
    kept_key,
    lost_key,
    record_key,
    requests_key,
)
from rocon_hub_protocol.password import FILE_VARIABLE
from rocon_hub_protocol.record import (
    PROTOCOL,
    PeerRequest,
    Record,
    RecordError,
    is_gateway_name,
    record_from_text,
    request_from_text,
    sound_namespaces,
    text_from_record,
    text_from_request,
)
from rocon_hub_protocol.redis_client import (
    TIMEOUT,
    Access,
    NotOurHubError,
    needs_certificate,
    redis_client,
    unreachable,
)

Value = TypeVar("Value")

ALIVE = 2.0
"""Lifetime of a registration after a heartbeat [s]."""

HEARTBEAT = 0.5
"""Heartbeat period [s]."""

KEPT = 30 * 86400.0
"""How long the hub keeps a gateway's text after its last heartbeat [s]."""

FORGOTTEN = object()
"""In place of a request that was written, but may not be on the hub any more."""

SCANNED = 1000
"""Number of the hub's keys that are looked at by one call."""

_FULL = "OOM command not allowed"
"""In the errors of a Redis that has reached its memory limit."""


@dataclass(frozen=True, slots=True)
class Description:
    """A gateway as shown by `remote_gateway_info`: its record and the time since its last heartbeat [s] (0: alive)."""

    record: Record
    silence: float


class HubSession:
    """A gateway's session on a hub. Must be used by one thread, except `describe`.

    Raises:
        HubError: 12 if nothing answers, 14 if the hub refuses us, 16 if it is not a hub.
    """

    def __init__(self, address: HubAddress, access: Access, name: str, instance: str) -> None:
        if address.tls and access.certificates is None:
            raise needs_certificate(address)
        self.address = dataclasses.replace(address, tls=access.certificates is not None)
        self.name = name
        self.instance = instance
        self.client = redis_client(address, access)
        self._written: dict[str, PeerRequest | object] = {}
        self._record: Record | None = None
        self.salt = ""  #: the hub's salt as of the last heartbeat
        try:
            self.hub_name = self._introduce()
            # Identifies the server process: a hub with several addresses must be joined only once.
            self.identity = self._identity()
            self.events = self.client.pubsub()
            channels = (GATEWAYS_KEY, requests_key(name), EXAMINE_KEY)
            self.events.subscribe(*channels)
            # From now on no change can be missed: it is either in the data read or reported by an event.
            for _ in channels:
                self.events.get_message(timeout=TIMEOUT)
        except (redis.exceptions.AuthenticationError, redis.exceptions.ResponseError) as error:
            raise HubError(
                Code.HUB_CONNECTION_FAILED, f"the hub at {address} {_refusal(error)}"
            ) from None
        except UnicodeError as error:  # a name with an empty or too long part
            text = f"no hub at {address}: the name is invalid: {error}"
            raise HubError(Code.HUB_CONNECTION_UNRESOLVABLE, text) from None
        except (redis.RedisError, OSError) as error:
            raise unreachable(self.address, access, error) from None

    def _introduce(self) -> str:
        name, protocol, salt = self.client.mget(NAME_KEY, PROTOCOL_KEY, SALT_KEY)
        if name is None:
            raise HubError(
                Code.HUB_NAME_NOT_FOUND, f"the Redis at {self.address} is not a hub: it has no name"
            )
        if protocol != str(PROTOCOL):
            text = f"the hub '{name}' at {self.address} speaks protocol {protocol}, this gateway speaks {PROTOCOL}"
            raise HubError(Code.HUB_CONNECTION_FAILED, text)
        self.salt = salt or ""
        return name

    def _identity(self) -> str:
        identity = self.client.info("server").get("run_id")
        if not identity:
            text = f"the server at {self.address} is not a hub: its INFO has no run_id"
            raise HubError(Code.HUB_CONNECTION_FAILED, text)
        return str(identity)

    @property
    def holder(self) -> str | None:
        """The live instance registered under our name, if any."""
        return self.client.get(alive_key(self.name))

    def join(
        self, record: Record, requests: Mapping[str, PeerRequest], namespaces: Collection[str] = ()
    ) -> None:
        """Registers us, replacing an earlier gateway of our name. Record and requests are written before the event.

        Older requests under our name are withdrawn from gateways to which we have no request now, also from those that
        the hub does not list: an earlier gateway of our name may have written one to a gateway that had just left.

        Args:
            record: our record.
            requests: our request to each other gateway.
            namespaces: robot namespaces; every gateway remembers them as long as the hub does.
        """
        self._tell_namespaces(namespaces)
        self._record = record
        self._written = dict(requests)
        others = sorted(self._receivers() - {self.name, *requests})
        with self.client.pipeline() as pipe:
            for receiver in others:
                pipe.hdel(requests_key(receiver), self.name)
            pipe.set(record_key(self.name), text_from_record(record))
            pipe.set(alive_key(self.name), self.instance, px=int(ALIVE * 1000))
            pipe.delete(lost_key(self.name))
            pipe.sadd(GATEWAYS_KEY, self.name)
            for receiver, request in requests.items():
                pipe.hset(requests_key(receiver), self.name, text_from_request(request))
            self._tell(pipe, "joined", namespaces)
            results = pipe.execute(raise_on_error=False)
        # A key that another client has overwritten with a different type holds no request of ours, so ignore its error.
        for error in results[len(others) :]:
            if isinstance(error, redis.RedisError):
                raise error

    def _receivers(self) -> set[str]:
        """Returns the names of all gateways to which there may be requests: listed ones, and others with an inbox."""
        listed = set(self.client.smembers(GATEWAYS_KEY))
        try:
            inboxes = list(self.client.scan_iter(match=requests_key("*"), count=SCANNED))
        except redis.exceptions.NoPermissionError:  # a hub of an earlier version
            return listed
        return listed | {key.removeprefix(requests_key("")) for key in inboxes}

    def _tell(
        self, pipe: redis.client.Pipeline, event: str, namespaces: Collection[str] = ()
    ) -> None:
        said: dict[str, object] = {"gateway": self.name, "event": event}
        if namespaces:
            said["namespaces"] = sorted(namespaces)
        pipe.publish(GATEWAYS_KEY, json.dumps(said))

    def _tell_namespaces(self, namespaces: Collection[str]) -> None:
        if not namespaces:
            return
        try:
            self.client.sadd(NAMESPACES_KEY, *namespaces)
        except redis.ResponseError:  # another client has overwritten the key
            self.client.delete(NAMESPACES_KEY)
            self.client.sadd(NAMESPACES_KEY, *namespaces)

    def namespaces(self) -> frozenset[str]:
        """Returns the robot namespaces known to the hub."""
        try:
            return sound_namespaces(list(self.client.smembers(NAMESPACES_KEY)))
        except redis.ResponseError:  # likewise; repaired by the next gateway that announces one
            return frozenset()

    def live(self) -> tuple[str | None, bool]:
        """Sends a heartbeat; returns the instance registered under our name until now, and whether the hub lists it."""
        # Not a transaction: a full Redis refuses those, and registered gateways would then expire.
        with self.client.pipeline(transaction=False) as pipe:
            pipe.get(alive_key(self.name))
            pipe.sismember(GATEWAYS_KEY, self.name)
            pipe.get(SALT_KEY)
            pipe.pexpire(alive_key(self.name), int(ALIVE * 1000))
            pipe.pexpire(kept_key(self.name), int(KEPT * 1000))
            holder, listed, salt, *_ = pipe.execute()
        self.salt = salt or self.salt
        return holder, bool(listed)

    def present(self) -> set[str]:
        """Returns the unique names of all live gateways except ourselves."""
        names = sorted(filter(is_gateway_name, self.client.smembers(GATEWAYS_KEY) - {self.name}))
        if not names:
            return set()
        alive = self.client.mget([alive_key(name) for name in names])
        return {name for name, instance in zip(names, alive, strict=True) if instance}

    def watch(self, names: Iterable[str]) -> None:
        """Subscribes to changes of these gateways' records; read the records when an event confirms it."""
        self.events.subscribe(*(record_key(name) for name in names))

    def unwatch(self, names: Iterable[str]) -> None:
        """Unsubscribes from these gateways' records."""
        self.events.unsubscribe(*(record_key(name) for name in names))

    def records(self, names: Collection[str]) -> dict[str, Record | RecordError]:
        """Returns the records of those of `names` that have one, and the error of each invalid one."""
        names = sorted(names)
        texts = self.client.mget([record_key(name) for name in names]) if names else []
        found: dict[str, Record | RecordError] = {}
        for name, text in zip(names, texts, strict=True):
            if text is not None:
                found[name] = _parsed(text, record_from_text)
        return found

    def requests(self, senders: Collection[str] | None = None) -> dict[str, PeerRequest | None]:
        """Returns the requests to us, all or those of `senders`; None for a sender without a valid one.

        Raises:
            HubError: 17 if another client has overwritten their key. The key is deleted; the caller should join again.
        """
        try:
            texts = self._requests(senders)
        except redis.ResponseError as error:
            self.client.delete(requests_key(self.name))
            raise HubError(
                Code.HUB_CONNECTION_LOST, f"our requests there could not be read: {error}"
            ) from None
        found: dict[str, PeerRequest | None] = {}
        for name, text in texts.items():
            request = None if text is None else _parsed(text, request_from_text)
            found[name] = request if isinstance(request, PeerRequest) else None
        return found

    def _requests(self, senders: Collection[str] | None) -> dict[str, str | None]:
        if senders is None:
            return self.client.hgetall(requests_key(self.name))
        ordered = sorted(senders)
        return dict(zip(ordered, self.client.hmget(requests_key(self.name), ordered), strict=True))

    def write(self, record: Record, requests: Mapping[str, PeerRequest]) -> None:
        """Writes the changes since the last write; nothing if we have lost our name, which `live` will report."""
        if record == self._record and requests == self._written:
            return
        changed = [
            one
            for one in {*requests, *self._written}
            if requests.get(one) != self._written.get(one)
        ]

        def fill(pipe: redis.client.Pipeline) -> None:
            if record != self._record:
                pipe.set(record_key(self.name), text_from_record(record))
                pipe.publish(record_key(self.name), self.name)
            for receiver in changed:
                request = requests.get(receiver)
                if request is None:
                    pipe.hdel(requests_key(receiver), self.name)
                else:
                    pipe.hset(requests_key(receiver), self.name, text_from_request(request))
                pipe.publish(requests_key(receiver), self.name)

        if self._execute_as((self.instance,), fill):
            self._record, self._written = record, dict(requests)

    def _execute_as(
        self, holders: Collection[str | None], fill: Callable[[redis.client.Pipeline], object]
    ) -> bool:
        """Executes a transaction only if one of `holders` holds our name until its end; returns whether it did.

        A gateway that has lost its name must not overwrite the requests of the new holder. A full Redis refuses
        transactions.
        """
        with self.client.pipeline() as pipe:
            pipe.watch(alive_key(self.name))
            if pipe.get(alive_key(self.name)) not in holders:
                return False
            pipe.multi()
            fill(pipe)
            try:
                pipe.execute()
            except redis.WatchError:
                return False
        return True

    def _delete_as(
        self, holders: Collection[str | None], fill: Callable[[redis.client.Pipeline], object]
    ) -> bool:
        """Like `_execute_as`, for deletions and events only, which take no memory: works in a full Redis too."""
        try:
            return self._execute_as(holders, fill)
        except redis.ResponseError as error:
            if _FULL not in str(error):
                raise
        # Not a transaction. Our name stays ours meanwhile: nobody can join a full hub.
        if self.holder not in holders:
            return False
        with self.client.pipeline(transaction=False) as pipe:
            fill(pipe)
            pipe.execute()
        return True

    def forget(self, receiver: str) -> None:
        """Makes the next `write` repeat the request to `receiver`, which is a new instance or came from a lost hub.

        If there is no request to it any more, the next `write` deletes the former one.
        """
        if receiver in self._written:
            self._written[receiver] = FORGOTTEN

    def kept(self) -> str:
        """Returns the text that the hub has stored for our name; empty for none."""
        try:
            return self.client.get(kept_key(self.name)) or ""
        except redis.ResponseError:  # another client has overwritten the key
            return ""

    def keep(self, text: str) -> bool:
        """Stores a text on the hub for the next gateway of our name; it outlives us by `KEPT`. Empty deletes it.

        Returns whether it did: not if we have lost our name, which `live` will report.
        """
        if text:
            lifetime = int(KEPT * 1000)
            return self._execute_as(
                (self.instance,), lambda pipe: pipe.set(kept_key(self.name), text, px=lifetime)
            )
        return self._delete_as((self.instance,), lambda pipe: pipe.delete(kept_key(self.name)))

    def describe(self, names: Collection[str]) -> list[Description]:
        """Returns what the hub knows of `names`, or of all others if empty; skips unknown names. For any thread.

        Only a heartbeat makes a gateway alive. The time of loss proves nothing: the hub writes it later than the last
        heartbeat expires, and it expires itself.
        """
        names = sorted(names or self.client.smembers(GATEWAYS_KEY) - {self.name})
        found = self.records(names)
        records = {name: one for name, one in found.items() if isinstance(one, Record)}
        if not records:
            return []
        alive = self.client.mget([alive_key(name) for name in records])
        lost = self.client.mget([lost_key(name) for name in records])
        now = self.client.time()[0]
        return [
            Description(record, 0.0 if is_alive else _silence(since, now))
            for record, is_alive, since in zip(records.values(), alive, lost, strict=True)
        ]

    def leave(self) -> None:
        """Removes all our data from the hub, unless another gateway has taken our name."""

        def fill(pipe: redis.client.Pipeline) -> None:
            # Also the requests to us: a sender that is offline now could not withdraw its request before we return.
            pipe.delete(record_key(self.name), alive_key(self.name), requests_key(self.name))
            pipe.srem(GATEWAYS_KEY, self.name)
            for receiver in self._written:
                pipe.hdel(requests_key(receiver), self.name)
            self._tell(pipe, "left")

        self._delete_as((None, self.instance), fill)

    def close(self) -> None:
        """Closes the sockets."""
        self.events.close()
        self.client.close()
        self.client.connection_pool.disconnect()


def event_from_message(message: Mapping[str, Any]) -> tuple[str, str] | None:
    """Returns channel and text of a message from `HubSession.events`; None if it is not an event.

    The acknowledgement of a subscription counts as an event, because data read from then on misses no change.
    """
    if message["type"] == "message":
        return message["channel"], message["data"]
    if message["type"] == "subscribe":
        return message["channel"], message["channel"].removeprefix(record_key(""))
    return None


def _silence(lost: str | None, now: int) -> float:
    """Returns how long a gateway has been silent [s], at least as long as a heartbeat lasts.

    Args:
        lost: when the hub noticed it, in seconds since the epoch; None if it is not known.
        now: the hub's time, likewise.
    """
    return max(ALIVE, now - int(lost)) if lost and lost.isdecimal() else ALIVE


def _refusal(error: redis.RedisError) -> str:
    """Returns why a hub does not accept us, and what to do."""
    if isinstance(error, NotOurHubError):
        return str(error)
    if isinstance(error, redis.exceptions.AuthenticationError):
        return f"wants a password: set {FILE_VARIABLE} to the file that holds it"
    return f"refuses: {error}"


def _parsed(text: str, parse: Callable[[str], Value]) -> Value | RecordError:
    """Returns the value of a text, or the error of a malformed one."""
    try:
        return parse(text)
    except RecordError as error:
        return error
