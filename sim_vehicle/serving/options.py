"""The conversion of command-line options into a scenario; one line for each problem."""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from sim_vehicle.faults.spec import FaultError, parse_fault
from sim_vehicle.links.url import Url, UrlError, parse_url
from sim_vehicle.personalities import PERSONALITIES, personality_of
from sim_vehicle.problems import nearest
from sim_vehicle.scenarios import Scenario, ScenarioError, Wind, default_scenario, load_scenario
from sim_vehicle.scenarios.base import Heading
from sim_vehicle.scenarios.file import Home, validated

MAX_SYSID = 250
DEFAULT_HOME = "46.0490,14.5060,300"  # Ljubljana, Slovenia
KINDS = ("copter", "plane")
Value = TypeVar("Value")
Model = TypeVar("Model", bound=BaseModel)


class OptionError(ValueError):
    """An unusable command line; the text has a line for each problem: option, value, remedy."""


class HomeOption(Home):
    """The home of `--home`, with the heading of the vehicles."""

    heading_deg: Heading = 0.0  # clockwise from north


@dataclass(frozen=True, slots=True)
class FleetOptions:
    """The options of the command line; None or empty for an absent option."""

    count: int | None = None
    home: str | None = None
    personality: str | None = None
    kind: str | None = None
    sysid: int | None = None
    seed: int | None = None
    per_port: int | None = None
    wind: str | None = None
    params: Sequence[str] = ()
    param_files: Sequence[Path] = ()
    faults: Sequence[str] = ()
    scenario: Path | None = None


def read_options(options: FleetOptions, urls: Sequence[str]) -> tuple[Scenario, list[Url], list[str]]:
    """Return scenario, URLs and notes to the operator. Raises OptionError with the problems found."""
    findings: list[str] = []
    scenario_and_notes = _try(findings, make_scenario, options)
    parsed_urls = _try(findings, parse_urls, urls)
    if scenario_and_notes is None or parsed_urls is None:
        raise OptionError("\n".join(findings))
    scenario, notes = scenario_and_notes
    return scenario, parsed_urls, notes


def make_scenario(options: FleetOptions) -> tuple[Scenario, list[str]]:
    """Return the scenario of these options and notes to the operator. Raises OptionError."""
    findings: list[str] = []
    faults = [_try(findings, parse_fault, text, "--") for text in options.faults]
    wind = None if options.wind is None else _try(findings, parse_wind, options.wind)
    params = [_try(findings, parse_param, text) for text in options.params]
    files = [_try(findings, read_param_file, path) for path in options.param_files]
    base = _try(findings, _base, options)
    if findings or base is None:
        raise OptionError("\n".join(findings))
    data = base.model_dump()
    notes: list[str] = []
    for path, given in zip(options.param_files, files, strict=True):
        ignored = _set_params(data["vehicles"], given or {})
        if ignored:
            notes.append(
                f"{path}: {len(ignored)} of {len(given or {})} parameters are not simulated and were ignored"
            )
    given = dict(filter(None, params))
    unknown = _set_params(data["vehicles"], given)
    if unknown:
        raise OptionError("\n".join(_no_such_parameter(name, data["vehicles"]) for name in unknown))
    if options.seed is not None:
        data["seed"] = options.seed
    if wind is not None:
        data["wind"] = wind.model_dump()
    data["faults"] = [*data["faults"], *(fault.model_dump() for fault in faults if fault is not None)]
    if base.script or base.checks:
        notes.append(
            f"{options.scenario}: script and checks were ignored; use `python -m sim_vehicle run` for them"
        )
    return _validated(data), notes


def _validated(data: dict[str, object]) -> Scenario:
    try:
        return validated(Scenario, data)
    except ScenarioError as error:  # a value out of range, or an unknown system id
        raise OptionError(str(error)) from error


def _try(findings: list[str], parse: Callable[..., Value], given: object, prefix: str = "") -> Value | None:
    try:
        return parse(given)
    except (OptionError, FaultError, ScenarioError, UrlError) as error:
        findings.extend(f"{prefix}{line}" for line in str(error).splitlines())
        return None


def parse_urls(texts: Iterable[str]) -> list[Url]:
    """Return the URLs. Raises OptionError for mistakes and duplicates."""
    findings: list[str] = []
    urls = [url for text in texts if (url := _try(findings, parse_url, text)) is not None]
    duplicates = sorted({str(url) for url in urls if urls.count(url) > 1})
    findings += [f"--url {url} is given more than once; remove the duplicate" for url in duplicates]
    if findings:
        raise OptionError("\n".join(findings))
    return urls


# -- vehicles ------------------------------------------------------------------------------------------


def _base(options: FleetOptions) -> Scenario:
    if options.scenario is None:
        return _counted(options)
    names = {"count": "--count", "home": "--home", "personality": "--personality", "kind": "--type"}
    names |= {"sysid": "--sysid", "per_port": "--per-port"}
    excluded = [text for name, text in names.items() if getattr(options, name) is not None]
    if excluded:
        raise OptionError(
            f"{', '.join(excluded)}: not allowed with --scenario, because the file defines the vehicles"
        )
    return load_scenario(options.scenario)


def _counted(options: FleetOptions) -> Scenario:
    personalities = parse_personality(options.personality or "ardupilot", options.count)
    count, first = len(personalities), options.sysid or 1
    most = MAX_SYSID - first + 1
    if options.sysid is not None and options.per_port is None and count > most:
        raise OptionError(
            f"--sysid {first}: the highest system id is {MAX_SYSID}, so a port carries at most {most} of "
            f"{count} vehicles; choose a lower --sysid, or more ports with --per-port {most}"
        )
    per_port = options.per_port or most
    distinct = count <= most
    if not distinct and per_port > most:
        raise OptionError(
            f"--per-port {per_port}: system ids go from {first} (--sysid) to {MAX_SYSID}; "
            f"a port carries at most {most} vehicles; use --per-port {most} or less"
        )
    kind = (options.kind or "copter").lower()
    if kind not in KINDS:
        raise OptionError(f"--type {options.kind!r}: expected {' or '.join(KINDS)}")
    home = parse_home(options.home or DEFAULT_HOME)
    data = default_scenario(count, home=(home.lat_deg, home.lon_deg, home.alt_amsl_m)).model_dump()
    for i, vehicle in enumerate(data["vehicles"]):
        vehicle["sysid"] = first + (i if distinct else i % per_port)
        vehicle["link"] = i // per_port
        vehicle["personality"] = personalities[i]
        vehicle["kind"] = kind
        vehicle["heading_deg"] = home.heading_deg
    return _validated(data)


def parse_personality(text: str, count: int | None) -> list[str]:
    """Return the personality of each vehicle from one name, or from `mixed` (alternating)."""
    given = text.lower()
    if given == "mixed":
        return list(itertools.islice(itertools.cycle(PERSONALITIES), count or len(PERSONALITIES)))
    if given not in PERSONALITIES:
        raise OptionError(f"--personality {text!r}: expected {', '.join(PERSONALITIES)} or mixed")
    return [given] * (count or 1)


def parse_home(text: str) -> HomeOption:
    """Return the home of LAT,LON,ALT[,HEADING] in degrees and metres above sea level."""
    return _section("--home", text, HomeOption, 3, f"LAT,LON,ALT[,HEADING], for example {DEFAULT_HOME}")


def parse_wind(text: str) -> Wind:
    """Return the wind of SPEED,FROM[,GUST] in m/s, degrees and m/s."""
    return _section("--wind", text, Wind, 2, "SPEED,FROM[,GUST] in m/s, degrees, m/s; for example 5,270,2")


def _section(option: str, text: str, model: type[Model], least: int, form: str) -> Model:
    """Return a model of the numbers in a text, at least `least` in the order of the model's fields."""
    numbers, names = _numbers(text), list(model.model_fields)
    if not least <= len(numbers) <= len(names):
        raise OptionError(f"{option} {text!r} is not {form}")
    try:
        return validated(model, dict(zip(names, numbers, strict=False)))
    except ScenarioError as error:
        raise OptionError("\n".join(f"{option} {line}" for line in str(error).splitlines())) from error


def _numbers(text: str) -> list[float]:
    """Return the finite numbers between commas; empty if a part is none."""
    parts = text.split(",")
    numbers = [number for part in parts if (number := _number(part)) is not None]
    return numbers if len(numbers) == len(parts) else []


# -- parameters ----------------------------------------------------------------------------------------


def parse_param(text: str) -> tuple[str, float]:
    """Return name and value of NAME=VALUE."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not name or not equals or (number := _number(value)) is None:
        raise OptionError(f"--param {text!r} is not NAME=VALUE, for example WPNAV_SPEED=800")
    return name, number


def read_param_file(path: Path) -> dict[str, float]:
    """Return the parameters of a file with `NAME VALUE`, `NAME,VALUE`, `NAME=VALUE` or QGC's five columns."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise OptionError(f"--param-file {path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise OptionError(f"--param-file {path}: the file is not UTF-8 text; save it as UTF-8") from error
    found: dict[str, float] = {}
    findings: list[str] = []
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").replace("=", " ").split()
        if not words:
            continue
        if len(words) == 5 and words[0].isdecimal() and words[1].isdecimal():
            words = words[2:4]
        value = _number(words[1]) if len(words) == 2 else None
        if value is None:
            findings.append(f"--param-file {path}:{number}: {line.strip()!r:.60} is not `NAME VALUE`")
        else:
            found[words[0]] = value
    if findings:
        raise OptionError("\n".join(findings))
    return found


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _set_params(vehicles: list[dict[str, object]], given: Mapping[str, float]) -> list[str]:
    """Set each parameter on the vehicles with this parameter; return the names without a vehicle."""
    unknown = dict.fromkeys(given)
    for vehicle in vehicles:
        known = personality_of(str(vehicle["personality"]), str(vehicle["kind"])).parameters.defaults
        supported = {name: value for name, value in given.items() if name in known}
        params = vehicle["params"]
        assert isinstance(params, dict)
        params.update(supported)
        for name in supported:
            unknown.pop(name, None)
    return list(unknown)


def _no_such_parameter(name: str, vehicles: list[dict[str, object]]) -> str:
    known = {
        parameter
        for kind in {(str(v["personality"]), str(v["kind"])) for v in vehicles}
        for parameter in personality_of(*kind).parameters.defaults
    }
    near = nearest(name, known)
    cure = f"did you mean {near}?" if near else "a ground station lists all parameters"
    return f"--param {name}: no vehicle of this fleet has this parameter; {cure} [unknown-parameter]"
