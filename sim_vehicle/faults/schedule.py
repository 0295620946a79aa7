"""The schedule that begins and ends faults at their times."""

import heapq
import itertools
import math
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.faults.base import EndFault, FaultTarget, VehicleAccess
from sim_vehicle.faults.spec import FaultError, FaultSpec
from sim_vehicle.ranges import ranges

SPAWN_KEY = 0xFA17  # separates the random generators of faults from the generators of vehicles


@dataclass(slots=True)
class _PlannedFault:
    """One fault on one vehicle: planned, running or ended."""

    vehicle_index: int
    spec: FaultSpec
    ended: bool = False
    stop: EndFault | None = None  # None unless the fault runs

    @property
    def runs(self) -> bool:
        return self.stop is not None

    def end(self, now: float) -> None:
        self.ended = True
        if self.stop is not None:
            self.stop(now)
            self.stop = None


class Schedule:
    """The faults of a fleet; raise FaultError if a fault names an unknown vehicle.

    specs: faults of the scenario.
    sysids: system ids by vehicle index; a system id can occur on several links.
    access: returns the access to a vehicle by its index.
    seed: the scenario's seed.
    """

    def __init__(
        self,
        specs: Sequence[FaultSpec],
        sysids: Sequence[int],
        access: Callable[[int], VehicleAccess],
        seed: int,
    ) -> None:
        self._sysids, self._access, self._seed = tuple(sysids), access, seed
        self._events: list[tuple[float, int, Callable[[float], None]]] = []
        self._order = itertools.count()
        self._begun: list[_PlannedFault] = []
        self._generators_made: Counter[int] = Counter()
        self._replaceable: dict[tuple[int, Hashable], list[_PlannedFault]] = {}
        self._tickers: dict[int, Callable[[float], None]] = {}
        for spec in specs:
            self._plan(spec, self._indices(spec), spec.at_s)

    @property
    def next_due_s(self) -> float:
        """Return the time of the next change [s]; inf: no further change, -inf: a change at each tick."""
        if self._tickers:
            return -math.inf
        return self._events[0][0] if self._events else math.inf

    def tick(self, now: float) -> None:
        """Begin and end the faults due by `now` [s], earliest first; then call the registered callbacks."""
        while self._events and self._events[0][0] <= now + EPSILON_S:
            due_s, _, action = heapq.heappop(self._events)
            action(due_s)
        for callback in tuple(self._tickers.values()):
            callback(now)

    def inject(self, spec: FaultSpec, now: float, indices: Sequence[int] | None = None) -> None:
        """Plan a fault at `now + spec.at_s` [s]; raise FaultError if a vehicle is unknown.

        indices: the vehicles; None: the system ids of `spec`, on every link.
        """
        self._plan(spec, self._indices(spec) if indices is None else indices, now + spec.at_s)
        self.tick(now)

    def replace(self, index: int, key: Hashable, specs: Sequence[FaultSpec], now: float) -> None:
        """End the faults of the last call with this vehicle index and key; plan `specs` from `now` [s] on."""
        for fault in self._replaceable.pop((index, key), ()):
            fault.end(now)
        if specs:
            self._replaceable[index, key] = [
                fault for spec in specs for fault in self._plan(spec, [index], now + spec.at_s)
            ]
        self.tick(now)

    def names(self, index: int) -> tuple[str, ...]:
        """Return the names of a vehicle's running faults; a reboot without `for_s` stays in the list."""
        return tuple(fault.spec.fault for fault in self._begun if fault.vehicle_index == index and fault.runs)

    def _indices(self, spec: FaultSpec) -> list[int]:
        if spec.vehicles is None:
            return list(range(len(self._sysids)))
        missing = sorted(set(spec.vehicles) - set(self._sysids))
        if missing:
            known = ranges(self._sysids)
            raise FaultError(
                f"fault {spec.fault}: unknown vehicle {missing[0]}; system ids: {known} [fault-vehicle]"
            )
        return [index for index, sysid in enumerate(self._sysids) if sysid in spec.vehicles]

    def _plan(self, spec: FaultSpec, indices: Sequence[int], at_s: float) -> list[_PlannedFault]:
        planned = [_PlannedFault(index, spec) for index in indices]
        for fault in planned:
            self._schedule(at_s, partial(self._begin, fault))
            if spec.for_s is not None:
                self._schedule(at_s + spec.for_s, fault.end)
        return planned

    def _schedule(self, time_s: float, action: Callable[[float], None]) -> None:
        heapq.heappush(self._events, (time_s, next(self._order), action))

    def _begin(self, fault: _PlannedFault, now: float) -> None:
        if fault.ended:
            return
        self._begun = [begun for begun in self._begun if not begun.ended] + [fault]
        index = fault.vehicle_index
        target = FaultTarget(self._access(index), partial(self._generator, index), self._every_tick)
        fault.stop = fault.spec.parameters().begin(target, now)

    def _generator(self, index: int) -> np.random.Generator:
        count = self._generators_made[index]
        self._generators_made[index] += 1
        return np.random.default_rng(
            np.random.SeedSequence(entropy=self._seed, spawn_key=(SPAWN_KEY, index, count))
        )

    def _every_tick(self, callback: Callable[[float], None]) -> Callable[[], None]:
        key = next(self._order)
        self._tickers[key] = callback

        def stop() -> None:
            self._tickers.pop(key, None)

        return stop
