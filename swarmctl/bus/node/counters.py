"""What a UAV's network came to, in numbers."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass(slots=True)
class Tally:
    """What a UAV's network came to."""

    sent: Counter[str] = field(default_factory=Counter)
    """messages by act/kind, each recipient counted"""
    sent_bytes: int = 0
    received: int = 0
    """frames taken"""
    relayed: int = 0
    """observations of others that were passed on at once"""
    snapshots_asked: int = 0
    snapshots_served: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    """of what it sent or would have heard, by what the model of the radio did to it"""
    refused: Counter[str] = field(default_factory=Counter)
    """by reason"""
    refused_from: Counter[int] = field(default_factory=Counter)
    """by who sent it"""
    flagged: Counter[int] = field(default_factory=Counter)
    """cells of which a UAV told the contrary of what was seen here, by that UAV"""
