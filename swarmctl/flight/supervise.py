"""Retries by a policy."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Backoff:
    """The waits between repeated attempts."""

    attempts: int
    first_s: float
    """wait after the first failure [s]"""
    factor: float = 2.0
    """ratio of each wait to the previous wait"""
    most_s: float = 60.0
    """longest wait [s]"""

    def delay_s(self, failed: int) -> float | None:
        """Return the wait after the `failed`-th failure (from 1) [s]; None: give up."""
        if failed >= self.attempts:
            return None
        return min(self.first_s * self.factor ** (failed - 1), self.most_s)


async def retrying(
    attempt: Callable[[], Awaitable[T]],
    policy: Backoff,
    retry_on: type[Exception] | tuple[type[Exception], ...],
) -> T:
    """Return the first success; raise the last failure when the policy gives up.

    Exceptions other than `retry_on` are raised at once.
    """
    failed = 0
    while True:
        try:
            return await attempt()
        except retry_on:
            failed += 1
            delay_s = policy.delay_s(failed)
            if delay_s is None:
                raise
        await asyncio.sleep(delay_s)
