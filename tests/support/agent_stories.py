"""One agent in a sequence of events: events in, effects and state out."""

from __future__ import annotations

import re
from typing import Any, TypeVar

import msgspec

from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.mission_changes import needs_tick
from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.agent.state import Task, initial_state
from swarmctl.agent.step import step
from swarmctl.agent.traffic.separation.watch import AvoidanceAction, SeparationRules
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.frames import IntentPoint, StateShared
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.messages import VehicleAnswer
from swarmctl.core.observation import Observation
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.planners import PLANNERS, Method

Kind = TypeVar("Kind")
GRID = Grid(9, 9, 50.0, 46.0, 14.0)
MID_M = GRID.centre_m((4, 4))
AMSL_M = 330.0
"""at 30 m above home"""


DIJKSTRA = Method("dijkstra", PLANNERS["dijkstra"], PLANNERS["dijkstra"].Params())


def task(**changes: object) -> Task:
    plain = Task(
        uav=1,
        name="uav1",
        grid=GRID,
        strength=FiringStrength(0.6, 0.3, 0.1),
        w=0.5,
        psi_per_cell=0.1,
        entry=(4, 0),
        goals=((4, 8),),
        altitude_m=30.0,
        method=DIJKSTRA,
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


class Story:
    """An agent that handles events one after the other; it keeps the effects of the last."""

    def __init__(self, **changes: object) -> None:
        self.state = initial_state(task(**changes), Belief.prior(GRID.rows, GRID.cols, 4))
        self.now = 0.0
        self.effects: list[ev.Effect] = []
        self._messages: dict[str, Any] = {}

    def __call__(self, event: ev.Event) -> list[ev.Effect]:
        self.now += 1.0
        if isinstance(event, ev.TelemetryReceived) and self._messages:
            event, self._messages = replace(event, **self._messages), {}
        self.state, self.effects = step(self.state, event, self.now)
        for message in publications(self.effects):
            check_accepted(message)
        return self.effects

    def tick(self) -> list[ev.Effect]:
        return self(ev.Tick()) if needs_tick(self.state, self.now) else []

    def swap(self) -> PlannedMission:
        (effect,) = swaps(self.tick())
        return effect

    def accept(self) -> list[ev.Effect]:
        assert self.state.plans.pending is not None
        return self(ev.MissionAccepted(self.state.plans.pending.plan_id))

    def over(self, cell: Cell, **changes: object) -> list[ev.Effect]:
        lat_deg, lon_deg = self.state.task.grid.centre(cell)
        up_m: Any = changes.get("alt_rel_m", 30.0)
        state = VehicleState(
            time_boot_s=self.now,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_rel_m=up_m,
            alt_amsl_m=None if up_m is None else AMSL_M - 30.0 + up_m,
            mode="AUTO",
            mode_role="mission",
            armed=True,
            landed=Landed.IN_AIR if changes.get("armed", True) else Landed.ON_GROUND,
            heartbeat_s=self.now,
            status_s=self.now,
            position_s=self.now,
        )
        return self(ev.TelemetryReceived(replace(state, **changes)))  # type: ignore[arg-type]

    def at(self, east_m: float, **changes: Any) -> list[ev.Effect]:
        """Report the vehicle on its flight east along row 4 at 10 m/s."""
        lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, MID_M[1])
        here = {"lat_deg": lat_deg, "lon_deg": lon_deg, "ground_speed_m_s": 10.0, "east_m_s": 10.0}
        return self.over((4, 0), **{**here, **changes})

    def swaps_took(self, took_s: float, stood_s: float = 0.0) -> None:
        """Let the agent have measured a swap of this duration, with a stop of `stood_s`."""
        times = SwapTimes((took_s,), (stood_s,))
        self.state = replace(self.state, plans=replace(self.state.plans, swap_times=times))

    def hear(self, *cells: tuple[int, int, bool], observer: int = 2, seq: int = 1) -> list[ev.Effect]:
        observation = Observation(observer, seq, self.now, cells)
        return self(ev.ObservationsReceived((observation,)))

    def tell(self, **messages: tuple[Any, ...]) -> None:
        """Send `neighbours` or `intents` of other vehicles; they come with the next telemetry."""
        for field, new in messages.items():
            self._messages[field] = self._messages.get(field, ()) + new

    def told(self, **messages: tuple[Any, ...]) -> list[ev.Effect]:
        """Deliver such messages with the latest telemetry once more."""
        self.tell(**messages)
        return self(ev.TelemetryReceived(self.state.vehicle))

    def standby(self) -> Story:
        self(ev.Ready())
        self.swap()
        self.accept()
        return self

    def launching(self) -> Story:
        self.standby()
        self(ev.OperatorCommand(ev.FlightOrder.LAUNCH))
        assert self.state.phase is Phase.LAUNCHING
        return self

    def flying(self) -> Story:
        self.launching()
        self(ev.OrderDone(ev.FlightOrder.LAUNCH))
        self.over((4, 0))
        assert self.state.phase is Phase.FLYING
        return self


def codes(effects: list[ev.Effect]) -> list[str]:
    """Return the codes of the messages to the operator; "" for a message without one."""
    found = (re.search(r"\[([a-z-]+)\]$", e.text) for e in effects if isinstance(e, ev.NotifyOperator))
    return [match[1] if match else "" for match in found]


def check_accepted(message: object) -> None:
    """Check that the decoder of a receiver accepts a published message."""
    msgspec.msgpack.decode(msgspec.msgpack.encode(message), type=type(message))


def publications(effects: list[ev.Effect], kind: type[Kind] = object) -> list[Kind]:
    """Return the published messages of a kind."""
    return [e.message for e in effects if isinstance(e, ev.Publish) and isinstance(e.message, kind)]


def swaps(effects: list[ev.Effect]) -> list[PlannedMission]:
    return [effect.mission for effect in effects if isinstance(effect, ev.SwapMission)]


def answers(effects: list[ev.Effect]) -> list[VehicleAnswer]:
    return [effect.answer for effect in effects if isinstance(effect, ev.Answer)]


def intent_path(*points: tuple[float, float, float, float]) -> tuple[IntentPoint, ...]:
    """Return the points (seconds from now, east, north, above the sea) of an intent."""
    return tuple(IntentPoint(t, *GRID.frame.to_geodetic(e, n), amsl_m) for t, e, n, amsl_m in points)


def orders(effects: list[ev.Effect]) -> list[ev.FlightOrder]:
    return [e.order for e in effects if isinstance(e, ev.Command)]


def operator_texts(effects: list[ev.Effect]) -> list[str]:
    return [effect.text for effect in effects if isinstance(effect, ev.NotifyOperator)]


class ApproachStory(Story):
    """Vehicle 2 flies east along row 4 at 10 m/s; `other` delivers a state of vehicle 1 or 3."""

    def __init__(self, action: AvoidanceAction = "hold", **changes: Any) -> None:
        super().__init__(uav=2, separation=replace(SeparationRules(), action=action), **changes)
        self.flying()
        self.at(100.0)

    def other(
        self, uav: int, east_m: float, north_m: float, velocity: tuple[float, float, float], **changes: Any
    ) -> None:
        lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, north_m)
        shared = {"time_s": 1.0, "lat_deg": lat_deg, "lon_deg": lon_deg, "alt_rel_m": 30.0, "phase": "flying"}
        shared |= {"n_observed": 0, "n_found": 0, "velocity_m_s": velocity, "hears": (self.state.task.uav,)}
        shared |= {"age_s": 1.0, **changes}
        shared.setdefault("alt_amsl_m", 300.0 + shared["alt_rel_m"])
        # It is of the time of the last telemetry, and comes with the next one.
        self.tell(neighbours=((uav, StateShared(**shared)),))

    def crossing(self, uav: int, away_m: float = 100.0, **changes: Any) -> None:
        """Send the state of a vehicle on its way north over the middle of the area.

        It will be `away_m` before the middle when vehicle 2 gets its next telemetry.
        """
        self.other(uav, MID_M[0], MID_M[1] - away_m - 10.0, (0.0, 10.0, 0.0), **changes)

    def stopped(self, uav: int = 1, **changes: Any) -> None:
        """Let vehicle 2 stop 50 m before the middle, for a vehicle that crosses its way there."""
        self.crossing(uav, 50.0, **changes)
        assert orders(self.at(MID_M[0] - 50.0)) == [ev.FlightOrder.HOLD]
        self(ev.OrderDone(ev.FlightOrder.HOLD))
