"""The end of a flight as a table, from the content of `summary.json`."""

from __future__ import annotations

from typing import Any

from rich.text import Text

from swarmctl.core.inference.survival import ProbabilityEstimate
from swarmctl.report.swaps import swap_lines
from swarmctl.report.tables import Column, FittedTable, estimate_texts, product_text

OUTCOME_WIDTH = 16
BOUND = Column("over goal /\nbound [s]")


def flight_table(summary: dict[str, Any]) -> FittedTable:
    """Return the flight of each vehicle as a row; lines about the swarm stand below."""
    vehicles = summary["vehicles"]
    bounded = any(v["arrival_bound_kept"] is not None for v in vehicles)
    columns = (
        Column("vehicle", "left"), Column("flown\n[m]"), Column("time\n[s]"), *[BOUND] * bounded,
        Column("ΣP_s", rank=3), Column("∏\n(1−P_s)", rank=4), Column("chance at\ntake-off"),
        Column("95 %\ninterval", rank=6), Column("by true\nhostiles", rank=2), Column("strikes"),
        Column("replans", rank=1), Column("sent", rank=5), Column("outcome", "left", wraps_at=OUTCOME_WIDTH),
    )  # fmt: skip
    table = FittedTable(columns, caption=swarm_lines(summary), elsewhere="summary.json")
    for v in vehicles:
        time_s = "–" if v["flight_time_s"] is None else f"{v['flight_time_s']:.0f}"
        true_chance = v["chance_among_true_hostiles"]
        table.add_row(
            v["name"],
            f"{v['flown_m']:.0f}",
            time_s,
            *([_over_goal(v)] if bounded else []),
            f"{v['exposure_sum_at_decisions']:.3f}",
            product_text(v["safety_factor_at_decisions"]),
            *_chance(v["at_takeoff"]),
            "–" if true_chance is None else f"{true_chance:.3f}",
            str(v["strikes"]),
            str(v["replans"]),
            str(v["messages_sent"]),
            v["outcome"],
        )
    return table


def swarm_lines(summary: dict[str, Any]) -> list[str]:
    """Return lines about mission changes, arrival and separation of the swarm."""
    separation, arrival, lines = summary["separation"], summary["arrival"], swap_lines(summary["vehicles"])
    if arrival is not None and arrival["spread_s"] is not None:
        how = "kept" if arrival["kept"] else "not kept"
        lines.append(f"spread at arrival: {arrival['spread_s']:.1f} s ({arrival['tolerance_s']:g} s {how})")
    if (least := separation["least_distance"]) is not None:
        one, other = least["vehicles"]
        when = "" if least["at_flight_s"] is None else f", {least['at_flight_s']:.0f} s after take-off"
        text = f"least distance in the air: {least['distance_m']:.1f} m, {one} and {other} "
        over, high = least["horizontal_m"], least["vertical_m"]
        lines.append(f"{text}({over:.1f} m horizontal, {high:.1f} m vertical{when})")
    for pair in separation["too_close"]:
        lines.append(f"{' and '.join(pair['vehicles'])} were too close for {pair['seconds']:.1f} s")
    first, plans = separation["first_routes"], separation["plans_in_flight"]
    if first is not None and first["predicted"]:
        lines.append(
            f"first routes that cross: {first['predicted']} pairs, {first['by_height']} of them separated "
            "by height"
        )
    if plans["predicted"]:
        lines.append(
            f"plan conflicts predicted in flight: {plans['predicted']}; resolved by height "
            f"{plans['by_height']}, by route {plans['by_route']}, by waiting {plans['by_waiting']}, by the "
            f"other vehicle {plans['ceased']}; unresolved {plans['unresolved']}"
        )
    if separation["alarms"]:
        lines.append(
            f"separation alarms: {separation['alarms']}; vehicles gave way by holding "
            f"{separation['held']} times, by "
            f"climbing {separation['climbed']} times"
        )
    return lines


def _over_goal(v: dict[str, Any]) -> Text:
    """Return a vehicle's arrival time and its bound, red where the bound was not kept."""
    if v["arrival_bound_kept"] is None:
        return Text("–")
    after_s, within_s, arrived_s = v["arrive_after_s"], v["arrive_within_s"], v["arrived_s"]
    bound = "" if within_s is None else f"{within_s:g}"
    bound = f"{after_s:g}–{bound}" if after_s > 0.0 else bound
    arrived = "–" if arrived_s is None else f"{arrived_s:.1f}"
    return Text(f"{arrived} / {bound}", style="" if v["arrival_bound_kept"] else "red")


def missed_bounds(summary: dict[str, Any]) -> list[str]:
    """Return the names of the vehicles that did not keep their time bounds."""
    return [v["name"] for v in summary["vehicles"] if v["arrival_bound_kept"] is False]


def network_lines(summary: dict[str, Any]) -> list[str]:
    """Return a line for each vehicle that refused messages, or whose observations others contradicted."""
    names = {str(v["sysid"]): v["name"] for v in summary["vehicles"]}
    lines = []
    for v in summary["vehicles"]:
        refused, flagged = v["network"]["refused"], v["network"]["flagged"]
        parts = []
        if refused:
            by_reason = ", ".join(f"{why} {n}" for why, n in refused.items())
            parts.append(f"refused {sum(refused.values())} messages ({by_reason})")
        for uav, n in flagged.items():
            parts.append(f"has observations of {n} cells that {names.get(uav, f'vehicle {uav}')} contradicts")
        if parts:
            lines.append(f"{v['name']} {' and '.join(parts)}")
    return lines


def _chance(at_takeoff: dict[str, Any] | None) -> tuple[str, str]:
    """Return the chance at take-off and its interval."""
    if at_takeoff is None:
        return "–", ""
    chance = at_takeoff["chance_by_simulation"]
    return estimate_texts(
        ProbabilityEstimate(chance["estimate"], chance["low_95"], chance["high_95"], chance["worlds"])
    )
