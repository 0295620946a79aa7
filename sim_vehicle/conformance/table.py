"""`python -m sim_vehicle conformance-table`: firmware and simulator side by side, as a page in Markdown."""

import fnmatch
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.dialects import PLANE_TYPES, version_text
from sim_vehicle.conformance.registry import CATEGORIES

UNEXPLAINED, USAGE_ERROR = 1, 2  # exit codes
# Parts of the reasons for which a skipped check never ran; such a check is no result.
NOT_ASKED = (
    "[vehicle-silent]",
    "not permitted",
    "[already-armed]",
    "[battery-low]",
    "only for the simulator",
)
NO_REASON = "**no reason is known**"
MAX_SEEN = 110  # characters of an observation
MAX_LISTED = 3  # names of checks in a row
COMPACT = "vehicles"  # the key of a file that `--compact` has written

_OF_ARDUPILOT = {
    "signing.refuses_*": "ArduPilot always accepts unsigned frames on its first serial port "
    "(`GCS_Signing.cpp`); the simulator does so on trusted links only",
    "commands.progress.can_be_cancelled": "the firmware calibrates before it acknowledges; "
    "the simulator answers IN_PROGRESS first, so that ground stations meet that answer",
}
# Why a firmware and the simulator differ: firmware -> pattern of checks, in the order of trying -> reason.
REASONS: Mapping[str, Mapping[str, str]] = {
    "ArduCopter": _OF_ARDUPILOT,
    "ArduPlane": _OF_ARDUPILOT,
    "PX4": {
        "reboot.*": "PX4 in software cannot reboot and answers DENIED (`Commander.cpp`, "
        "CONFIG_BOARDCTL_RESET); boards can, and so can the simulator",
        "flight.telemetry.battery": "the battery of PX4's SIH measures no current",
    },
}

Result = tuple[str, str]  # passed, failed or skipped; the observation


class BadResults(ValueError):
    """A file that is no result of the suite."""


@dataclass
class VehicleResults:
    """The results of one firmware, or of the simulator of the same autopilot."""

    name: str  # such as "ArduCopter"
    version: str
    simulator: bool
    results: dict[str, Result] = field(default_factory=dict)  # check -> result

    @property
    def title(self) -> str:
        return f"{self.name} {self.version}{' (simulator)' if self.simulator else ''}"


def _name(autopilot: int, vehicle_type: int) -> str:
    kind = "Plane" if vehicle_type in PLANE_TYPES else "Copter"
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        return "PX4" if kind == "Copter" else "PX4 plane"
    return f"Ardu{kind}" if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA else f"autopilot {autopilot}"


def read(paths: Iterable[Path]) -> list[VehicleResults]:
    """Return the results by vehicle; a later result of a check replaces an earlier one. Raises BadResults."""
    found: dict[tuple[str, bool], VehicleResults] = {}
    for path in paths:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            for vehicle in list(_vehicles(content)):
                key = vehicle.name, vehicle.simulator
                found.setdefault(key, vehicle).results.update(vehicle.results)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise BadResults(f"{path}: expected a result of `conformance --json`: {error!r}") from error
    return sorted(found.values(), key=lambda vehicle: (vehicle.name, vehicle.simulator))


def _vehicles(content: Any) -> Iterator[VehicleResults]:
    if COMPACT in content:
        for entry in content[COMPACT]:
            results = {c: (outcome, entry["seen"].get(c, "")) for c, outcome in entry["outcomes"].items()}
            yield VehicleResults(entry["name"], entry["version"], entry["simulator"], results)
        return
    identity = content["vehicle"]
    yield VehicleResults(
        _name(identity["autopilot"], identity["type"]),
        version_text(identity["flight_sw_version"]),
        bool(identity["simulator"]),
        {
            c["name"]: (c["result"], c["seen"])
            for c in content["checks"]
            if c["result"] != "skipped" or not any(reason in c["seen"] for reason in NOT_ASKED)
        },
    )


def compact(vehicles: Sequence[VehicleResults]) -> str:
    """Return all results as JSON: outcomes and observations by check, for each vehicle.

    The observations of passed checks, and of checks that are for other vehicles, are left out.
    """
    content = [
        {
            "name": vehicle.name,
            "version": vehicle.version,
            "simulator": vehicle.simulator,
            "outcomes": {check: outcome for check, (outcome, _) in sorted(vehicle.results.items())},
            "seen": {
                check: text
                for check, (outcome, text) in sorted(vehicle.results.items())
                if outcome != "passed" and text and not text.startswith("only for")
            },
        }
        for vehicle in vehicles
    ]
    return json.dumps({COMPACT: content}, indent=1) + "\n"


@dataclass(frozen=True, slots=True)
class _Pair:
    """One firmware and the simulator of the same autopilot."""

    firmware: VehicleResults
    simulator: VehicleResults

    def asked(self) -> list[str]:
        """Return the checks with a result of both."""
        return sorted(set(self.firmware.results) & set(self.simulator.results), key=_order)

    def differs(self, check: str) -> bool:
        return self.firmware.results[check][0] != self.simulator.results[check][0]

    def reason(self, check: str) -> str:
        found = REASONS.get(self.firmware.name, {})
        return next((why for pattern, why in found.items() if fnmatch.fnmatchcase(check, pattern)), NO_REASON)


def _order(check: str) -> tuple[int, str]:
    category = check.partition(".")[0]
    return (CATEGORIES.index(category) if category in CATEGORIES else len(CATEGORIES), check)


def pairs(vehicles: Sequence[VehicleResults]) -> list[_Pair]:
    """Pair each firmware with the simulator of the same autopilot; raise BadResults if one is missing."""
    simulators = {vehicle.name: vehicle for vehicle in vehicles if vehicle.simulator}
    firmware = [vehicle for vehicle in vehicles if not vehicle.simulator]
    if missing := [vehicle.name for vehicle in firmware if vehicle.name not in simulators]:
        raise BadResults(f"no result of the simulator as {', '.join(missing)}; run the suite on it, too")
    if not firmware:
        raise BadResults("no result of a firmware among the files")
    return [_Pair(vehicle, simulators[vehicle.name]) for vehicle in firmware]


def page(found: Sequence[_Pair]) -> str:
    """Return the page: a summary by category, then the rows that differ or failed, with reasons."""
    names = [pair.firmware.title for pair in found]
    lines = [
        "# Firmware",
        "",
        "The [conformance suite](simulator/conformance.md) asks firmware and simulator the same questions. "
        "It ran on unmodified firmware in software (SITL, SIH), with the defaults of its simulation:",
        "",
        *(f"- {name}" for name in names),
        "",
        "Frames that end ArduPilot's SITL were not sent (`--allow-crash`). "
        "Checks for the simulator only are left out. "
        "A check that depended on the load of the machine was run again.",
        "",
        "A command makes this page from recorded results:",
        "",
        "```sh",
        "python -m sim_vehicle conformance udpin:0.0.0.0:14550 --allow-arm --allow-reboot --allow-alter "
        "--json copter.json  # and so on",
        "python -m sim_vehicle conformance-table *.json --compact docs/firmware.json > docs/firmware.md",
        "```",
        "",
        "## Agreement",
        "",
        "A cell counts the checks with the same result on firmware and simulator: passed, or not applicable. "
        "The number of differing checks follows.",
        "",
        "| checks of | " + " | ".join(names) + " |",
        "|---|" + "---:|" * len(found),
        *_summary(found),
        "",
        "## Differences",
        "",
        *_differences(found),
        "",
        "## Failures of both",
        "",
        *_common_failures(found),
    ]
    return "\n".join(lines) + "\n"


def _summary(found: Sequence[_Pair]) -> Iterator[str]:
    for category in CATEGORIES:
        cells = [_cell(pair, [c for c in pair.asked() if c.startswith(f"{category}.")]) for pair in found]
        if any(cells):
            yield f"| {category} | " + " | ".join(cells) + " |"
    yield "| **all** | " + " | ".join(f"**{_cell(pair, pair.asked())}**" for pair in found) + " |"
    passed = [sum(outcome == "passed" for outcome, _ in pair.firmware.results.values()) for pair in found]
    yield "| passed on the firmware | " + " | ".join(map(str, passed)) + " |"


def _cell(pair: _Pair, checks: Sequence[str]) -> str:
    n_differ = sum(pair.differs(check) for check in checks)
    same = str(len(checks) - n_differ)
    return f"{same}, {n_differ} differ" if n_differ > 1 else f"{same}, 1 differs" if n_differ else same


def _differences(found: Sequence[_Pair]) -> Iterator[str]:
    rows = []
    for pair in found:
        groups: dict[tuple[str, str, str], list[str]] = {}
        for check in filter(pair.differs, pair.asked()):
            outcomes = pair.firmware.results[check][0], pair.simulator.results[check][0]
            groups.setdefault((*outcomes, pair.reason(check)), []).append(check)
        for (outcome, simulated, why), checks in groups.items():
            texts = {_shown(pair.firmware.results[check][1]) for check in checks}
            seen = f": {texts.pop()}" if len(texts) == 1 and texts != {""} else ""
            rows.append(
                f"| {_listed(checks)} | {pair.firmware.title} | {outcome}{seen} | {simulated} | {why} |"
            )
    head = ("| check | firmware | result | simulator | reason |", "|---|---|---|---|---|")
    yield from (*head, *rows) if rows else ("None.",)


def _common_failures(found: Sequence[_Pair]) -> Iterator[str]:
    rows = [
        f"| `{check}` | {pair.firmware.title} | {_shown(pair.firmware.results[check][1])} |"
        for pair in found
        for check in pair.asked()
        if not pair.differs(check) and pair.firmware.results[check][0] == "failed"
    ]
    yield from ("| check | firmware | seen |", "|---|---|---|", *rows) if rows else ("None.",)


def _listed(checks: Sequence[str]) -> str:
    """Return the names; more than `MAX_LISTED` checks of one category are counted."""
    categories = {check.partition(".")[0] for check in checks}
    if len(checks) > MAX_LISTED and len(categories) == 1:
        return f"{len(checks)} checks of `{categories.pop()}`"
    return ", ".join(f"`{check}`" for check in checks)


def _shown(text: str) -> str:
    clean = "".join(c if c.isprintable() and c not in "|<>" else " " for c in text)
    return clean if len(clean) <= MAX_SEEN else clean[: MAX_SEEN - 1] + "…"


def conformance_table(
    files: Annotated[list[Path], typer.Argument(help="Results of `conformance --json`, or compact results.")],
    compact_file: Annotated[
        Path | None, typer.Option("--compact", help="Also write all results to this file, in compact form.")
    ] = None,
) -> None:
    """Print a page in Markdown that compares firmware with the simulator.

    A later result of a check replaces an earlier one of the same firmware, so that checks can be run again.

    Exit codes: 0 every difference has a reason; 1 a difference has none; 2 a bad file.
    """
    try:
        vehicles = read(files)
        found = pairs(vehicles)
        if compact_file is not None:
            compact_file.write_text(compact(vehicles), encoding="utf-8")
    except (BadResults, OSError) as error:
        typer.echo(f"sim_vehicle conformance-table: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    text = page(found)
    typer.echo(text, nl=False)
    if NO_REASON in text:
        raise typer.Exit(UNEXPLAINED)
