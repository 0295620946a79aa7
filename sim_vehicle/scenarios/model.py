"""A scenario: vehicles, wind, faults, threats, script and checks, and their consistency."""

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    model_validator,
)

from sim_vehicle.faults.spec import FaultSpec, parse_fault
from sim_vehicle.personalities import PERSONALITIES, personality_of
from sim_vehicle.physics.geodesy import LocalFrame
from sim_vehicle.physics.gps import GpsSettings
from sim_vehicle.problems import remedy
from sim_vehicle.scenarios.base import (
    Altitude,
    Heading,
    Latitude,
    Length,
    Longitude,
    NameIn,
    Number,
    Probability,
    Section,
    SystemId,
)
from sim_vehicle.scenarios.checks import CHECKS
from sim_vehicle.scenarios.plan import FenceShape, Leg, StartOffset, jump_problem
from sim_vehicle.scenarios.steps import CheckSpec, ScriptStep
from sim_vehicle.scenarios.yaml_lines import KeyPath

MAX_DISTANCE_M = 50_000.0
GOOD_RECEIVER = GpsSettings()

Finding = tuple[KeyPath, str]  # path in the scenario, text of the problem


class InconsistentScenarioError(ValueError):
    """A contradiction in the scenario; `findings` has path and text of each contradiction."""

    def __init__(self, findings: list[Finding]) -> None:
        super().__init__("\n".join(text for _, text in findings))
        self.findings = findings


class VehicleSpec(Section):
    """One vehicle: system id, autopilot, position; `params` are set at the first boot."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_by_name=True, validate_by_alias=True)

    sysid: SystemId
    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Altitude = 10.0
    heading_deg: Heading = 0.0
    personality: Annotated[str, NameIn(PERSONALITIES)] = "ardupilot"
    kind: Annotated[Literal["copter", "plane"], Field(validation_alias=AliasChoices("type", "kind"))] = (
        "copter"
    )
    link: Annotated[int, Field(strict=True, ge=0, lt=10_000)] = 0  # system ids on one link differ
    params: Annotated[dict[str, Number], Field(default_factory=dict)]
    mission: tuple[Leg, ...] = ()
    fence: tuple[FenceShape, ...] = ()
    goal: StartOffset | None = None

    @model_validator(mode="after")
    def _is_simulated(self) -> Self:
        if self.kind not in PERSONALITIES.get(self.personality, {}):
            available = [f"{name} {kind}" for name, kinds in PERSONALITIES.items() for kind in kinds]
            raise ValueError(
                f"{self.personality} {self.kind} is not simulated; the vehicles are {', '.join(available)}"
            )
        known = personality_of(self.personality, self.kind).parameters.defaults
        unknown = sorted(set(self.params) - set(known))
        if unknown:
            vehicle = f"{self.personality} {self.kind}"
            names = ", ".join(sorted(known))
            raise ValueError(
                f"unknown parameters of {vehicle}: {', '.join(unknown)}; the parameters are {names}"
            )
        return self

    def goal_m(self) -> tuple[float, float] | None:
        """Return `goal`, else the mission's last position, else None; [m] east and north of the start."""
        if self.goal is not None:
            return self.goal.east_m, self.goal.north_m
        leg = self._last_placed_leg()
        return None if leg is None else self.mission[leg].place()

    def goal_item(self) -> int | None:
        """Return the number of the goal's mission item, or None if the goal is not an item."""
        leg = self._last_placed_leg()
        return None if self.goal is not None or leg is None else self.item_of(leg)

    def item_of(self, leg: int) -> int:
        """Return the MAVLink sequence number of a mission entry; on some autopilots item 0 is home."""
        return leg + int(personality_of(self.personality, self.kind).mission.home_item)

    def _last_placed_leg(self) -> int | None:
        legs = range(len(self.mission))
        return next((leg for leg in reversed(legs) if self.mission[leg].place()), None)


def _fault(value: Any) -> Any:
    """Return a fault in its command-line form as a FaultSpec, and other values unchanged."""
    return parse_fault(value) if isinstance(value, str) else value


class Area(Section):
    """The grid of square cells, with its origin at the south-west corner of cell (0, 0)."""

    origin_lat_deg: Latitude
    origin_lon_deg: Longitude
    rows: Annotated[int, Field(strict=True, ge=1)]
    cols: Annotated[int, Field(strict=True, ge=1)]
    cell_size_m: Length


class Wind(Section):
    """The steady wind, the direction of its origin, and the standard deviation of gusts."""

    speed_m_s: Annotated[float, Field(strict=True, ge=0, le=60)] = 0.0
    from_deg: Annotated[float, Field(strict=True, ge=0, le=360)] = 0.0
    gust_m_s: Annotated[float, Field(strict=True, ge=0, le=30)] = 0.0


class Gps(Section):
    """The standard deviations of the GPS receiver's noise and slow drift; the defaults: a good receiver."""

    noise_m: Annotated[float, Field(strict=True, ge=0, le=100)] = GOOD_RECEIVER.noise_m
    drift_m: Annotated[float, Field(strict=True, ge=0, le=100)] = GOOD_RECEIVER.drift_m


def _folder_name(name: str) -> str:
    """Return the name; raise ValueError if the name cannot be the name of the run's folder."""
    if name in (".", "..") or not name.isprintable() or set(name) & set("/\\"):
        raise ValueError(f"must be a folder's name, without / and \\; found {name!r:.60}")
    return name


class Scenario(Section):
    """The start of a fleet, and the script and checks of a run."""

    name: Annotated[str, AfterValidator(_folder_name)] = ""
    about: str = ""
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    ready_s: Annotated[float, Field(strict=True, ge=0, le=3600)] | None = (
        None  # from boot; None: the autopilot's own
    )
    vehicles: Annotated[list[VehicleSpec], Field(min_length=1)]
    wind: Wind = Wind()
    gps: Gps = Gps()
    area: Area | None = None
    firing_strength: tuple[Probability, Probability, Probability] | None = None
    hostiles: tuple[tuple[int, int], ...] = ()
    faults: tuple[Annotated[FaultSpec, BeforeValidator(_fault)], ...] = ()
    script: tuple[ScriptStep, ...] = ()
    checks: tuple[CheckSpec, ...] = ()
    until_s: Annotated[float, Field(strict=True, gt=0, le=86_400)] = 600.0
    speedup: Annotated[float, Field(strict=True, gt=0, le=1000)] | None = None  # None: unlimited

    @model_validator(mode="after")
    def _check_consistency(self, info: ValidationInfo) -> Self:
        findings = [
            *self._duplicate_sysids(),
            *self._mission_problems(),
            *self._threat_problems(),
            *self._unknown_sysids(),
            *self._script_problems(),
            *self._check_requirements(),
            *self._mode_problems(),
            # A fault of `serve --fault` may begin at any time, because `serve` has no end.
            *self._late_entries(with_faults=bool(info.context and info.context.get("from_file"))),
            *self._distant_vehicles(),
        ]
        if info.context and info.context.get("standalone"):
            findings += self._idle_problems()
        if findings:
            raise InconsistentScenarioError(findings)
        return self

    @property
    def origin_deg(self) -> tuple[float, float]:
        """Return latitude and longitude [deg] of the origin of the fleet's common local plane."""
        if self.area is not None:
            return self.area.origin_lat_deg, self.area.origin_lon_deg
        return self.vehicles[0].lat_deg, self.vehicles[0].lon_deg

    def _duplicate_sysids(self) -> Iterator[Finding]:
        counted = Counter((v.link, v.sysid) for v in self.vehicles)
        if duplicates := sorted({sysid for (_, sysid), n in counted.items() if n > 1}):
            yield ("vehicles",), f"system ids on one link must differ; duplicates: {duplicates}"

    def _distant_vehicles(self) -> Iterator[Finding]:
        """Find vehicles too far away for the fleet's common local plane."""
        frame = LocalFrame(*self.origin_deg)
        name = "the area's origin" if self.area else "the first vehicle"
        limit = f"{MAX_DISTANCE_M / 1000:.0f} km"
        for index, vehicle in enumerate(self.vehicles):
            away_m = math.hypot(*frame.point_to_local(vehicle.lat_deg, vehicle.lon_deg))
            if away_m > MAX_DISTANCE_M:
                yield (
                    ("vehicles", index),
                    f"starts {away_m / 1000:.0f} km from {name}; the limit is {limit}",
                )

    def _mission_problems(self) -> Iterator[Finding]:
        for index, vehicle in enumerate(self.vehicles):
            where: KeyPath = ("vehicles", index, "mission")
            legs = vehicle.mission
            if legs and not any(leg.flown or leg.item is not None for leg in legs):
                yield where, "has only speeds and jumps; add a takeoff or a waypoint"
            yield from (((*where, i), text) for i in range(len(legs)) if (text := jump_problem(legs, i)))

    def _threat_problems(self) -> Iterator[Finding]:
        if self.firing_strength is not None:
            own, nearest, diagonal = self.firing_strength
            if not own > nearest > diagonal:
                text = "must decrease: own cell, adjacent cells, diagonal cells; found"
                yield ("firing_strength",), f"{text} {own}, {nearest}, {diagonal}"
        if not self.hostiles:
            return
        where: KeyPath = ("hostiles",)
        if self.area is None or self.firing_strength is None:
            yield where, "needs `area` and `firing_strength`; add the missing section"
            return
        rows, cols = self.area.rows, self.area.cols
        if outside := [cell for cell in self.hostiles if not (0 <= cell[0] < rows and 0 <= cell[1] < cols)]:
            yield where, f"{outside} are outside of rows 0 to {rows - 1}, columns 0 to {cols - 1}"
        if duplicates := [cell for cell, n in Counter(self.hostiles).items() if n > 1]:
            yield where, f"a cell has at most one hostile; duplicates: {duplicates}"

    def _unknown_sysids(self) -> Iterator[Finding]:
        known = {v.sysid for v in self.vehicles}
        for section in ("script", "faults", "checks"):
            for i, entry in enumerate(getattr(self, section)):
                if unknown := set(entry.vehicles or ()) - known:
                    text = f"no vehicle has system id {sorted(unknown)}; the system ids are {sorted(known)}"
                    yield (section, i), text

    def _script_problems(self) -> Iterator[Finding]:
        for index, step in enumerate(self.script):
            for vehicle in self.selected(step.vehicles):
                if text := _missing_for_step(step, vehicle):
                    yield ("script", index), f"{step.chosen}: vehicle {vehicle.sysid} {text}"

    def _check_requirements(self) -> Iterator[Finding]:
        for index, check in enumerate(self.checks):
            if missing := self._missing(CHECKS[check.chosen].needs, self.selected(check.vehicles)):
                yield ("checks", index), f"{check.chosen} needs {missing}"

    def _missing(self, need: str | None, vehicles: Sequence[VehicleSpec]) -> str:
        """Return what a check needs and the scenario or a vehicle lacks, in words, or an empty text."""
        present = {"area": self.area, "hostiles": self.hostiles, "others": self.vehicles[1:]}
        if need is None or present.get(need):
            return ""
        if need in present:
            return "two vehicles or more" if need == "others" else f"the scenario's `{need}`"
        lacking = [v.sysid for v in vehicles if not (v.goal_m() if need == "goal" else getattr(v, need))]
        what = "`goal` or a mission with a position" if need == "goal" else f"`{need}`"
        cure = "add it, or name other vehicles in the check's `vehicles`"
        return f"{what}, missing on vehicles {lacking}; {cure}" if lacking else ""

    def _mode_problems(self) -> Iterator[Finding]:
        """Find steps and checks with a mode that a selected vehicle does not have."""
        requested: list[tuple[KeyPath, str, str, Collection[int] | None]] = [
            (("script", index), "mode", step.mode, step.vehicles)
            for index, step in enumerate(self.script)
            if step.mode is not None
        ]
        requested += [
            (("checks", index), check.chosen, str(check.argument), check.vehicles)
            for index, check in enumerate(self.checks)
            if CHECKS[check.chosen].argument == "mode"
        ]
        for where, what, alternatives, sysids in requested:
            kinds: set[tuple[str, str]] = {(v.personality, v.kind) for v in self.selected(sysids)}
            available = {kind: _mode_names(*kind, selectable=what == "mode") for kind in sorted(kinds)}
            if available and (text := _mode_problem(alternatives, available)):
                yield where, f"{what}: {text}"  # unknown vehicles have their own finding

    def _late_entries(self, *, with_faults: bool) -> Iterator[Finding]:
        """Find steps, checks and faults that begin or end after the run."""
        for index, step in enumerate(self.script):
            yield from self._too_late(("script", index), step.chosen, at_s=step.at_s)
        for index, check in enumerate(self.checks):
            times = {name: getattr(check.settings, name) for name in ("from_s", "until_s", "by_s")}
            yield from self._too_late(("checks", index), check.chosen, **times)
        for index, fault in enumerate(self.faults if with_faults else ()):
            yield from self._too_late(("faults", index), fault.fault, at_s=fault.at_s)

    def _idle_problems(self) -> Iterator[Finding]:
        """Find a missing script, and missions that no step uploads."""
        if not self.script and not self.checks:
            yield (), "has neither `script` nor `checks`; add a `script` (`[fly_mission]`), or `checks`"
            return
        uploads = [step for step in self.script if step.chosen in ("fly_mission", "upload_mission")]
        uploaded = {v.sysid for step in uploads for v in self.selected(step.vehicles)}
        for index, vehicle in enumerate(self.vehicles):
            if vehicle.mission and vehicle.sysid not in uploaded:
                yield ("vehicles", index, "mission"), "is not uploaded; add `script: [fly_mission]`"

    @staticmethod
    def step_problem(step: ScriptStep, vehicle: VehicleSpec) -> str:
        """Return the mode, plan or parameter that the vehicle lacks for a step, or an empty text."""
        if step.mode is not None:
            names = _mode_names(vehicle.personality, vehicle.kind, selectable=True)
            known = {name.casefold() for name in names}
            if not known & set(step.mode.casefold().split("|")):
                return f"has no mode {step.mode!r}; its modes are {', '.join(names)}"
        return _missing_for_step(step, vehicle)

    def _too_late(self, where: KeyPath, what: str, **times_s: float | None) -> Iterator[Finding]:
        """Find the first time after the run; an entry must also begin before the end of the run."""
        end = f"the run ends at the scenario's `until_s` ({self.until_s:g} s)"
        for name, time_s in times_s.items():
            begins = name in ("at_s", "from_s")
            if time_s is not None and (time_s > self.until_s or (begins and time_s == self.until_s)):
                text = f"`{name}` ({time_s:g} s) is too late, because {end}; change one of the two times"
                yield where, f"{what}: {text}"
                return

    def selected(self, sysids: Collection[int] | None) -> list[VehicleSpec]:
        """Return the vehicles with these system ids, on any link; None selects all vehicles."""
        return [v for v in self.vehicles if sysids is None or v.sysid in sysids]


def _mode_names(personality: str, kind: str, *, selectable: bool) -> list[str]:
    modes = personality_of(personality, kind).modes.by_number.values()
    return [mode.name for mode in modes if mode.selectable or not selectable]


def _mode_problem(alternatives: str, available: Mapping[tuple[str, str], Sequence[str]]) -> str:
    """Return the problem with a mode or with alternatives (`RTL|Return`), or an empty text."""
    wanted = alternatives.split("|")
    known = [name for names in available.values() for name in names]
    for word in wanted:
        if word.casefold() not in {name.casefold() for name in known}:
            return f"no selected vehicle has a mode {word!r}; {remedy(word, known, 'modes')}"
    for (personality, kind), names in available.items():
        if not {name.casefold() for name in names} & {word.casefold() for word in wanted}:
            return (
                f"a {personality} {kind} has no mode {alternatives!r}; its modes are {', '.join(names)} "
                "(with alternatives: `RTL|Return`)"
            )
    return ""


def _missing_for_step(step: ScriptStep, vehicle: VehicleSpec) -> str:
    personality = personality_of(vehicle.personality, vehicle.kind)
    if step.chosen in ("fly_mission", "upload_mission") and not vehicle.mission:
        return "has no `mission`"
    if step.chosen == "upload_fence" and not vehicle.fence:
        return "has no `fence`"
    unknown = sorted(set(step.param or ()) - set(personality.parameters.defaults))
    return f"has no parameters {', '.join(unknown)}" if unknown else ""
