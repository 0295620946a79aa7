"""The reader of scenario files. It expands short forms and reports every problem with a line number."""

from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim_vehicle.personalities import PERSONALITIES
from sim_vehicle.physics.geodesy import LocalFrame
from sim_vehicle.problems import describe, remedy
from sim_vehicle.scenarios.base import Altitude, Latitude, Length, Longitude, Metres, Section
from sim_vehicle.scenarios.model import Finding, InconsistentScenarioError, Scenario
from sim_vehicle.scenarios.steps import ScriptStep
from sim_vehicle.scenarios.yaml_lines import Document, FileSyntaxError, KeyPath, parse

SPACING_M = 5.0  # default eastward distance between the vehicles of one entry
VEHICLES_PER_LINK = 250
POSITION_KEYS = ("lat_deg", "lon_deg", "alt_amsl_m")
Model = TypeVar("Model", bound=BaseModel)
SHORT_FORMS = ("count", "spacing_m", "east_m", "north_m")


class ScenarioError(ValueError):
    """An invalid scenario; the text has one line for each problem."""


class Home(Section):
    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Altitude = 10.0


NO_HOME = Home(lat_deg=0.0, lon_deg=0.0)


class Shorthand(BaseModel):
    """The short forms of a vehicle: `count` vehicles in a row eastward, offsets [m] from `home`."""

    model_config = ConfigDict(extra="ignore")

    count: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 1
    spacing_m: Length = SPACING_M
    east_m: Metres = 0.0
    north_m: Metres = 0.0


def load_scenario(path: Path, *, standalone: bool = False) -> Scenario:
    """Return the checked scenario of a YAML or JSON file; raise ScenarioError with all problems.

    `standalone`: True for a run without another ground station, which needs a script or checks.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{path}: the file cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: the file is not UTF-8 text") from error
    return parse_scenario(text, str(path), default_name=path.stem, standalone=standalone)


def parse_scenario(text: str, file: str, *, default_name: str = "", standalone: bool = False) -> Scenario:
    """Return the checked scenario of a file's text; `file`: its name, for the format and the messages."""
    try:
        document = parse(text, as_json=file.endswith(".json"))
    except FileSyntaxError as error:
        raise ScenarioError(f"{file}:{error.line}: {error.text}") from error
    if not isinstance(document.data, dict):
        raise ScenarioError(f"{file}:1: must be a mapping with `vehicles`, found {document.data!r:.60}")
    findings, data, sources = _expanded(document.data)
    if data.get("name", "") == "":
        data["name"] = default_name
    try:
        scenario = Scenario.model_validate(data, context={"from_file": True, "standalone": standalone})
        if not findings:
            return scenario
    except ValidationError as error:
        findings += _findings(error, sources)
    raise ScenarioError("\n".join(_lines(findings, document, file)))


def read_step(action: str, value: Any) -> ScriptStep:
    """Return one step of a script from its name and value; raise ScenarioError if the step is invalid."""
    actions = [name for name in ScriptStep.choices() if name != "heartbeat"]  # concerns all vehicles
    if action not in actions:
        raise ScenarioError(f"unknown action {action!r}; {remedy(action, actions, 'actions')}")
    return validated(ScriptStep, {action: value})


def validated(model: type[Model], data: Any) -> Model:
    """Return the model of data; raise ScenarioError with a line for each problem."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        lines = [f"{'.'.join(map(str, path))}: {text}" for path, text in _findings(error, [], model)]
        raise ScenarioError("\n".join(line.removeprefix(": ") for line in lines)) from None


def _expanded(data: dict[Any, Any]) -> tuple[list[Finding], dict[Any, Any], list[int]]:
    """Expand `home`, `count` and metres; return findings, data, and the index of each vehicle's entry.

    A default replaces an invalid short form, so that the check can continue.
    """
    findings: list[Finding] = []
    rest = {key: value for key, value in data.items() if key not in ("home", "count")}
    home = (_checked(Home, data["home"], ("home",), findings) or NO_HOME) if "home" in data else None
    if "count" in data:
        if "vehicles" in data:
            findings.append(
                (("count",), "is short for `vehicles: [{count: ...}]`; remove `count` or `vehicles`")
            )
        else:
            rest["vehicles"] = [{"count": data["count"]}]
    entries = rest.get("vehicles")
    counted = "count" in data and "vehicles" not in data
    if not isinstance(entries, list):
        return findings, rest, []
    vehicles: list[Any] = []
    sources: list[int] = []
    used: dict[int, int] = {}  # link -> last used system id; above 250 the ids continue on the next link
    for index, entry in enumerate(entries):
        where = () if counted else ("vehicles", index)
        expanded = _vehicles(entry, home, where, used, findings) if isinstance(entry, dict) else [entry]
        vehicles += expanded
        sources += [index] * len(expanded)
    return findings, {**rest, "vehicles": vehicles}, sources


def _vehicles(
    entry: dict[Any, Any], home: Home | None, where: KeyPath, used: dict[int, int], findings: list[Finding]
) -> list[dict[Any, Any]]:
    short = _checked(Shorthand, entry, where, findings) or Shorthand()
    rest = {key: value for key, value in entry.items() if key not in SHORT_FORMS}
    offsets = [key for key in ("east_m", "north_m") if key in entry]
    if "lat_deg" in entry or "lon_deg" in entry:
        if offsets:
            findings.append(
                ((*where, offsets[0]), "is an offset from `home`; remove it, or lat_deg and lon_deg")
            )
        if short.count == 1 and "sysid" in entry:
            return [rest]
        home = _checked(Home, {key: entry[key] for key in POSITION_KEYS if key in entry}, where, findings)
    elif home is None:
        findings.append(
            (where, "the position is missing; add lat_deg and lon_deg, or `home` to the scenario")
        )
    home = home or NO_HOME
    frame = LocalFrame(home.lat_deg, home.lon_deg)
    ids = _allocate_sysids(entry, short.count, used)
    return [
        {
            "alt_amsl_m": home.alt_amsl_m,
            **rest,
            **sysid_and_link,
            **dict(
                zip(
                    POSITION_KEYS,
                    frame.point_to_geodetic(short.east_m + i * short.spacing_m, short.north_m),
                    strict=False,
                )
            ),
        }
        for i, sysid_and_link in enumerate(ids)
    ]


def _allocate_sysids(entry: dict[Any, Any], count: int, used: dict[int, int]) -> list[dict[str, Any]]:
    """Return `sysid` and `link` of `count` vehicles: the next free ids, or ids from a given `sysid` on."""
    link, first = entry.get("link", 0), entry.get("sysid")
    if not isinstance(link, int) or not isinstance(first, int | None):
        return [{"sysid": first or 1}]  # the model reports the mistake
    if first is not None:
        used[link] = max(used.get(link, 0), first + count - 1)
        return [{"sysid": first + i} for i in range(count)]
    begin = used.get(link, 0)
    used[link] = begin + count
    return [
        {"sysid": n % VEHICLES_PER_LINK + 1, "link": link + n // VEHICLES_PER_LINK}
        for n in range(begin, begin + count)
    ]


def _checked(model: type[Model], data: Any, where: KeyPath, findings: list[Finding]) -> Model | None:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        findings += [((*where, *path), text) for path, text in _findings(error, [], model)]
        return None


def _findings(error: ValidationError, sources: list[int], model: type[BaseModel] = Scenario) -> list[Finding]:
    found: list[Finding] = []
    for detail in error.errors():
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, InconsistentScenarioError):
            inconsistencies = [(_in_file(path, sources), text) for path, text in cause.findings]
            found += [finding for finding in dict.fromkeys(inconsistencies) if finding not in found]
            continue
        loc = tuple(part for part in detail["loc"] if part != "kind")
        path = _in_file(loc, sources)
        for text in describe(detail, loc, model).split("\n"):
            if (path, text) not in found:
                found.append((path, text))
    return found


def _in_file(path: KeyPath, sources: list[int]) -> KeyPath:
    """Convert a path in the scenario to a path in the file, where `count` vehicles share one entry."""
    if len(path) > 1 and path[0] == "vehicles" and isinstance(path[1], int) and sources:
        return ("vehicles", sources[path[1]], *path[2:])
    return path


def _lines(findings: list[Finding], document: Document, file: str) -> list[str]:
    lines = []
    for path, text in sorted(findings, key=lambda finding: document.line_of(finding[0])):
        name = ".".join(str(part) for part in path)
        lines.append(f"{file}:{document.line_of(path)}: {f'{name}: ' if name else ''}{text}")
    return lines


def default_scenario(
    count: int,
    *,
    home: tuple[float, float, float],
    seed: int = 0,
    personality: str = "ardupilot",
    kind: str = "copter",
) -> Scenario:
    """Return a scenario of `count` vehicles in a row, eastward from home.

    home: latitude [deg], longitude [deg], altitude [m above mean sea level].
    personality: a name in PERSONALITIES, or "mixed" for all personalities in alternation.
    """
    names = tuple(PERSONALITIES) if personality == "mixed" else (personality,)
    entries = [
        {"personality": names[i % len(names)], "kind": kind, "east_m": i * SPACING_M} for i in range(count)
    ]
    place = dict(zip(POSITION_KEYS, home, strict=True))
    findings, data, _ = _expanded({"seed": seed, "home": place, "vehicles": entries})
    if findings:
        raise ScenarioError("\n".join(f"{'.'.join(map(str, path))}: {text}" for path, text in findings))
    return validated(Scenario, data)
