"""What a vehicle knows of the hostiles: a set of observations, and the occupancy it implies (Eq. 4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """An immutable set of observations of an area of (rows, cols) cells that hides `n_hostiles` hostiles.

    Merging is set union, so it does not matter in which order observations come, or how often. Two vehicles
    that contradict each other on a cell are settled the same way everywhere: occupied wins.
    """

    n_hostiles: int
    """n_HA, as announced beforehand"""
    known: NDArray[np.int8]
    """(rows, cols) of UNKNOWN, CLEAR or OCCUPIED; read-only"""
    _seen: Mapping[int, Mapping[int, Observation]]
    """observer -> seq -> observation. Never changed in place: a merge copies the outer dictionary and the
    inner ones that grow, all others are shared with the belief it came from."""

    @classmethod
    def prior(cls, rows: int, cols: int, n_hostiles: int) -> Belief:
        """Nothing observed yet. Raises ValueError for an area or a number of hostiles that cannot be."""
        if rows < 1 or cols < 1:
            raise ValueError(f"an area of {rows} × {cols} cells: expected at least 1 × 1")
        if not 0 <= n_hostiles <= rows * cols:
            raise ValueError(
                f"{n_hostiles} hostiles in {rows} × {cols} cells: expected 0 to {rows * cols}, "
                "at most one a cell"
            )
        known = np.full((rows, cols), UNKNOWN, dtype=np.int8)
        known.flags.writeable = False
        return cls(n_hostiles, known, {})

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
        known = self.known.copy()
        for observation in news:
            for row, col, occupied in observation.cells:
                # DEVIATION: the paper's sensors never contradict each other. Where observations do, occupied
                # wins: UNKNOWN < CLEAR < OCCUPIED, the greatest of all that was said, in whatever order.
                known[row, col] = max(int(known[row, col]), OCCUPIED if occupied else CLEAR)
        known.flags.writeable = False
        return Belief(self.n_hostiles, known, seen)

    @property
    def n_observed(self) -> int:
        """v, cells observed so far"""
        return int(np.count_nonzero(self.known != UNKNOWN))

    @property
    def n_found(self) -> int:
        """n_V, hostiles found so far"""
        return int(np.count_nonzero(self.known == OCCUPIED))

    @property
    def announced_too_low(self) -> bool:
        """More hostiles were found than announced."""
        return self.n_found > self.n_hostiles

    def occupancy(self) -> NDArray[np.float64]:
        """p_O, the probability that a hostile holds a cell: Eq. 4, shape (rows, cols), in [0, 1]."""
        unseen = self.known.size - self.n_observed  # n_C - v
        # DEVIATION: Eq. 4 has no value once v = n_C, and leaves [0, 1] when the announced count was wrong.
        p_unseen = min(max((self.n_hostiles - self.n_found) / unseen, 0.0), 1.0) if unseen else 0.0  # Eq. 4
        return np.where(self.known == UNKNOWN, p_unseen, np.where(self.known == OCCUPIED, 1.0, 0.0))

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

    def _check_cells(self, observation: Observation) -> None:
        rows, cols = self.known.shape
        for row, col, _ in observation.cells:
            if not (0 <= row < rows and 0 <= col < cols):
                raise ValueError(
                    f"observation {observation.seq} of vehicle {observation.observer}: cell ({row}, {col}) "
                    f"is outside the area of {rows} × {cols} cells; do both fly the same configuration?"
                )


def _two_contents(observation: Observation) -> str:
    return (
        f"observation {observation.seq} of vehicle {observation.observer} came with two different contents; "
        "expected one observer a system id, and a sequence that does not start again: look for a second "
        "process that flies this vehicle, or one that was restarted"
    )
