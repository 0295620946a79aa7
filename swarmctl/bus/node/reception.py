"""Reception state of all UAVs of a process as tables: a message to a hundred UAVs is one step. No I/O.

A hundred UAVs in one process that observe five times a second receive fifty thousand observations a second.
Nearly every message is the sender's next message with its next observation, and needs no answer. The tables
have the numbers to recognise such a message: one row for each sender, one column for each receiver, in the
order of system ids. `ReceptionTable.deliver` checks and updates a whole row at once. Each node reads and
writes single numbers through its `ReceptionColumn`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.node.observation_log import ObservationLogs
from swarmctl.bus.node.own_sightings import OwnSightings
from swarmctl.core.frames import Frame, StateShared
from swarmctl.core.geo import LatLon, distances_m
from swarmctl.core.observation import Observation

STALE_S = 60.0
"""largest age of messages and of relayed states; older messages may be replays and are refused"""
SILENT_AFTER_S = 5.0
"""silence of a UAV after which its next message causes a request for missed observations"""
RANKED_LAST_AFTER_S = 20.0
"""time without direct or relayed news after which a UAV ranks last among the receivers"""
WORK_PER_MESSAGE = 5
MAX_WORK_PER_PERIOD, RATE_PERIOD_S = 10_000, 10.0
"""limit on the steps of work that a sender causes at a receiver in a period; more messages are refused"""
N_FINGERPRINTS = 2048
"""number of stored fingerprints of a UAV: the observations of a sender are often a little older"""
EMPTY_FINGERPRINT = 0
"""fingerprint of an empty set of observations"""

T = TypeVar("T")


class IndexedValues(Protocol[T]):
    """Numbers or objects by index."""

    def __getitem__(self, index: int, /) -> T: ...

    def __setitem__(self, index: int, value: T, /) -> None: ...


ReceiverMask = NDArray[np.bool_]
"""(UAVs of the swarm,) mask of a set of UAVs"""


class ReceptionTable:
    """The tables of all UAVs of the swarm; all nodes of the process share the tables."""

    def __init__(self, uavs: Iterable[int], options: NodeOptions) -> None:
        self.system_ids = np.array(sorted(set(uavs)), np.int64)
        """system id of each row of the arrays"""
        self._indices = {uav: index for index, uav in enumerate(self.system_ids.tolist())}
        self._clock_tolerance_s = options.clock_tolerance_s
        self.logs = ObservationLogs()
        self.sightings = OwnSightings()
        n = len(self._indices)
        # (sender, receiver): see the fields of `ReceptionColumn`
        self.newest = np.zeros((n, n), np.int64)
        self.incarnation = np.full((n, n), -1, np.int64)
        self.received_s = np.full((n, n), -np.inf)
        self.work = np.zeros((n, n), np.int64)
        self.work_period_end_s = np.full((n, n), -np.inf)
        self.upto = np.zeros((n, n), np.int64)
        self.in_order = np.zeros((n, n), np.bool_)
        self.log_number = np.zeros((n, n), np.int64)
        self.state = np.full((n, n), None, object)
        self.failed = np.zeros((n, n), np.bool_)
        self.lat_deg = np.full((n, n), np.nan)
        self.lon_deg = np.full((n, n), np.nan)
        self.state_s = np.full((n, n), -np.inf)
        self.direct_state_s = np.full((n, n), -np.inf)
        self.agreed_s = np.full((n, n), -np.inf)
        # (receiver,)
        self.fingerprint = np.zeros(n, np.int64)
        self.fingerprints = np.zeros((n, N_FINGERPRINTS), np.int64)
        self.n_fingerprints = np.zeros(n, np.int64)
        self.n_delivered = np.zeros(n, np.int64)

    def index_of(self, uav: int) -> int:
        """Return the index of a UAV's row and column."""
        return self._indices[uav]

    def mask(self, uavs: Iterable[int]) -> ReceiverMask:
        mask = np.zeros(len(self._indices), np.bool_)
        mask[[self._indices[uav] for uav in uavs]] = True
        return mask

    def uavs(self, mask: ReceiverMask) -> list[int]:
        """Return the system ids of a mask in ascending order."""
        uavs: list[int] = self.system_ids[mask].tolist()
        return uavs

    def deliver(
        self,
        sender: int,
        act: str,
        decoded: DecodedFrame,
        receivers: ReceiverMask,
        now_s: float,
        unix_s: float,
    ) -> ReceiverMask:
        """Deliver a message to the receivers that need no further action; return the mask of these receivers.

        For such a receiver the message is the sender's next observation, or a newer state that shows no
        missing observation of the sender. Nothing changes for the remaining receivers: pass the message to
        `Node.receive_decoded` for each of them. Both paths give the same result. `receivers` does not include
        the sender.
        """
        frame, content = decoded.frame, decoded.frame.content
        matches_key = frame.sender == sender and decoded.act == act
        is_in_time = -self._clock_tolerance_s <= unix_s - frame.unix_s <= STALE_S
        if not (matches_key and is_in_time and isinstance(content, Observation | StateShared)):
            return np.zeros_like(receivers)
        row = self._indices[sender]
        delivered = self._is_next(row, frame, receivers, now_s)
        if isinstance(content, Observation):
            delivered &= self.upto[row] == content.seq - 1
            delivered[_set_bits(self.sightings.conflicting_uavs(decoded.clear, decoded.occupied))] = False
            self._append(decoded, delivered, self.log_number[row])
            self.upto[row] += delivered
            self._toggle_mark(delivered, decoded.mark)
        else:
            delivered &= self.upto[row] >= content.last_seq
            delivered &= self._is_newer(row, frame.unix_s)
            self.state[row, delivered] = decoded
            self.failed[row, delivered] = content.phase == "failed"
            self.lat_deg[row, delivered], self.lon_deg[row, delivered] = content.lat_deg, content.lon_deg
            self.state_s[row, delivered] = self.direct_state_s[row, delivered] = now_s
            self.agreed_s[row, delivered & self._has_held(content.knows)] = now_s
        self.newest[row] += delivered
        self.work[row] += WORK_PER_MESSAGE * delivered
        self.received_s[row, delivered] = now_s
        self.n_delivered += delivered
        return delivered

    def _is_next(self, row: int, frame: Frame, receivers: ReceiverMask, now_s: float) -> ReceiverMask:
        """Return the receivers for which the frame is the next in order, within the limits."""
        return np.asarray(
            receivers
            & self.in_order[row]
            & (self.newest[row] == frame.n - 1)
            & (self.incarnation[row] == frame.incarnation)
            & (now_s - self.received_s[row] <= SILENT_AFTER_S)
            & (now_s < self.work_period_end_s[row])
            & (self.work[row] <= MAX_WORK_PER_PERIOD - WORK_PER_MESSAGE)
        )

    def _is_newer(self, row: int, unix_s: float) -> ReceiverMask:
        """Return the receivers whose known state of the sender is older, by the sender's clock."""
        states: list[DecodedFrame | None] = self.state[row].tolist()
        return np.array([state is None or state.frame.unix_s < unix_s for state in states], np.bool_)

    def _has_held(self, fingerprint: int) -> ReceiverMask:
        holds: ReceiverMask = (self.fingerprint == fingerprint) | (fingerprint == EMPTY_FINGERPRINT)
        if not holds.all():
            holds |= np.any(self.fingerprints == fingerprint, axis=1)
        return holds

    def _append(self, decoded: DecodedFrame, delivered: ReceiverMask, numbers: NDArray[np.int64]) -> None:
        """Append an observation to the receivers' logs; nearly always all receivers share one log.

        Remove from `delivered` the receivers without a shared log, or with another observation of the number.
        """
        remaining = delivered.copy()
        while remaining.any():
            number = numbers[remaining.argmax()]
            remaining &= numbers != number
            log = self.logs.by_number(int(number))
            if log is None or not log.try_append(decoded):
                delivered &= numbers != number

    def _toggle_mark(self, receivers: ReceiverMask, mark: int) -> None:
        self.fingerprint[receivers] ^= mark
        self.fingerprints[receivers, self.n_fingerprints[receivers] % N_FINGERPRINTS] = self.fingerprint[
            receivers
        ]
        self.n_fingerprints += receivers


def _set_bits(mask: int) -> list[int]:
    return [i for i in range(mask.bit_length()) if mask >> i & 1] if mask else []


class ReceptionColumn:
    """The reception state of one UAV, by the sender's row: a writable view of the tables."""

    def __init__(self, table: ReceptionTable, uav: int) -> None:
        """Reset the column, as for a UAV that has received nothing."""
        self.table = table
        self.index = at = table.index_of(uav)
        for counts in (table.newest, table.work, table.upto, table.in_order, table.log_number):
            counts[:, at] = 0
        table.incarnation[:, at] = -1
        for times in (
            table.received_s,
            table.work_period_end_s,
            table.state_s,
            table.direct_state_s,
            table.agreed_s,
        ):
            times[:, at] = -np.inf
        table.state[:, at] = None
        table.lat_deg[:, at] = table.lon_deg[:, at] = np.nan
        table.failed[:, at] = False
        table.fingerprint[at] = table.n_fingerprints[at] = table.n_delivered[at] = 0
        table.fingerprints[at] = 0
        table.sightings.forget(at)
        self.newest: IndexedValues[int] = _values(table.newest[:, at])
        """number of the sender's newest message"""
        self.incarnation: IndexedValues[int] = _values(table.incarnation[:, at])
        """incarnation in the sender's newest message; -1: no message received"""
        self.received_s: IndexedValues[float] = _values(table.received_s[:, at])
        """time of the sender's last direct message"""
        self.work: IndexedValues[int] = _values(table.work[:, at])
        """work that the sender's messages caused in the period until `work_period_end_s`"""
        self.work_period_end_s: IndexedValues[float] = _values(table.work_period_end_s[:, at])
        self.upto: IndexedValues[int] = _values(table.upto[:, at])
        """number up to which this UAV has all observations of the sender's current incarnation"""
        self.in_order: IndexedValues[bool] = _values(table.in_order[:, at])
        """True if no stored observation lies beyond a gap, so the table may append to log `log_number`"""
        self.log_number: IndexedValues[int] = _values(table.log_number[:, at])
        self.state: IndexedValues[DecodedFrame | None] = table.state[:, at]
        """newest known state, received directly or relayed"""
        self.lat_deg: IndexedValues[float] = _values(table.lat_deg[:, at])
        self.lon_deg: IndexedValues[float] = _values(table.lon_deg[:, at])
        """position in `state`; NaN: unknown"""
        self.failed: IndexedValues[bool] = _values(table.failed[:, at])
        """True if `state` reports the phase `failed`"""
        self.state_s: IndexedValues[float] = _values(table.state_s[:, at])
        """reception time of `state`"""
        self.direct_state_s: IndexedValues[float] = _values(table.direct_state_s[:, at])
        """reception time of the last direct state; -inf after `PeerRecord.record_missing`"""
        self.agreed_s: IndexedValues[float] = _values(table.agreed_s[:, at])
        """time of the last direct state without news for this UAV; -inf if an observation is missing"""
        self._fingerprint: IndexedValues[int] = _values(table.fingerprint[at : at + 1])
        self._fingerprints: IndexedValues[int] = _values(table.fingerprints[at])
        self._n_fingerprints: IndexedValues[int] = _values(table.n_fingerprints[at : at + 1])

    @property
    def fingerprint(self) -> int:
        """Hash of the set of this UAV's observations, 63 bits; the order of arrival has no effect."""
        return self._fingerprint[0]

    def toggle_mark(self, mark: int) -> None:
        """Add marks to the fingerprint, or remove marks: both are exclusive or."""
        self._fingerprint[0] ^= mark
        self._fingerprints[self._n_fingerprints[0] % N_FINGERPRINTS] = self._fingerprint[0]
        self._n_fingerprints[0] += 1

    def has_held(self, fingerprint: int) -> bool:
        """Return whether this UAV has, or once had, exactly the observations of this fingerprint."""
        if fingerprint in (EMPTY_FINGERPRINT, self._fingerprint[0]):
            return True
        return bool((self.table.fingerprints[self.index] == fingerprint).any())

    def set_state(self, decoded: DecodedFrame, state: StateShared, row: int, now_s: float) -> None:
        """Store a sender's state, received directly or relayed."""
        self.state[row], self.failed[row] = decoded, state.phase == "failed"
        self.lat_deg[row], self.lon_deg[row] = state.lat_deg, state.lon_deg
        self.state_s[row] = now_s

    def is_ranked_last(self, now_s: float) -> ReceiverMask:
        """Return the mask of the UAVs with a known state but no news for `RANKED_LAST_AFTER_S`."""
        table, at = self.table, self.index
        last_s = np.maximum(table.received_s[:, at], table.state_s[:, at])
        mask: ReceiverMask = (table.state_s[:, at] > -np.inf) & (now_s - last_s > RANKED_LAST_AFTER_S)
        return mask

    def nearest(self, position: LatLon | None, k: int | None, now_s: float) -> tuple[int, ...]:
        """Return the `k` UAVs nearest to `position`, without UAVs in the phase `failed`."""
        table, at = self.table, self.index
        mask = ~table.failed[:, at]
        mask[at] = False
        is_ranked_last = self.is_ranked_last(now_s)
        positions = table.lat_deg[mask, at], table.lon_deg[mask, at]
        return nearest_uavs(position, table.system_ids[mask], positions, is_ranked_last[mask], k)

    def pop_n_delivered(self) -> int:
        """Return the number of messages that the table has delivered since the last call."""
        n = int(self.table.n_delivered[self.index])
        self.table.n_delivered[self.index] = 0
        return n


def _values(table: NDArray[Any]) -> Any:
    """Return a view for single values as Python's own numbers, three times as fast as the array."""
    return memoryview(table)  # type: ignore[arg-type]


def nearest_uavs(
    position: LatLon | None,
    uavs: NDArray[np.int64],
    positions: tuple[NDArray[np.float64], NDArray[np.float64]],
    is_ranked_last: NDArray[np.bool_],
    k: int | None,
) -> tuple[int, ...]:
    """Return the `k` nearest of `uavs` by last known position, nearest first.

    The paper defines the communication range as a number of UAVs. `uavs` ascend; `positions` are latitudes
    and longitudes [deg], or NaN if unknown. UAVs without a position come after UAVs with a position, and UAVs
    in `is_ranked_last` come last. If `k` is None or not below the number of `uavs`, the result is `uavs`.
    """
    if k is None or k >= uavs.size:
        return tuple(uavs.tolist())
    metres = np.full(uavs.size, np.inf)
    if position is not None:
        known = np.flatnonzero(~np.isnan(positions[0]))
        metres[known] = distances_m(position, positions[0][known], positions[1][known])
    order = np.lexsort((uavs, metres, is_ranked_last))
    return tuple(uavs[order[:k]].tolist())
