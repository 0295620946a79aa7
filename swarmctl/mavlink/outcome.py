"""How a procedure ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Flying = Literal["new", "old", "hold", "unknown"]


@dataclass(frozen=True, slots=True)
class Done:
    """`failure` is None when it did what it is named after."""

    failure: str | None = None


@dataclass(frozen=True, slots=True)
class Swapped(Done):
    """How a swap ended, and what the vehicle flies now."""

    flying: Flying = "unknown"
    stood_still_s: float = 0.0
    """for how long it held or stood still in the air meanwhile, by its own clock"""
