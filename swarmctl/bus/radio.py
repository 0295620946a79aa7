"""Radio model: range, loss, delay and bandwidth of messages between UAVs. No I/O.

The model works above every transport, in simulated time. The sender calls `Radio.send`, and the receiver
calls `Radio.distance_loss`. Each ordered pair of UAVs has its own random stream. So the random loss and the
jitter of a pair's n-th message do not depend on other pairs, nor on the number of processes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum

import msgspec
import numpy as np

from swarmctl.core.geo import LatLon, distance_m

MAX_WAIT_S = 2.0
"""longest wait for the transmitter; a message with a longer wait is dropped"""
SPAWN_KEY = 3
"""first number of the spawn keys; it separates this model's random streams from the run's other streams"""
_MESSAGES_PER_DRAW = 32
"""number of messages per draw; many random numbers take numpy little longer than a single number"""


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
    """overload of the receivers' machine; not a part of the model"""


class Partition(msgspec.Struct, frozen=True):
    """A split of the swarm into groups, from `from_s` to before `until_s` [s since the start].

    A UAV reaches only UAVs of its own group. A UAV outside all groups is isolated.
    """

    groups: tuple[frozenset[int], ...]
    from_s: float = 0.0
    until_s: float = math.inf

    def allows(self, sender: int, to: int, now_s: float) -> bool:
        if not self.from_s <= now_s < self.until_s:
            return True
        return any(sender in group and to in group for group in self.groups)


class RadioSilence(msgspec.Struct, frozen=True):
    """Radio silence of UAVs, from `from_s` to before `until_s` [s since the start]."""

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
    p_enter = p_exit · loss / (1 − loss); p_stay = 1 − p_exit. If `burst` is None, p_enter and p_stay are
    `loss`: losses are independent, and bursts have 1 / (1 − loss) messages on average.

    Raises ValueError for bursts shorter than 1 or than loss / (1 − loss): at least one message is received
    between two bursts, so shorter bursts cannot lose that share. Raises ValueError for a loss of 1 or more.
    """
    if not 0.0 <= loss < 1.0:
        raise ValueError(f"loss of {loss:g}: expected a share from 0 to below 1")
    if burst is None:
        return loss, loss
    shortest = max(1.0, loss / (1.0 - loss))
    if burst < shortest * (1.0 - 1e-9):
        # Rounded up, so that the shown number is valid; rounding errors of the division do not count.
        least = math.ceil(100.0 * shortest - 1e-6) / 100.0
        raise ValueError(
            f"bursts of {burst:g} messages cannot lose a share of {loss:g}: at least one message is received "
            f"between two bursts; give at least {least:g}, or less loss"
        )
    return min(1.0, loss / (1.0 - loss) / burst), 1.0 - 1.0 / burst


class RadioSettings(msgspec.Struct, frozen=True):
    """Settings of the radio model; UAVs are given by system id. The defaults deliver every message at once.

    Raises ValueError for a `loss` or `loss_burst` that `gilbert_probabilities` refuses.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    loss_burst: float | None = None
    """mean number of messages randomly lost in a row; None: losses are independent"""
    bandwidth_bytes_s: float = math.inf
    """bandwidth of each transmitter"""
    max_distance_m: float = math.inf
    min_distance_m: float = 0.0
    partitions: tuple[Partition, ...] = ()
    quiet: tuple[RadioSilence, ...] = ()

    def __post_init__(self) -> None:
        gilbert_probabilities(self.loss, self.loss_burst)


def _losses_and_jitters(rng: np.random.Generator, settings: RadioSettings) -> Iterator[tuple[bool, float]]:
    """Yield (lost, jitter [s]) of each message of a pair.

    Each message takes two draws, even without jitter, so jitter does not change which messages are lost.
    """
    p_enter, p_stay = gilbert_probabilities(settings.loss, settings.loss_burst)
    p_lost = settings.loss  # the stationary value: the state before the first message is unknown
    while True:
        draws = iter(rng.random(2 * _MESSAGES_PER_DRAW).tolist())
        for lost_draw, jitter_draw in zip(draws, draws, strict=True):
            is_lost = lost_draw < p_lost
            p_lost = p_stay if is_lost else p_enter
            yield is_lost, jitter_draw * settings.jitter_s


class Radio:
    """Radio model of one run: loss or arrival time of each message, in the order of sending."""

    def __init__(self, settings: RadioSettings, seed: int) -> None:
        self.is_transparent = settings == RadioSettings()
        """True for the default settings: every message arrives at once"""
        self._settings = settings
        self._seed = seed
        self._is_random = settings.loss > 0.0 or settings.jitter_s > 0.0
        self._pair_draws: dict[tuple[int, int], Iterator[tuple[bool, float]]] = {}
        self._free_at_s: dict[int, float] = {}

    def send(self, sender: int, to: int, n_bytes: int, now_s: float) -> float | LossReason:
        """Return the time of arrival of a message sent now [s since the start], or the cause of its loss.

        Partitions and radio silence count at the time of sending. Messages lost to radio silence or bandwidth
        take no transmission time; all other messages do.
        """
        settings = self._settings
        # The draw comes first, so that other causes of loss do not change the draws of later messages.
        is_lost, jitter_s = self._loss_and_jitter(sender, to) if self._is_random else (False, 0.0)
        if any(quiet.silences(sender, now_s) for quiet in settings.quiet):
            return LossReason.QUIET
        sent_s = self._transmit(sender, n_bytes, now_s)
        if sent_s is None:
            return LossReason.BANDWIDTH
        if not all(partition.allows(sender, to, now_s) for partition in settings.partitions):
            return LossReason.PARTITION
        return LossReason.LOSS if is_lost else sent_s + settings.delay_s + jitter_s

    def distance_loss(self, receiver: LatLon | None, sender: LatLon | None) -> LossReason | None:
        """Return the cause of loss between UAVs at these positions; None within the limits.

        If a position is None, no message is lost: the sender's first message may report the position.
        """
        settings = self._settings
        if settings.min_distance_m == 0.0 and settings.max_distance_m == math.inf:
            return None
        if receiver is None or sender is None:
            return None
        return self.range_loss(distance_m(receiver, sender))

    def range_loss(self, range_m: float) -> LossReason | None:
        """Return the cause of loss at this distance [m]; None within the limits."""
        settings = self._settings
        if range_m > settings.max_distance_m:
            return LossReason.TOO_FAR
        return LossReason.TOO_NEAR if range_m < settings.min_distance_m else None

    def _loss_and_jitter(self, sender: int, to: int) -> tuple[bool, float]:
        draws = self._pair_draws.get((sender, to))
        if draws is None:
            sequence = np.random.SeedSequence(self._seed, spawn_key=(SPAWN_KEY, sender, to))
            draws = _losses_and_jitters(np.random.default_rng(sequence), self._settings)
            self._pair_draws[sender, to] = draws
        return next(draws)

    def _transmit(self, sender: int, n_bytes: int, now_s: float) -> float | None:
        """Return the end time of a transmission [s]; None if the wait is above `MAX_WAIT_S`.

        A sender transmits a message to several receivers once for each receiver.
        """
        bandwidth_bytes_s = self._settings.bandwidth_bytes_s
        if bandwidth_bytes_s == math.inf:
            return now_s
        begins_s = max(now_s, self._free_at_s.get(sender, now_s))
        if begins_s - now_s > MAX_WAIT_S:
            return None
        self._free_at_s[sender] = begins_s + n_bytes / bandwidth_bytes_s
        return self._free_at_s[sender]
