"""A run as tables for the terminal and as JSON for programs."""

import json
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from sim_vehicle.conformance.dialects import VehicleIdentity, version_text
from sim_vehicle.conformance.outcomes import Outcome
from sim_vehicle.conformance.registry import Check
from sim_vehicle.conformance.runner import CheckResult, RunReport
from sim_vehicle.station.messages import enum_name

STYLES = {Outcome.PASSED: "green", Outcome.FAILED: "bold red", Outcome.SKIPPED: "yellow"}
NAME_WIDTH = 36


def describe_vehicle(identity: VehicleIdentity) -> str:
    """Return the identity of the vehicle in one line."""
    autopilot = enum_name("MAV_AUTOPILOT", identity.autopilot, "MAV_AUTOPILOT_")
    kind = enum_name("MAV_TYPE", identity.vehicle_type, "MAV_TYPE_")
    suffix = ", the simulator" if identity.simulator else ""
    return f"system {identity.sysid}: {autopilot} {version_text(identity.software)}, {kind}{suffix}"


def describe_counts(results: Sequence[CheckResult]) -> str:
    """Return the number of each outcome, such as `3 passed, 1 failed`."""
    counts = {outcome: sum(r.outcome is outcome for r in results) for outcome in Outcome}
    return ", ".join(f"{count} {outcome.value}" for outcome, count in counts.items() if count) or "none"


def result_tables(report: RunReport) -> Group:
    """Return the results of a run as tables by category, with counts."""
    parts: list[Any] = []
    for category, group in groupby(report.results, key=lambda result: result.check.category):
        results = list(group)
        table = _checks_table(f"{category}: {describe_counts(results)}")
        table.add_column("result", width=7)
        table.add_column("seen", ratio=1, overflow="fold")
        table.add_column("s", justify="right", width=5)
        for result in results:
            outcome = Text(result.outcome.value, style=STYLES[result.outcome])
            name, seen = result.check.name.partition(".")[2], Text(_printable(result.seen))
            table.add_row(name, outcome, seen, f"{result.took_s:.1f}")
        parts += [table, Text()]
    parts += [Text(f"note: {note}", style="yellow") for note in report.notes]
    total = f"{len(report.results)} checks, {describe_counts(report.results)}"
    return Group(*parts, Text(f"{describe_vehicle(report.identity)}: {total}"))


def _checks_table(title: str) -> Table:
    table = Table(title=title, title_justify="left", expand=True, show_edge=False)
    table.add_column("check", width=NAME_WIDTH, overflow="fold")
    return table


def _printable(text: str) -> str:
    """Replace unprintable characters by blanks, because they would disturb a terminal."""
    return "".join(character if character.isprintable() else " " for character in text)


def check_tables(checks: Sequence[Check]) -> Group:
    """Return the checks as tables by category: name, statement, conditions."""
    parts: list[Any] = []
    for category, group in groupby(checks, key=lambda check: check.category):
        found = list(group)
        table = _checks_table(f"{category}: {len(found)}")
        table.add_column("statement", ratio=1, overflow="fold")
        table.add_column("only with", width=14, overflow="fold")
        for check in found:
            conditions = [*sorted(check.needs), *check.claims, *sorted(check.dialects), check.kind]
            only_with = ", ".join(filter(None, conditions))
            table.add_row(check.name.partition(".")[2], check.summary, only_with)
        parts += [table, Text()]
    return Group(*parts, Text(f"{len(checks)} checks"))


def as_json(report: RunReport, url: str) -> str:
    """Return the run as JSON: vehicle, counts, notes, one entry for each check."""
    identity = report.identity
    return json.dumps(
        {
            "url": url,
            "vehicle": {
                "system_id": identity.sysid,
                "component_id": identity.component,
                "autopilot": identity.autopilot,
                "type": identity.vehicle_type,
                "capabilities": identity.capabilities,
                "flight_sw_version": identity.software,
                "simulator": identity.simulator,
            },
            "counts": {outcome.value: report.count(outcome) for outcome in Outcome},
            "notes": list(report.notes),
            "checks": [
                {
                    "name": result.check.name,
                    "category": result.check.category,
                    "result": result.outcome.value,
                    "seen": result.seen,
                    "took_s": round(result.took_s, 3),
                    "source": result.check.source,
                }
                for result in report.results
            ],
        },
        indent=1,
    )


def print_result(console: Console, result: CheckResult) -> None:
    """Print one result during the run."""
    outcome = Text(f"{result.outcome.value:8}", style=STYLES[result.outcome])
    console.print(
        Text.assemble(outcome, f"{result.check.name}  ", (_printable(result.seen), "dim")), soft_wrap=True
    )
