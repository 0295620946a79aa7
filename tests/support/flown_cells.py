"""Positions of a vehicle against the cells of the plans that it was given."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_witness import Fix
from metric_plans import most_backwards_m
from recorded import effects

from swarmctl.core.grid import Cell, Grid
from swarmctl.core.planar import distance_to_leg

NS = 1e9


@dataclass(frozen=True, slots=True)
class Flown:
    """One vehicle of a flight: the program's own account, and the distances of a witness."""

    name: str
    account: dict[str, Any]
    """the vehicle in `summary.json`"""
    off_plan: list[tuple[float, float]]
    """time, and distance from the nearest cell of a plan given so far [m], at each position in the air"""
    back_m: float
    """greatest distance flown back to the west, beyond that of the plans: the crossings here are eastward"""

    @property
    def furthest_m(self) -> float:
        return max((metres for _, metres in self.off_plan), default=0.0)

    def __str__(self) -> str:
        account, swaps = self.account, self.account["swaps"]
        return (
            f"{self.name}: {account['outcome']}{account['trouble'] and ' (' + account['trouble'] + ')'}, "
            f"strikes {account['strikes']}, changed {swaps['changed']}, failed {swaps['failed']}, "
            f"flown {account['flown_m']:.0f} m, off plan {self.furthest_m:.1f} m, back {self.back_m:.1f} m"
        )


def flown(run: Path, name: str, fixes: Sequence[Fix], grid: Grid, until_s: float = math.inf) -> Flown:
    """Return the account of one vehicle, with distances up to a time."""
    account = next(one for one in summary(run)["vehicles"] if one["name"] == name)
    plans = [(one["log_time_ns"] / NS, one["effect"]["mission"]) for one in effects(run, "SwapMission", name)]
    off_plan, east_m = [], []
    for fix in fixes:
        if fix.at_s < until_s:
            given = [plan for at_s, plan in plans if at_s <= fix.at_s]
            off_plan.append((fix.at_s, off_plan_m(fix, given, fixes[0], grid)))
            east_m.append(grid.frame.to_local(fix.lat_deg, fix.lon_deg)[0])
    planned = [[grid.centre_m((row, col))[0] for row, col in plan["cells"]] for _, plan in plans]
    back_m = most_backwards_m(east_m) - max(map(most_backwards_m, planned))
    return Flown(name, account, off_plan, max(0.0, back_m))


def summary(run: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((run / "summary.json").read_text())
    return content


def off_plan_m(fix: Fix, plans: Sequence[dict[str, Any]], start: Fix, grid: Grid) -> float:
    """Return the distance from the nearest cell of a plan, or from the leg to the first cell of a plan."""
    place = grid.frame.to_local(fix.lat_deg, fix.lon_deg)
    distances = [_from_cell_m(place, cell, grid) for plan in plans for cell in {*map(tuple, plan["cells"])}]
    for plan in (one["plan"] for one in plans):
        begins = plan["begins"] or {"lat_deg": start.lat_deg, "lon_deg": start.lon_deg}
        leg = [grid.frame.to_local(one["lat_deg"], one["lon_deg"]) for one in (begins, plan["track"][0])]
        distances.append(distance_to_leg(place, *leg))
    return min(distances)


def _from_cell_m(place: tuple[float, float], cell: Cell, grid: Grid) -> float:
    east_m, north_m = grid.centre_m(cell)
    half_m = grid.cell_size_m / 2
    east_m, north_m = abs(place[0] - east_m) - half_m, abs(place[1] - north_m) - half_m
    return float((max(east_m, 0.0) ** 2 + max(north_m, 0.0) ** 2) ** 0.5)
