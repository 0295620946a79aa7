"""What an agent has to do and what it knows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.arrival.common_time import ArrivalGroup
from swarmctl.agent.failsafes import ALWAYS_ON
from swarmctl.agent.failsafes.base import ActiveRule, Demand, Fence
from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.replan.length_bounds import UNBOUNDED, TimeBound
from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.agent.traffic.separation.clash import Clash
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.agent.traffic.separation.watch import (
    DEFAULT_SEPARATION,
    NeighbourIntent,
    NeighbourReport,
    ProximityAlarm,
    SeparationRules,
)
from swarmctl.core import events as ev
from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.belief import Belief
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import VehicleState
from swarmctl.planners.base import Method, Route

ARRIVED = "arrived"
"""the outcome of a flight that did what it was for"""


class Phase(StrEnum):
    """Where a vehicle is in its flight."""

    WAITING = "waiting"
    """not ready yet"""
    UPLOADING = "uploading"
    """ready; its first mission is planned or on its way"""
    STANDBY = "standby"
    """on the ground with a verified mission"""
    LAUNCHING = "launching"
    FLYING = "flying"
    LANDING = "landing"
    """over its goal, coming down"""
    HOLDING = "holding"
    """by order"""
    LEAVING = "leaving"
    """returning or landing by order"""
    RELEASED = "released"
    """a pilot, a failsafe or another station has taken it over: it is not fought for"""
    DONE = "done"
    FAILED = "failed"


ENDED = frozenset({Phase.RELEASED, Phase.DONE, Phase.FAILED})
ON_GROUND = frozenset({Phase.WAITING, Phase.UPLOADING, Phase.STANDBY})
IN_FLIGHT = frozenset({Phase.FLYING, Phase.LANDING, Phase.HOLDING, Phase.LEAVING})
PLANS_NO_MORE = ENDED | {Phase.LANDING, Phase.HOLDING, Phase.LEAVING}
PLANNING = frozenset({Phase.UPLOADING, Phase.STANDBY, Phase.FLYING})


@dataclass(frozen=True, slots=True)
class Task:
    """What one vehicle has to do and by which rules; constant during a run.

    `strength` and `w` are those it begins with: an operator may change an agent's own (`AgentState`), as with
    the paper's sliders. ψ stays as it is, whatever the weights become.
    """

    uav: int
    name: str
    grid: Grid
    strength: FiringStrength
    w: float
    psi_per_cell: float
    entry: Cell
    goals: tuple[Cell, ...]
    altitude_m: float
    """flown at, above home [m]"""
    method: Method
    arrival: TimeBound = UNBOUNDED
    """when it is to be over its goal"""
    max_exposure: float = math.inf
    """cells whose P_s exceeds this are not entered"""
    no_fly: frozenset[Cell] = frozenset()
    landing_index: int = 0
    landing_count: int = 1
    """which of how many landing spots in the goal cell is this vehicle's"""
    any_angle: ExposureMeasure | None = None
    """whether its routes are pulled straight, and how exposure then counts; None: lattice routes are flown"""
    turn_radius_m: float = 0.0
    """it turns no tighter, where its routes are pulled straight; 0: it turns on the spot"""
    wings: FixedWing | None = None
    """of a fixed wing; None: it hovers"""
    fallback: ev.FlightOrder = ev.FlightOrder.RETURN
    """what it does when its mission cannot be changed any more: RETURN or LAND"""
    rules: tuple[ActiveRule, ...] = ALWAYS_ON
    """what may happen in flight, and what it does then"""
    fence: Fence | None = None
    separation: SeparationRules = DEFAULT_SEPARATION
    """how far it keeps from the others"""
    arrival_group: ArrivalGroup | None = None
    """with whom it arrives; None: by itself"""


@dataclass(frozen=True, slots=True)
class DeconflictionCounts:
    """How often its plans were found to meet another vehicle's, and what mended it."""

    predicted: int = 0
    by_height: int = 0
    by_route: int = 0
    by_waiting: int = 0
    """the plan before was kept, or the vehicle held"""
    ceased: int = 0
    """the other changed its plan, or times have shifted"""


@dataclass(frozen=True, slots=True)
class FlightComparison:
    """Two flights that were compared."""

    own: Trajectory
    other: NeighbourIntent
    met: Clash | None


@dataclass(frozen=True, slots=True)
class AgentState:
    """Everything an agent knows; replaced, never changed, by `step`."""

    task: Task
    belief: Belief
    w: float
    """distance anxiety of the next plan (Eq. 5)"""
    strength: FiringStrength
    """firing strengths of the next plan (Eq. 1)"""
    phase: Phase = Phase.WAITING
    vehicle: VehicleState = field(default_factory=VehicleState)
    last_position: VehicleState = field(default_factory=VehicleState)
    """as it was when it last told where it is"""
    cell: Cell | None = None
    """the cell of the area it is over; None outside or unknown"""
    lost: bool = False
    route: ev.SwapMission | None = None
    """the plan the vehicle flies, or will once it is launched"""
    accepted: ev.SwapMission | None = None
    """the last plan that was verified on the vehicle, flown or not"""
    progress: int = 0
    """index in `route.cells` of the cell it was last seen over"""
    pending: ev.SwapMission | None = None
    """the plan on its way to the vehicle"""
    swap_times: SwapTimes = field(default_factory=SwapTimes)
    """how long changing its mission took of late"""
    swapped_boot_s: float = -math.inf
    """when its mission was changed last, by its own clock"""
    swap_started_boot_s: float = -math.inf
    """when it was decided to change it, by the same"""
    braking_until_boot_s: float = -math.inf
    """until then it brakes to take up the plan it flies, if it does so at all, by the same"""
    dirty: bool = False
    because: tuple[ev.ObservationId, ...] = ()
    """observations merged since the last decision"""
    exposure: NDArray[np.float64] | None = None
    """P_s as of the last decision, (rows, cols)"""
    route_exposure: NDArray[np.float64] | None = None
    """P_s by which the route being flown was last found good, (rows, cols)"""
    retry_at_s: float = -math.inf
    failed_swaps: int = 0
    """in a row"""
    launch_ordered: bool = False
    launch_is_operators: bool = False
    """an operator has ordered it, not its own process"""
    launch_wait_since_boot_s: float | None = None
    """since when it waits for others in the air to be out of the way of its first route, by its clock, also
    where it has been about to take off in between"""
    launch_ignored: frozenset[int] = frozenset()
    """others that it does not wait for then, as an operator has ordered"""
    ordered: ev.FlightOrder | None = None
    """the last order it was given"""
    order_followed: bool = False
    """and it was seen to follow it"""
    previous_own_roles: frozenset[str] = frozenset()
    """the roles of modes that were of its own choosing when it was given that"""
    hold_is_own: bool = False
    """who stands in hold between two plans does so because this agent, or a swap of its, has had it hold"""
    return_turn_boot_s: float | None = None
    """it holds, and returns at this time of the vehicle's clock"""
    returns_when_clear: bool = False
    """or as soon as its way home is clear: it has no turn among others that are called back"""
    return_checked_boot_s: float = -math.inf
    """when it was looked at last whether it is"""
    return_started_boot_s: float | None = None
    """when a return began that may still have to wait …"""
    return_deadline_boot_s: float = -math.inf
    """… and until when it may, which does not change however often it waits"""
    returning_neighbours: Mapping[int, NeighbourReport] = field(default_factory=dict)
    """others on the way home, as they told of themselves last"""
    repeat_order_at_s: float = math.inf
    """when to give an order again that it was not seen to follow"""
    launch_aborted: bool = False
    launched_boot_s: float | None = None
    """when it was first seen armed, by the vehicle's own clock; its time bound counts from here"""
    arrived_boot_s: float | None = None
    """when it was first seen over its goal"""
    planned: Route | None = None
    """what the planner answered last, whether it was flown or not"""
    late_s: float | None = None
    """when it will be over its goal, from its take-off, by its last decision; None while that is in time"""
    armed_seen: bool = False
    """its own launch has armed it"""
    disarmed_since_s: float | None = None
    """when the first of the heartbeats came that say it is not armed; None while it is"""
    orders_given: int = 0
    memories: tuple[Any, ...] = ()
    """what the rules of flight remember, in the order of `task.rules`"""
    demands: tuple[Demand | None, ...] = ()
    """what each of them demands now"""
    neighbours: Mapping[int, NeighbourReport] = field(default_factory=dict)
    """others near it, as they told of themselves of late"""
    alarms: tuple[ProximityAlarm, ...] = ()
    """others that will be too close"""
    interrupted_plan: ev.SwapMission | None = None
    """the plan it left to hold until others are clear"""
    gave_way_to: Mapping[int, NeighbourReport] = field(default_factory=dict)
    """for whom, as heard last: who falls silent may stand there still"""
    height_offset_m: float = 0.0
    """by so much it flies higher than its altitude, to keep clear of others"""
    must_change: bool = False
    """its next plan is flown whatever it brings"""
    intents: Mapping[int, NeighbourIntent] = field(default_factory=dict)
    """where others will be, as they have told of late"""
    own_intent: Trajectory | None = None
    """what it has told last of where it will be itself, by its own clock, up above the sea"""
    intent_sent_boot_s: float = -math.inf
    comparisons: Mapping[int, FlightComparison] = field(default_factory=dict)
    """those, as compared with its own"""
    predicted_conflicts: frozenset[int] = frozenset()
    """others that the route being flown meets, and for which it is to give way"""
    deferred_for: frozenset[int] = frozenset()
    """others for which a new plan was put off"""
    deconfliction: DeconflictionCounts = DeconflictionCounts()
    resume_earliest_boot_s: float = -math.inf
    """who gave way does not fly on before, by the vehicle's clock"""
    holding_since_boot_s: float = math.inf
    """since when it holds to give way"""
    descent_checked_boot_s: float = -math.inf
    """when who lands has looked last whether its way down is clear"""
    others_earliest_s: Mapping[int, float] = field(default_factory=dict)
    """when others can be over their goals at the earliest, by this vehicle's clock [s]"""
    due_s: float | None = None
    """when it is to be over its goal with them, by its own clock"""
    spare_time_due_s: float | None = None
    """what that was when it was found to be early, and planned to use the time; None: it was not"""
    speed_m_s: float | None = None
    """what it was told to fly, on its present plan; None: its own; 0: nobody knows"""
    speed_given_s: float = -math.inf
    n_alarms: int = 0
    n_holds: int = 0
    n_climbs: int = 0
    """to give way"""
    incarnation: int = 0
    """of its program, as its observations are named"""
    next_seq: int = 1
    next_plan_id: int = 1
    last_shared_s: float = -math.inf
    searches: int = 0
    replans: int = 0
    """missions changed in flight"""
    flown_m: float = 0.0
    flown_cells: tuple[Cell, ...] = ()
    flown_exposure: float = 0.0
    """ΣP_s over the cells entered after the first, each as believed when it was decided to enter it"""
    flown_safety: float = 1.0
    """∏(1 − P_s) over the same"""
    no_fly_entered: int = 0
    """times it came over a cell that no route may enter"""
    refused: int = 0
    """observations of others that cannot be"""
    given_up: bool = False
    """it is coming down because its mission could not be flown"""
    outcome: str = ""
    """how it ended, in words; empty before"""
    trouble: str = ""
    """what went wrong last, in words"""
    swap_trouble: str = ""
    """why its mission could not be changed last, in words"""

    @property
    def height_m(self) -> float:
        """It flies so high above home."""
        return self.task.altitude_m + self.height_offset_m

    @property
    def alarm(self) -> str:
        """Whom it is about to come too close to, in words; empty where nobody."""
        others = ", ".join(str(alarm.other) for alarm in self.alarms)
        return f"too close to vehicle {others}" if others else ""

    @property
    def late(self) -> str:
        """Why it will not arrive in time, in words; empty as long as it will."""
        arrival = self.task.arrival
        if self.late_s is None:
            return ""
        # Rounded away from the bound, so that it never seems kept.
        away = math.ceil if self.late_s > arrival.within_s else math.floor
        rounding = 1e-6 if self.late_s > arrival.within_s else -1e-6
        over_s = away(10.0 * self.late_s - rounding) / 10.0
        return f"no route meets its bound of {arrival} any more; over its goal after {over_s:.1f} s"

    @property
    def ended(self) -> bool:
        return self.phase in ENDED


def begin(task: Task, belief: Belief) -> AgentState:
    return AgentState(task=task, belief=belief, w=task.w, strength=task.strength)
