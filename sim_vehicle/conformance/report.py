"""A run as a matrix for people and as JSON for machines."""

import json
from collections.abc import Iterable
from itertools import groupby
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from sim_vehicle.conformance.facts import Facts
from sim_vehicle.conformance.registry import Check
from sim_vehicle.conformance.runner import Outcome, Report, Result

STYLES = {Outcome.PASSED: "green", Outcome.FAILED: "bold red", Outcome.SKIPPED: "yellow"}
NAME_WIDTH = 36


def vehicle_words(facts: Facts) -> str:
    """Who was checked, in one line."""

    def name(enum: str, value: int, prefix: str) -> str:
        entry = mavlink.enums[enum].get(value)
        return entry.name.removeprefix(prefix) if entry is not None else str(value)

    version = f"{facts.software >> 24}.{facts.software >> 16 & 0xFF}.{facts.software >> 8 & 0xFF}"
    return (
        f"system {facts.sysid}: {name('MAV_AUTOPILOT', facts.autopilot, 'MAV_AUTOPILOT_')} {version}, "
        f"{name('MAV_TYPE', facts.vehicle_type, 'MAV_TYPE_')}{', the simulator' if facts.simulator else ''}"
    )


def counts_words(results: Iterable[Result]) -> str:
    """`3 passed, 1 failed`"""
    found = list(results)
    counts = {outcome: sum(r.outcome is outcome for r in found) for outcome in Outcome}
    return ", ".join(f"{count} {outcome.value}" for outcome, count in counts.items() if count) or "none"


def matrix(report: Report) -> Group:
    """The whole run, grouped by category, with counts."""
    parts: list[Any] = []
    for category, group in groupby(report.results, key=lambda result: result.check.category):
        results = list(group)
        table = Table(
            title=f"{category}: {counts_words(results)}", title_justify="left", expand=True, show_edge=False
        )
        table.add_column("check", width=NAME_WIDTH, overflow="fold")
        table.add_column("result", width=7)
        table.add_column("seen", ratio=1, overflow="fold")
        table.add_column("s", justify="right", width=5)
        for result in results:
            table.add_row(
                result.check.name.partition(".")[2],
                Text(result.outcome.value, style=STYLES[result.outcome]),
                Text(_printable(result.seen)),
                f"{result.took_s:.1f}",
            )
        parts += [table, Text()]
    parts += [Text(f"note: {note}", style="yellow") for note in report.notes]
    parts.append(
        Text(f"{vehicle_words(report.facts)}: {len(report.results)} checks, {counts_words(report.results)}")
    )
    return Group(*parts)


def _printable(text: str) -> str:
    """What a vehicle said may be anything; a terminal is spared it."""
    return "".join(character if character.isprintable() else " " for character in text)


def catalogue(checks: Iterable[Check]) -> Group:
    """Every check with what it says and needs."""
    parts: list[Any] = []
    total = 0
    for category, group in groupby(checks, key=lambda found: found.category):
        found = list(group)
        total += len(found)
        table = Table(title=f"{category}: {len(found)}", title_justify="left", expand=True, show_edge=False)
        table.add_column("check", width=NAME_WIDTH, overflow="fold")
        table.add_column("what is checked", ratio=1, overflow="fold")
        table.add_column("only with", width=14, overflow="fold")
        for entry in found:
            limits = [
                *sorted(entry.needs),
                *entry.claims,
                *sorted(entry.dialects),
                *([entry.kind] if entry.kind else []),
            ]
            table.add_row(entry.name.partition(".")[2], entry.says, ", ".join(limits))
        parts += [table, Text()]
    parts.append(Text(f"{total} checks"))
    return Group(*parts)


def as_json(report: Report, url: str) -> str:
    """The run as a JSON text: vehicle, counts, one entry a check."""
    facts = report.facts
    return json.dumps(
        {
            "url": url,
            "vehicle": {
                "system_id": facts.sysid,
                "component_id": facts.component,
                "autopilot": facts.autopilot,
                "type": facts.vehicle_type,
                "capabilities": facts.capabilities,
                "flight_sw_version": facts.software,
                "simulator": facts.simulator,
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
                    "pins": result.check.pins,
                }
                for result in report.results
            ],
        },
        indent=1,
    )


def print_result(console: Console, result: Result) -> None:
    """One line while the run goes on."""
    mark = Text(f"{result.outcome.value:8}", style=STYLES[result.outcome])
    console.print(
        Text.assemble(mark, f"{result.check.name}  ", (_printable(result.seen), "dim")), soft_wrap=True
    )
