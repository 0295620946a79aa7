"""An agent and its vehicle together on a virtual clock: the part of the runner, and the track flown."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from agent_stories import task
from flying_bench import HOME, FlyingBench

from swarmctl.agent.phases import ON_GROUND, Phase
from swarmctl.agent.replan.mission_changes import needs_tick
from swarmctl.agent.state import initial_state
from swarmctl.agent.step import step
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.events import TelemetryReceived
from swarmctl.core.geo import LocalFrame
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.observation import Observation
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.mavlink.events import ProcedureDone
from swarmctl.mavlink.procedures import basic

SIZE_M = 50.0
WEST = LocalFrame(*HOME).to_geodetic(25.0, -4.5 * SIZE_M)
GRID = Grid(9, 24, SIZE_M, *WEST)
"""The vehicle starts west of row 4."""
ROW = 4
SPEED: dict[str, dict[str, float]] = {"ardupilot": {}, "px4": {"MPC_XY_CRUISE": 10.0}}
"""parameters of a vehicle that flies at 10 m/s"""


TASK = task(grid=GRID, w=0.7, psi_per_cell=0.05, entry=(ROW, 0), goals=((ROW, 23),), altitude_m=20.0)


class AgentFlight:
    """The part of the runner on the bench's clock: events of the link in, effects out."""

    def __init__(self, personality: str, delay_s: float = 0.0) -> None:
        self.bench = FlyingBench(personality, params=SPEED[personality]).prepared()
        self.bench.delay_s = delay_s
        prior = Belief.prior(GRID.rows, GRID.cols, 12)
        self.state = initial_state(TASK, prior)
        self.flown: list[PlanarPoint] = []
        self.swaps: list[PlannedMission] = []
        self.planned: list[PlannedMission] = []
        """all plans, the plan for the launch first"""
        self.ended: list[ev.Event] = []
        self._seen = len(self.bench.events)
        self._pending: PlannedMission | None = None
        self._seq = 0
        self(ev.Ready())
        self.tick()
        assert self.bench.run(120.0, self._go_on_until(Phase.STANDBY))
        self(ev.OperatorCommand(ev.FlightOrder.LAUNCH))
        assert self.bench.run(60.0, self._go_on_until(Phase.FLYING))

    def __call__(self, event: ev.Event) -> None:
        self.state, effects = step(self.state, event, self.bench.now)
        for effect in effects:
            self._perform(effect)

    def tick(self) -> None:
        if needs_tick(self.state, self.bench.now):
            self(ev.Tick())

    def _perform(self, effect: ev.Effect) -> None:
        if isinstance(effect, ev.SwapMission):
            mission = self._pending = effect.mission
            self.planned.append(mission)
            if self.state.phase in ON_GROUND:
                items = self.bench.session.mission_items(mission.plan)
                self.bench.begin("upload", lambda c: basic.upload(c, items))
                return
            self.swaps.append(mission)
            self.bench.begin("swap", partial(basic.swap, plan=mission.plan))
        elif isinstance(effect, ev.Command):
            assert effect.order is ev.FlightOrder.LAUNCH, effect
            self.bench.begin("launch", basic.launch)

    def go_on(self) -> None:
        """Pass the new reports of the link to the agent."""
        while self._seen < len(self.bench.events):
            event = self.bench.events[self._seen]
            self._seen += 1
            if isinstance(event, TelemetryReceived):
                self(ev.TelemetryReceived(event.state))
            elif isinstance(event, ProcedureDone):
                self._done(event)
        if self.bench.session.busy_with is None:
            self.tick()

    def _done(self, done: ProcedureDone) -> None:
        if done.name == "launch":
            assert done.failure is None
            self(ev.OrderDone(ev.FlightOrder.LAUNCH))
            return
        assert self._pending is not None
        plan_id = self._pending.plan_id
        if done.name == "upload":
            assert done.failure is None
            self.ended.append(ev.MissionAccepted(plan_id, done.result.swap_takes_s))
        else:
            self.ended.append(done.result.event(plan_id))
        self(self.ended[-1])

    def _go_on_until(self, phase: Phase) -> Any:
        def there() -> bool:
            self.go_on()
            return self.state.phase is phase

        return there

    def receives_hostiles(self, *cells: Cell) -> None:
        self._seq += 1
        self(
            ev.ObservationsReceived((Observation(2, self._seq, 0.0, tuple((*cell, True) for cell in cells)),))
        )

    def outside_m(self) -> float:
        """Return the distance of the vehicle from the cells of the plans that it may fly [m]; 0 inside.

        These are the plans from the last accepted plan but one on. West of the area the distance is 0.
        """
        east_m, north_m = self.place
        accepted = [e.plan_id for e in self.ended if isinstance(e, ev.MissionAccepted)]
        least_id = accepted[-2] if len(accepted) > 1 else 0
        cells = {cell for swap in self.planned if swap.plan_id >= least_id for cell in swap.cells}

        def beside_m(at_m: float, index: int) -> float:
            return max(index * SIZE_M - at_m, at_m - (index + 1) * SIZE_M, 0.0)

        nearest_m = min(math.hypot(beside_m(north_m, row), beside_m(east_m, col)) for row, col in cells)
        return nearest_m if east_m > 0.0 else 0.0

    @property
    def place(self) -> PlanarPoint:
        """The vehicle's true position (east, north) [m]."""
        return GRID.frame.to_local(*self.bench.vehicle.body.lat_lon_deg)

    def lands(self, watch: Any = lambda: None) -> None:
        def down() -> bool:
            self.go_on()
            if self.bench.vehicle.armed:
                self.flown.append(self.place)
            watch()
            return self.state.ended

        assert self.bench.run(500.0, down), "the vehicle does not land"
