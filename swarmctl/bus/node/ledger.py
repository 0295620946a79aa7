"""What the UAVs of a process have heard of whom, as tables: what one says to a hundred is one step. Pure.

A hundred UAVs in one process that see five times a second hear fifty thousand observations a second, nearly
all of which are simply news: the message after the last, with the observation after the last, of which there
is nothing to say. What decides that, and what it changes, stands here, a row for each UAV that is heard and
in it a place for each that hears, and is judged and changed for all at once. Each node reads and writes the
same numbers, its column of them, one by one.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmctl.bus.node.decoding import Reading
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.node.observation_log import Shelves
from swarmctl.bus.node.own_sightings import Sightings
from swarmctl.bus.node.reach import recipients
from swarmctl.core.frames import Frame, StateShared
from swarmctl.core.geo import LatLon
from swarmctl.core.observation import Observation

STALE_S = 60.0
"""An older message, or an older state that is passed on, is not taken: somebody may have kept it."""
SILENT_AFTER_S = 5.0
"""who is heard again after so long is asked what was missed"""
ALIVE_S = 20.0
"""of whom nothing was heard for longer, directly or by others, is spoken to last"""
A_MESSAGE = 5
MAX_WORK, WITHIN_S = 10_000, 10.0
"""what is done for one UAV in so long; faster ones are refused. A message is so much of it."""
REMEMBERED = 2048
"""fingerprints: while all speak no two hold quite the same"""
NOTHING = 0
"""the fingerprint of who knows nothing"""

T = TypeVar("T")


class Numbers(Protocol[T]):
    """By place."""

    def __getitem__(self, place: int, /) -> T: ...

    def __setitem__(self, place: int, number: T, /) -> None: ...


Hearers = NDArray[np.bool_]
"""(places,) which of the UAVs"""


class Ledger:
    """Of the UAVs `uavs`, those of this process and others: all of its nodes share one."""

    def __init__(self, uavs: Iterable[int], options: NodeOptions) -> None:
        self.known = np.array(sorted(set(uavs)), np.int64)
        """system ids, by place"""
        self._places = {uav: place for place, uav in enumerate(self.known.tolist())}
        self._clock_tolerance_s = options.clock_tolerance_s
        self.shelves = Shelves()
        self.sightings = Sightings()
        n = len(self._places)
        # (heard, hears): what `Column` says of each
        self.newest = np.zeros((n, n), np.int64)
        self.incarnation = np.full((n, n), -1, np.int64)
        self.heard_s = np.full((n, n), -np.inf)
        self.worked = np.zeros((n, n), np.int64)
        self.worked_until_s = np.full((n, n), -np.inf)
        self.upto = np.zeros((n, n), np.int64)
        self.in_order = np.zeros((n, n), np.bool_)
        self.shelf = np.zeros((n, n), np.int64)
        self.state = np.full((n, n), None, object)
        self.failed = np.zeros((n, n), np.bool_)
        self.lat_deg = np.full((n, n), np.nan)
        self.lon_deg = np.full((n, n), np.nan)
        self.told_s = np.full((n, n), -np.inf)
        self.said_s = np.full((n, n), -np.inf)
        self.agreed_s = np.full((n, n), -np.inf)
        # (hears,)
        self.fingerprint = np.zeros(n, np.int64)
        self.remembered = np.zeros((n, REMEMBERED), np.int64)
        self.n_remembered = np.zeros(n, np.int64)
        self.n_taken = np.zeros(n, np.int64)

    def place(self, uav: int) -> int:
        """Where its row and its column are."""
        return self._places[uav]

    def hearers(self, uavs: Iterable[int]) -> Hearers:
        hearers = np.zeros(len(self._places), np.bool_)
        hearers[[self._places[uav] for uav in uavs]] = True
        return hearers

    def uavs(self, hearers: Hearers) -> list[int]:
        """In ascending order."""
        uavs: list[int] = self.known[hearers].tolist()
        return uavs

    def take(
        self, sender: int, act: str, reading: Reading, hearers: Hearers, now_s: float, unix_s: float
    ) -> Hearers:
        """Those of `hearers` to whom this message is simply news, or a state of which nothing follows: they
        have taken it now.

        To the others nothing was done: for them it is to go the general way, `Node.hear`, which comes to the
        same. None of `hearers` is its sender.
        """
        frame, content = reading.frame, reading.frame.content
        is_its_own = frame.sender == sender and reading.act == act
        is_in_time = -self._clock_tolerance_s <= unix_s - frame.unix_s <= STALE_S
        if not (is_its_own and is_in_time and isinstance(content, Observation | StateShared)):
            return np.zeros_like(hearers)
        row = self._places[sender]
        takes = self._next(row, frame, hearers, now_s)
        if isinstance(content, Observation):
            takes &= self.upto[row] == content.seq - 1
            takes[_bits(self.sightings.against(reading.clear, reading.occupied))] = False
            self._shelve(reading, takes, self.shelf[row])
            self.upto[row] += takes
            self._know(takes, reading.mark)
        else:
            takes &= self.upto[row] >= content.last_seq
            takes &= self._is_newer(row, frame.unix_s)
            self.state[row, takes] = reading
            self.failed[row, takes] = content.phase == "failed"
            self.lat_deg[row, takes], self.lon_deg[row, takes] = content.lat_deg, content.lon_deg
            self.told_s[row, takes] = self.said_s[row, takes] = now_s
            self.agreed_s[row, takes & self._has_held(content.knows)] = now_s
        self.newest[row] += takes
        self.worked[row] += A_MESSAGE * takes
        self.heard_s[row, takes] = now_s
        self.n_taken += takes
        return takes

    def _next(self, row: int, frame: Frame, hearers: Hearers, now_s: float) -> Hearers:
        """To whom it is the message after the last, and nothing is missing that was seen before."""
        return np.asarray(
            hearers
            & self.in_order[row]
            & (self.newest[row] == frame.n - 1)
            & (self.incarnation[row] == frame.incarnation)
            & (now_s - self.heard_s[row] <= SILENT_AFTER_S)
            & (now_s < self.worked_until_s[row])
            & (self.worked[row] <= MAX_WORK - A_MESSAGE)
        )

    def _is_newer(self, row: int, unix_s: float) -> Hearers:
        """To whom a state of that time, by its sender's clock, is newer than the one that is known."""
        states: list[Reading | None] = self.state[row].tolist()
        return np.array([state is None or state.frame.unix_s < unix_s for state in states], np.bool_)

    def _has_held(self, fingerprint: int) -> Hearers:
        holds: Hearers = (self.fingerprint == fingerprint) | (fingerprint == NOTHING)
        if not holds.all():
            holds |= np.any(self.remembered == fingerprint, axis=1)
        return holds

    def _shelve(self, reading: Reading, takes: Hearers, numbers: NDArray[np.int64]) -> None:
        """On the shelves of those who take it, nearly always one; where that cannot be, they do not."""
        left = takes.copy()
        while left.any():
            number = numbers[left.argmax()]
            left &= numbers != number
            shelf = self.shelves.numbered(int(number))
            if shelf is None or not shelf.takes(reading):
                takes &= numbers != number

    def _know(self, who: Hearers, mark: int) -> None:
        self.fingerprint[who] ^= mark
        self.remembered[who, self.n_remembered[who] % REMEMBERED] = self.fingerprint[who]
        self.n_remembered += who


def _bits(bits: int) -> list[int]:
    return [place for place in range(bits.bit_length()) if bits >> place & 1] if bits else []


class Column:
    """What one UAV has heard of each, by place: its numbers in the ledger, to read and to write."""

    def __init__(self, ledger: Ledger, uav: int) -> None:
        """Of one that has heard nothing yet, whatever was before."""
        self.ledger = ledger
        self.place = at = ledger.place(uav)
        for table in (ledger.newest, ledger.worked, ledger.upto, ledger.in_order, ledger.shelf):
            table[:, at] = 0
        ledger.incarnation[:, at] = -1
        for table in (ledger.heard_s, ledger.worked_until_s, ledger.told_s, ledger.said_s, ledger.agreed_s):
            table[:, at] = -np.inf
        ledger.state[:, at] = None
        ledger.lat_deg[:, at] = ledger.lon_deg[:, at] = np.nan
        ledger.failed[:, at] = False
        ledger.fingerprint[at] = ledger.n_remembered[at] = ledger.n_taken[at] = 0
        ledger.remembered[at] = 0
        ledger.sightings.forget(at)
        self.newest: Numbers[int] = _numbers(ledger.newest[:, at])
        """number of its newest message"""
        self.incarnation: Numbers[int] = _numbers(ledger.incarnation[:, at])
        """as which it was heard last; -1: never"""
        self.heard_s: Numbers[float] = _numbers(ledger.heard_s[:, at])
        """when it was heard directly"""
        self.worked: Numbers[int] = _numbers(ledger.worked[:, at])
        """what was done for its messages"""
        self.worked_until_s: Numbers[float] = _numbers(ledger.worked_until_s[:, at])
        """when that is counted anew"""
        self.upto: Numbers[int] = _numbers(ledger.upto[:, at])
        """everything it saw, as it was started last, is held up to here"""
        self.in_order: Numbers[bool] = _numbers(ledger.in_order[:, at])
        """whether so much is held on the shelf below, and nothing beyond a gap"""
        self.shelf: Numbers[int] = _numbers(ledger.shelf[:, at])
        """its number"""
        self.state: Numbers[Reading | None] = ledger.state[:, at]
        """the newest that is known, told by itself or by others"""
        self.lat_deg: Numbers[float] = _numbers(ledger.lat_deg[:, at])
        self.lon_deg: Numbers[float] = _numbers(ledger.lon_deg[:, at])
        """where it was by that; NaN: not known"""
        self.failed: Numbers[bool] = _numbers(ledger.failed[:, at])
        """whether by that it flies no more"""
        self.told_s: Numbers[float] = _numbers(ledger.told_s[:, at])
        """when that came"""
        self.said_s: Numbers[float] = _numbers(ledger.said_s[:, at])
        """when it last told its state itself, unless it has more since then"""
        self.agreed_s: Numbers[float] = _numbers(ledger.agreed_s[:, at])
        """when it last told that it knew nothing that was not known here"""
        self._fingerprint: Numbers[int] = _numbers(ledger.fingerprint[at : at + 1])
        self._remembered: Numbers[int] = _numbers(ledger.remembered[at])
        self._n_remembered: Numbers[int] = _numbers(ledger.n_remembered[at : at + 1])

    @property
    def fingerprint(self) -> int:
        """The same for all who hold the same, whatever stands for it; 63 bits."""
        return self._fingerprint[0]

    def know(self, mark: int) -> None:
        """What this is the mark of, or was till now."""
        self._fingerprint[0] ^= mark
        self._remembered[self._n_remembered[0] % REMEMBERED] = self._fingerprint[0]
        self._n_remembered[0] += 1

    def has_held(self, fingerprint: int) -> bool:
        """Whether just this was held of late: then who holds it holds nothing that is not held here."""
        if fingerprint in (NOTHING, self._fingerprint[0]):
            return True
        return bool((self.ledger.remembered[self.place] == fingerprint).any())

    def told(self, reading: Reading, state: StateShared, place: int, now_s: float) -> None:
        """Of itself, or of it by others."""
        self.state[place], self.failed[place] = reading, state.phase == "failed"
        self.lat_deg[place], self.lon_deg[place] = state.lat_deg, state.lon_deg
        self.told_s[place] = now_s

    def silent(self, now_s: float) -> Hearers:
        """Those that have told their state, and of whom nothing has come for long."""
        ledger, at = self.ledger, self.place
        last_s = np.maximum(ledger.heard_s[:, at], ledger.told_s[:, at])
        silent: Hearers = (ledger.told_s[:, at] > -np.inf) & (now_s - last_s > ALIVE_S)
        return silent

    def nearest(self, here: LatLon | None, k: int | None, now_s: float) -> tuple[int, ...]:
        """The UAVs in range `k` of who is `here`, but those that have told that they fly no more."""
        ledger, at = self.ledger, self.place
        flies = ~ledger.failed[:, at]
        flies[at] = False
        silent = self.silent(now_s)
        places = ledger.lat_deg[flies, at], ledger.lon_deg[flies, at]
        return recipients(here, ledger.known[flies], places, silent[flies], k)

    def taken(self) -> int:
        """How many messages were taken at once since this was last asked."""
        n = int(self.ledger.n_taken[self.place])
        self.ledger.n_taken[self.place] = 0
        return n


def _numbers(table: NDArray[Any]) -> Any:
    """A view of the same memory for who reads and writes one at a time: three times as fast as the array, and
    what it reads are Python's own numbers."""
    return memoryview(table)  # type: ignore[arg-type]
