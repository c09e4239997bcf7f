"""The hub's part of the keys in Redis: writes its name, and removes silent gateways."""

import json
import time
from collections.abc import Callable, Iterable, Iterator

import redis

from rocon_hub.watch import Watch
from rocon_hub_protocol.key import (
    GATEWAYS_KEY,
    NAME_KEY,
    PROTOCOL_KEY,
    SALT_KEY,
    alive_key,
    lost_key,
    record_key,
    requests_key,
)
from rocon_hub_protocol.record import PROTOCOL

_EXPIRE = """
if redis.call('exists', KEYS[1]) == 1 then return 0 end
redis.pcall('set', KEYS[2], ARGV[1], 'ex', ARGV[2])
redis.call('publish', KEYS[3], ARGV[3])
return 1
"""
"""A full Redis rejects the time of loss and any transaction; this script publishes the event anyway."""


LOST_MARGIN = 60.0
"""How much longer than the record the time of loss is kept, as records are deleted only now and then [s]."""


class Registry:
    """Maintains the hub's keys in Redis. Times are monotonic [s].

    Args:
        client: a client of our own server.
        patience: how long the record of a silent gateway is kept [s].
        salt: returns the fleet's salt, for its gateways; empty for none.
    """

    def __init__(self, client: redis.Redis, patience: float, salt: Callable[[], str] = str) -> None:
        self._salt = salt
        self._client = client
        self._patience = patience
        self._watch = Watch(patience)
        self._name = ""
        self.returned: set[str] = (
            set()
        )  #: gateways that the last look found alive again after a silence

    def open(self, name: str) -> None:
        """Writes the name that identifies this Redis as a hub, and resets the tracking of silent gateways."""
        self._watch = Watch(self._patience)
        self._name = name
        self.write()

    def write(self) -> None:
        """Writes, or rewrites, the keys that identify the hub; raises redis.ResponseError if Redis is full."""
        self._client.mset({PROTOCOL_KEY: PROTOCOL, NAME_KEY: self._name, SALT_KEY: self._salt()})

    def look(self, now: float) -> Iterator[str]:
        """Announces gateways that have just fallen silent, and yields each one after its announcement.

        Gateways skipped because of an error are announced by the next look.
        """
        names = sorted(self._members())
        lives = self._client.mget([alive_key(name) for name in names]) if names else []
        alive = [name for name, life in zip(names, lives, strict=True) if life]
        self.returned = self._watch.returned(alive)
        for name in sorted(self._watch.fallen_silent(names, alive)):
            if self._expire(name):
                self._watch.note(name, now)
                yield name

    def _expire(self, name: str) -> bool:
        """Announces that a gateway has expired, unless it has joined again meanwhile; returns whether it did announce.

        An "expired" after its "joined" would make the others drop a live gateway permanently.
        """
        since = int(time.time()), int(self._patience + LOST_MARGIN)
        event = json.dumps({"gateway": name, "event": "expired"})
        return bool(
            self._client.eval(
                _EXPIRE, 3, alive_key(name), lost_key(name), GATEWAYS_KEY, *since, event
            )
        )

    def _members(self) -> set[str]:
        try:
            return self._client.smembers(GATEWAYS_KEY)
        except redis.ResponseError:
            # Another client has overwritten the key. The gateways notice that they are not listed and join again.
            self._client.delete(GATEWAYS_KEY)
            return set()

    def clear(self, now: float) -> set[str]:
        """Deletes all data of gateways that were silent for too long; returns their names."""
        gone = self._watch.gone(now)
        if gone:
            self._delete(gone, self._members())
        return gone

    def _delete(self, gone: Iterable[str], everybody: Iterable[str]) -> None:
        gone = sorted(gone)
        # Not a transaction: a full Redis rejects those, but accepts deletions.
        with self._client.pipeline(transaction=False) as pipe:
            pipe.srem(GATEWAYS_KEY, *gone)
            for name in gone:
                pipe.delete(record_key(name), requests_key(name), lost_key(name))
            for receiver in everybody:
                pipe.hdel(requests_key(receiver), *gone)
            # A key that another client has overwritten with a different type holds no requests, so ignore its error.
            pipe.execute(raise_on_error=False)
