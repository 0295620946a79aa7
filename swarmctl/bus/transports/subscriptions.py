"""Subscriptions of a process by key, and reports of bugs in receivers."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

from swarmctl.bus.transports.base import Receive
from swarmctl.core.operator_text import excerpt, printable

EVERYTHING = "**"
MAX_TEXTS = 32
"""largest number of different texts about bugs; senders of messages can influence the texts"""


class Subscriptions:
    """Subscriptions to a single key, to `PREFIX/**`, or to `**`."""

    def __init__(self) -> None:
        self._by_key: dict[str, list[Receive]] = {}
        self._by_prefix: dict[str, list[Receive]] = {}

    def add(self, key_expression: str, receive: Receive) -> None:
        """Add a subscription. Raises ValueError for other forms of expressions."""
        if key_expression == EVERYTHING or key_expression.endswith("/**"):
            stem, table = key_expression.removesuffix(EVERYTHING), self._by_prefix
        else:
            stem, table = key_expression, self._by_key
        if "*" in stem or "$" in stem:
            raise ValueError(f"expected a key, or a prefix with /**, found {key_expression!r}")
        table.setdefault(stem, []).append(receive)

    def reached_by(self, key: str) -> Iterator[Receive]:
        """Yield the receivers of a key, with one look-up for each part of the key."""
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
    """Report a receiver's bug to the loop's exception handler, which logs it."""
    asyncio.get_running_loop().call_exception_handler(
        {"message": f"a receiver of the bus failed at {key[:200]}", "exception": error}
    )


class ReportOnce:
    """A `Failure` callback for flights: shows a receiver's exception in one line, each text once."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._said: set[str] = set()

    def __call__(self, key: str, error: Exception) -> None:
        if len(self._said) >= MAX_TEXTS:
            return
        *_, frame = traceback.extract_tb(error.__traceback__) or [None]
        where = "" if frame is None else f" in {frame.name}, {Path(frame.filename).name}:{frame.lineno}"
        text = (
            f"a bug in handling a message of the bus{where}; the message is ignored: "
            f"{type(error).__name__}: {error}"
        )
        text = excerpt(text)
        if text not in self._said:
            self._said.add(text)
            self._say(f"{text} (key {printable(key[:100])}; shown once) [receiver-bug]")
