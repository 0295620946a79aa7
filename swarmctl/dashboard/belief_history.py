"""The observations that a vehicle, or the whole swarm, has learned, and its belief at any time. Pure."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.belief import OCCUPIED as BELIEVED_OCCUPIED
from swarmctl.core.belief import Belief, LookCounts, ObservationLog
from swarmctl.core.observation import BeliefItem, Checkpoint, Observation
from swarmctl.dashboard.picture import OCCUPIED, OWN, SEEN, UNSEEN, CellCodes

Name = tuple[int, int, int]
"""observer, incarnation, sequence number"""


class BeliefAt(NamedTuple):
    """The belief after the first `version` observations."""

    version: int
    belief: Belief
    own: NDArray[np.bool_]
    """(rows, cols) True for cells with a look of the vehicle itself"""

    @property
    def codes(self) -> CellCodes:
        known = self.belief.known
        codes = np.where(self.belief.looks > 0, SEEN, UNSEEN).astype(np.uint8)
        codes[known == BELIEVED_OCCUPIED] |= OCCUPIED
        codes[self.own] |= OWN
        return codes


class BeliefHistory:
    """Looks at cells in the order in which they were learned.

    The belief at a time follows from the sums of looks and of hits, whatever the order was.
    """

    def __init__(self, prior: Belief, uav: int | None) -> None:
        """`uav`: the vehicle, whose own looks are told apart; None: the belief of all together."""
        self._prior = prior
        self._uav = uav
        self._cols = prior.looks.shape[1]
        self._newest = prior
        self.times_s = array("d")
        """time of each item"""
        self._ends = array("q")
        """number of cells up to and with each item"""
        self._cells, self._looks, self._hits = array("i"), array("i"), array("i")
        self._own = bytearray()
        self._cache: BeliefAt | None = None

    def learn(self, time_s: float, items: Iterable[BeliefItem]) -> None:
        """Add the new ones of these observations. An item that the agents refuse is ignored."""
        for item in items:
            try:
                after = self._newest.merge((item,))
            except ValueError:  # outside the area, a malformed checkpoint, or a second content of one name
                continue
            if after is self._newest:
                continue
            if isinstance(item, Checkpoint):
                self._add_difference(after, item.observer)
            else:
                self._add(item)
            self._newest = after
            self.times_s.append(time_s)
            self._ends.append(len(self._cells))

    def _add(self, item: Observation) -> None:
        for row, col, occupied in item.cells:
            self._add_cell(item.observer, row * self._cols + col, 1, int(occupied))

    def _add_difference(self, after: Belief, observer: int) -> None:
        """Add the cells whose counts a checkpoint changes. Each of its other cells has counts already."""
        looks = (after.looks - self._newest.looks).ravel()
        hits = (after.hits - self._newest.hits).ravel()
        for cell in np.flatnonzero((looks != 0) | (hits != 0)).tolist():
            self._add_cell(observer, cell, int(looks[cell]), int(hits[cell]))

    def _add_cell(self, observer: int, cell: int, looks: int, hits: int) -> None:
        self._cells.append(cell)
        self._looks.append(looks)
        self._hits.append(hits)
        self._own.append(observer == self._uav)

    def version(self, time_s: float) -> int:
        """Return the number of items up to a time."""
        return bisect_right(self.times_s, time_s)

    def belief(self, version: int) -> BeliefAt:
        """Return the belief after the first `version` items."""
        before = self._cache
        if before is not None and before.version == version:
            return before
        if before is None or before.version > version:
            shape = self._prior.looks.shape
            looks, hits = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
            own, done = np.zeros(shape, bool), 0
        else:
            looks, hits = before.belief.looks.copy(), before.belief.hits.copy()
            own, done = before.own.copy(), self._ends[before.version - 1] if before.version else 0
        end = self._ends[version - 1] if version else 0
        cells = np.array(self._cells[done:end], np.int64)
        np.add.at(looks.ravel(), cells, np.array(self._looks[done:end], np.int32))
        np.add.at(hits.ravel(), cells, np.array(self._hits[done:end], np.int32))
        own.ravel()[cells[np.frombuffer(self._own[done:end], np.uint8) > 0]] = True
        self._cache = BeliefAt(version, self._of(looks, hits), own)
        return self._cache

    def own_belief(self, version: int) -> Belief:
        """Return the belief by the vehicle's own observations alone, after the first `version` items."""
        end = self._ends[version - 1] if version else 0
        is_own = np.frombuffer(self._own[:end], np.uint8) > 0
        cells = np.array(self._cells[:end], np.int64)[is_own]
        looks, hits = np.zeros(self._prior.looks.shape, np.int32), np.zeros(self._prior.looks.shape, np.int32)
        np.add.at(looks.ravel(), cells, np.array(self._looks[:end], np.int32)[is_own])
        np.add.at(hits.ravel(), cells, np.array(self._hits[:end], np.int32)[is_own])
        return self._of(looks, hits)

    def _of(self, looks: NDArray[np.int32], hits: NDArray[np.int32]) -> Belief:
        counts = LookCounts(looks, hits).sealed()
        return Belief(self._prior.count, self._prior.sensor, counts, 0, ObservationLog(), 0, {})
