"""Tables of the results of preflight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from swarmctl.preflight.checks import CHECKS
from swarmctl.preflight.results import CheckResult

_PASSES, _WAIVED, _FAILS = Text("ok", "green"), Text("waived", "yellow"), Text("FAILS", "bold red")
_SET_BY_FLY = Text("fly sets", "yellow")


def overview(checked: Mapping[str, Sequence[CheckResult]]) -> Table:
    """Return a table with a row for each vehicle and a column for each check; results are in their order."""
    grid = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 1, 0, 0))
    grid.add_column("vehicle", no_wrap=True)
    for check in CHECKS:
        grid.add_column(check.NAME, no_wrap=True)
    for name, results in checked.items():
        grid.add_row(name, *map(_verdict, results))
    return grid


def _verdict(result: CheckResult) -> Text:
    if result.waived:
        return _WAIVED
    if result.finding.set_by_fly:
        return _SET_BY_FLY
    return _PASSES if result.finding.ok else _FAILS


def failures(checked: Mapping[str, Sequence[CheckResult]]) -> Table:
    """Return a table of all failures, including the waived ones: found, wanted, what to do."""
    grid = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for title in ("vehicle", "check"):
        grid.add_column(title, no_wrap=True)
    for title in ("found", "wanted", "what to do"):
        grid.add_column(title, overflow="fold")
    for results in checked.values():
        for result in results:
            finding = result.finding
            if not finding.ok:
                remedy = "waived by the operator" if result.waived else finding.remedy
                grid.add_row(
                    *(Text(t) for t in (result.vehicle, result.check, finding.found, finding.wanted, remedy))
                )
    return grid
