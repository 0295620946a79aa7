"""An operator who calls vehicles back."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

from flights import small

from sim_vehicle.fleet import Truth
from swarmctl.config.scenario import Scenario
from swarmctl.core.geo import distance_m


def gathering(**sections: object) -> Scenario:
    """Three that fly to one place: from the 40th to the 50th second two may return at once, and the one
    between them after that."""
    return small(simulate={"count": 3, "ready_s": 3.0, "goal": [4, 7]}, **sections)


@dataclass
class Looker:
    """Looks on: who returns from when, and how near two that return come to each other over ground."""

    since_s: dict[int, float] = field(default_factory=dict)
    least_m: float = float("inf")

    def __call__(self, now: float, truth: Truth) -> None:
        returning = []
        for index, mode in enumerate(truth.mode):
            if mode == "RTL" and truth.armed[index]:
                self.since_s.setdefault(int(truth.sysid[index]), now)
                returning.append((float(truth.lat_deg[index]), float(truth.lon_deg[index])))
        near = (distance_m(one, other) for one, other in combinations(returning, 2))
        self.least_m = min((self.least_m, *near))
