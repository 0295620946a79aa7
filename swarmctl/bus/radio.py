"""Radio model: range, loss, delay and bandwidth of messages between UAVs. Pure.

The model works above every transport, in simulated time. The sender calls `Radio.send`, the receiver
`Radio.can_hear`. Each ordered pair of UAVs has its own random stream: the fate of the n-th message from one
to the other follows from the seed and n alone, in one process or in many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from swarmctl.core.geo import LatLon, distance_m

MAX_WAIT_S = 2.0
"""Messages that would wait longer for the transmitter are dropped as out of date."""
STREAM = 3
"""first part of the pairs' spawn keys, which separates them from other streams of the run's seed"""
_DRAWN_AHEAD = 32
"""messages; numpy draws many at little more than the cost of one"""


class LossReason(StrEnum):
    """Cause of a lost message."""

    QUIET = "quiet"
    """radio silence of the sender"""
    PARTITION = "partition"
    """the receiver is in another part of the swarm"""
    LOSS = "loss"
    """random loss"""
    BANDWIDTH = "bandwidth"
    """the sender's transmitter is overloaded"""
    TOO_FAR = "too_far"
    TOO_NEAR = "too_near"
    OVERLOAD = "overload"
    """not from the model: the receivers' machine is too slow for the messages"""


@dataclass(frozen=True, slots=True)
class Partition:
    """A split of the swarm from `from_s` until before `until_s`: UAVs reach those of their own group only.

    A UAV outside of all groups is isolated.
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
    """Radio silence of UAVs from `from_s` until before `until_s`."""

    uavs: frozenset[int]
    from_s: float = 0.0
    until_s: float = math.inf

    def silences(self, sender: int, now_s: float) -> bool:
        return sender in self.uavs and self.from_s <= now_s < self.until_s


def gilbert_probabilities(loss: float, burst: float | None) -> tuple[float, float]:
    """Return (p_enter, p_stay), the probabilities of a loss after a received and after a lost message.

    Gilbert's two-state model: in the bad state every message is lost. Each message leaves the bad state with
    probability p_exit = 1 / `burst`, so a burst has `burst` messages on average. In the long run a share
    p_enter / (p_enter + p_exit) of all messages is lost. This share is `loss` for
    p_enter = p_exit · loss / (1 − loss); p_stay = 1 − p_exit. Without `burst` both are `loss`: messages are
    independent, and bursts have 1 / (1 − loss) messages on average.

    Raises ValueError if no such model exists: at least one message is received between two bursts, so bursts
    shorter than loss / (1 − loss) cannot reach the share.
    """
    if not 0.0 <= loss < 1.0:
        raise ValueError(f"loss of {loss:g}: expected a share from 0 to below 1")
    if burst is None:
        return loss, loss
    shortest = max(1.0, loss / (1.0 - loss))
    if burst < shortest * (1.0 - 1e-9):
        # Rounded up, so that the number shown is valid; but not for the last bit of the division.
        least = math.ceil(100.0 * shortest - 1e-6) / 100.0
        raise ValueError(
            f"bursts of {burst:g} messages cannot lose a share of {loss:g}: at least one message is received "
            f"between two bursts; give at least {least:g}, or less loss"
        )
    return min(1.0, loss / (1.0 - loss) / burst), 1.0 - 1.0 / burst


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """Settings of the radio model; UAVs are system ids. The defaults deliver every message at once.

    Raises ValueError if `loss` and `loss_burst` are incompatible.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    loss_burst: float | None = None
    """mean number of messages lost in a row; None: losses are independent"""
    bandwidth_bytes_s: float = math.inf
    """per transmitter"""
    max_distance_m: float = math.inf
    min_distance_m: float = 0.0
    partitions: tuple[Partition, ...] = ()
    quiet: tuple[RadioSilence, ...] = ()

    def __post_init__(self) -> None:
        gilbert_probabilities(self.loss, self.loss_burst)


def _fates(rng: np.random.Generator, settings: RadioSettings) -> Iterator[tuple[bool, float]]:
    """Yield for each message of a pair whether it is lost, and its jitter [s].

    Each message takes two draws, used or not: the same messages are lost with jitter as without.
    """
    p_enter, p_stay = gilbert_probabilities(settings.loss, settings.loss_burst)
    p_lost = settings.loss  # stationary, as the state before the first message is unknown
    while True:
        draws = iter(rng.random(2 * _DRAWN_AHEAD).tolist())
        for lost_draw, jitter_draw in zip(draws, draws, strict=True):
            is_lost = lost_draw < p_lost
            p_lost = p_stay if is_lost else p_enter
            yield is_lost, jitter_draw * settings.jitter_s


class Radio:
    """The fates of messages, in the order of sending."""

    def __init__(self, settings: RadioSettings, seed: int) -> None:
        self.is_transparent = settings == RadioSettings()
        """whether every message arrives at once"""
        self._settings = settings
        self._seed = seed
        self._draws = settings.loss > 0.0 or settings.jitter_s > 0.0
        self._fates: dict[tuple[int, int], Iterator[tuple[bool, float]]] = {}
        self._free_at_s: dict[int, float] = {}

    def send(self, sender: int, to: int, n_bytes: int, now_s: float) -> float | LossReason:
        """Return the time of arrival of a message sent now, or the cause of its loss; [s] since the start.

        Partitions and radio silence count at the time of sending. A lost message occupies the transmitter
        all the same.
        """
        settings = self._settings
        # Drawn first, so that other causes of loss do not change the fates of later messages.
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
        """Return why UAVs at these positions do not hear each other; None if they do, limits included.

        A UAV with an unknown position is heard: its first message may report the position.
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
        """Return the end of a message's transmission, after all earlier ones; None above `MAX_WAIT_S`.

        A message to several receivers is sent to each of them separately.
        """
        bandwidth_bytes_s = self._settings.bandwidth_bytes_s
        if bandwidth_bytes_s == math.inf:
            return now_s
        begins_s = max(now_s, self._free_at_s.get(sender, now_s))
        if begins_s - now_s > MAX_WAIT_S:
            return None
        self._free_at_s[sender] = begins_s + n_bytes / bandwidth_bytes_s
        return self._free_at_s[sender]
