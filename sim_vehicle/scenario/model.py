"""A scenario: which vehicles stand where, what blows, breaks and threatens them, and what is checked."""

from collections import Counter
from collections.abc import Collection
from typing import Annotated, Any, Literal, Self

from pydantic import AliasChoices, BeforeValidator, ConfigDict, Field, model_validator

from sim_vehicle.checks import CHECKS
from sim_vehicle.faults.spec import FaultSpec, parse_fault
from sim_vehicle.personalities import PERSONALITIES, personality_of
from sim_vehicle.scenario.base import (
    Altitude,
    Latitude,
    Length,
    Longitude,
    Number,
    Probability,
    Section,
    SystemId,
)
from sim_vehicle.scenario.plan import FenceShape, Leg, Point
from sim_vehicle.scenario.steps import CheckSpec, Step
from sim_vehicle.yaml_lines import KeyPath

Finding = tuple[KeyPath, str]


class MisfitError(ValueError):
    """Parts of a scenario that do not fit together; `findings` says where each is."""

    def __init__(self, findings: list[Finding]) -> None:
        super().__init__("\n".join(text for _, text in findings))
        self.findings = findings


class VehicleSpec(Section):
    """One vehicle: system id, autopilot and where it stands; `params` are set at its first boot."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_by_name=True, validate_by_alias=True)

    sysid: SystemId
    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Altitude = 10.0
    heading_deg: Annotated[float, Field(strict=True, ge=0, le=360)] = 0.0  # clockwise from north
    personality: Literal["ardupilot", "px4"] = "ardupilot"
    kind: Annotated[Literal["copter", "plane"], Field(validation_alias=AliasChoices("type", "kind"))] = (
        "copter"
    )
    link: Annotated[int, Field(strict=True, ge=0, lt=10_000)] = 0
    params: Annotated[dict[str, Number], Field(default_factory=dict)]
    mission: tuple[Leg, ...] = ()
    fence: tuple[FenceShape, ...] = ()
    goal: Point | None = None

    @model_validator(mode="after")
    def _parameters_exist(self) -> Self:
        if self.kind not in PERSONALITIES.get(self.personality, {}):
            there = [f"{name} {kind}" for name, kinds in PERSONALITIES.items() for kind in kinds]
            raise ValueError(f"there is no {self.personality} {self.kind}; there are: {', '.join(there)}")
        known = personality_of(self.personality, self.kind).parameters
        unknown = sorted(set(self.params) - set(known))
        if unknown:
            whose = f"{self.personality} {self.kind}"
            raise ValueError(
                f"no such parameters of {whose}: {', '.join(unknown)}; known: {', '.join(sorted(known))}"
            )
        return self

    def goal_m(self) -> tuple[float, float] | None:
        """East and north [m] of the start: `goal`, or the last place of the mission."""
        if self.goal is not None:
            return self.goal.east_m, self.goal.north_m
        return next((place for leg in reversed(self.mission) if (place := leg.place())), None)


def _fault(value: Any) -> Any:
    """As on the command line, or with the fields of a FaultSpec."""
    return parse_fault(value) if isinstance(value, str) else value


class Area(Section):
    """The square cells; the origin is the south-west corner of cell (0, 0)."""

    origin_lat_deg: Latitude
    origin_lon_deg: Longitude
    rows: Annotated[int, Field(strict=True, ge=1)]
    cols: Annotated[int, Field(strict=True, ge=1)]
    cell_size_m: Length


class Wind(Section):
    """Steady wind, where it comes from, and the standard deviation of its gusts."""

    speed_m_s: Annotated[float, Field(strict=True, ge=0, le=60)] = 0.0
    from_deg: Annotated[float, Field(strict=True, ge=0, le=360)] = 0.0
    gust_m_s: Annotated[float, Field(strict=True, ge=0, le=30)] = 0.0


class Gps(Section):
    """Standard deviation of the receiver's noise, and of its slow drift."""

    noise_m: Annotated[float, Field(strict=True, ge=0, le=100)] | None = None  # None: a good receiver's
    drift_m: Annotated[float, Field(strict=True, ge=0, le=100)] | None = None


class Scenario(Section):
    """Everything a fleet starts from, and what a run of it is judged by."""

    name: str = ""
    about: str = ""
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    ready_s: Annotated[float, Field(strict=True, ge=0, le=3600)] | None = None  # None: the autopilot's own
    vehicles: Annotated[list[VehicleSpec], Field(min_length=1)]
    wind: Wind = Wind()
    gps: Gps = Gps()
    area: Area | None = None
    firing_strength: tuple[Probability, Probability, Probability] | None = None
    hostiles: tuple[tuple[int, int], ...] = ()
    faults: tuple[Annotated[FaultSpec, BeforeValidator(_fault)], ...] = ()
    script: tuple[Step, ...] = ()
    checks: tuple[CheckSpec, ...] = ()
    until_s: Annotated[float, Field(strict=True, gt=0, le=86_400)] = 600.0
    speedup: Annotated[float, Field(strict=True, gt=0, le=1000)] | None = None  # None: as fast as it goes

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        findings = [*self._twice(), *self._threats_wrong(), *self._strangers(), *self._steps_wrong()]
        findings += self._checks_lacking()
        if findings:
            raise MisfitError(findings)
        return self

    def _twice(self) -> list[Finding]:
        counted = Counter((v.link, v.sysid) for v in self.vehicles)
        twice = sorted({sysid for (_, sysid), n in counted.items() if n > 1})
        if not twice:
            return []
        text = f"system ids on one link must differ, but these occur more than once: {twice}"
        return [(("vehicles",), text)]

    def _threats_wrong(self) -> list[Finding]:
        findings: list[Finding] = []
        if self.firing_strength is not None:
            own, nearest, diagonal = self.firing_strength
            if not own > nearest > diagonal:
                text = "must decrease (Eq. 1: own cell, nearest, diagonal), found"
                findings.append((("firing_strength",), f"{text} {own}, {nearest}, {diagonal}"))
        if not self.hostiles:
            return findings
        where: KeyPath = ("hostiles",)
        if self.area is None or self.firing_strength is None:
            return [*findings, (where, "hostiles need `area` and `firing_strength` as well")]
        rows, cols = self.area.rows, self.area.cols
        outside = [cell for cell in self.hostiles if not (0 <= cell[0] < rows and 0 <= cell[1] < cols)]
        if outside:
            findings.append((where, f"{outside} are outside the area of {rows} rows and {cols} columns"))
        twice = [cell for cell, n in Counter(self.hostiles).items() if n > 1]
        if twice:
            findings.append((where, f"a cell holds at most one hostile, but these are named twice: {twice}"))
        return findings

    def _strangers(self) -> list[Finding]:
        """System ids that steps, faults and checks name and no vehicle has."""
        known = {v.sysid for v in self.vehicles}
        named: list[tuple[KeyPath, Collection[int] | None]] = []
        named += [(("script", i), step.vehicles) for i, step in enumerate(self.script)]
        named += [(("faults", i), fault.vehicles) for i, fault in enumerate(self.faults)]
        named += [(("checks", i), check.vehicles) for i, check in enumerate(self.checks)]
        return [
            (where, f"no vehicle has system id {sorted(strange)}; there are {sorted(known)}")
            for where, sysids in named
            if (strange := set(sysids or ()) - known)
        ]

    def _steps_wrong(self) -> list[Finding]:
        """Modes and parameters that the vehicles do not have, missions and fences that are not there."""
        findings: list[Finding] = []
        for index, step in enumerate(self.script):
            for vehicle in self.meant(step.vehicles):
                text = _step_wrong(step, vehicle)
                if text:
                    findings.append((("script", index), f"{step.chosen}: vehicle {vehicle.sysid} {text}"))
        return findings

    def _checks_lacking(self) -> list[Finding]:
        findings: list[Finding] = []
        for index, check in enumerate(self.checks):
            need, where = CHECKS[check.name].needs, ("checks", index)
            if need == "area":
                if self.area is None:
                    findings.append((where, f"{check.name} needs the scenario's `area`"))
                continue
            lacking = [v.sysid for v in self.meant(check.vehicles) if need is not None and not _has(v, need)]
            if lacking:
                what = "`goal` or a mission with a place" if need == "goal" else f"`{need}`"
                cure = "give them one, or name others in the check's `vehicles`"
                findings.append((where, f"{check.name} needs {what} of vehicles {lacking}; {cure}"))
        return findings

    def meant(self, sysids: Collection[int] | None) -> list[VehicleSpec]:
        """The vehicles with these system ids, on whatever link; all for None."""
        return [v for v in self.vehicles if sysids is None or v.sysid in sysids]


def _has(vehicle: VehicleSpec, need: str) -> bool:
    return bool({"goal": vehicle.goal_m(), "fence": vehicle.fence, "mission": vehicle.mission}[need])


def _step_wrong(step: Step, vehicle: VehicleSpec) -> str:
    personality = personality_of(vehicle.personality, vehicle.kind)
    if step.chosen in ("fly_mission", "upload_mission") and not vehicle.mission:
        return "has no `mission`"
    if step.chosen == "upload_fence" and not vehicle.fence:
        return "has no `fence`"
    if step.mode is not None:
        names = [mode.name for mode in personality.modes.values() if mode.selectable]
        if not {name.casefold() for name in names} & set(step.mode.casefold().split("|")):
            return f"has no mode {step.mode!r}; it has {', '.join(names)} (several: `RTL|Return`)"
    unknown = sorted(set(step.param or ()) - set(personality.parameters))
    return f"has no parameters {', '.join(unknown)}" if unknown else ""
