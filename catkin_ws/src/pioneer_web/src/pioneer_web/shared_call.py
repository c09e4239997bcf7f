"""Runs slow calls for pages without letting their number grow with the number of requests."""

import asyncio
from collections.abc import Awaitable, Callable, Hashable
from typing import Any, TypeVar

Value = TypeVar("Value")


class SharedCalls:
    """Runs one call for each key at a time; requests that arrive meanwhile get the same result."""

    def __init__(self) -> None:
        self._running: dict[Hashable, asyncio.Future[Any]] = {}

    async def result(self, key: Hashable, call: Callable[[], Awaitable[Value]]) -> Value:
        """Returns what the running call of this key returns, or else what ``call`` does; raises what it raises."""
        running = self._running.get(key)
        if running is None:
            running = asyncio.ensure_future(call())
            self._running[key] = running
            running.add_done_callback(lambda _: self._running.pop(key, None))
        # A page that closes does not cancel the call for the others.
        value: Value = await asyncio.shield(running)
        return value
