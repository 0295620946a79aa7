"""A node's options, input, output and counters."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import msgspec

from swarmctl.core.frames import IntentShared, MemberShared, StateShared
from swarmctl.core.observation import BeliefItem

NewestT = TypeVar("NewestT", StateShared, IntentShared, MemberShared)
"""a kind of message of which only each UAV's newest counts"""

STALE_S = 60.0
"""age at which messages may be replays and are refused, in addition to the round trip of the radio model"""


class NodeOptions(msgspec.Struct, frozen=True):
    """Options of all nodes of a swarm."""

    rows: int
    cols: int
    k: int | None = None
    """number of nearest UAVs that each UAV sends to; None: all"""
    relay: bool = False
    """True: each UAV passes on new observations of other UAVs at once"""
    sync_every_s: float = 3.0
    """period of requests for missed observations; 0: no requests"""
    round_trip_s: float = 0.0
    """delay of a request and its answer together, in the radio model"""
    clock_tolerance_s: float = 5.0
    perfect_sensors: bool = True
    """True if two different observations of a cell contradict each other"""

    @property
    def max_age_s(self) -> float:
        """Largest age of messages and of relayed states."""
        return STALE_S + self.round_trip_s


class Instant(NamedTuple):
    """A moment, by both clocks."""

    run_s: float
    """simulated time of the run [s]"""
    unix_s: float
    """wall clock [s since 1970]"""


class OutgoingMessage(msgspec.Struct, frozen=True):
    """A message and its receivers."""

    to: tuple[int, ...]
    act: str
    data: bytes


class NodeOutput(msgspec.Struct):
    """Result of a message or of a tick; a Struct for speed, because every message has a result."""

    messages: list[OutgoingMessage] = []
    news: list[BeliefItem] = []
    """observations and checkpoints that are new to the agent"""
    notices: list[tuple[str, str]] = []
    """(topic, text); the network shows the first few notices of each topic"""


@dataclass(slots=True)
class NetworkCounters:
    """Statistics of one UAV's communication."""

    sent: Counter[str] = field(default_factory=Counter)
    """messages by act/kind; a message to several receivers counts for each receiver"""
    sent_bytes: int = 0
    received: int = 0
    """accepted messages"""
    relayed: int = 0
    """observations and checkpoints of other UAVs that were relayed at once"""
    snapshots_asked: int = 0
    snapshots_served: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    """messages lost by the radio model or by overload, by cause"""
    refused: Counter[str] = field(default_factory=Counter)
    """refused messages and frames, by reason"""
    refused_from: Counter[int] = field(default_factory=Counter)
    """refused messages and frames, by the UAV that sent or relayed them"""
    flagged: Counter[int] = field(default_factory=Counter)
    """number of contradicting cells, by observer; at least 1 if one observation came with two contents"""
