"""How a procedure ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

FlyingAfterSwap = Literal["new", "old", "hold", "theirs", "unknown"]
"""theirs: what somebody else wants, who has chosen another mode"""


@dataclass(frozen=True, slots=True)
class Done:
    """`failure` is None when it did what it is named after."""

    failure: str | None = None


@dataclass(frozen=True, slots=True)
class LaunchBlocked(Done):
    """A launch that has not left the ground, for somebody came into its way; the vehicle is not armed."""

    was_armed: bool = False
    """and has been disarmed again"""


@dataclass(frozen=True, slots=True)
class Uploaded(Done):
    """How an upload on the ground ended."""

    swap_takes_s: float = 0.0
    """so long a change in flight will take over this link, by how long this took"""


@dataclass(frozen=True, slots=True)
class Swapped(Done):
    """How a swap ended, and what the vehicle flies now."""

    flying: FlyingAfterSwap = "unknown"
    stood_still_s: float = 0.0
    """for how long it held or stood still in the air meanwhile, by its own clock"""
    took_s: float | None = None
    """until it flew the new plan, by its own clock; None where it does not"""
    is_late: bool = False
    """it had flown past where the new plan leaves the old one: the next has to leave it farther ahead"""
