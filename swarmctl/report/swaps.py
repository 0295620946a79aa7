"""How the changes of missions in flight went, for the summary and for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmctl.core import events as ev


@dataclass(slots=True)
class Swaps:
    """Of one vehicle; times by its own clock."""

    changed: int = 0
    failed: int = 0
    stood: int = 0
    """of all, for which it held or stood still"""
    stood_still_s: float = 0.0
    longest_s: float = 0.0
    took_s: tuple[float, ...] = ()
    """until it flew the new plan, of those that did"""

    def ended(self, event: ev.MissionAccepted | ev.MissionFailed) -> None:
        """One in flight."""
        if isinstance(event, ev.MissionFailed):
            self.failed += 1
        else:
            self.changed += 1
            self.took_s += () if event.took_s is None else (event.took_s,)
        self.stood += event.stood_still_s > 0.0
        self.stood_still_s += event.stood_still_s
        self.longest_s = max(self.longest_s, event.stood_still_s)

    def summary(self) -> dict[str, Any]:
        """For `summary.json`."""
        took_s = None
        if self.took_s:
            p50, top = np.quantile(self.took_s, (0.5, 1.0))
            took_s = {"p50": float(p50), "max": float(top)}
        return {
            "changed": self.changed,
            "failed": self.failed,
            "stood_still": self.stood,
            "stood_still_s": self.stood_still_s,
            "longest_stood_still_s": self.longest_s,
            "took_s": took_s,
        }


def swap_lines(vehicles: Sequence[dict[str, Any]]) -> list[str]:
    """What is to be said of it below the table: all together, and who stood still."""
    all_of = [(v["name"], v["swaps"]) for v in vehicles]
    tried = sum(swaps["changed"] + swaps["failed"] for _, swaps in all_of)
    if not tried:
        return []
    failed = sum(swaps["failed"] for _, swaps in all_of)
    stood = [(name, swaps) for name, swaps in all_of if swaps["stood_still"]]
    text = f"{tried} changes of missions in flight" + (f", {failed} failed" if failed else "")
    if not stood:
        return [f"{text}: no vehicle stood still for one"]
    return [
        f"{text}; stood still for them:",
        *(
            f"  {name}: {swaps['stood_still_s']:.1f} s in {swaps['stood_still']} of "
            f"{swaps['changed'] + swaps['failed']}, {swaps['longest_stood_still_s']:.1f} s at most"
            for name, swaps in stood
        ),
    ]
