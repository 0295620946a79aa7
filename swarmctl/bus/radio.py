"""What a radio does to messages: who hears whom, what is lost, and when the rest arrives. Pure.

A model above every transport, in simulated time. The sender asks `Radio.send`, the receiver `Radio.can_hear`.
Chance is drawn for each ordered pair of UAVs by itself: what the n-th message from one to the other meets
follows from the seed and n, whatever else is sent or lost, and be the UAVs in one process or in many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from swarmctl.core.geo import LatLon, distance_m

MAX_WAIT_S = 2.0
"""What would wait longer for its sender's transmitter is out of date, and dropped."""
STREAM = 3
"""first part of the pairs' spawn keys: keeps them apart from whatever else is spawned from the run's seed"""
_DRAWN_AHEAD = 32
"""messages; numpy draws many at little more than the cost of one"""


class LossReason(StrEnum):
    """Why a message does not arrive."""

    QUIET = "quiet"
    """its sender sends nothing at that time"""
    PARTITION = "partition"
    """its receiver is in another part of the swarm"""
    LOSS = "loss"
    """by chance"""
    BANDWIDTH = "bandwidth"
    """its sender has too much to send"""
    TOO_FAR = "too_far"
    TOO_NEAR = "too_near"
    OVERLOAD = "overload"
    """no model: more is said than the receivers' machine can hear"""


@dataclass(frozen=True, slots=True)
class Partition:
    """From `from_s` until before `until_s`, UAVs reach those of their own group only.

    Who is in no group reaches nobody and is reached by nobody.
    """

    groups: tuple[frozenset[int], ...]
    from_s: float = 0.0
    until_s: float = math.inf

    def allows(self, sender: int, to: int, now_s: float) -> bool:
        if not self.from_s <= now_s < self.until_s:
            return True
        return any(sender in group and to in group for group in self.groups)


@dataclass(frozen=True, slots=True)
class RadioSilence:
    """From `from_s` until before `until_s`, these UAVs send nothing."""

    uavs: frozenset[int]
    from_s: float = 0.0
    until_s: float = math.inf

    def silences(self, sender: int, now_s: float) -> bool:
        return sender in self.uavs and self.from_s <= now_s < self.until_s


def gilbert_probabilities(loss: float, burst: float | None) -> tuple[float, float]:
    """(p_enter, p_stay): the chance that a message is lost after one that came through, and after a lost one.

    Gilbert's two-state model, in whose bad state everything is lost. The bad state is left with chance
    p_exit = 1 / `burst` at each message, so it lasts `burst` messages on average; in the long run a share
    p_enter / (p_enter + p_exit) of all messages falls into it, and that this is `loss` makes
    p_enter = p_exit · loss / (1 − loss). p_stay = 1 − p_exit. Without `burst` both are `loss`: each message
    is drawn for itself, and bursts have 1 / (1 − loss) messages on average.

    Raises ValueError where there is no such model: between two bursts at least one message comes through, so
    bursts shorter than loss / (1 − loss) cannot make up the share.
    """
    if not 0.0 <= loss < 1.0:
        raise ValueError(f"a share of {loss:g} cannot be lost; give a number from 0 to below 1")
    if burst is None:
        return loss, loss
    shortest = max(1.0, loss / (1.0 - loss))
    if burst < shortest * (1.0 - 1e-9):
        text = f"{burst:g} in a row cannot make up {loss:g} of all: between two bursts one comes through"
        # Rounded up, so that what is read can be given; but not for the last bit of the division.
        raise ValueError(
            f"{text}; give at least {math.ceil(100.0 * shortest - 1e-6) / 100.0:g}, or less loss"
        )
    return min(1.0, loss / (1.0 - loss) / burst), 1.0 - 1.0 / burst


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """What the radio is like; UAVs are system ids. As it stands it does nothing to messages.

    Raises ValueError where `loss` and `loss_burst` cannot be together.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    loss_burst: float | None = None
    """messages lost in a row, on average; None: each is drawn for itself"""
    bandwidth_bytes_s: float = math.inf
    """of each UAV's transmitter"""
    max_distance_m: float = math.inf
    min_distance_m: float = 0.0
    partitions: tuple[Partition, ...] = ()
    quiet: tuple[RadioSilence, ...] = ()

    def __post_init__(self) -> None:
        gilbert_probabilities(self.loss, self.loss_burst)


def _fates(rng: np.random.Generator, settings: RadioSettings) -> Iterator[tuple[bool, float]]:
    """For each message of a pair in turn, whether it is lost and how much later it comes [s].

    Two draws a message, whether or not both are used: losses stay the same where a jitter is added.
    """
    p_enter, p_stay = gilbert_probabilities(settings.loss, settings.loss_burst)
    p_lost = settings.loss  # nobody knows what came before the first
    while True:
        draws = iter(rng.random(2 * _DRAWN_AHEAD).tolist())
        for lost_draw, jitter_draw in zip(draws, draws, strict=True):
            is_lost = lost_draw < p_lost
            p_lost = p_stay if is_lost else p_enter
            yield is_lost, jitter_draw * settings.jitter_s


class Radio:
    """What becomes of each message, in the order in which they are sent."""

    def __init__(self, settings: RadioSettings, seed: int) -> None:
        self.is_transparent = settings == RadioSettings()
        """whether everything arrives at once, and nobody needs to ask"""
        self._settings = settings
        self._seed = seed
        self._draws = settings.loss > 0.0 or settings.jitter_s > 0.0
        self._fates: dict[tuple[int, int], Iterator[tuple[bool, float]]] = {}
        self._free_at_s: dict[int, float] = {}

    def send(self, sender: int, to: int, n_bytes: int, now_s: float) -> float | LossReason:
        """When a message arrives that is sent now, or why it does not; both in seconds since the start.

        Partitions and quiet times count at sending. What is lost on the way has kept the transmitter busy all
        the same, as the sender does not know.
        """
        settings = self._settings
        # Drawn first, so that a message that comes to nothing else changes no later one's luck.
        is_lost, jitter_s = self._fate(sender, to) if self._draws else (False, 0.0)
        if any(quiet.silences(sender, now_s) for quiet in settings.quiet):
            return LossReason.QUIET
        sent_s = self._transmit(sender, n_bytes, now_s)
        if sent_s is None:
            return LossReason.BANDWIDTH
        if not all(partition.allows(sender, to, now_s) for partition in settings.partitions):
            return LossReason.PARTITION
        return LossReason.LOSS if is_lost else sent_s + settings.delay_s + jitter_s

    def can_hear(self, me: LatLon | None, other: LatLon | None) -> LossReason | None:
        """Why UAVs at these places do not hear each other; None if they do, just at a limit as well.

        A UAV whose place nobody knows is heard: its first message may be what tells it.
        """
        settings = self._settings
        if settings.min_distance_m == 0.0 and settings.max_distance_m == math.inf:
            return None
        if me is None or other is None:
            return None
        apart_m = distance_m(me, other)
        if apart_m > settings.max_distance_m:
            return LossReason.TOO_FAR
        return LossReason.TOO_NEAR if apart_m < settings.min_distance_m else None

    def _fate(self, sender: int, to: int) -> tuple[bool, float]:
        fates = self._fates.get((sender, to))
        if fates is None:
            sequence = np.random.SeedSequence(self._seed, spawn_key=(STREAM, sender, to))
            fates = _fates(np.random.default_rng(sequence), self._settings)
            self._fates[sender, to] = fates
        return next(fates)

    def _transmit(self, sender: int, n_bytes: int, now_s: float) -> float | None:
        """When a message has left its sender, after all that it sent before; None if it waited too long.

        A message to several is sent to each by itself.
        """
        bandwidth_bytes_s = self._settings.bandwidth_bytes_s
        if bandwidth_bytes_s == math.inf:
            return now_s
        begins_s = max(now_s, self._free_at_s.get(sender, now_s))
        if begins_s - now_s > MAX_WAIT_S:
            return None
        self._free_at_s[sender] = begins_s + n_bytes / bandwidth_bytes_s
        return self._free_at_s[sender]
