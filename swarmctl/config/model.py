"""The schema of a configuration, and the loader that reports all errors of a file at once.

Keys carry their units. `load` reads a YAML file into a frozen `Config`; `ConfigError` lists each error with
file, line and advice. `swarmctl.config.checks` checks values against each other, such as a goal against the
area; `load` reports these problems in the same form.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import BaseModel, Field, ValidationError

from swarmctl.bus.keys import SWARM_NAME
from swarmctl.config import yaml_lines
from swarmctl.config.arrival import ArrivalSection
from swarmctl.config.failsafes import Rules
from swarmctl.config.flight import FlightSection
from swarmctl.config.formations import FormationSection
from swarmctl.config.links import Links
from swarmctl.config.planner import PlannerSection
from swarmctl.config.preflight import PreflightSection
from swarmctl.config.problems import ConfigError, ConfigProblem, problem_lines
from swarmctl.config.roster import GridArea, Roster
from swarmctl.config.separation import SeparationSection
from swarmctl.config.threats import Threats
from swarmctl.config.vehicles import Simulate, Vehicle
from swarmctl.config.wings import WingsSection
from swarmctl.config.yaml_lines import KeyPath, touches
from swarmctl.core.grid import Cell
from swarmctl.core.inference.sensor import SensorModel
from swarmctl.core.operator_text import VEHICLE_NAME, did_you_mean
from swarmctl.core.section import NameIn, Section
from swarmctl.planners import needs_machine_code
from swarmctl.sensors import SOURCES


class Area(GridArea, extra="forbid"):
    """The area with its threats, a grid of square cells."""

    no_fly: tuple[Cell, ...] = Field((), description="Cells [row, col] that no route enters. Default: none.")


class Sensor(Section):
    """Observations and their errors. Simulated sensors make these errors, and beliefs account for them."""

    source: Annotated[str, NameIn(SOURCES)] = Field(
        "both",
        description="Source of observations: simulated (the 3 × 3 cells around a vehicle), external (reports "
        "of payloads over the bus, and of operators by `swarmctl observe`), or both.",
    )
    p_miss: float = Field(
        0.0, ge=0.0, lt=1.0, description="Probability that one observation misses a hostile."
    )
    p_false_alarm: float = Field(
        0.0, ge=0.0, lt=1.0, description="Probability that one observation reports a hostile in a clear cell."
    )

    def model_post_init(self, _context: object) -> None:
        SensorModel(self.p_miss, self.p_false_alarm)


class Config(Roster, extra="forbid"):
    """A swarm and its flight."""

    seed: int = Field(0, ge=0, description="Seed of all random draws. Equal seeds give equal draws.")
    area: Area = Field(description="The area with its threats, a grid of square cells.")
    threats: Threats = Field(description="The hostiles in the area.")
    sensor: Sensor = Field(Sensor(), description="Observations and their errors.")
    planner: PlannerSection = Field(PlannerSection(), description="The choice of routes.")
    flight: FlightSection = Field(
        FlightSection(), description="Altitudes, tracks and timeouts of the flight, and its end on Ctrl-C."
    )
    links: Links = Field(Links(), description="Settings that the MAVLink links of all vehicles share.")
    rules: Rules = Field(Rules(), description="Failsafe rules of each vehicle in flight.")
    preflight: PreflightSection = Field(
        PreflightSection(), description="Checks of every vehicle before arming."
    )
    separation: SeparationSection = Field(
        SeparationSection(),
        description="The least distances between vehicles, and the reaction to conflicts.",
    )
    arrival: ArrivalSection | None = Field(
        None, description="Arrival of all vehicles at one time, or in order. Default: independent arrivals."
    )
    formations: tuple[FormationSection, ...] = Field(
        (), description="Groups that fly in a shape. Default: each vehicle flies alone."
    )
    wings: WingsSection = Field(WingsSection(), description="Performance of all fixed wings.")
    simulate: Simulate | None = Field(None, description="Simulated vehicles. Default: none.")
    vehicles: tuple[Vehicle, ...] = Field((), description="Vehicles by MAVLink URL. Default: none.")

    @property
    def vehicle_sections(self) -> list[tuple[KeyPath, Simulate | Vehicle]]:
        """The sections of vehicles with their paths: `simulate`, followed by each of `vehicles`."""
        simulated: list[tuple[KeyPath, Simulate | Vehicle]] = []
        if self.simulate is not None:
            simulated.append((("simulate",), self.simulate))
        return [*simulated, *((("vehicles", i), vehicle) for i, vehicle in enumerate(self.vehicles))]

    @property
    def needs_machine_code(self) -> bool:
        """True if a planner of this swarm needs machine code."""
        planner, n_cells = self.planner, self.area.rows * self.area.cols
        names = (planner.name, *(["formation"] if self.formations else []))
        return any(needs_machine_code(n_cells, name, planner.benevolence) for name in names)


Check = Callable[[Config], Iterable[ConfigProblem]]


def load(path: Path, check: Check = lambda _: ()) -> Config:
    """Return the configuration of a file; `check` finds problems across sections. Raises ConfigError."""
    document = read_document(path)
    config, problems = validate(document.data, check)
    if problems or config is None:
        raise ConfigError(problem_lines(path, document, problems))
    return config


def read_document(path: Path) -> yaml_lines.Document:
    """Return the data of a YAML file, with its lines. Raises ConfigError."""
    try:
        return yaml_lines.parse(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError([f"{path}: the file does not exist; give --config a YAML file"]) from None
    except IsADirectoryError:
        raise ConfigError([f"{path}: this is a folder; give --config a YAML file"]) from None
    except UnicodeDecodeError as error:
        raise ConfigError([f"{path}: this is no text in UTF-8; give --config a YAML file"]) from error
    except OSError as error:
        raise ConfigError([f"{path}: the file cannot be read: {error.strerror or error}"]) from error
    except yaml_lines.YamlError as error:
        raise ConfigError([f"{path}:{error.line}: {error.text}"]) from error


def validate(data: Any, check: Check = lambda _: ()) -> tuple[Config | None, list[ConfigProblem]]:
    """Return the configuration of a document's data, None if it is invalid, and its problems."""
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        problems = schema_problems(error, data, Config)
        return None, problems + list(_check_valid_part(data, [p.path for p in problems], check))
    return config, list(check(config))


def schema_problems(error: ValidationError, data: Any, schema: type[BaseModel]) -> list[ConfigProblem]:
    """Return the problems of a document's data that `schema` refuses, one for each key."""
    return _merged(_problem(dict(e), data, schema) for e in error.errors(include_url=False))


def _check_valid_part(data: Any, wrong: list[KeyPath], check: Check) -> Iterator[ConfigProblem]:
    """Yield problems between the valid values, so that one run reports as many problems as possible."""
    if not isinstance(data, dict):
        return
    vehicles = data.get("vehicles")
    kept = list(range(len(vehicles))) if isinstance(vehicles, tuple) else []
    kept = [i for i in kept if not any(touches(("vehicles", i), w) for w in wrong)]
    valid = _without(data, wrong)
    if isinstance(vehicles, tuple) and "vehicles" in valid:
        valid["vehicles"] = tuple(vehicles[i] for i in kept)
    try:
        config = Config.model_validate(valid)
    except ValidationError:
        return
    for problem in check(config):
        path = problem.path
        if len(path) > 1 and path[0] == "vehicles" and isinstance(path[1], int):
            path = ("vehicles", kept[path[1]], *path[2:])
        concerned = [path, problem.depends_on] if problem.depends_on else [path]
        if not any(touches(key, w) for key in concerned for w in wrong):
            yield ConfigProblem(path, problem.text)


def _merged(problems: Iterable[ConfigProblem]) -> list[ConfigProblem]:
    """Return one problem for each key: pydantic reports a wrong value once for each member of a union."""
    texts: dict[KeyPath, list[str]] = {}
    for problem in problems:
        texts.setdefault(problem.path, []).append(problem.text)
    return [ConfigProblem(path, "; or ".join(dict.fromkeys(several))) for path, several in texts.items()]


NAME_RULES = {
    SWARM_NAME: "expected up to 64 letters, digits and `_.-`, with a letter or a digit first, because the "
    "name stands in options, keys of the bus and names of files",
    VEHICLE_NAME: "expected up to 32 letters, digits and `_.-`, with a letter, a digit or `_` first, because "
    "the name stands in options and in names of files",
}
"""the rule of each pattern of a name"""


def _problem(error: dict[str, Any], data: Any, schema: type[BaseModel]) -> ConfigProblem:
    path = _in_file(tuple(error["loc"]), data, keep_last=error["type"] in ("missing", "extra_forbidden"))
    if error["type"] == "extra_forbidden":
        return ConfigProblem(path, _unknown_key(tuple(error["loc"]), schema))
    text = str(error["msg"]).removeprefix("Value error, ")
    if error["type"] == "missing":
        last = error["loc"][-1]
        text = f"expected at least {last + 1} entries" if isinstance(last, int) else "is missing; add it"
        return ConfigProblem(path, text)
    if error["type"] == "string_pattern_mismatch":
        text = NAME_RULES[error["ctx"]["pattern"]]
    if error["type"] in ("tuple_type", "list_type"):
        text = "expected a list"
    if error["type"] in ("too_short", "too_long"):
        limit = error["ctx"].get("min_length", error["ctx"].get("max_length"))
        side = "least" if error["type"] == "too_short" else "most"
        return ConfigProblem(
            path, f"expected at {side} {limit} entries, found {error['ctx']['actual_length']}"
        )
    if error["type"] == "model_type":
        text = "expected a section, keys with values"
        text += "; to turn the rule off, write null" if path[:1] == ("rules",) else ""
    found = error.get("input")
    if isinstance(found, (str, int, float, bool)) and repr(found) not in text:
        text = f"{text}, found {found!r}"
    return ConfigProblem(path, text[:1].lower() + text[1:])


def _in_file(path: KeyPath, data: Any, *, keep_last: bool) -> KeyPath:
    """Return pydantic's path without names of union members; `keep_last`: keep a last key not in `data`."""
    kept: list[str | int] = []
    for i, part in enumerate(path):
        if isinstance(data, dict):
            keys = {str(key): key for key in data}
            if str(part) in keys:
                kept.append(str(part))
                data = data[keys[str(part)]]
            elif keep_last and i == len(path) - 1:
                kept.append(part)
        elif isinstance(data, tuple) and isinstance(part, int) and part < len(data):
            kept.append(part)
            data = data[part]
    return tuple(kept)


def _unknown_key(path: KeyPath, schema: type[BaseModel]) -> str:
    models = [schema]
    for part in path[:-1]:
        fields = models[0].model_fields if models else {}
        if isinstance(part, str) and part in fields:
            models = list(models_in(fields[part].annotation))
        elif isinstance(part, str):  # the name of a union member
            models = [m for m in models if m.__name__.lower() == part]
    known = sorted(models[0].model_fields) if models else []
    hint = did_you_mean(str(path[-1]), known) or f"the keys here are {', '.join(known)}"
    return f"unknown key; {hint}"


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the sections that the type of a key allows, including those of lists and alternatives."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_in(part)


def _without(data: Any, paths: list[KeyPath], here: KeyPath = ()) -> Any:
    if isinstance(data, dict):
        return {k: _without(v, paths, (*here, k)) for k, v in data.items() if (*here, str(k)) not in paths}
    return data
