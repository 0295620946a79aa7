"""What a vehicle knows of the hostiles: a set of observations, and the occupancy it implies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.inference import occupancy
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.occupancy import CellClasses
from swarmctl.core.inference.sensor import PERFECT, SensorModel
from swarmctl.core.observation import (
    CELL,
    BeliefItem,
    CellCounts,
    Checkpoint,
    IndexedObservation,
    Observation,
    Source,
    indexed,
)

UNKNOWN = -1
CLEAR = 0
OCCUPIED = 1
ONCE = np.int32(1)


class ObservationLog:
    """Observations in the order in which they were merged, each name once; it only grows.

    Beliefs that grew from one another share one, and each knows how much of it is its own: a merge copies
    nothing. Who merges into a belief whose log has grown beyond it begins a log of its own.
    """

    __slots__ = ("at", "items", "n_covered")

    def __init__(self, items: Iterable[IndexedObservation] = ()) -> None:
        self.items = list(items)
        self.at = {item.name: where for where, item in enumerate(self.items)}
        """name -> where in the log"""
        self.n_covered = 0
        """about how many a checkpoint stands for by now; they go when they are the greater part"""

    def of(self, source: Source, after: int, upto: int, n: int) -> list[int]:
        """Where, in the first `n`, the observations of these sequence numbers are, without the first."""
        if upto - after < n:
            places = [self.at.get((*source, seq), n) for seq in range(after + 1, upto + 1)]
            return [where for where in places if where < n]
        return [
            where
            for where, item in enumerate(self.items[:n])
            if item.seen.source == source and after < item.seen.seq <= upto
        ]


@dataclass(frozen=True, slots=True, eq=False)
class LookCounts:
    """How often each cell was looked at, and how often a hostile was seen there; (rows, cols) each."""

    looks: NDArray[np.int32]
    hits: NDArray[np.int32]

    def copy(self) -> LookCounts:
        """One that can be written to."""
        return LookCounts(self.looks.copy(), self.hits.copy())

    def count(self, seen: Sequence[IndexedObservation], sign: np.int32 = ONCE) -> None:
        """Cells may be named several times."""
        if seen:
            # With a plain int, or another type, `add.at` takes forty times as long.
            np.add.at(self.looks.ravel(), _joined(item.cells[0] for item in seen), sign)
            np.add.at(self.hits.ravel(), _joined(item.cells[1] for item in seen), sign)

    def change(self, counts: CellCounts, sign: int) -> None:
        self.looks.ravel()[counts.cells] += sign * counts.looks
        self.hits.ravel()[counts.cells] += sign * counts.hits

    def equals(self, other: LookCounts) -> bool:
        return np.array_equal(self.looks, other.looks) and np.array_equal(self.hits, other.hits)

    def sealed(self) -> LookCounts:
        self.looks.flags.writeable = self.hits.flags.writeable = False
        return self


@dataclass(eq=False)  # not frozen, which would make a merge half as dear again
class Belief:
    """An immutable set of observations of an area of (rows, cols) cells in which hostiles hide.

    Merging is set union, so it does not matter in which order observations come, how often, or whether a
    checkpoint stands for many of them: all that is believed follows from how often each cell was looked at
    and how often a hostile was seen there.
    """

    count: HostileCount
    """n_HA, as announced beforehand"""
    sensor: SensorModel
    """how reliable looks are taken to be"""
    _base: LookCounts
    """what the first `_counted` of the log and the checkpoints come to"""
    _counted: int
    _log: ObservationLog
    _n: int
    """how much of the log is this belief's"""
    _checkpoints: Mapping[Source, Checkpoint]
    """what they stand for of each source counts by them, whether the log has it or not"""
    _counted_all: LookCounts | None = None
    """what all of it comes to, once somebody has asked"""

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
        return cls(
            count,
            sensor,
            LookCounts(_read_only(rows, cols), _read_only(rows, cols)),
            0,
            ObservationLog(),
            0,
            {},
        )

    def merge(self, told: Iterable[BeliefItem]) -> Belief:
        """The union with `told`; `self` where it brings nothing new.

        Raises ValueError, and takes none of it, where a cell lies outside the area or where one name
        (observer, incarnation, seq) comes with two contents.
        """
        told = tuple(told)
        for item in told:
            if isinstance(item, Checkpoint):
                belief = self._advance([item for item in told if isinstance(item, Checkpoint)])
                return belief._append([item for item in told if isinstance(item, Observation)])
        return self._append(told)

    def _append(self, told: Iterable[BeliefItem]) -> Belief:
        log, n, checkpoints = self._log, self._n, self._checkpoints
        if n == 0 or n < len(log.items):
            log, base = self._held(), self._looked
            n = upto = len(log.items)
        elif self._counted_all is not None:
            base, upto = self._counted_all, n
        else:
            base, upto = self._base, self._counted
        items, at, (rows, cols) = log.items, log.at, base.looks.shape
        for seen in told:
            assert isinstance(seen, Observation)
            item = indexed(seen, rows, cols)
            stands = checkpoints.get(seen.source) if checkpoints else None
            if stands is None or seen.seq > stands.upto:
                where = at.setdefault(item.name, len(items))
            else:
                where = at.get(item.name, -1)
            if where == len(items):
                items.append(item)
            elif where >= 0 and items[where] is not item and items[where].seen != seen:
                raise ValueError(seen.two_contents)
        if len(items) == n:
            return self
        return Belief(self.count, self.sensor, base, upto, log, len(items), checkpoints)

    def _held(self) -> ObservationLog:
        """A log of its own, without what checkpoints stand for."""
        upto = {source: checkpoint.upto for source, checkpoint in self._checkpoints.items()}
        items = self._log.items[: self._n]
        return ObservationLog(item for item in items if item.seen.seq > upto.get(item.seen.source, 0))

    def _advance(self, told: list[Checkpoint]) -> Belief:
        """What was counted one by one, or by an earlier checkpoint, is counted by a later one instead.

        Where that makes no difference to what is believed, it is this belief that takes less room from then
        on: nobody has anything to decide anew.
        """
        checkpoints = dict(self._checkpoints)
        looked, size, n_covered = self._looked.copy(), self._base.looks.size, 0
        for to in told:
            before = checkpoints.get(to.source)
            if before is not None and to.upto <= before.upto:
                continue
            after = 0 if before is None else before.upto
            covered = self._log.of(to.source, after, to.upto, self._n)
            n_covered += len(covered)
            looked.change(to.counts(size), 1)
            looked.count([self._log.items[where] for where in covered], -ONCE)
            if before is not None:
                looked.change(before.counts(size), -1)
            checkpoints[to.source] = to
        if checkpoints == self._checkpoints:
            return self
        looked.sealed()
        belief = self
        if not n_covered or not looked.equals(self._looked):
            belief = Belief(self.count, self.sensor, looked, self._n, self._log, self._n, checkpoints)
        belief._base, belief._counted, belief._checkpoints = looked, self._n, checkpoints
        belief._counted_all = looked
        belief._log.n_covered += n_covered
        if 2 * belief._log.n_covered > belief._n:
            belief._log = belief._held()
            belief._counted = belief._n = len(belief._log.items)
        return belief

    @property
    def looks(self) -> NDArray[np.int32]:
        """(rows, cols) how often each cell was looked at; read-only"""
        return self._looked.looks

    @property
    def hits(self) -> NDArray[np.int32]:
        """(rows, cols) how many of these looks showed a hostile; read-only"""
        return self._looked.hits

    @property
    def _looked(self) -> LookCounts:
        if self._counted_all is None:
            looked = self._base
            if self._counted < self._n:
                looked = looked.copy()
                looked.count(self._log.items[self._counted : self._n])
            self._counted_all = looked.sealed()
        return self._counted_all

    @cached_property
    def n_observed(self) -> int:
        """v, cells observed so far"""
        return int(np.count_nonzero(self.looks))

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

        Eq. 4 for the paper's belief, else its generalisation (`swarmctl.core.inference.occupancy.bayes`).
        """
        classes, which = self._classes
        p_unseen = self._p_occupied[0] if classes.looks[0] == 0 else 0.0
        p_occupied = np.full(self.looks.shape, p_unseen)
        p_occupied.ravel()[self._seen_cells] = self._p_occupied[which]
        return p_occupied

    def uncertain(self, cells: Iterable[tuple[int, int, bool]]) -> tuple[tuple[int, int, bool], ...]:
        """Those of a look's cells of which one more look can teach something.

        What the paper's sensor has seen need not be sensed again (section 3); where sensors err, every look
        counts until a cell is certain.
        """
        return tuple(
            (r, c, occupied)
            for r, c, occupied in cells
            if not self.sensor.settled(int(self.looks[r, c]), int(self.hits[r, c]))
        )

    def contradicted(self, cells: Iterable[tuple[int, int, bool]]) -> tuple[tuple[int, int, bool], ...]:
        """Those of a look's cells of which the contrary was certain, by what others told."""
        return tuple(
            (r, c, occupied)
            for r, c, occupied in cells
            if self.sensor.settled(looks := int(self.looks[r, c]), hits := int(self.hits[r, c]))
            and (hits == 0 if occupied else hits == looks)
        )

    def looks_and_hits(self, flat: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n, 2) looks and hits of cells given as row · cols + col"""
        return np.stack([self.looks.ravel()[flat], self.hits.ravel()[flat]], axis=1).astype(np.int64)

    @property
    def classes(self) -> CellClasses:
        """The cells of the area, by what was seen of them."""
        return self._classes[0]

    def items(self) -> Iterator[BeliefItem]:
        """Everything held, in order of observer, incarnation and sequence."""
        items: list[BeliefItem] = [*self._checkpoints.values(), *(item.seen for item in self._held().items)]

        def place(item: BeliefItem) -> tuple[Source, int]:
            return item.source, 0 if isinstance(item, Checkpoint) else item.seq

        return iter(sorted(items, key=place))

    def n_cells_from(self, observer: int) -> int:
        """How many different cells this observer has told of."""
        cells: set[int] = set()
        for item in self._held().items:
            if item.seen.observer == observer:
                cells.update(_joined((item.cells[0],)).tolist())
        for (whose, _), checkpoint in self._checkpoints.items():
            if whose == observer:
                cells.update(checkpoint.counts(self.looks.size).cells.tolist())
        return len(cells)

    @cached_property
    def _seen_cells(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.looks)

    @cached_property
    def _classes(self) -> tuple[CellClasses, NDArray[np.int64]]:
        """The classes in order of looks and hits, and the class of each cell seen."""
        pairs = self.looks_and_hits(self._seen_cells)
        packed = pairs[:, 0] << 32 | pairs[:, 1]
        kinds, which, n_cells = np.unique(packed, return_inverse=True, return_counts=True)
        n_unseen = self.looks.size - packed.size
        if n_unseen:
            kinds, n_cells, which = np.append(0, kinds), np.append(n_unseen, n_cells), which + 1
        return CellClasses(kinds >> 32, kinds & 0xFFFFFFFF, n_cells.astype(np.int64)), which

    @cached_property
    def _p_occupied(self) -> NDArray[np.float64]:
        """p_O of each class"""
        classes, _ = self._classes
        if self.sensor.is_perfect and self.count.is_number:
            return occupancy.eq4(self.count.greatest, classes)
        return occupancy.bayes(self.count, self.sensor, classes)


def _joined(cells: Iterable[bytes]) -> NDArray[np.int64]:
    return np.frombuffer(b"".join(cells), CELL)


def _read_only(rows: int, cols: int) -> NDArray[np.int32]:
    zeros = np.zeros((rows, cols), dtype=np.int32)
    zeros.flags.writeable = False
    return zeros
