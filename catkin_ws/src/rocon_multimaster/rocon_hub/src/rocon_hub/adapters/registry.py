"""The hub's side of the keys: its name, and the removal of gateways that fell silent."""

import json
import time
from collections.abc import Iterable

import redis

from rocon_gateway.core.hub import GATEWAYS_KEY, NAME_KEY, PROTOCOL_KEY, alive_key, letters_key, lost_key, record_key
from rocon_gateway.core.record import PROTOCOL
from rocon_hub.core.watch import Watch


class Registry:
    """What the hub does in its Redis.

    Args:
        client: a client of our own server.
        patience: how long the record of a silent gateway is kept [s].
    """

    def __init__(self, client: redis.Redis, patience: float) -> None:
        self._client = client
        self._patience = patience
        self._watch = Watch(patience)

    def open(self, name: str) -> None:
        """Writes the name by which gateways know that this is a hub; all silences are forgotten."""
        self._watch = Watch(self._patience)
        self._client.mset({PROTOCOL_KEY: PROTOCOL, NAME_KEY: name})

    def look(self) -> set[str]:
        """Tells everybody of gateways that have just fallen silent, and returns them."""
        names = sorted(self._members())
        lives = self._client.mget([alive_key(name) for name in names]) if names else []
        alive = [name for name, life in zip(names, lives, strict=True) if life]
        fallen = self._watch.fallen_silent(names, alive, time.monotonic())
        return {name for name in fallen if self._expire(name)}

    def _expire(self, name: str) -> bool:
        """Says that a gateway has fallen silent, unless it has joined again since we looked; returns whether it did.

        "Expired" after its "joined" would have the others drop a gateway that lives, for good.
        """
        with self._client.pipeline() as pipe:
            pipe.watch(alive_key(name))
            if pipe.exists(alive_key(name)):
                return False
            pipe.multi()
            pipe.set(lost_key(name), int(time.time()), ex=int(self._patience) + 1)
            pipe.publish(GATEWAYS_KEY, json.dumps({"gateway": name, "event": "expired"}))
            try:
                pipe.execute()
            except redis.WatchError:
                return False
        return True

    def _members(self) -> set[str]:
        try:
            return self._client.smembers(GATEWAYS_KEY)
        except redis.ResponseError:
            # A stranger wrote something else in its place. The gateways notice that they are not listed.
            self._client.delete(GATEWAYS_KEY)
            return set()

    def clear(self) -> set[str]:
        """Deletes all that belongs to gateways that were silent for too long, and returns them."""
        gone = self._watch.gone(time.monotonic())
        if gone:
            self._delete(gone, self._members())
        return gone

    def _delete(self, gone: Iterable[str], everybody: Iterable[str]) -> None:
        everybody = list(everybody)
        with self._client.pipeline() as pipe:
            for name in gone:
                pipe.delete(record_key(name), letters_key(name), lost_key(name))
                pipe.srem(GATEWAYS_KEY, name)
                for receiver in everybody:
                    pipe.hdel(letters_key(receiver), name)
            # What is no hash, because a stranger wrote it, has no letters to delete.
            pipe.execute(raise_on_error=False)
