"""Sets vehicles up as the configuration declares, asks them, and judges; arms nothing."""

from __future__ import annotations

import asyncio
import math
import statistics
from collections import deque
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

from swarmctl.agent.replan.copter_trajectory import from_takeoff
from swarmctl.agent.state import ON_GROUND, AgentState, Phase
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.conflicts import CrossingCounts, count_crossings
from swarmctl.agent.traffic.separation.trajectory import Trajectory, until_landing
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.links.base import FenceFailed, Identity, Link, LinkError, ParametersFailed
from swarmctl.mavlink.firmware import firmware_of
from swarmctl.mavlink.telemetry.instruments import Instruments
from swarmctl.preflight.checks import CHECKS, parameters
from swarmctl.preflight.checks import separation as apart_from_others
from swarmctl.preflight.declared import declared_behaviour
from swarmctl.preflight.facts import Finding, OtherVehicle, PreflightFacts
from swarmctl.preflight.policy import NoParameterTable, RequiredParameter, parameters_for
from swarmctl.preflight.waivers import Waiver

SIMULATED_ENDURANCE_S = 1400.0
"""6600 mAh at 11.4 V, of which hovering and electronics take 179 W, is 1513 s; turns and climbs take more"""


LOOKS = 3
"""What fails may be a message that was lost; it is looked at so often before it is believed."""


class ConnectedAgent(Protocol):
    """The link of a vehicle, and the state of its agent."""

    @property
    def link(self) -> Link: ...
    @property
    def state(self) -> AgentState: ...
    @property
    def conflict(self) -> str:
        """A second vehicle of the same system id, in words; empty where there is none."""


class VehicleToCheck(Protocol):
    """A vehicle of this process."""

    @property
    def spec(self) -> Spec: ...
    @property
    def runner(self) -> ConnectedAgent: ...
    @property
    def identity(self) -> Identity | None: ...
    @property
    def not_ready_because(self) -> str:
        """What keeps it from being made ready, in words; empty where nothing does."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """What one check found of one vehicle."""

    vehicle: str
    check: str
    waivable: bool
    finding: Finding
    waived: bool = False
    """it failed, and an operator has taken that upon himself"""
    left_to_fly: str = ""
    """what `fly` does about it before it arms, and `preflight` does not"""

    @property
    def passes(self) -> bool:
        return self.finding.ok or self.waived or bool(self.left_to_fly)

    def __str__(self) -> str:
        finding = self.finding
        waive = f" (or --waive {self.check}:{self.vehicle})" if self.waivable else ""
        return (
            f"{self.vehicle}: {self.check}: found {finding.found}; wanted {finding.wanted}; "
            f"{finding.cure}{waive}"
        )


@dataclass(slots=True)
class _Answers:
    """Of one vehicle, as far as they came."""

    instruments: Instruments = field(default_factory=partial(Instruments, None, None, None))
    parameters: Mapping[str, float] = field(default_factory=dict)
    fence_failure: str = ""
    rally_points: int | None = None
    fence: tuple[MissionItem, ...] | None = None


class Preflight:
    """The checks of one run; `checked` is filled with the last findings of every vehicle, by its name, and
    `crossings`, last of it, with the first routes of this process that meet over ground.

    `unix_s_at_zero`, `speedup`: wall time when the running loop's clock showed 0, and simulated seconds in
    one of the loop's. `free_clocks`: simulated vehicles tell a date of their own, not this machine's.
    """

    def __init__(
        self,
        scenario: Scenario,
        checked: dict[str, tuple[CheckResult, ...]],
        waivers: Sequence[Waiver],
        *,
        unix_s_at_zero: float,
        speedup: float,
        free_clocks: bool,
        say: Callable[[str], None],
        on_waived: Callable[[CheckResult], None] = lambda _: None,
        sets_parameters: bool = True,
        crossings: deque[CrossingCounts] | None = None,
    ) -> None:
        self._checked = checked
        self._crossings = crossings
        self._scenario = scenario
        self._waivers = waivers
        self._unix_s_at_zero = unix_s_at_zero
        self._speedup = speedup
        self._free_clocks = free_clocks
        self._say = say
        self._on_waived = on_waived
        self._sets_parameters = sets_parameters and scenario.config.preflight.set_parameters
        self._fly_sets_them = not sets_parameters and scenario.config.preflight.set_parameters
        self._polygon = scenario.fence_polygon
        separation = scenario.config.separation
        self._limits = Limits(separation.horizontal_m, separation.vertical_m)
        self._instruments: dict[str, Instruments] = {}
        self._flights: dict[str, Trajectory | None] = {}
        """of the vehicles of this process, as of the last look"""

    async def set_up(self, subject: VehicleToCheck) -> None:
        """Parameters, where the configuration lets us, and the fence. What fails is said, and found again by
        the checks. Raises LinkError where the vehicle is not there."""
        if self._sets_parameters:
            await self._said(self._correct(subject))
        await self._said(subject.runner.link.put_fence(self._polygon))

    async def _said(self, doing: Coroutine[Any, Any, None]) -> None:
        try:
            await doing
        except (ParametersFailed, FenceFailed) as error:
            self._say(str(error))

    async def _correct(self, subject: VehicleToCheck) -> None:
        wanted, _ = self._wanted(subject)
        link = subject.runner.link
        found = await link.read_parameters([w.name for w in wanted])
        wrong = _corrections(wanted, found)
        if wrong:
            await link.set_parameters(wrong)
            changes = _changes(wrong, found)
            self._say(
                f"{subject.spec.name}: set as preflight.policy declares: {changes} (they stay so afterwards)"
            )

    async def failures(
        self, subjects: Sequence[VehicleToCheck], everyone: Sequence[VehicleToCheck]
    ) -> list[str]:
        """Check the subjects, of all vehicles of this process; a line for each check that fails and is not
        waived."""
        await self._look_until_believed(subjects, everyone)
        for found in self._found(subjects):
            if found.waived:
                text = f"found {found.finding.found}; wanted {found.finding.wanted}"
                self._say(f"{found.vehicle}: {found.check} is waived: {text}")
                self._on_waived(found)
        return [str(found) for found in self._found(subjects) if not found.passes]

    async def found_early(self, subject: VehicleToCheck, everyone: Sequence[VehicleToCheck]) -> list[str]:
        """What fails of one vehicle while others are not ready; not what is judged by where those fly."""
        await self._look_until_believed([subject], everyone)
        early = [found for found in self._found([subject]) if found.check != apart_from_others.NAME]
        return [str(found) for found in early if not found.passes]

    async def _look_until_believed(
        self, subjects: Sequence[VehicleToCheck], everyone: Sequence[VehicleToCheck]
    ) -> None:
        """Once, and again at those of whom something fails."""
        failing = list(subjects)
        for _ in range(LOOKS):
            await self._look(failing, everyone)
            failing = [s for s in failing if not all(found.passes for found in self._found([s]))]
            if not failing:
                break

    def _found(self, subjects: Sequence[VehicleToCheck]) -> list[CheckResult]:
        return [found for subject in subjects for found in self._checked[subject.spec.name]]

    async def _look(self, subjects: Sequence[VehicleToCheck], everyone: Sequence[VehicleToCheck]) -> None:
        asked = await asyncio.gather(*map(self._ask, subjects))
        # Who is in the air already is where it then was to be: its route begins where it took off.
        standing = ON_GROUND | {Phase.LAUNCHING}
        self._flights |= {s.spec.name: _flight(s) for s in everyone if s.runner.state.phase in standing}
        if self._crossings is not None:
            known = (until_landing(flight) for flight in self._flights.values() if flight is not None)
            self._crossings.append(count_crossings(dict(enumerate(known)), self._limits))
        for subject, answers in zip(subjects, asked, strict=True):
            self._instruments[subject.spec.name] = answers.instruments
        for subject, answers in zip(subjects, asked, strict=True):
            facts = self._facts(subject, everyone, answers)
            self._checked[subject.spec.name] = tuple(self._checks(facts))

    async def _ask(self, subject: VehicleToCheck) -> _Answers:
        """What does not come is not known, and what is not known fails."""
        link, wanted = subject.runner.link, self._wanted(subject)[0]
        answers = _Answers()
        try:
            answers.instruments = await link.read_instruments()
            answers.parameters = await link.read_parameters([w.name for w in wanted])
            answers.fence_failure = await _enforced(link, wanted, answers.parameters)
            answers.rally_points = await self._count_rally_points(link)
            answers.fence = await link.read_fence()
        except LinkError as error:
            self._say(str(error))
        return answers

    async def _count_rally_points(self, link: Link) -> int | None:
        try:
            return await link.count_rally_points()
        except LinkError as error:
            self._say(str(error))
            return None

    def _checks(self, facts: PreflightFacts) -> Iterable[CheckResult]:
        for check in CHECKS:
            finding = check.check(facts)
            waived = check.WAIVABLE and any(w.covers(check.NAME, facts.name) for w in self._waivers)
            later = self._left_to_fly(facts) if check.NAME == parameters.NAME and not finding.ok else ""
            yield CheckResult(
                facts.name, check.NAME, check.WAIVABLE, finding, waived and not finding.ok, later
            )

    def _left_to_fly(self, facts: PreflightFacts) -> str:
        """What `fly` sets, where that mends all that is wrong."""
        wrong = _corrections(facts.wanted, facts.parameters)
        uncured = [w for w in facts.wanted if w.name not in wrong and not w.met_by(facts.parameters)]
        if not self._fly_sets_them or facts.no_table or uncured or not wrong:
            return ""
        return f"`fly` sets: {_changes(wrong, facts.parameters)}"

    def _facts(
        self,
        subject: VehicleToCheck,
        everyone: Sequence[VehicleToCheck],
        answers: _Answers,
    ) -> PreflightFacts:
        spec, runner, asked = subject.spec, subject.runner, self._scenario.config.preflight
        wanted, no_table = self._wanted(subject)
        ours, state = spec.simulated, runner.link.state()
        return PreflightFacts(
            name=spec.name,
            sysid=spec.sysid,
            identity=subject.identity,
            conflict=runner.conflict,
            state=state,
            age_s=runner.link.age_s(),
            position_age_s=_age_s(state.position_s),
            status_age_s=_age_s(state.status_s),
            instruments=answers.instruments,
            clock_offset_s=self._offset_s(subject, everyone),
            clock_tolerance_s=asked.clock_tolerance_s * (self._speedup if ours else 1.0),
            wanted=wanted,
            no_table=no_table,
            parameters=answers.parameters,
            fence=self._polygon,
            fence_items=answers.fence,
            fence_failure=answers.fence_failure,
            rally_points=answers.rally_points,
            ceiling_m=self._scenario.ceiling_m,
            plan=_plan(subject),
            no_route=subject.not_ready_because or runner.state.outcome or runner.state.trouble,
            flight=self._flights.get(spec.name),
            altitude_m=spec.altitude_m,
            speed_m_s=spec.speed_m_s,
            endurance_s=asked.endurance_s or (SIMULATED_ENDURANCE_S if _is_simulated(subject) else None),
            reserve_percent=asked.reserve_percent,
            frame=self._scenario.grid.frame,
            others=tuple(self._others(spec, everyone)),
            limits=self._limits,
            airframe=spec.airframe,
        )

    def _others(self, spec: Spec, everyone: Sequence[VehicleToCheck]) -> Iterable[OtherVehicle]:
        identities = {subject.spec.name: subject.identity for subject in everyone}
        for other in self._scenario.swarm:
            if other.name != spec.name:
                yield OtherVehicle(
                    other.name,
                    other.sysid,
                    other.altitude_m,
                    identities.get(other.name),
                    self._flights.get(other.name),
                    other.airframe,
                )

    def _wanted(self, subject: VehicleToCheck) -> tuple[tuple[RequiredParameter, ...], str]:
        """What its parameters may be; or why nobody knows."""
        if subject.identity is None:
            return (), "it has not said which firmware it runs"
        try:
            firmware = firmware_of(subject.identity)
            return parameters_for(firmware, declared_behaviour(self._scenario, subject.spec)), ""
        except NoParameterTable as error:
            return (), str(error)

    def _offset_s(self, subject: VehicleToCheck, everyone: Sequence[VehicleToCheck]) -> float | None:
        own_s = self._against_own_s(subject)
        if own_s is None or not (self._free_clocks and _is_simulated(subject)):
            return own_s
        if not subject.spec.simulated:
            return 0.0  # the date of somebody else's simulation is in step with nothing
        told = [self._against_own_s(other) for other in everyone if other.spec.simulated]
        return own_s - statistics.median(offset_s for offset_s in told if offset_s is not None)

    def _against_own_s(self, subject: VehicleToCheck) -> float | None:
        """A vehicle's clock less this machine's [s], which for simulated vehicles goes as fast as they do."""
        told = self._instruments.get(subject.spec.name)
        if told is None or told.unix_s is None or told.told_at_s is None:
            return None
        pace = self._speedup if subject.spec.simulated else 1.0
        return told.unix_s - (self._unix_s_at_zero + told.told_at_s * pace)


def summary_of(checked: Mapping[str, Sequence[CheckResult]]) -> list[dict[str, Any]]:
    """For `summary.json`: of each vehicle what was found, and what of it an operator has waived."""
    return [
        {
            "vehicle": found.vehicle,
            "check": found.check,
            "ok": found.finding.ok,
            "waived": found.waived,
            "found": found.finding.found,
            "wanted": found.finding.wanted,
        }
        for findings in checked.values()
        for found in findings
    ]


_WHICH_LIMITS = frozenset({"FENCE_ENABLE", "FENCE_TYPE"})


async def _enforced(link: Link, wanted: Sequence[RequiredParameter], told: Mapping[str, float]) -> str:
    """Why the limits may not be in force that an ArduPilot's parameters name; empty where they are, now.

    Where those say another than is declared somebody has waived that, and decides what is in force.
    """
    saying = [w for w in wanted if w.name in _WHICH_LIMITS]
    if not saying or not all(w.met_by(told) for w in saying):
        return ""
    try:
        await link.enforce_fence()
    except FenceFailed as error:
        return str(error)
    return ""


def _corrections(wanted: Sequence[RequiredParameter], found: Mapping[str, float]) -> dict[str, float]:
    """What is to be set of the parameters that were found, by name."""
    return {
        w.name: value
        for w in wanted
        if w.name in found
        and not w.accepts(found[w.name])
        and (value := w.corrected(found[w.name])) is not None
    }


def _changes(wrong: Mapping[str, float], found: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {found[name]:g} → {value:g}" for name, value in wrong.items())


def _is_simulated(subject: VehicleToCheck) -> bool:
    return subject.identity is not None and subject.identity.simulated


def _age_s(told_s: float | None) -> float:
    return math.inf if told_s is None else asyncio.get_running_loop().time() - told_s


def _plan(subject: VehicleToCheck) -> FlightPlan | None:
    """What is verified on the vehicle."""
    accepted = subject.runner.state.accepted
    return None if accepted is None or not subject.runner.link.items() else accepted.plan


def _flight(subject: VehicleToCheck) -> Trajectory | None:
    plan, state = _plan(subject), subject.runner.link.state()
    if plan is None or state.lat_deg is None or state.lon_deg is None:
        return None
    flight = from_takeoff(subject.runner.state.task, plan, (state.lat_deg, state.lon_deg))
    return flight.later(subject.spec.delay_s)
