"""Mission changes in flight, as statistics for the summary and as lines."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from swarmctl.core import events as ev

MAX_FAILURES = 20
"""greatest number of a vehicle's failed changes in the summary; the newest are listed"""
MAX_LISTED = 5
"""greatest number of failed changes below the table"""


@dataclass(slots=True)
class SwapStatistics:
    """Mission changes of one vehicle in flight."""

    changed: int = 0
    failed: int = 0
    failures: list[dict[str, Any]] = field(default_factory=list)
    """plan number and reason of up to MAX_FAILURES failed changes"""
    stood: int = 0
    """number of changes for which the vehicle held or stood still"""
    stood_still_s: float = 0.0
    longest_stood_still_s: float = 0.0
    took_s: tuple[float, ...] = ()
    """durations of the changes [s]"""

    def count(self, event: ev.MissionAccepted | ev.MissionFailed) -> None:
        if isinstance(event, ev.MissionFailed):
            self.failed += 1
            self.failures = [*self.failures, {"plan": event.plan_id, "reason": event.reason}][-MAX_FAILURES:]
        else:
            self.changed += 1
            self.took_s += () if event.took_s is None else (event.took_s,)
        self.stood += event.stood_still_s > 0.0
        self.stood_still_s += event.stood_still_s
        self.longest_stood_still_s = max(self.longest_stood_still_s, event.stood_still_s)

    def summary(self) -> dict[str, Any]:
        """Return the section of `summary.json`."""
        took_s = None
        if self.took_s:
            p50, top = np.quantile(self.took_s, (0.5, 1.0))
            took_s = {"p50": float(p50), "max": float(top)}
        return {
            "changed": self.changed,
            "failed": self.failed,
            "failures": self.failures,
            "stood_still": self.stood,
            "stood_still_s": self.stood_still_s,
            "longest_stood_still_s": self.longest_stood_still_s,
            "took_s": took_s,
        }


def swap_lines(vehicles: Sequence[dict[str, Any]]) -> list[str]:
    """Return lines: the number of changes, up to MAX_LISTED failures, vehicles that held or stood still."""
    by_name = [(v["name"], v["swaps"]) for v in vehicles]
    tried = sum(swaps["changed"] + swaps["failed"] for _, swaps in by_name)
    if not tried:
        return []
    failed = sum(swaps["failed"] for _, swaps in by_name)
    stood = [(name, swaps) for name, swaps in by_name if swaps["stood_still"]]
    failures = [(name, failure) for name, swaps in by_name for failure in swaps["failures"]]
    lines = [
        f"mission changes in flight: {tried}; {failed or 'none'} failed"
        + ("" if stood else "; no vehicle stopped for a change")
    ]
    lines += [
        f"  {name}, plan {failure['plan']}: {_without_address(failure['reason'], name)}"
        for name, failure in failures[:MAX_LISTED]
    ]
    if failed > MAX_LISTED:
        lines.append(f"  and {failed - MAX_LISTED} more: swaps.failures in summary.json")
    lines += [
        f"  {name}, changes with a stop: {swaps['stood_still']} of {swaps['changed'] + swaps['failed']}; "
        f"{swaps['stood_still_s']:.1f} s in all, {swaps['longest_stood_still_s']:.1f} s at most"
        for name, swaps in stood
    ]
    return lines


def _without_address(reason: str, name: str) -> str:
    """Return a link's reason without the leading name and address of the vehicle."""
    return re.sub(rf"^{re.escape(name)}( \(.*?\))?: ", "", reason)
