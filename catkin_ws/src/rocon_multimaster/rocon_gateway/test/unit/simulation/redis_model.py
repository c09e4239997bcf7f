"""An in-memory Redis with simulated time; implements only the commands that gateways and hub use."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn

import redis

Clock = Callable[[], float]


class RedisModel:
    """One run of a Redis server. Events are passed to `deliver(subscription, message)`, which may delay them."""

    def __init__(
        self, number: int, clock: Clock, deliver: Callable[[Subscription, dict[str, Any]], None]
    ) -> None:
        self.number = number
        self.clock = clock
        self.deliver = deliver
        self.values: dict[str, Any] = {}
        self.expiry: dict[str, float] = {}
        self.subscriptions: defaultdict[str, dict[Subscription, None]] = defaultdict(dict)

    def live(self, key: str) -> Any:
        if key in self.expiry and self.clock() >= self.expiry[key]:
            self.delete(key)
        return self.values.get(key)

    def delete(self, *keys: str) -> None:
        for key in keys:
            self.values.pop(key, None)
            self.expiry.pop(key, None)

    def set(self, key: str, value: str, px: int | None = None) -> None:
        self.values[key] = value
        self.expiry.pop(key, None)
        if px is not None:
            self.pexpire(key, px)

    def mset(self, values: Mapping[str, Any]) -> None:
        self.values.update((key, str(value)) for key, value in values.items())

    def get(self, key: str) -> Any:
        return self.live(key)

    def mget(self, *keys: Any) -> list[Any]:
        return [self.live(key) for key in (keys[0] if isinstance(keys[0], list) else keys)]

    def pexpire(self, key: str, milliseconds: int) -> None:
        if self.live(key) is not None:
            self.expiry[key] = self.clock() + milliseconds / 1000

    def sadd(self, key: str, *members: str) -> None:
        self.values.setdefault(key, set()).update(members)

    def srem(self, key: str, *members: str) -> None:
        self.values.get(key, set()).difference_update(members)

    def smembers(self, key: str) -> set[str]:
        return set(self.values.get(key, ()))

    def sismember(self, key: str, member: str) -> bool:
        return member in self.values.get(key, ())

    def hset(self, key: str, field: str, value: str) -> None:
        self.values.setdefault(key, {})[field] = value

    def hdel(self, key: str, *fields: str) -> None:
        for field in fields:
            self.values.get(key, {}).pop(field, None)

    def hgetall(self, key: str) -> dict[str, str]:
        return dict(self.values.get(key, {}))

    def hmget(self, key: str, fields: Iterable[str]) -> list[str | None]:
        return [self.values.get(key, {}).get(field) for field in fields]

    def scan_iter(self, match: str, count: int) -> list[str]:
        """Returns the keys that begin as `match` does, which ends with an asterisk."""
        return [key for key in self.values if key.startswith(match.removesuffix("*"))]

    def publish(self, channel: str, text: str) -> None:
        for subscription in list(self.subscriptions[channel]):
            self.deliver(subscription, {"type": "message", "channel": channel, "data": text})

    def info(self, _section: str) -> dict[str, str]:
        return {"run_id": str(self.number)}

    def expire_script(self, keys: list[str], event: str) -> int:
        """Emulates the hub's script: marks a gateway as lost if its heartbeat has expired."""
        alive, lost, channel = keys
        if self.live(alive) is not None:
            return 0
        self.set(lost, str(int(self.clock())))
        self.publish(channel, event)
        return 1


class ClientModel:
    """One process's connection. `server()` returns the Redis that it reaches now, or raises a `redis.RedisError`."""

    def __init__(self, server: Callable[[], RedisModel]) -> None:
        self._server = server
        self.connection_pool = self

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments, **options: getattr(self._server(), name)(*arguments, **options)

    def eval(
        self, _script: str, _count: int, alive: str, lost: str, channel: str, *arguments: object
    ) -> int:
        return self._server().expire_script([alive, lost, channel], str(arguments[-1]))

    def pubsub(self) -> Subscription:
        return Subscription(self._server)

    def pipeline(self, transaction: bool = True) -> PipelineModel:
        return PipelineModel(self._server)

    def close(self) -> None:
        """Nothing to close."""

    disconnect = close


class PipelineModel:
    """Commands that are executed together."""

    def __init__(self, server: Callable[[], RedisModel]) -> None:
        self._server = server
        self._commands: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self._watching = False

    def __enter__(self) -> PipelineModel:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to release."""

    def watch(self, _key: str) -> None:
        """Needs no check: in a single thread, nothing can happen in between."""
        self._watching = True

    def multi(self) -> None:
        self._watching = False

    def __len__(self) -> int:
        return len(self._commands)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if self._watching:
            return getattr(self._server(), name)
        return lambda *arguments, **options: self._commands.append((name, arguments, options))

    def execute(self, raise_on_error: bool = True) -> list[Any]:
        server = self._server()
        return [
            getattr(server, name)(*arguments, **options)
            for name, arguments, options in self._commands
        ]


class Subscription:
    """A connection that receives events; bound to the run of Redis that it was created on."""

    def __init__(self, server: Callable[[], RedisModel]) -> None:
        self._server = server
        self.redis = server()
        self.arrived: list[dict[str, Any]] = []
        self.is_open = True
        self.last: dict[str, float] = {}

    def subscribe(self, *channels: str) -> None:
        self._check()
        for channel in channels:
            self.redis.subscriptions[channel][self] = None
            self.redis.deliver(self, {"type": "subscribe", "channel": channel})

    def unsubscribe(self, *channels: str) -> None:
        self._check()
        for channel in channels:
            self.redis.subscriptions[channel].pop(self, None)

    def get_message(self, timeout: float = 0.0) -> None:
        """`HubSession` itself reads only acknowledgements, which the simulation delivers later instead."""

    def take(self) -> list[dict[str, Any]]:
        """Returns the events that have arrived; raises redis.ConnectionError if the connection's Redis has ended."""
        self._check()
        arrived, self.arrived = self.arrived, []
        return arrived

    def close(self) -> None:
        self.is_open = False
        for subscribers in self.redis.subscriptions.values():
            subscribers.pop(self, None)

    def _check(self) -> None:
        if self._server() is not self.redis:
            _lost()


def _lost() -> NoReturn:
    raise redis.ConnectionError("Connection closed by server.")
