"""The abstract mission by machine code, with the results of `mission.fly_mission`.

The compiled loop flies what most studies vary: the paper's planner, sensor and exact number of hostiles.
Routes, strikes, counts and sums are equal to those of `fly_mission`; `covers` says for which scenarios.
"""

from __future__ import annotations

import math

import numpy as np

from swarmctl.bus.radio import SPAWN_KEY, gilbert_probabilities
from swarmctl.config.scenario import Scenario
from swarmctl.core import exposure as measures
from swarmctl.planners.kernels import is_small
from swarmctl.planners.kernels.compilation import compiled
from swarmctl.planners.kernels.lattice import Bytes, Floats, Ints, offsets_of
from swarmctl.study import kernel_layout as k
from swarmctl.study.mission import MAX_ENTRIES_PER_CELL, first_route, on_ground
from swarmctl.study.mission_kernels import mission
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


class CompiledMission:
    """The missions of one scenario: its arrays, which each mission uses again."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        grid, radio, tasks = scenario.grid, scenario.config.communication, scenario.tasks
        n, self.width = len(tasks), grid.cols + 2
        size = (grid.rows + 2) * self.width
        self.inside = np.zeros((grid.rows + 2, self.width), dtype=np.uint8)
        self.inside[1:-1, 1:-1] = 1
        self.walls = np.zeros(size, dtype=np.uint8)
        self.walls[[self._index(cell) for cell in tasks[0].no_fly]] = 1
        longest = MAX_ENTRIES_PER_CELL * grid.n_cells
        self._first = [first_route(task, scenario.prior) for task in tasks]
        self._begin_ints = np.zeros((n, k.N_INTS), dtype=np.int64)
        self._begin_floats = np.zeros((n, k.N_FLOATS))
        self._routes = np.zeros((n, size), dtype=np.int32)
        self._first_routes = self._routes.copy()
        for i, (task, spec) in enumerate(zip(tasks, scenario.specs, strict=True)):
            vehicle = on_ground(task, spec, scenario.prior)
            edge_s = vehicle.enters_s
            begin_s, start_m, end_s, entry_m = vehicle.leg
            speed_m_s = task.arrival.speed_m_s
            self._begin_floats[i] = (
                *(edge_s, vehicle.over_entry_s, begin_s, *start_m, end_s, *entry_m, speed_m_s, math.nan),
            )
            first = self._first[i]
            self._begin_ints[i, [k.UAV, k.PHASE, k.SEARCHES]] = task.uav, k.ENDED, 1
            if first is not None:
                self._begin_ints[i, [k.PHASE, k.N_ROUTE]] = k.SEE, len(first.cells)
                self._first_routes[i, : len(first.cells)] = [self._index(cell) for cell in first.cells]
        goals = [sorted({self._index(goal) for goal in task.goals}) for task in tasks]
        range_ = n - 1 if radio.range == "all" else min(radio.range, n - 1)
        is_random = radio.loss > 0.0 or radio.jitter_s > 0.0
        self._is_random = is_random
        self.rules = np.array(
            [self.width, range_, radio.relay, scenario.prior.count.least, longest, is_random], dtype=np.int64
        )
        task = tasks[0]
        max_m = math.inf if radio.max_distance_m is None else radio.max_distance_m
        self.settings = np.array(
            [
                *(task.w, (1.0 - task.w) * task.psi_per_cell, task.max_exposure, grid.cell_size_m),
                *(radio.delay_s, radio.jitter_s, radio.min_distance_m, max_m, radio.loss),
                *gilbert_probabilities(radio.loss, radio.loss_burst),
            ]
        )
        strength = scenario.strength
        self.strength = np.array([strength.direct, strength.first_neighbour, strength.second_neighbour])
        self.goals = np.array([goal for each in goals for goal in each], dtype=np.int64)
        self._first_goals = np.cumsum([0, *(len(each) for each in goals)], dtype=np.int64)
        most = n * grid.n_cells
        self._has, self.known = np.zeros((n, most), dtype=np.uint8), np.zeros((n, size), dtype=np.uint8)
        self._news, self._observers = np.zeros((most, 10), dtype=np.int32), np.zeros(most, dtype=np.int32)
        self._visits = np.zeros((n, size), dtype=np.int32)
        self._flown, self._strikes = np.zeros((2, n, longest), dtype=np.int32)
        self._n_draws = 64
        self._n_messages = 64
        self._order, self._metres = np.zeros(n, dtype=np.int64), np.zeros(n)
        self.work = np.full((5, size), np.nan)
        self.work[0], self.work[2] = 0.0, np.inf  # the padding: no hostiles, and closed
        # A cell waits once for each neighbour that improves it; rounding may let a neighbour do so twice.
        self.heap, self.keys = np.zeros(32 * size, dtype=np.int64), np.zeros(32 * size)
        self.offsets = offsets_of(self.width)
        self._kernel = compiled(mission)

    def _index(self, cell: tuple[int, int]) -> int:
        return (cell[0] + 1) * self.width + cell[1] + 1

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
            ints, floats, counts = self.flown_once(world)
            if not counts[k.OVERFLOW]:
                break
            self._n_draws, self._n_messages = 2 * self._n_draws, 2 * self._n_messages
        return self.result(world, ints, floats)

    def occupied(self, world: World) -> Bytes:
        """Return 1 for the cells of the hostiles, flat."""
        occupied = np.zeros_like(self.inside)
        for row, col in world.hostiles:
            occupied[row + 1, col + 1] = 1
        return occupied.ravel()

    def flown_once(self, world: World) -> tuple[Ints, Floats, Ints]:
        """Fly by arrays of the present sizes; the last value, `counts`, says whether they were too short."""
        n, settings = len(self._order), self.settings
        ints, floats = self._begin_ints.copy(), self._begin_floats.copy()
        counts = np.zeros(4, dtype=np.int64)
        self._routes[:] = self._first_routes
        self.known[:] = self._visits[:] = 0
        draws = self._draws(world.seed) if self._is_random else np.zeros((1, 1, 1))
        times, ends = np.zeros((self._n_messages, 3)), np.zeros((self._n_messages, 3), dtype=np.int64)
        drawn, p_lost = np.zeros((n, n), dtype=np.int64), np.full((n, n), settings[k.LOSS])
        self._kernel(
            np.uint64(world.seed & MASK), ints, floats, self.rules, settings, self.strength,
            self._routes, self.goals, self._first_goals, self.occupied(world), self.inside.ravel(),
            self.walls, self.offsets, self.known, self._has, self._news, self._observers, self._visits,
            self._flown, self._strikes, draws, drawn, p_lost, times, ends, counts, self._order,
            self._metres, self.work, self.heap, self.keys,
        )  # fmt: skip
        return ints, floats, counts

    def result(self, world: World, ints: Ints, floats: Floats) -> MissionResult:
        """Return the results of the last mission flown."""
        p_s = measures.exposure(world.occupancy(), self._scenario.strength)  # Eq. 2
        rows, tracks, strikes = [], [], []
        for i, (first, numbers) in enumerate(zip(self._first, ints.tolist(), strict=True)):
            flown = self._flown[i, : numbers[k.N_FLOWN]]
            hits = self._strikes[i, : numbers[k.N_FLOWN]].tolist()
            cells = np.stack(np.divmod(flown.astype(np.int64), self.width), axis=1) - 1
            arrived_s = float(floats[i, k.ARRIVED_S])
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
        return MissionResult(tuple(rows), tuple(tracks), tuple(strikes))
