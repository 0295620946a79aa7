"""What goes into a node and comes out of it: its options, messages to be sent, what came of one."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from swarmctl.core.observation import Told


@dataclass(frozen=True, slots=True)
class NodeOptions:
    """What all nodes of a swarm have in common."""

    rows: int
    cols: int
    k: int | None = None
    """how many UAVs, the nearest, are spoken to; None: all"""
    relay: bool = False
    sync_every_s: float = 3.0
    """0: nobody is ever asked for what was missed"""
    round_trip_s: float = 0.0
    """what the model's delays make of a question and its answer"""
    clock_tolerance_s: float = 5.0
    perfect_sensors: bool = True
    """two looks that differ contradict each other"""


@dataclass(frozen=True, slots=True)
class Out:
    """A message to be sent."""

    to: tuple[int, ...]
    act: str
    data: bytes


class Took(msgspec.Struct):
    """What came of a message or of time. A Struct, for one is made of every message."""

    out: list[Out] = []
    news: list[Told] = []
    """for the agent"""
    said: list[tuple[str, str]] = []
    """(topic, text): of each topic a few are shown"""
