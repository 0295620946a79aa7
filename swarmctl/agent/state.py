"""Task and state of an agent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.arrival.common_time import ArrivalGroup, CommandedSpeed, CommonArrival
from swarmctl.agent.failsafes import ALWAYS_ON
from swarmctl.agent.failsafes.base import ActiveRule, Demand, Fence
from swarmctl.agent.flown import Flown
from swarmctl.agent.formation.membership import Formation, Membership
from swarmctl.agent.given_order import GivenOrder
from swarmctl.agent.launch import Launch
from swarmctl.agent.phases import ENDED, Phase, changed
from swarmctl.agent.progress import Progress, points_ahead_on, progress_on
from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.replan.length_bounds import UNBOUNDED, TimeBound
from swarmctl.agent.replan.plans import Plans
from swarmctl.agent.traffic.broadcasts import ReceivedBroadcasts, SentBroadcasts
from swarmctl.agent.traffic.plan_conflicts import Conflicts
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight, NeighbourReport
from swarmctl.agent.traffic.separation.watch import (
    DEFAULT_SEPARATION,
    ProximityAlarm,
    SeparationRules,
)
from swarmctl.agent.traffic.wait import Wait, WaitFor
from swarmctl.core import events as ev
from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.belief import Belief
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.route import landing_spot
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import START_DELAY_S, VehicleState
from swarmctl.planners.base import Method, Problem
from swarmctl.planners.benevolence import OtherVehicle

ARRIVED = "arrived"
"""outcome of a flight that landed at its goal"""


class Task(msgspec.Struct, frozen=True):
    """Task of one vehicle and its rules; constant during a run.

    `strength` and `w` are initial values. An operator may change the values in `AgentState`, as with the
    paper's sliders. ψ stays constant.
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
    """cruise altitude above home [m]"""
    method: Method
    arrival: TimeBound = UNBOUNDED
    """time bound for the arrival over the goal, and the commanded speed"""
    max_exposure: float = math.inf
    """greatest P_s of a cell that a route may enter"""
    no_fly: frozenset[Cell] = frozenset()
    landing_index: int = 0
    """index of this vehicle's landing spot in the goal cell"""
    landing_count: int = 1
    """number of landing spots in the goal cell"""
    any_angle: ExposureMeasure | None = None
    """exposure measure for straightened routes; None: the vehicle flies lattice routes"""
    turn_radius_m: float = 0.0
    """least turn radius on straightened routes [m]; 0: turns on the spot"""
    wings: FixedWing | None = None
    """parameters of a fixed wing; None: a copter"""
    start_delay_s: float = START_DELAY_S
    """`VehicleState.start_delay_s` as configured, for plans before the vehicle is known [s]"""
    fallback: ev.FlightOrder = ev.FlightOrder.RETURN
    """RETURN or LAND, after MAX_FAILED_SWAPS failed mission changes or a hold until its deadline, and without
    a route"""
    rules: tuple[ActiveRule, ...] = ALWAYS_ON
    fence: Fence | None = None
    separation: SeparationRules = DEFAULT_SEPARATION
    """distances kept from other vehicles, and the evasive action"""
    arrival_group: ArrivalGroup | None = None
    """vehicles of the simultaneous arrival; None: no simultaneous arrival"""
    autonomy: float = 0.0
    """weight of the vehicle's own observations above those of others (`weighed_occupancy`), in [0, 1]"""
    benevolence: float = 0.0
    """weight of what the others would learn against the own cost (`planners.benevolence`), in [0, 1]"""
    others: Mapping[int, OtherVehicle] = msgspec.field(default_factory=dict)
    """entry cells and goals of the vehicles that hear this vehicle; empty without benevolence"""

    formation: Formation | None = None
    """the vehicle's group; None: it flies alone"""
    names: Mapping[int, str] = msgspec.field(default_factory=dict)
    """names of all vehicles of the configuration, for messages"""

    def name_of(self, uav: int) -> str:
        """Return another vehicle's name for a message."""
        return self.names.get(uav, f"vehicle {uav}")

    @property
    def speed_m_s(self) -> float:
        """Cruise speed [m/s]."""
        return self.arrival.speed_m_s

    def problem(
        self,
        p_s: NDArray[np.float64],
        start: Cell,
        w: float,
        *,
        min_length_cells: float = 0.0,
        max_length_cells: float = math.inf,
        gain: NDArray[np.float64] | None = None,
    ) -> Problem:
        """Return the planning problem from a cell to the goals; `p_s` (rows, cols): exposure P_s."""
        return Problem(
            p_s,
            start,
            self.goals,
            w,
            self.psi_per_cell,
            self.max_exposure,
            min_length_cells,
            max_length_cells,
            gain,
        )

    def landing_spot(self, goal: Cell) -> LatLon:
        """Return this vehicle's landing spot in a goal cell."""
        separation_m = self.separation.limits.horizontal_m
        return landing_spot(self.grid, goal, self.landing_index, self.landing_count, separation_m)


class AgentState(msgspec.Struct, frozen=True):
    """Everything an agent knows; `step` returns a new state and never changes a state in place.

    Fields that end in `_boot_s` are times by the vehicle's clock. `disarmed_since_s` is a time by the run's
    clock. A comment names the modules that write the fields below it.
    """

    task: Task
    # The belief: `sharing`, and `orders` for an operator's weights.
    belief: Belief
    w: float
    """distance anxiety of the next plan (Eq. 5)"""
    strength: FiringStrength
    """firing strengths of the next plan (Eq. 1)"""
    own: Belief | None = None
    """belief by the vehicle's own observations; None without autonomy"""
    incarnation: int = 0
    """number that grows with each start of the agent's program, part of the names of observations"""
    next_seq: int = 1
    refused: int = 0
    """number of impossible observations received"""
    # The vehicle, by its telemetry: `step`.
    vehicle: VehicleState = msgspec.field(default_factory=VehicleState)
    last_position: VehicleState = msgspec.field(default_factory=VehicleState)
    """telemetry of the last message with a position"""
    cell: Cell | None = None
    """cell below the last position; None outside the area, or before the first position"""
    progress: Progress | None = None
    """progress on `followed`, by the last telemetry with a position"""
    flown: Flown = msgspec.field(default_factory=Flown)
    lost: bool = False
    """True while the link is lost"""
    silent_s: float = 0.0
    """time without telemetry, noted once a second while the link is lost [s]"""
    telemetry_is_late: bool = False
    """True while telemetry is too old to decide by it"""
    disarmed_since_s: float | None = None
    """time of the first heartbeat that reports the vehicle disarmed; None while armed (`touchdown`)"""
    # The flight: phase, order, plan. `phases` has the transitions; each record has methods for its changes.
    phase: Phase = Phase.WAITING
    launch: Launch = msgspec.field(default_factory=Launch)
    order: GivenOrder = msgspec.field(default_factory=GivenOrder)
    plans: Plans = msgspec.field(default_factory=Plans)
    arrived_boot_s: float | None = None
    """time at which the vehicle was first seen in its goal cell; None after an order to leave the goal"""
    given_up: bool = False
    """True: the flight has failed, and the vehicle returns or lands"""
    outcome: str = ""
    """reason for the end of the flight, or for its last change by an order or a failsafe rule, as text"""
    trouble: str = ""
    """last problem, as text for the operator; empty: none"""
    # Failsafe rules: `failsafes.enforcement`.
    memories: tuple[Any, ...] = ()
    """memory of each failsafe rule, in the order of `task.rules`"""
    demands: tuple[Demand | None, ...] = ()
    # Other vehicles: `traffic`.
    sent: SentBroadcasts = msgspec.field(default_factory=SentBroadcasts)
    received: ReceivedBroadcasts = msgspec.field(default_factory=ReceivedBroadcasts)
    others: Mapping[int, OtherVehicle] = msgspec.field(default_factory=dict)
    """present cells and goals of the vehicles in `task.others` that are not known to have ended"""
    alarms: tuple[ProximityAlarm, ...] = ()
    """vehicles predicted to come too close"""
    conflicts: Conflicts = msgspec.field(default_factory=Conflicts)
    wait: Wait | None = None
    """wait for other vehicles; None: the vehicle waits for none"""
    height_offset_m: float = 0.0
    """height above the task's altitude, for separation from other vehicles [m]"""
    # Flight with others: `formation` and `arrival`.
    membership: Membership = msgspec.field(default_factory=Membership)
    """the vehicle's group as it knows it"""
    common_arrival: CommonArrival = msgspec.field(default_factory=CommonArrival)
    speed: CommandedSpeed = msgspec.field(default_factory=CommandedSpeed)

    def enter(self, phase: Phase, **changes: Any) -> AgentState:
        """Return the state in another phase, with further changed fields. Raises IllegalTransition.

        A wait ends with the phases to which it belongs, and so does the flight to a place.
        """
        if self.wait is not None and phase not in self.wait.rule.phases:
            changes = {"wait": None, **changes}
        if self.phase is Phase.FORMATION and phase is not Phase.FORMATION:
            changes = {"membership": self.membership.without_place(self.vehicle.time_boot_s), **changes}
        return replace(self, phase=changed(self.phase, phase), **changes)

    def with_new_flight(self) -> AgentState:
        """Return the state of a vehicle that flies otherwise from now on: its intent is due at once."""
        return replace(self, sent=self.sent.intent_due(self.now_boot_s))

    def without_trouble(self) -> AgentState:
        """Return the state without the text of the last problem."""
        return replace(self, trouble="") if self.trouble else self

    @property
    def now_boot_s(self) -> float:
        """Present time by the vehicle's clock [s]: time of the last telemetry, its delay, and the silence."""
        return self.vehicle.time_boot_s + max(self.vehicle.delay_s, 0.0) + self.silent_s

    @property
    def leads_group(self) -> bool:
        """True for the leader of a group; a vehicle alone leads a group of one."""
        return self.membership.leader == self.task.uav

    @property
    def followed(self) -> PlannedMission | None:
        """The mission being flown, to be flown after the launch, or interrupted to give way."""
        return (self.interrupted if self.is_waiting else None) or self.plans.mission

    def with_progress(self) -> AgentState:
        """Return the state with the progress on `followed` at the present position."""
        if (mission := self.followed) is None:
            return replace(self, progress=None) if self.progress is not None else self
        return replace(self, progress=progress_on(mission, self.progress, self.task.grid, self.last_position))

    def progress_on(self, mission: PlannedMission) -> Progress | None:
        """Return the progress on a mission, as if it were flown now; None while the position is unknown."""
        if self.progress is not None and self.progress.flight.mission is mission:
            return self.progress
        return progress_on(mission, None, self.task.grid, self.last_position)

    def points_ahead(self, mission: PlannedMission) -> tuple[PlanarPoint, ...] | None:
        """Return the waypoints ahead and the landing spot of a mission; None while the position is unknown.

        It is quicker than `progress_on` for a mission that is not followed.
        """
        if self.progress is not None and self.progress.flight.mission is mission:
            return self.progress.points_ahead
        return points_ahead_on(mission, self.task.grid, self.last_position)

    @property
    def flies_mission(self) -> bool:
        """True while the vehicle flies its mission, and no order and no mission change is under way.

        The runner ends a job for the vehicle when it begins another one. So a part of the policy that only
        adjusts the flight acts at such times, and ends no order.
        """
        is_under_way = self.phase is Phase.FLYING and self.plans.mission is not None
        is_free = self.plans.pending is None and self.order.given in (None, ev.FlightOrder.LAUNCH)
        return is_under_way and is_free and not self.lost and self.vehicle.mode_role == "mission"

    @property
    def neighbours(self) -> Mapping[int, NeighbourReport]:
        """The states of vehicles nearby for the rules for other traffic: without hidden members."""
        hidden, known = self.membership.hidden, self.received.reports
        return {uav: known[uav] for uav in known if uav not in hidden} if hidden else known

    @property
    def intents(self) -> Mapping[int, KnownFlight]:
        """The intents of other vehicles for the rules for other traffic: without hidden members."""
        hidden, known = self.membership.hidden, self.received.intents
        return {uav: known[uav] for uav in known if uav not in hidden} if hidden else known

    @property
    def is_waiting(self) -> bool:
        """True while the vehicle waits for other vehicles."""
        return self.wait is not None and self.wait.is_on

    @property
    def interrupted(self) -> PlannedMission | None:
        """Mission that a hold for other vehicles interrupts."""
        return None if self.wait is None else self.wait.mission

    def waits_for(self, purpose: WaitFor) -> bool:
        """Return whether the vehicle waits now, for this purpose."""
        return self.wait is not None and self.wait.is_on and self.wait.purpose is purpose

    @property
    def height_m(self) -> float:
        """Cruise height above home, with the offset for separation [m]."""
        return self.task.altitude_m + self.height_offset_m

    @property
    def alarm(self) -> str:
        """Active proximity alarms as text; empty if there is none, or if nothing predicts the flight now."""
        if self.ended or self.lost or self.telemetry_is_late or not self.alarms:
            return ""
        others = ", ".join(self.task.name_of(alarm.other) for alarm in self.alarms)
        return f"predicted to come too close to {others}"

    @property
    def group(self) -> str:
        """Group, shape, leader and place error as text; empty for a vehicle that flies alone."""
        formation, membership = self.task.formation, self.membership
        if formation is None or membership.leader is None or membership.n_present == 1:
            return ""
        kind = "split" if membership.is_split else formation.shape(membership.shape).kind
        text = f"group {formation.name}: {kind} of {membership.n_present}"
        if self.leads_group:
            return f"{text}, leads"
        leader = self.task.name_of(membership.leader)
        if membership.error_m is None:
            return f"{text}, led by {leader}"
        return f"{text}, led by {leader}, {membership.from_place_m:.1f} m from its place"

    @property
    def late(self) -> str:
        """Predicted violation of the time bound as text; empty while the bound is met."""
        arrival = self.task.arrival
        if self.plans.late_s is None:
            return ""
        # Rounded away from the bound, so that a violated bound never looks met.
        round_away = math.ceil if self.plans.late_s > arrival.within_s else math.floor
        rounding = 1e-6 if self.plans.late_s > arrival.within_s else -1e-6
        arrives_s = round_away(10.0 * self.plans.late_s - rounding) / 10.0
        return (
            f"no route found keeps the time bound of {arrival}; the vehicle flies the route nearest to the "
            f"bound, with arrival over the goal {arrives_s:.1f} s after the take-off [no-timely-route]"
        )

    @property
    def ended(self) -> bool:
        return self.phase in ENDED


def initial_state(task: Task, belief: Belief) -> AgentState:
    """Return the state of an agent before its flight."""
    own = belief if task.autonomy > 0.0 else None
    return AgentState(task=task, belief=belief, w=task.w, strength=task.strength, own=own, others=task.others)
