"""Results of the checks: one for each vehicle and check. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from swarmctl.preflight.facts import Finding


class CheckResult(msgspec.Struct, frozen=True):
    """The result of one check of one vehicle."""

    vehicle: str
    check: str
    waivable: bool
    finding: Finding
    waived: bool = False
    """True if the check failed and an operator waived the failure"""

    @property
    def passes(self) -> bool:
        return self.finding.ok or self.waived or self.finding.set_by_fly

    def __str__(self) -> str:
        finding = self.finding
        waive = f" (or --waive {self.check}:{self.vehicle})" if self.waivable else ""
        return (
            f"{self.vehicle}: {self.check}: found {finding.found}; wanted {finding.wanted}; "
            f"{finding.remedy}{waive}"
        )


def summary_of(checked: Mapping[str, Sequence[CheckResult]]) -> list[dict[str, Any]]:
    """Return all results for `summary.json`."""
    return [
        {
            "vehicle": result.vehicle,
            "check": result.check,
            "ok": result.finding.ok,
            "waived": result.waived,
            "found": result.finding.found,
            "wanted": result.finding.wanted,
        }
        for results in checked.values()
        for result in results
    ]
