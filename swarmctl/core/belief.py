"""What a vehicle knows of the hostiles: a set of observations, and the occupancy it implies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swarmctl.core import occupancy
from swarmctl.core.hostiles import HostileCount
from swarmctl.core.occupancy import Classes
from swarmctl.core.sensor import PERFECT, SensorModel

UNKNOWN = -1
CLEAR = 0
OCCUPIED = 1


@dataclass(frozen=True, slots=True)
class Observation:
    """Cells that one vehicle saw at one moment. (observer, seq) names it for ever."""

    observer: int
    """system id of the vehicle that saw it"""
    seq: int
    """counts this observer's observations"""
    time_s: float
    cells: tuple[tuple[int, int, bool], ...]
    """(row, col, occupied)"""


@dataclass(frozen=True, eq=False)
class Belief:
    """An immutable set of observations of an area of (rows, cols) cells in which hostiles hide.

    Merging is set union, so it does not matter in which order observations come, or how often: all that is
    believed follows from how often each cell was looked at and how often a hostile was seen there.
    """

    count: HostileCount
    """n_HA, as announced beforehand"""
    sensor: SensorModel
    """how reliable looks are taken to be"""
    looks: NDArray[np.int32]
    """(rows, cols) how often each cell was looked at; read-only"""
    hits: NDArray[np.int32]
    """(rows, cols) how many of these looks showed a hostile; read-only"""
    _seen: Mapping[int, Mapping[int, Observation]]
    """observer -> seq -> observation. Never changed in place: a merge copies the outer dictionary and the
    inner ones that grow, all others are shared with the belief it came from."""

    @classmethod
    def prior(
        cls, rows: int, cols: int, hostiles: int | HostileCount, sensor: SensorModel = PERFECT
    ) -> Belief:
        """Nothing observed yet; the paper's belief for a number of hostiles and a perfect sensor.

        Raises ValueError for an area or a number of hostiles that cannot be.
        """
        if rows < 1 or cols < 1:
            raise ValueError(f"an area of {rows} × {cols} cells: expected at least 1 × 1")
        count = HostileCount.known(hostiles) if isinstance(hostiles, int) else hostiles
        if count.greatest > rows * cols:
            raise ValueError(
                f"{count.greatest} hostiles in {rows} × {cols} cells: expected 0 to {rows * cols}, "
                "at most one a cell"
            )
        return cls(count, sensor, _read_only(rows, cols), _read_only(rows, cols), {})

    def merge(self, observations: Iterable[Observation]) -> Belief:
        """The union with `observations`; `self` where they bring nothing new.

        Raises ValueError, and takes none of them, where a cell lies outside the area or where one name
        (observer, seq) comes with two contents.
        """
        seen = dict(self._seen)
        grown: dict[int, dict[int, Observation]] = {}
        news: list[Observation] = []
        for observation in observations:
            held = seen.get(observation.observer, {}).get(observation.seq)
            if held is not None:
                if held != observation:
                    raise ValueError(_two_contents(observation))
                continue
            self._check_cells(observation)
            if observation.observer not in grown:
                grown[observation.observer] = dict(seen.get(observation.observer, {}))
                seen[observation.observer] = grown[observation.observer]
            grown[observation.observer][observation.seq] = observation
            news.append(observation)
        if not news:
            return self
        looks, hits = self.looks.copy(), self.hits.copy()
        for observation in news:
            for row, col, occupied in observation.cells:
                looks[row, col] += 1
                hits[row, col] += occupied
        looks.flags.writeable = hits.flags.writeable = False
        return Belief(self.count, self.sensor, looks, hits, seen)

    @property
    def n_observed(self) -> int:
        """v, cells observed so far"""
        return int(self._seen_cells.size)

    @cached_property
    def n_found(self) -> int:
        """n_V, hostiles found so far: cells that were looked at and hold one more likely than not"""
        classes, _ = self._classes
        return int(classes.n_cells[(classes.looks > 0) & (self._p_occupied > 0.5)].sum())

    @cached_property
    def announced_too_low(self) -> bool:
        """More hostiles were found than can be, by what was announced; with 95 % where sensors err."""
        return occupancy.announced_too_low(self.count, self.sensor, self._classes[0])

    @cached_property
    def known(self) -> NDArray[np.int8]:
        """(rows, cols) of UNKNOWN, CLEAR or OCCUPIED, for pictures: a cell that was looked at is taken for
        what it is more likely than not; read-only"""
        _, which = self._classes
        known = np.full(self.looks.shape, UNKNOWN, dtype=np.int8)
        known.ravel()[self._seen_cells] = np.where(self._p_occupied > 0.5, OCCUPIED, CLEAR)[which]
        known.flags.writeable = False
        return known

    def occupancy(self) -> NDArray[np.float64]:
        """p_O, the probability that a hostile holds a cell, shape (rows, cols), in [0, 1].

        Eq. 4 for the paper's belief, else its generalisation (`swarmctl.core.occupancy.bayes`).
        """
        classes, which = self._classes
        p_unseen = self._p_occupied[0] if classes.looks[0] == 0 else 0.0
        p_occupied = np.full(self.looks.shape, p_unseen)
        p_occupied.ravel()[self._seen_cells] = self._p_occupied[which]
        return p_occupied

    def unsettled(self, cells: Iterable[tuple[int, int, bool]]) -> tuple[tuple[int, int, bool], ...]:
        """Those of a look's cells of which one more look can teach something.

        What the paper's sensor has seen need not be sensed again (section 3); where sensors err, every look
        counts until a cell is certain.
        """
        return tuple(
            (r, c, occupied)
            for r, c, occupied in cells
            if not self.sensor.settled(int(self.looks[r, c]), int(self.hits[r, c]))
        )

    def seen_of(self, flat: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n, 2) looks and hits of cells given as row · cols + col"""
        return np.stack([self.looks.ravel()[flat], self.hits.ravel()[flat]], axis=1).astype(np.int64)

    @property
    def classes(self) -> Classes:
        """The cells of the area, by what was seen of them."""
        return self._classes[0]

    def observations(self) -> Iterator[Observation]:
        """Everything held, for a peer that joins late; in order of observer and seq."""
        for observer in sorted(self._seen):
            by_seq = self._seen[observer]
            for seq in sorted(by_seq):
                yield by_seq[seq]

    def n_cells_from(self, observer: int) -> int:
        """How many different cells this observer has told of."""
        by_seq = self._seen.get(observer, {})
        return len({(row, col) for seen in by_seq.values() for row, col, _ in seen.cells})

    @cached_property
    def _seen_cells(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.looks)

    @cached_property
    def _classes(self) -> tuple[Classes, NDArray[np.int64]]:
        """The classes in order of looks and hits, and the class of each cell seen."""
        pairs = self.seen_of(self._seen_cells)
        packed = pairs[:, 0] << 32 | pairs[:, 1]
        kinds, which, n_cells = np.unique(packed, return_inverse=True, return_counts=True)
        n_unseen = self.looks.size - packed.size
        if n_unseen:
            kinds, n_cells, which = np.append(0, kinds), np.append(n_unseen, n_cells), which + 1
        return Classes(kinds >> 32, kinds & 0xFFFFFFFF, n_cells.astype(np.int64)), which

    @cached_property
    def _p_occupied(self) -> NDArray[np.float64]:
        """p_O of each class"""
        classes, _ = self._classes
        if self.sensor.is_perfect and self.count.is_number:
            return occupancy.eq4(self.count.greatest, classes)
        return occupancy.bayes(self.count, self.sensor, classes)

    def _check_cells(self, observation: Observation) -> None:
        rows, cols = self.looks.shape
        for row, col, _ in observation.cells:
            if not (0 <= row < rows and 0 <= col < cols):
                raise ValueError(
                    f"observation {observation.seq} of vehicle {observation.observer}: cell ({row}, {col}) "
                    f"is outside the area of {rows} × {cols} cells; do both fly the same configuration?"
                )


def _read_only(rows: int, cols: int) -> NDArray[np.int32]:
    zeros = np.zeros((rows, cols), dtype=np.int32)
    zeros.flags.writeable = False
    return zeros


def _two_contents(observation: Observation) -> str:
    return (
        f"observation {observation.seq} of vehicle {observation.observer} came with two different contents; "
        "expected one observer a system id, and a sequence that does not start again: look for a second "
        "process that flies this vehicle, or one that was restarted"
    )
