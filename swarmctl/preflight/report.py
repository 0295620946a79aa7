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
    """Return a table with a row for each vehicle and a column for each check."""
    grid = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 1, 0, 0))
    grid.add_column("vehicle", no_wrap=True)
    for check in CHECKS:
        grid.add_column(check.NAME, no_wrap=True)
    for name, findings in checked.items():
        verdicts = {found.check: found for found in findings}
        grid.add_row(name, *(_verdict(verdicts.get(check.NAME)) for check in CHECKS))
    return grid


def _verdict(found: CheckResult | None) -> Text:
    if found is None:
        return _FAILS
    if found.waived:
        return _WAIVED
    if found.set_by_fly:
        return _SET_BY_FLY
    return _PASSES if found.finding.ok else _FAILS


def failures(checked: Mapping[str, Sequence[CheckResult]]) -> Table:
    """Return a table of all failures, including the waived ones: found, wanted, what to do."""
    grid = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for title in ("vehicle", "check"):
        grid.add_column(title, no_wrap=True)
    for title in ("found", "wanted", "what to do"):
        grid.add_column(title, overflow="fold")
    for findings in checked.values():
        for found in findings:
            if not found.finding.ok:
                finding = found.finding
                cure = "waived by the operator" if found.waived else found.set_by_fly or finding.cure
                grid.add_row(
                    *(Text(t) for t in (found.vehicle, found.check, finding.found, finding.wanted, cure))
                )
    return grid
