"""The last barrier before arming: permission, passed preflight checks, and the vehicle's identity."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Sequence

from swarmctl.links.base import LinkError
from swarmctl.links.direct import DirectLink
from swarmctl.mavlink.events import Identity

TIMEOUT_S = 30.0
"""longest wait of an ordered launch for its preflight checks [s]"""
LASTS_S = 30.0
"""age above which checks are repeated before a launch [s]: batteries drain, other stations change fences"""
IDENTIFY_TIMEOUT_S = 15.0


class LaunchNotPermitted(RuntimeError):
    """A launch without permission to arm. Only a bug can cause it."""


class ArmingClearance:
    """The clearance of one vehicle for arming. It counts from a pass of the preflight checks to a reboot."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._permitted: Identity | None = None
        """the vehicle that may be armed; no other vehicle is launched at this address. None: no permission"""
        self._check_again: Callable[[], Awaitable[Sequence[str]]] | None = None
        self._given = asyncio.Event()
        self._given_s = -math.inf

    @property
    def is_permitted(self) -> bool:
        return self._permitted is not None

    @property
    def is_given(self) -> bool:
        """True if preflight checks have passed since the last boot."""
        return self._given.is_set()

    @property
    def is_fresh(self) -> bool:
        """True if preflight checks have passed since the last boot, at most LASTS_S ago."""
        return self.is_given and asyncio.get_running_loop().time() - self._given_s <= LASTS_S

    def permit(self, identity: Identity | None, check_again: Callable[[], Awaitable[Sequence[str]]]) -> None:
        """Let the vehicle be armed; `check_again` repeats its checks and returns a line for each failure."""
        self._permitted, self._check_again = identity, check_again

    def give(self) -> None:
        """Record that the preflight checks have passed now."""
        self._given_s = asyncio.get_running_loop().time()
        self._given.set()

    def withdraw(self) -> None:
        """Record that the vehicle has rebooted."""
        self._given.clear()

    async def confirm(self, link: DirectLink) -> None:
        """Wait for the clearance, and identify the vehicle once more.

        Raises LinkError if the vehicle must not be armed now, LaunchNotPermitted without permission.
        """
        if self._permitted is None:
            raise LaunchNotPermitted(self._name)
        try:
            async with asyncio.timeout(TIMEOUT_S):
                await self._given.wait()
        except TimeoutError:
            why = "preflight checks have not passed; see the messages of the checks [not-cleared]"
            raise LinkError(f"{self._name}: not launched: {why}") from None
        if not self.is_fresh:
            await self._renew()
        found = await link.identify(IDENTIFY_TIMEOUT_S)
        if found != self._permitted:
            expected, other = (f"{i.firmware}, uid {i.uid2.hex()}" for i in (self._permitted, found))
            text = f"another vehicle answers: expected {expected}, found {other} [other-vehicle]"
            raise LinkError(f"{self._name}: not launched: {text}")

    async def _renew(self) -> None:
        """Repeat the preflight checks. Raises LinkError if a check fails now."""
        assert self._check_again is not None  # set with the permission
        if failures := await self._check_again():
            raise LinkError("; ".join(failures))
        if not self.is_given:
            raise LinkError(f"{self._name}: not launched: the vehicle rebooted during its checks [rebooted]")
        self.give()
