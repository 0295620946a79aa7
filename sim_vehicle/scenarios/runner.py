"""One run of a scenario: the fleet, its ground station and the checks under one simulated clock; no I/O."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.fleet import Fleet
from sim_vehicle.physics.geodesy import Floats, LocalFrame
from sim_vehicle.scenarios.checks import View
from sim_vehicle.scenarios.geometry import outside_m
from sim_vehicle.scenarios.judging import Failure, Judge
from sim_vehicle.scenarios.model import Scenario
from sim_vehicle.station.client import Heard, Station, StepFailure
from sim_vehicle.truth import Truth

STEP_S = 0.05
SETTLE_S = 2.0  # after everything has ended, so that the last messages are in the logs


@dataclass(frozen=True, slots=True)
class VehicleEnd:
    """One vehicle when the run was over."""

    sysid: int
    link: int
    personality: str
    kind: str
    mode: str
    armed: bool
    height_m: float
    from_start_m: float
    flown_m: float
    battery_remaining: float
    strikes: int
    messages: int
    last_text: str


@dataclass(frozen=True, slots=True)
class CheckEnd:
    """One check's verdict."""

    check: str
    passed: bool
    failures: list[Failure]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came of a run."""

    scenario: str
    seed: int
    simulated_s: float
    checks: list[CheckEnd]
    steps_failed: list[StepFailure]
    vehicles: list[VehicleEnd] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        return not self.steps_failed and all(check.passed for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"passed": self.passed, **asdict(self)}


class Run:
    """Steps through a scenario.

    Parameters
    ----------
    heard: takes vehicle index, frame and time of every message between the vehicles and the ground station.
    said: takes a line about what has just failed.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        heard: Heard = lambda _index, _frame, _now: None,
        said: Callable[[str], None] = lambda _line: None,
    ) -> None:
        self.scenario = scenario
        self.fleet = Fleet(scenario)
        self.station = Station(scenario, heard=heard)
        self.now = 0.0
        self._said = said
        self._judges = [Judge(spec, scenario) for spec in scenario.checks]
        self._steps_told = 0
        area, first = scenario.area, scenario.vehicles[0]
        self._frame = (
            LocalFrame(area.origin_lat_deg, area.origin_lon_deg)
            if area is not None
            else LocalFrame(first.lat_deg, first.lon_deg)
        )
        self._start_m = self._local(
            np.array([v.lat_deg for v in scenario.vehicles]),
            np.array([v.lon_deg for v in scenario.vehicles]),
            np.array([v.alt_amsl_m for v in scenario.vehicles]),
        )
        goals = [v.goal_m() or (np.nan, np.nan) for v in scenario.vehicles]
        self._goal_m = self._start_m[:, :2] + np.array(goals, dtype=np.float64)
        self._goal_item = [v.goal_item() for v in scenario.vehicles]
        self._flown = np.zeros(len(scenario.vehicles), dtype=bool)
        self._flown_m = np.zeros(len(scenario.vehicles))
        self._before_m = self._start_m
        self._last_fault_s = max(
            (fault.at_s + (fault.for_s or 0.0) for fault in scenario.faults), default=0.0
        )
        self._over_s: float | None = None

    def step(self) -> bool:
        """Advance by one tick of 0.05 s and look at the checks; False when the run is over."""
        for index, data in self.fleet.step(self.now):
            self.station.receive(index, data, self.now)
        for link, data in self.station.step(self.now):
            for index, answer in self.fleet.receive(data, self.now, link=link):
                self.station.receive(index, answer, self.now)
        view = self._view()
        for judge in self._judges:
            for failure in judge.look(view):
                self._said(str(failure))
        for failed in self.station.failures[self._steps_told :]:
            self._said(f"t={failed.t_s:.2f} s, vehicle {failed.sysid}: {failed.action} failed, {failed.text}")
        self._steps_told = len(self.station.failures)
        if self._ended(view) or self.now + EPSILON_S >= self.scenario.until_s:
            return False
        self.now = round(self.now / STEP_S + 1) * STEP_S
        return True

    def run(self, pace: Callable[[float], None] = lambda _now: None) -> Verdict:
        """To the end; `pace` is called with the simulated time before each step and may wait."""
        pace(self.now)
        while self.step():
            pace(self.now)
        return self.verdict()

    def verdict(self) -> Verdict:
        """The judgement, with everything that was still open closed now."""
        view = self._view()
        for judge in self._judges:
            for failure in judge.end(view):
                self._said(str(failure))
        return Verdict(
            scenario=self.scenario.name,
            seed=self.scenario.seed,
            simulated_s=round(self.now, 3),
            checks=[CheckEnd(j.words, not j.failures, j.failures) for j in self._judges],
            steps_failed=[*self.station.failures, *self.station.unfinished()],
            vehicles=self._vehicles(view),
        )

    def _ended(self, view: View) -> bool:
        """Whether nothing more can happen: all is done, and everybody is down again."""
        quiet = (
            self.station.done
            and self.now >= self._last_fault_s
            and all(judge.settled(self.now) for judge in self._judges)
            and bool(view.flown.all())
            and not (view.truth.airborne | view.truth.armed).any()
        )
        if not quiet:
            self._over_s = None
        elif self._over_s is None:
            self._over_s = self.now
        return self._over_s is not None and self.now - self._over_s >= SETTLE_S

    def _local(self, lat_deg: Floats, lon_deg: Floats, alt_amsl_m: Floats) -> Floats:
        east_m, north_m = self._frame.to_local(lat_deg, lon_deg)
        return np.column_stack([east_m, north_m, alt_amsl_m])

    def _view(self) -> View:
        truth: Truth = self.fleet.truth()
        position_m = self._local(truth.lat_deg, truth.lon_deg, truth.alt_amsl_m)
        moved = position_m - self._before_m
        self._flown_m += np.sqrt(np.einsum("ij,ij->i", moved, moved))
        self._before_m = position_m
        self._flown |= truth.airborne
        contacts, area = self.station.contacts, self.scenario.area
        from_start = position_m - self._start_m
        return View(
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
            silent_s=self.now - np.array([contact.heard_s for contact in contacts]),
            mission_done=np.array([contact.progress.done for contact in contacts]),
            outside_fence_m=np.array(
                [
                    outside_m(contact.spec.fence, *from_start[i, :2].tolist()) if contact.spec.fence else 0.0
                    for i, contact in enumerate(contacts)
                ]
            ),
            area_m=(0.0, 0.0, area.cols * area.cell_size_m, area.rows * area.cell_size_m) if area else None,
            texts=[contact.texts for contact in contacts],
        )

    def _vehicles(self, view: View) -> list[VehicleEnd]:
        return [
            VehicleEnd(
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
