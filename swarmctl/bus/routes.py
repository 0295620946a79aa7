"""Which of a process's own subscriptions a key reaches, and who is told of a receiver's bug."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

from swarmctl.bus.base import Receive

EVERYTHING = "**"


class Routes:
    """Subscriptions to a single key, to `PREFIX/**`, or to `**`."""

    def __init__(self) -> None:
        self._by_key: dict[str, list[Receive]] = {}
        self._by_prefix: dict[str, list[Receive]] = {}

    def add(self, key_expression: str, receive: Receive) -> None:
        """Raises ValueError where the expression is of another form."""
        if key_expression == EVERYTHING or key_expression.endswith("/**"):
            stem, table = key_expression.removesuffix(EVERYTHING), self._by_prefix
        else:
            stem, table = key_expression, self._by_key
        if "*" in stem or "$" in stem:
            raise ValueError(f"expected a key, or one that ends in /**, found {key_expression!r}")
        table.setdefault(stem, []).append(receive)

    def reached_by(self, key: str) -> Iterator[Receive]:
        """A lookup for each part of the key, however many subscriptions there are."""
        yield from self._by_key.get(key, ())
        yield from self._by_prefix.get("", ())
        end = key.find("/")
        while end >= 0:
            yield from self._by_prefix.get(key[: end + 1], ())
            end = key.find("/", end + 1)

    def clear(self) -> None:
        self._by_key.clear()
        self._by_prefix.clear()


def report_to_loop(key: str, error: Exception) -> None:
    """Where nobody else is told of a receiver's bug: the loop's exception handler, which logs it."""
    asyncio.get_running_loop().call_exception_handler(
        {"message": f"a receiver of the bus failed at {key[:200]}", "exception": error}
    )
