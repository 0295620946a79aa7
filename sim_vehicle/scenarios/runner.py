"""A run of a scenario, without I/O: fleet, ground station and checks on one simulated clock."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.fleet import Fleet
from sim_vehicle.personalities import personality_of
from sim_vehicle.physics.geodesy import Floats, LocalFrame
from sim_vehicle.scenarios.checking import CheckFailure, RunningCheck
from sim_vehicle.scenarios.checks import RunView
from sim_vehicle.scenarios.model import Scenario, VehicleSpec
from sim_vehicle.scenarios.plan import FenceShape
from sim_vehicle.scenarios.script import FrameSink, ScriptStation, StepFailure
from sim_vehicle.truth import Truth
from sim_vehicle.vehicle.mission import Mission, MissionState

Corner = tuple[float, float]  # east, north [m]

STEP_S = 0.05
SETTLE_S = 2.0  # simulated time from the last event to the end, so that the logs have the last messages


@dataclass(frozen=True, slots=True)
class FinalVehicleState:
    """The state of one vehicle at the end of the run."""

    sysid: int
    link: int
    personality: str
    kind: str
    mode: str
    armed: bool
    height_m: float  # above the start
    from_start_m: float  # horizontal
    flown_m: float  # length of the flown path
    battery_remaining: float  # share of the full charge
    strikes: int
    messages: int  # number of received messages
    last_text: str


@dataclass(frozen=True, slots=True)
class CheckVerdict:
    check: str
    passed: bool
    failures: list[CheckFailure]


@dataclass(frozen=True, slots=True)
class Verdict:
    scenario: str
    seed: int
    simulated_s: float
    checks: list[CheckVerdict]
    steps_failed: list[StepFailure]
    vehicles: list[FinalVehicleState] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        return not self.steps_failed and all(check.passed for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict as data for JSON."""
        return {"passed": self.passed, **asdict(self)}


class Run:
    """A run of a scenario.

    on_frame: called with vehicle index, frame and time for every message, in both directions.
    on_failure: called with a line of text about each failure, except of steps that are unfinished at the end.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        on_frame: FrameSink = lambda _index, _frame, _now: None,
        on_failure: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self.scenario = scenario
        self.fleet = Fleet(scenario)
        self.station = ScriptStation(scenario, on_frame=on_frame)
        self.now = 0.0
        self._on_failure = on_failure
        self._running_checks = [RunningCheck(spec, scenario) for spec in scenario.checks]
        self._failures_reported = 0
        self._frame = LocalFrame(*scenario.origin_deg)
        self._start_m = self._local(
            np.array([v.lat_deg for v in scenario.vehicles]),
            np.array([v.lon_deg for v in scenario.vehicles]),
            np.array([v.alt_amsl_m for v in scenario.vehicles]),
        )
        goals = [v.goal_m() or (np.nan, np.nan) for v in scenario.vehicles]
        self._goal_m = self._start_m[:, :2] + np.array(goals, dtype=np.float64)
        self._goal_item = [v.goal_item() for v in scenario.vehicles]
        self._mission_ends = [_MissionEnd(v) for v in scenario.vehicles]
        self._flown = np.zeros(len(scenario.vehicles), dtype=bool)
        self._flown_m = np.zeros(len(scenario.vehicles))
        self._previous_m = self._start_m
        self._last_fault_s = max(
            (fault.at_s + (fault.for_s or 0.0) for fault in scenario.faults), default=0.0
        )
        self._quiet_since_s: float | None = None

    def step(self) -> bool:
        """Advance by one tick of 0.05 s and evaluate the checks; return False at the end of the run."""
        for index, data in self.fleet.step(self.now):
            self.station.receive(index, data, self.now)
        for link, data in self.station.step(self.now):
            for index, answer in self.fleet.receive(data, self.now, link=link):
                self.station.receive(index, answer, self.now)
        view = self._view()
        for running in self._running_checks:
            for failure in running.observe(view):
                self._on_failure(str(failure))
        for failed in self.station.failures[self._failures_reported :]:
            self._on_failure(
                f"t={failed.t_s:.2f} s, vehicle {failed.sysid}: {failed.action} failed, {failed.text}"
            )
        self._failures_reported = len(self.station.failures)
        if self._ended(view) or self.now + EPSILON_S >= self.scenario.until_s:
            return False
        self.now = round(self.now / STEP_S + 1) * STEP_S
        return True

    def run(self, pace: Callable[[float], None] = lambda _now: None) -> Verdict:
        """Run to the end; `pace` is called with the simulated time before each step and may wait."""
        pace(self.now)
        while self.step():
            pace(self.now)
        return self.verdict()

    def verdict(self) -> Verdict:
        """End all checks and return the verdict."""
        view = self._view()
        for running in self._running_checks:
            for failure in running.end(view):
                self._on_failure(str(failure))
        return Verdict(
            scenario=self.scenario.name,
            seed=self.scenario.seed,
            simulated_s=round(self.now, 3),
            checks=[
                CheckVerdict(running.description, not running.failures, running.failures)
                for running in self._running_checks
            ],
            steps_failed=[*self.station.failures, *self.station.unfinished()],
            vehicles=self._final_states(view),
        )

    def _ended(self, view: RunView) -> bool:
        """Return True if for SETTLE_S no step, fault or check runs and all vehicles are back and disarmed."""
        quiet = (
            self.station.done
            and self.now >= self._last_fault_s
            and all(running.is_settled(self.now) for running in self._running_checks)
            and bool(view.flown.all())
            and not (view.truth.airborne | view.truth.armed).any()
        )
        if not quiet:
            self._quiet_since_s = None
        elif self._quiet_since_s is None:
            self._quiet_since_s = self.now
        return self._quiet_since_s is not None and self.now - self._quiet_since_s >= SETTLE_S

    def _local(self, lat_deg: Floats, lon_deg: Floats, alt_amsl_m: Floats) -> Floats:
        east_m, north_m = self._frame.to_local(lat_deg, lon_deg)
        return np.column_stack([east_m, north_m, alt_amsl_m])

    def _view(self) -> RunView:
        truth: Truth = self.fleet.truth()
        position_m = self._local(truth.lat_deg, truth.lon_deg, truth.alt_amsl_m)
        moved = position_m - self._previous_m
        self._flown_m += np.sqrt(np.einsum("ij,ij->i", moved, moved))
        self._previous_m = position_m
        self._flown |= truth.airborne
        contacts, area = self.station.contacts, self.scenario.area
        from_start = position_m - self._start_m
        return RunView(
            now=self.now,
            truth=truth,
            position_m=position_m,
            start_m=self._start_m,
            goal_m=self._goal_m,
            bound_for_goal=np.array(
                [
                    item is None or self.fleet.vehicles[i].mission.index >= item
                    for i, item in enumerate(self._goal_item)
                ]
            ),
            flown=self._flown,
            heartbeat_age_s=self.now - np.array([contact.last_heartbeat_s for contact in contacts]),
            mission_done=np.array(
                [
                    end.reached(vehicle.mission)
                    for end, vehicle in zip(self._mission_ends, self.fleet.vehicles, strict=True)
                ]
            ),
            outside_fence_m=np.array(
                [
                    outside_m(contact.spec.fence, *from_start[i, :2].tolist()) if contact.spec.fence else 0.0
                    for i, contact in enumerate(contacts)
                ]
            ),
            area_m=(0.0, 0.0, area.cols * area.cell_size_m, area.rows * area.cell_size_m) if area else None,
            texts=[contact.texts for contact in contacts],
        )

    def _final_states(self, view: RunView) -> list[FinalVehicleState]:
        return [
            FinalVehicleState(
                sysid=contact.spec.sysid,
                link=contact.spec.link,
                personality=contact.spec.personality,
                kind=contact.spec.kind,
                mode=view.truth.mode[i],
                armed=bool(view.truth.armed[i]),
                height_m=round(float(view.height_m[i]), 2),
                from_start_m=round(float(view.from_start_m[i]), 2),
                flown_m=round(float(self._flown_m[i]), 1),
                battery_remaining=round(float(view.truth.battery_remaining[i]), 4),
                strikes=int(view.truth.strikes[i]),
                messages=contact.messages,
                last_text=contact.texts[-1] if contact.texts else "",
            )
            for i, contact in enumerate(self.station.contacts)
        ]


class _MissionEnd:
    """The end of one vehicle's mission."""

    def __init__(self, spec: VehicleSpec) -> None:
        legs = spec.mission
        flown = [i for i, leg in enumerate(legs) if leg.flown]
        self._last_item = spec.item_of(flown[-1]) if flown else math.inf
        self._lands_before = any(legs[i].lands for i in flown[:-1])
        reports_state = personality_of(spec.personality, spec.kind).telemetry.mission_state
        self._ends_at_return = bool(flown) and legs[flown[-1]].returns and not reports_state
        self._last_item_seen = self._reached = False

    def reached(self, mission: Mission) -> bool:
        """Return True if the mission is complete now or was complete at an earlier call."""
        is_last = mission.index >= self._last_item
        self._last_item_seen |= is_last
        # ArduPilot also completes a mission at a landing before the last item.
        if mission.state is MissionState.COMPLETE and (self._last_item_seen or not self._lands_before):
            self._reached |= mission.flyable  # PX4 also completes a mission that it cannot fly
        # PX4 leaves the mission mode at a last item that returns, and does not complete the mission.
        self._reached |= self._ends_at_return and is_last and mission.state is MissionState.PAUSED
        return self._reached


def outside_m(shapes: Sequence[FenceShape], east_m: float, north_m: float) -> float:
    """Return the distance beyond the most violated shape [m], or 0, without the vehicles' own fence code."""
    return max((_beyond_m(shape, east_m, north_m) for shape in shapes), default=0.0)


def _beyond_m(shape: FenceShape, east_m: float, north_m: float) -> float:
    circle = shape.keep_in_circle or shape.keep_out_circle
    if circle is not None:
        inside_m = circle.radius_m - math.hypot(east_m - circle.east_m, north_m - circle.north_m)
    else:
        polygon = shape.keep_in or shape.keep_out or ()
        edge_m = min(_distance_to_edge_m(a, b, east_m, north_m) for a, b in _edges(polygon))
        inside_m = edge_m if _inside(polygon, east_m, north_m) else -edge_m
    return max(0.0, -inside_m if shape.inclusion else inside_m)


def _edges(polygon: Sequence[Corner]) -> list[tuple[Corner, Corner]]:
    return list(zip(polygon, [*polygon[1:], polygon[0]], strict=True))


def _inside(polygon: Sequence[Corner], east_m: float, north_m: float) -> bool:
    """Return True if a ray to the east crosses an odd number of edges."""
    crossed = False
    for (east_a, north_a), (east_b, north_b) in _edges(polygon):
        if (north_a > north_m) != (north_b > north_m):
            crossing_m = east_a + (north_m - north_a) / (north_b - north_a) * (east_b - east_a)
            crossed ^= east_m < crossing_m
    return crossed


def _distance_to_edge_m(a: Corner, b: Corner, east_m: float, north_m: float) -> float:
    along = (b[0] - a[0], b[1] - a[1])
    squared = along[0] ** 2 + along[1] ** 2
    share = ((east_m - a[0]) * along[0] + (north_m - a[1]) * along[1]) / squared if squared else 0.0
    share = min(1.0, max(0.0, share))
    return math.hypot(east_m - a[0] - share * along[0], north_m - a[1] - share * along[1])
