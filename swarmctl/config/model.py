"""The configuration: what a YAML file may say, and every error in it at once.

Keys carry their units. `load` reads a file into a frozen `Config`; `ConfigError` lists what is wrong with
file, line and cure. What the values mean together (a goal inside the area, a start that can enter it) is
judged by `swarmctl.config.checks`, whose problems are reported the same way.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from swarmctl.bus.keys import SWARM_NAME
from swarmctl.config import yaml_lines
from swarmctl.config.arrival import ArrivalSection
from swarmctl.config.communication import Communication
from swarmctl.config.count import Count
from swarmctl.config.failsafes import Rules
from swarmctl.config.links import Links
from swarmctl.config.preflight import PreflightSection
from swarmctl.config.separation import SeparationSection
from swarmctl.config.vehicles import Simulate, Vehicle
from swarmctl.config.wings import WingsSection
from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.grid import Cell
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.section import Section as _Section
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import PLANNERS, method


def _planner(name: str) -> str:
    if name not in PLANNERS:
        raise ValueError(f"no planner of this name; there is {', '.join(sorted(PLANNERS))}")
    return name


class Area(_Section):
    """The square cells over which threats hide."""

    origin_lat_deg: float = Field(ge=-89.0, le=89.0, description="latitude of the south-west corner [deg]")
    origin_lon_deg: float = Field(ge=-180.0, le=180.0, description="longitude of the south-west corner [deg]")
    rows: int = Field(ge=1, le=10_000, description="cells from south to north; row 0 is the southernmost")
    cols: int = Field(ge=1, le=10_000, description="cells from west to east")
    cell_size_m: float = Field(gt=0.0, description="side of a cell [m]")
    no_fly: tuple[Cell, ...] = Field((), description="cells [row, col] that no route may enter")


class Strength(_Section):
    """Eq. 1: the chance that a hostile hits a vehicle, by where the vehicle is."""

    direct: float = Field(description="over the hostile's own cell")
    first_neighbour: float = Field(description="over one of the 4 nearest cells")
    second_neighbour: float = Field(description="over one of the 4 diagonal cells")

    def model_post_init(self, _context: object) -> None:
        FiringStrength(self.direct, self.first_neighbour, self.second_neighbour)


class Threats(_Section):
    """What hides in the area. `hostiles` is the truth: only the simulated sensor and the simulator see it."""

    count: Count = Field(
        description="how many hostiles the UAVs are told there are (n_HA): a number, or a prior over it"
    )
    firing_strength: Strength = Strength(direct=0.6, first_neighbour=0.3, second_neighbour=0.1)
    hostiles: Literal["random"] | tuple[Cell, ...] = Field(
        "random", description="true cells [row, col], or random: as many as `count` says, drawn from the seed"
    )


class Sensor(_Section):
    """What one look at a cell gets wrong. Beliefs reckon with it, and simulated sensors err by it."""

    source: Literal["simulated", "external", "both"] = Field(
        "both",
        description="of looks: simulated (the 3 × 3 cells below a vehicle), external (only what payloads "
        "report over the bus, and people by `swarmctl observe`), or both",
    )
    p_miss: float = Field(0.0, ge=0.0, lt=1.0, description="chance that a hostile is not seen")
    p_false_alarm: float = Field(
        0.0, ge=0.0, lt=1.0, description="chance that one is seen where there is none"
    )

    def model_post_init(self, _context: object) -> None:
        SensorModel(self.p_miss, self.p_false_alarm)


class PlannerSection(_Section):
    """How routes are chosen."""

    name: Annotated[str, AfterValidator(_planner)] = "dijkstra"
    w: float = Field(0.5, ge=0.0, le=1.0, description="0: the shortest route, 1: the least exposed (Eq. 5)")
    psi_per_cell: float | None = Field(
        None, gt=0.0, description="what a cell's length costs; default: the prior P_s of an inner cell"
    )
    max_exposure: float | None = Field(
        None, gt=0.0, description="cells whose P_s exceeds this are not entered; default: none is too exposed"
    )
    options: dict[str, Any] = Field({}, description="what else the planner lets one choose, by its name")

    @field_validator("options")
    @classmethod
    def _known_to_the_planner(cls, options: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if (name := info.data.get("name")) is not None:
            method(name, PLANNERS[name], options)
        return options


class FlightSection(_Section):
    """How vehicles fly, and what becomes of them."""

    altitude_m: float = Field(40.0, gt=2.0, le=1000.0, description="of the first vehicle, above home [m]")
    altitude_step_m: float = Field(5.0, ge=0.0, description="each next vehicle flies this much higher [m]")
    any_angle: bool = Field(
        False,
        description="whether routes are pulled straight where neither length nor exposure gets worse, as "
        "any_angle_exposure counts it; false: the paper's lattice route is flown unchanged",
    )
    any_angle_exposure: ExposureMeasure = Field(
        ExposureMeasure.ENTERED,
        description="what must not get worse: entered (ΣP_s over the cells entered, as strikes are drawn, "
        "and P_s along the track) or integral (P_s along the track alone: pulls more, but enters more cells, "
        "so that ΣP_s may rise and the chance of getting through fall)",
        strict=False,
    )
    on_exit: Literal["hold", "return", "land"] = Field("return", description="on Ctrl-C, after holding")
    on_exit_deadline_s: float = Field(
        300.0, gt=0.0, description="wall time given to it, until the last has landed [s]"
    )
    connect_timeout_s: float = Field(15.0, gt=0.0, description="for the first heartbeat [s]")
    ready_timeout_s: float = Field(120.0, gt=0.0, description="for a vehicle to become ready to arm [s]")
    lost_timeout_s: float = Field(
        60.0, gt=0.0, description="of silence after which the run goes on without [s]"
    )
    max_start_distance_m: float = Field(5000.0, gt=0.0, description="from a start to the area [m]")


class Config(_Section):
    """A swarm and its flight."""

    name: str = Field("swarm", pattern=SWARM_NAME, description="names the run folder and the bus")
    seed: int = Field(0, ge=0, description="of everything drawn by chance")
    area: Area
    threats: Threats
    sensor: Sensor = Sensor()
    planner: PlannerSection = PlannerSection()
    communication: Communication = Communication()
    flight: FlightSection = FlightSection()
    links: Links = Links()
    rules: Rules = Rules()
    preflight: PreflightSection = PreflightSection()
    separation: SeparationSection = SeparationSection()
    arrival: ArrivalSection | None = None
    wings: WingsSection = WingsSection()
    simulate: Simulate | None = None
    vehicles: tuple[Vehicle, ...] = ()


@dataclass(frozen=True, slots=True)
class ConfigProblem:
    """One thing that is wrong; `path` leads to it in the file."""

    path: yaml_lines.Path
    text: str
    given: yaml_lines.Path = ()
    """another value that it comes of: where that is wrong, nobody knows whether this is"""


class ConfigError(Exception):
    """What is wrong with a configuration; one line each, `file:line: key: what, what to do`."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


def load(path: Path, judge: Callable[[Config], Iterable[ConfigProblem]] = lambda _: ()) -> Config:
    """Read and check a file; `judge` adds what it finds across sections. Raises ConfigError."""
    try:
        document = yaml_lines.parse(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError([f"{path}: there is no such file; --config names a YAML file"]) from None
    except IsADirectoryError:
        raise ConfigError([f"{path}: is a folder; --config names a YAML file in it"]) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError([f"{path}: cannot be read: {error}"]) from error
    except yaml_lines.YamlError as error:
        raise ConfigError([f"{path}:{error.line}: {error.text}"]) from error
    config, problems = _validate(_tupled(document.data), judge)
    if problems or config is None:
        raise ConfigError(problem_lines(path, document, problems))
    return config


def problem_lines(path: Path, document: yaml_lines.Document, problems: Iterable[ConfigProblem]) -> list[str]:
    """A line for each problem, with where in the file it is."""
    found = sorted((document.line_of(p.path), _dotted(p.path), p.text) for p in problems)
    return [f"{path}:{line}: {key}: {text}" for line, key, text in found]


def _validate(
    data: Any, judge: Callable[[Config], Iterable[ConfigProblem]]
) -> tuple[Config | None, list[ConfigProblem]]:
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        problems = _merged(_problem(dict(e), data) for e in error.errors(include_url=False))
        return None, problems + list(_judged_rest(data, [p.path for p in problems], judge))
    return config, list(judge(config))


def _judged_rest(
    data: Any, wrong: list[yaml_lines.Path], judge: Callable[[Config], Iterable[ConfigProblem]]
) -> Iterator[ConfigProblem]:
    """Judge what is left when the wrong values are taken out, so that one round of mending is enough."""
    if not isinstance(data, dict):
        return
    vehicles = data.get("vehicles")
    kept = list(range(len(vehicles))) if isinstance(vehicles, tuple) else []
    kept = [i for i in kept if not any(_touches(("vehicles", i), w) for w in wrong)]
    rest = _without(data, wrong)
    if isinstance(vehicles, tuple) and "vehicles" in rest:
        rest["vehicles"] = tuple(vehicles[i] for i in kept)
    try:
        config = Config.model_validate(rest)
    except ValidationError:
        return
    for problem in judge(config):
        path = problem.path
        if len(path) > 1 and path[0] == "vehicles" and isinstance(path[1], int):
            path = ("vehicles", kept[path[1]], *path[2:])
        concerned = [path, problem.given] if problem.given else [path]
        if not any(_touches(key, w) for key in concerned for w in wrong):
            yield ConfigProblem(path, problem.text)


def _merged(problems: Iterable[ConfigProblem]) -> list[ConfigProblem]:
    """One problem a key: a value that fits no member of a union is wrong once, not once a member."""
    texts: dict[yaml_lines.Path, list[str]] = {}
    for problem in problems:
        texts.setdefault(problem.path, []).append(problem.text)
    return [ConfigProblem(path, "; or ".join(dict.fromkeys(several))) for path, several in texts.items()]


def _problem(error: dict[str, Any], data: Any) -> ConfigProblem:
    path = _in_file(tuple(error["loc"]), data, keep_last=error["type"] in ("missing", "extra_forbidden"))
    if error["type"] == "extra_forbidden":
        return ConfigProblem(path, _unknown_key(tuple(error["loc"])))
    text = str(error["msg"]).removeprefix("Value error, ")
    if error["type"] == "missing":
        return ConfigProblem(path, "is missing")
    if error["type"] == "model_type":
        text = "expected a section: keys with their values"
        text += "; null turns the rule off" if path[:1] == ("rules",) else ""
    found = error.get("input")
    if isinstance(found, (str, int, float, bool)) and repr(found) not in text:
        text = f"{text}, found {found!r}"
    return ConfigProblem(path, text[:1].lower() + text[1:])


def _in_file(path: yaml_lines.Path, data: Any, *, keep_last: bool) -> yaml_lines.Path:
    """The path without what no file has: pydantic names the member of a union it tried, too."""
    there: list[str | int] = []
    for i, part in enumerate(path):
        if isinstance(data, dict):
            keys = {str(key): key for key in data}
            if str(part) in keys:
                there.append(str(part))
                data = data[keys[str(part)]]
            elif keep_last and i == len(path) - 1:
                there.append(part)
        elif isinstance(data, tuple) and isinstance(part, int) and part < len(data):
            there.append(part)
            data = data[part]
    return tuple(there)


def _unknown_key(path: yaml_lines.Path) -> str:
    models: list[type[BaseModel]] = [Config]
    for part in path[:-1]:
        fields = models[0].model_fields if models else {}
        if isinstance(part, str) and part in fields:
            models = list(_models_in(fields[part].annotation))
        elif isinstance(part, str):  # the member of a union that was tried
            models = [m for m in models if m.__name__.lower() == part]
    known = sorted(models[0].model_fields) if models else []
    close = difflib.get_close_matches(str(path[-1]), known, n=1)
    hint = f"did you mean {close[0]!r}?" if close else f"there is {', '.join(known)}"
    return f"unknown key; {hint}"


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models_in(part)


def _tupled(data: Any) -> Any:
    """YAML knows lists only; types are checked strictly, so that `yes` is no number and "20" neither."""
    if isinstance(data, dict):
        return {key: _tupled(value) for key, value in data.items()}
    return tuple(map(_tupled, data)) if isinstance(data, list) else data


def _without(data: Any, paths: list[yaml_lines.Path], here: yaml_lines.Path = ()) -> Any:
    if isinstance(data, dict):
        return {k: _without(v, paths, (*here, k)) for k, v in data.items() if (*here, str(k)) not in paths}
    return data


def _touches(path: yaml_lines.Path, other: yaml_lines.Path) -> bool:
    shorter = min(len(path), len(other))
    return path[:shorter] == other[:shorter]


def _dotted(path: yaml_lines.Path) -> str:
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "(file)"
