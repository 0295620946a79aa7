"""The belief of a vehicle about the hostiles: a set of observations, and the occupancy of the cells."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.inference import occupancy
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.occupancy import CellClasses
from swarmctl.core.inference.sensor import PERFECT, SensorModel
from swarmctl.core.observation import (
    CELL_INDEX_DTYPE,
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
ADD, SUBTRACT = np.int32(1), np.int32(-1)


class ObservationLog:
    """Observations in merge order. Each name (observer, incarnation, seq) occurs once. The log only grows.

    A belief and the beliefs merged from it share one log, so most merges copy nothing. A merge into a belief
    copies the log if another belief has added entries to the log.
    """

    __slots__ = ("index_of", "items", "n_covered")

    def __init__(self, items: Iterable[IndexedObservation] = ()) -> None:
        self.items = list(items)
        self.index_of = {item.name: index for index, item in enumerate(self.items)}
        """name -> index in `items`"""
        self.n_covered = 0
        """approximate number of replaced observations; above half of all, a belief starts a new log"""

    def indices(self, source: Source, after: int, upto: int, n: int) -> list[int]:
        """Return the indices, below `n`, of a source's observations with after < sequence number ≤ upto."""
        if upto - after < n:
            found = [self.index_of.get((*source, seq), n) for seq in range(after + 1, upto + 1)]
            return [index for index in found if index < n]
        return [
            index
            for index, item in enumerate(self.items[:n])
            if item.seen.source == source and after < item.seen.seq <= upto
        ]


class LookCounts(msgspec.Struct, frozen=True, eq=False):
    """Looks at each cell, and looks that showed a hostile, (rows, cols). A look is one cell observed once."""

    looks: NDArray[np.int32]
    hits: NDArray[np.int32]

    def copy(self) -> LookCounts:
        return LookCounts(self.looks.copy(), self.hits.copy())

    def add_observations(self, seen: Sequence[IndexedObservation], sign: np.int32 = ADD) -> None:
        """Add observations, or subtract them with `sign` −1; a cell may occur several times."""
        if seen:
            # `add.at` takes forty times as long with a plain int or another type.
            np.add.at(self.looks.ravel(), _joined(item.cells[0] for item in seen), sign)
            np.add.at(self.hits.ravel(), _joined(item.cells[1] for item in seen), sign)

    def add_counts(self, counts: CellCounts, sign: int) -> None:
        """Add the counts of a checkpoint, or subtract them with `sign` −1."""
        self.looks.ravel()[counts.cells] += sign * counts.looks
        self.hits.ravel()[counts.cells] += sign * counts.hits

    def equals(self, other: LookCounts) -> bool:
        return np.array_equal(self.looks, other.looks) and np.array_equal(self.hits, other.hits)

    def sealed(self) -> LookCounts:
        """Make these counts read-only and return them."""
        self.looks.flags.writeable = self.hits.flags.writeable = False
        return self


@dataclass(eq=False)  # `_add_checkpoints` compacts a belief in place
class Belief:
    """An immutable set of observations of an area of (rows, cols) cells in which hostiles hide.

    Merging is set union: the result is the same for any order, any repetition and any use of checkpoints.
    The occupancy follows from two numbers for each cell: the looks, and the looks that showed a hostile.
    """

    count: HostileCount
    """announced number of hostiles, n_HA"""
    sensor: SensorModel
    """assumed error rates of the sensors"""
    _base: LookCounts
    """counts of the checkpoints, and of the first `_counted` observations except those replaced"""
    _counted: int
    _log: ObservationLog
    _n: int
    """number of the log's observations that belong to this belief"""
    _checkpoints: Mapping[Source, Checkpoint]
    """checkpoint of each source; it replaces the observations that it summarises"""
    _counts_cache: LookCounts | None = None
    """counts of all observations; None before their first use"""
    _n_cells_from: dict[int, int] = field(default_factory=dict)
    """answers of `n_cells_from`, by observer"""

    @classmethod
    def prior(
        cls, rows: int, cols: int, hostiles: int | HostileCount, sensor: SensorModel = PERFECT
    ) -> Belief:
        """Return the belief before any observation.

        If the number of hostiles is exact and the sensor is perfect, the result is the paper's belief. Raises
        ValueError for an area without cells, and for hostiles that are no number or more than the cells.
        """
        if rows < 1 or cols < 1:
            raise ValueError(f"an area of {rows} × {cols} cells: expected at least 1 × 1")
        count = hostiles if isinstance(hostiles, HostileCount) else HostileCount.known(_whole(hostiles))
        if count.greatest > rows * cols:
            raise ValueError(
                f"{count.greatest} hostiles in {rows} × {cols} cells: expected 0 to {rows * cols}, "
                "at most one a cell"
            )
        return cls(
            count,
            sensor,
            LookCounts(_read_only_zeros(rows, cols), _read_only_zeros(rows, cols)),
            0,
            ObservationLog(),
            0,
            {},
        )

    def merge(self, new: Iterable[BeliefItem]) -> Belief:
        """Return the union with `new`; `self` if `new` adds nothing.

        Raises ValueError for a cell outside the area, for a malformed checkpoint, and for one name (observer,
        incarnation, seq) with two contents. The belief then stays unchanged.
        """
        new = tuple(new)
        for item in new:
            if isinstance(item, Checkpoint):
                belief = self._add_checkpoints([item for item in new if isinstance(item, Checkpoint)])
                return belief._append([item for item in new if isinstance(item, Observation)])
        return self._append(new)

    def _append(self, new: Iterable[BeliefItem]) -> Belief:
        log, n, checkpoints = self._log, self._n, self._checkpoints
        if n == 0 or n < len(log.items):
            log, base = self._own_log(), self._all_counts
            n = upto = len(log.items)
        elif self._counts_cache is not None:
            base, upto = self._counts_cache, n
        else:
            base, upto = self._base, self._counted
        items, index_of, (rows, cols) = log.items, log.index_of, base.looks.shape
        for seen in new:
            assert isinstance(seen, Observation)
            item = indexed(seen, rows, cols)
            checkpoint = checkpoints.get(seen.source) if checkpoints else None
            if checkpoint is None or seen.seq > checkpoint.upto:
                index = index_of.setdefault(item.name, len(items))
            else:
                index = index_of.get(item.name, -1)
            if index == len(items):
                items.append(item)
            elif index >= 0 and items[index] is not item and items[index].seen != seen:
                raise ValueError(seen.two_contents)
        if len(items) == n:
            return self
        return Belief(self.count, self.sensor, base, upto, log, len(items), checkpoints)

    def _own_log(self) -> ObservationLog:
        """Return a log of this belief alone, without the observations that checkpoints replace."""
        upto = {source: checkpoint.upto for source, checkpoint in self._checkpoints.items()}
        items = self._log.items[: self._n]
        return ObservationLog(item for item in items if item.seen.seq > upto.get(item.seen.source, 0))

    def _add_checkpoints(self, new: list[Checkpoint]) -> Belief:
        """Return the belief with new checkpoints in place of the replaced observations and checkpoints.

        If observations are replaced and the counts stay equal, the result is this belief, compacted in place.
        So the agent has no reason to plan again.
        """
        checkpoints = dict(self._checkpoints)
        counts, size, n_covered = self._all_counts.copy(), self._base.looks.size, 0
        for checkpoint in new:
            before = checkpoints.get(checkpoint.source)
            if before is not None and checkpoint.upto <= before.upto:
                continue
            after = 0 if before is None else before.upto
            covered = self._log.indices(checkpoint.source, after, checkpoint.upto, self._n)
            n_covered += len(covered)
            counts.add_counts(checkpoint.counts(size), 1)
            counts.add_observations([self._log.items[index] for index in covered], SUBTRACT)
            if before is not None:
                counts.add_counts(before.counts(size), -1)
            checkpoints[checkpoint.source] = checkpoint
        if checkpoints == self._checkpoints:
            return self
        counts.sealed()
        belief = self
        if not n_covered or not counts.equals(self._all_counts):
            belief = Belief(self.count, self.sensor, counts, self._n, self._log, self._n, checkpoints)
        belief._base, belief._counted, belief._checkpoints = counts, self._n, checkpoints
        belief._counts_cache = counts
        belief._log.n_covered += n_covered
        if 2 * belief._log.n_covered > belief._n:
            belief._log = belief._own_log()
            belief._counted = belief._n = len(belief._log.items)
        return belief

    @property
    def looks(self) -> NDArray[np.int32]:
        """(rows, cols) looks at each cell; read-only"""
        return self._all_counts.looks

    @property
    def hits(self) -> NDArray[np.int32]:
        """(rows, cols) looks at each cell that showed a hostile; read-only"""
        return self._all_counts.hits

    @property
    def _all_counts(self) -> LookCounts:
        if self._counts_cache is None:
            counts = self._base
            if self._counted < self._n:
                counts = counts.copy()
                counts.add_observations(self._log.items[self._counted : self._n])
            self._counts_cache = counts.sealed()
        return self._counts_cache

    @cached_property
    def n_observed(self) -> int:
        """v, cells observed so far"""
        return int(np.count_nonzero(self.looks))

    @cached_property
    def n_found(self) -> int:
        """n_V, hostiles found so far: cells with a look and with p_O > 0.5"""
        classes, _ = self._classes
        return int(classes.n_cells[(classes.looks > 0) & (self._p_occupied > 0.5)].sum())

    @cached_property
    def announced_too_low(self) -> bool:
        """True if more hostiles were found than announced; with 95 % confidence for sensors that err."""
        return occupancy.announced_too_low(self.count, self.sensor, self._classes[0])

    @cached_property
    def known(self) -> NDArray[np.int8]:
        """(rows, cols) of UNKNOWN, CLEAR or OCCUPIED, for pictures; read-only.

        A cell with a look is OCCUPIED if p_O > 0.5, else CLEAR.
        """
        _, class_of = self._classes
        known = np.full(self.looks.shape, UNKNOWN, dtype=np.int8)
        known.ravel()[self._seen_cells] = np.where(self._p_occupied > 0.5, OCCUPIED, CLEAR)[class_of]
        known.flags.writeable = False
        return known

    def occupancy(self) -> NDArray[np.float64]:
        """Return p_O, the probability that a hostile holds a cell, shape (rows, cols), in [0, 1].

        Eq. 4 for the paper's belief, else its generalisation (`swarmctl.core.inference.occupancy.bayes`).
        """
        classes, class_of = self._classes
        p_unseen = self._p_occupied[0] if classes.looks[0] == 0 else 0.0
        p_occupied = np.full(self.looks.shape, p_unseen)
        p_occupied.ravel()[self._seen_cells] = self._p_occupied[class_of]
        return p_occupied

    def uncertain(self, cells: Iterable[tuple[int, int, bool]]) -> tuple[tuple[int, int, bool], ...]:
        """Return the observed `cells` that are not certain yet. Only these cells add information.

        A look of the paper's sensor makes a cell certain (section 3).
        """
        return tuple(
            (r, c, occupied)
            for r, c, occupied in cells
            if not self.sensor.settled(int(self.looks[r, c]), int(self.hits[r, c]))
        )

    def contradicted(self, cells: Iterable[tuple[int, int, bool]]) -> tuple[tuple[int, int, bool], ...]:
        """Return the observed `cells` that contradict a certain cell of this belief."""
        return tuple(
            (r, c, occupied)
            for r, c, occupied in cells
            if self.sensor.settled(looks := int(self.looks[r, c]), hits := int(self.hits[r, c]))
            and (hits == 0 if occupied else hits == looks)
        )

    def looks_and_hits(self, flat: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return (n, 2) looks and hits of cells given as row · cols + col."""
        return np.stack([self.looks.ravel()[flat], self.hits.ravel()[flat]], axis=1).astype(np.int64)

    @property
    def classes(self) -> CellClasses:
        """The classes of the area's cells, by looks and hits."""
        return self._classes[0]

    def items(self) -> Iterator[BeliefItem]:
        """Return the checkpoints and the unreplaced observations, in order of source and sequence number."""
        items: list[BeliefItem] = [
            *self._checkpoints.values(),
            *(item.seen for item in self._own_log().items),
        ]
        items.sort(key=lambda item: (item.source, 0 if isinstance(item, Checkpoint) else item.seq))
        return iter(items)

    def n_cells_from(self, observer: int) -> int:
        """Return the number of different cells that this observer has reported."""
        if observer not in self._n_cells_from:
            # An observation in a checkpoint adds no cell to those of the checkpoint.
            parts = [item.cells[0] for item in self._log.items[: self._n] if item.seen.observer == observer]
            cells = set(_joined(parts).tolist())
            for (of_observer, _), checkpoint in self._checkpoints.items():
                if of_observer == observer:
                    cells.update(checkpoint.counts(self.looks.size).cells.tolist())
            self._n_cells_from[observer] = len(cells)
        return self._n_cells_from[observer]

    @cached_property
    def _seen_cells(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.looks)

    @cached_property
    def _classes(self) -> tuple[CellClasses, NDArray[np.int64]]:
        """The classes in order of looks and hits, and the index of the class of each cell with a look."""
        pairs = self.looks_and_hits(self._seen_cells)
        packed = pairs[:, 0] << 32 | pairs[:, 1]
        kinds, class_of, n_cells = np.unique(packed, return_inverse=True, return_counts=True)
        n_unseen = self.looks.size - packed.size
        if n_unseen:
            kinds, n_cells, class_of = np.append(0, kinds), np.append(n_unseen, n_cells), class_of + 1
        return CellClasses(kinds >> 32, kinds & 0xFFFFFFFF, n_cells.astype(np.int64)), class_of

    @cached_property
    def _p_occupied(self) -> NDArray[np.float64]:
        """p_O of each class."""
        classes, _ = self._classes
        if self.sensor.is_perfect and self.count.is_number:
            return occupancy.eq4(self.count.greatest, classes)
        return occupancy.bayes(self.count, self.sensor, classes)


def news(
    belief: Belief, own: Belief | None, seen: Sequence[tuple[int, int, bool]]
) -> tuple[tuple[int, int, bool], ...]:
    """Return the observed cells that add to the belief, or that contradict it.

    `own` is the belief by the own observations alone, to which a told cell adds too; None without autonomy.
    """
    contradicting = belief.contradicted(seen)
    if own is None:
        return *belief.uncertain(seen), *contradicting
    uncertain = own.uncertain(seen)
    return *uncertain, *(cell for cell in contradicting if cell not in uncertain)


def weighed_occupancy(belief: Belief, own: Belief, autonomy: float) -> NDArray[np.float64]:
    """Return p_O of a vehicle that weighs `own`, the belief by its own observations, above `belief`.

    The result is (1 − a)·p_O(belief) + a·p_O(own) for the autonomy a in [0, 1]: what the others tell is true
    with probability 1 − a, and else worthless. a = 0 is the paper; a = 1 ignores the others.
    """
    if autonomy == 0.0:
        return belief.occupancy()
    return (1.0 - autonomy) * belief.occupancy() + autonomy * own.occupancy()


def _whole(number: object) -> int:
    try:
        return operator.index(number)  # type: ignore[arg-type]
    except TypeError:
        raise ValueError(f"hostiles = {number!r}: expected a whole number or a HostileCount") from None


def _joined(cells: Iterable[bytes]) -> NDArray[np.int64]:
    return np.frombuffer(b"".join(cells), CELL_INDEX_DTYPE)


def _read_only_zeros(rows: int, cols: int) -> NDArray[np.int32]:
    zeros = np.zeros((rows, cols), dtype=np.int32)
    zeros.flags.writeable = False
    return zeros
