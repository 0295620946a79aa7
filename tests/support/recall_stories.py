"""Recalled swarms, and a monitor of their returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

from flights import small

from sim_vehicle.truth import Truth
from swarmctl.config.scenario import Scenario
from swarmctl.core.geo import distance_m


def gathering(**sections: object) -> Scenario:
    """Return a swarm of three vehicles with one goal.

    From 47 s to 55 s two of them may return at once, and the vehicle between them afterwards.
    """
    return small(simulate={"count": 3, "ready_s": 3.0, "goal": [4, 7]}, **sections)


def landing_together() -> Scenario:
    """Return a swarm of two vehicles with one goal, 6 m apart in height, that lands when it is stopped."""
    return small(
        simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0},
        threats={"count": 0},
        flight={"altitude_m": 15.0, "altitude_step_m": 6.0, "on_exit": "land", "on_exit_deadline_s": 200.0},
    )


@dataclass
class ReturnMonitor:
    """The start times of returns, and the least horizontal distance between returning vehicles."""

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
