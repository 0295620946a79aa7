"""The abstract mission by machine code, with the results of `mission.fly_mission`.

The compiled loop flies what most studies vary: the paper's planner, sensor and exact number of hostiles.
Routes, strikes, counts and sums are equal to those of `fly_mission`; `covers` says for which scenarios.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from swarmctl.bus.radio import SPAWN_KEY, gilbert_probabilities
from swarmctl.config.scenario import Scenario
from swarmctl.core import exposure as measures
from swarmctl.planners.kernels import is_small
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.lattice import offsets_of
from swarmctl.study import kernel_layout as k
from swarmctl.study.mission import MAX_ENTRIES_PER_CELL, first_route, fly_mission, on_ground
from swarmctl.study.mission_kernels import mission
from swarmctl.study.tables import SeedResult
from swarmctl.study.vehicle_result import MissionResult, measured
from swarmctl.study.world import MASK, World


def covers(scenario: Scenario) -> bool:
    """Return whether the compiled loop flies a scenario; `fly_mission` flies every other one."""
    config, prior = scenario.config, scenario.prior
    radio = config.communication
    return (
        config.planner.name == "dijkstra"
        and not config.flight.any_angle
        and config.planner.autonomy == 0.0
        and config.planner.benevolence == 0.0
        and prior.sensor.is_perfect
        and prior.count.is_number
        and is_small(scenario.grid.n_cells)
        and not any(task.arrival.is_bounded for task in scenario.tasks)
        and radio.bandwidth_bytes_s is None
        and not radio.partitions
        and not radio.quiet
    )


def flyer_of(scenario: Scenario) -> Callable[[World], MissionResult]:
    """Return the function that flies the missions of a scenario: by the compiled loop where it can."""
    return CompiledMission(scenario).fly if covers(scenario) else partial(fly_mission, scenario)


class CompiledMission:
    """The missions of one scenario: its arrays, which each mission uses again."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        grid, radio, tasks = scenario.grid, scenario.config.communication, scenario.tasks
        n, width, n_cells = len(tasks), grid.cols + 2, grid.n_cells
        size, most = (grid.rows + 2) * width, n * n_cells
        self._width = width
        inside = np.zeros((grid.rows + 2, width), dtype=np.uint8)
        inside[1:-1, 1:-1] = 1
        walls = np.zeros(size, dtype=np.uint8)
        walls[[self._index(cell) for cell in tasks[0].no_fly]] = 1
        fs = scenario.strength
        strength = np.array([fs.direct, fs.first_neighbour, fs.second_neighbour])
        self.area = k.Area(width, inside.ravel(), walls, np.zeros_like(walls), offsets_of(width), strength)
        longest, task = MAX_ENTRIES_PER_CELL * n_cells, tasks[0]
        self.settings = k.Settings(
            w=float(task.w),
            step=float((1.0 - task.w) * task.psi_per_cell),
            max_exposure=float(task.max_exposure),
            n_hostiles=scenario.prior.count.least,
            cell_m=float(grid.cell_size_m),
            max_entries=longest,
            range=n - 1 if radio.range == "all" else min(radio.range, n - 1),
            relays=radio.relay,
            is_random=radio.loss > 0.0 or radio.jitter_s > 0.0,
            delay_s=float(radio.delay_s),
            jitter_s=float(radio.jitter_s),
            min_m=float(radio.min_distance_m),
            max_m=math.inf if radio.max_distance_m is None else float(radio.max_distance_m),
            **dict(
                zip(("p_enter", "p_stay"), gilbert_probabilities(radio.loss, radio.loss_burst), strict=True)
            ),
        )
        self._first = [first_route(task, scenario.prior) for task in tasks]
        self._at_begin = self._vehicles_at_begin(longest)
        self._n_draws = self._n_messages = 64
        cells = np.zeros((most, 10), dtype=np.int32)
        observers, has = np.zeros(most, dtype=np.int32), np.zeros((n, most), dtype=np.uint8)
        self._observations = k.Observations(cells, observers, has)
        fields = np.full((5, size), np.nan)
        fields[0], fields[2] = 0.0, np.inf  # the padding: no hostiles, and closed
        # A cell waits once for each neighbour that improves it; rounding may let a neighbour do so twice.
        heap, keys = np.zeros(32 * size, dtype=np.int64), np.zeros(32 * size)
        self.search = k.Search._make([*fields, heap, keys])
        self._kernel = compiled(mission)

    def _vehicles_at_begin(self, longest: int) -> k.Vehicles:
        """Return all vehicles before their starts."""
        scenario, size = self._scenario, self.area.inside.size
        n = len(scenario.tasks)
        ints, floats = np.zeros((n, k.N_INTS), dtype=np.int64), np.zeros((n, k.N_FLOATS))
        routes = np.zeros((n, size), dtype=np.int32)
        for i, (task, spec, first) in enumerate(
            zip(scenario.tasks, scenario.specs, self._first, strict=True)
        ):
            vehicle = on_ground(task, spec, scenario.prior)
            begin_s, start_m, end_s, entry_m = vehicle.leg
            times_s = vehicle.enters_s, vehicle.over_entry_s, begin_s
            floats[i] = *times_s, *start_m, end_s, *entry_m, task.speed_m_s, math.nan
            ints[i, [k.UAV, k.PHASE, k.SEARCHES]] = task.uav, k.ENDED, 1
            if first is not None:
                ints[i, [k.PHASE, k.N_ROUTE]] = k.SEE, len(first.cells)
                routes[i, : len(first.cells)] = [self._index(cell) for cell in first.cells]
        goals = [sorted({self._index(goal) for goal in task.goals}) for task in scenario.tasks]
        return k.Vehicles(
            ints=ints,
            floats=floats,
            routes=routes,
            goals=np.array([goal for each in goals for goal in each], dtype=np.int64),
            first_goals=np.cumsum([0, *(len(each) for each in goals)], dtype=np.int64),
            known=np.zeros((n, size), dtype=np.uint8),
            visits=np.zeros((n, size), dtype=np.int32),
            flown=np.zeros((n, longest), dtype=np.int32),
            strikes=np.zeros((n, longest), dtype=np.int32),
        )

    def _index(self, cell: tuple[int, int]) -> int:
        return (cell[0] + 1) * self._width + cell[1] + 1

    def _draws(self, seed: int) -> np.ndarray[tuple[int, int, int], np.dtype[np.float64]]:
        """Return the random numbers of the messages between each pair of vehicles, as `Radio` draws them."""
        uavs = [task.uav for task in self._scenario.tasks]
        draws = np.zeros((len(uavs), len(uavs), 2 * self._n_draws))
        for i, sender in enumerate(uavs):
            for j, to in enumerate(uavs):
                if i != j:
                    sequence = np.random.SeedSequence(seed, spawn_key=(SPAWN_KEY, sender, to))
                    draws[i, j] = np.random.default_rng(sequence).random(2 * self._n_draws)
        return draws

    def fly(self, world: World) -> MissionResult:
        """Fly all vehicles across a world."""
        while True:
            vehicles, messages = self.flown_once(world)
            if not messages.counts[k.OVERFLOW]:
                return self.result(world, vehicles)
            self._n_draws, self._n_messages = 2 * self._n_draws, 2 * self._n_messages

    def area_of(self, world: World) -> k.Area:
        """Return the area with the hostiles of a world."""
        occupied = np.zeros_like(self.area.inside)
        occupied[[self._index(cell) for cell in world.hostiles]] = 1
        return self.area._replace(occupied=occupied)

    def flown_once(self, world: World) -> tuple[k.Vehicles, k.Messages]:
        """Fly by arrays of the present sizes; the counts of the messages say whether they were too short."""
        begin = self._at_begin
        n = len(begin.ints)
        vehicles = begin._replace(
            ints=begin.ints.copy(), floats=begin.floats.copy(), routes=begin.routes.copy()
        )
        vehicles.known[:] = vehicles.visits[:] = 0
        messages = k.Messages(
            times=np.zeros((self._n_messages, 3)),
            ends=np.zeros((self._n_messages, 3), dtype=np.int64),
            counts=np.zeros(4, dtype=np.int64),
            draws=self._draws(world.seed) if self.settings.is_random else np.zeros((1, 1, 1)),
            drawn=np.zeros((n, n), dtype=np.int64),
            p_lost=np.full((n, n), self._scenario.config.communication.loss),
            order=np.zeros(n, dtype=np.int64),
            metres=np.zeros(n),
        )
        self._kernel(
            np.uint64(world.seed & MASK),
            self.settings,
            self.area_of(world),
            vehicles,
            self._observations,
            messages,
            self.search,
        )
        return vehicles, messages

    def result(self, world: World, vehicles: k.Vehicles) -> MissionResult:
        """Return the results of a mission flown."""
        p_s = measures.exposure(world.occupancy(), self._scenario.strength)  # Eq. 2
        rows, tracks, strikes = [], [], []
        for i, (first, numbers) in enumerate(zip(self._first, vehicles.ints.tolist(), strict=True)):
            flown = vehicles.flown[i, : numbers[k.N_FLOWN]]
            hits = vehicles.strikes[i, : numbers[k.N_FLOWN]].tolist()
            cells = np.stack(np.divmod(flown.astype(np.int64), self._width), axis=1) - 1
            arrived_s = float(vehicles.floats[i, k.ARRIVED_S])
            row = measured(
                self._scenario,
                i,
                first,
                p_s,
                cells,
                sum(hits),
                None if math.isnan(arrived_s) else arrived_s,
                searches=numbers[k.SEARCHES],
                replans=numbers[k.REPLANS],
                messages_sent=numbers[k.SENT],
                messages_received=numbers[k.RECEIVED],
                cells_known=numbers[k.KNOWN],
                hostiles_known=numbers[k.FOUND],
            )
            rows.append(row)
            tracks.append(tuple(map(tuple, cells.tolist())))
            strikes.append(tuple(hits))
        return SeedResult(tuple(rows), tuple(tracks), tuple(strikes))
