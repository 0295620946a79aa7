"""The results of a flight as a table, from the content of `summary.json`."""

from __future__ import annotations

from typing import Any

from rich.text import Text

from swarmctl.core.inference.survival import ProbabilityEstimate
from swarmctl.report.swaps import swap_lines
from swarmctl.report.tables import Column, FittedTable, estimate_texts, product_text

OUTCOME_WIDTH = 16
BOUND = Column("over goal /\nbound [s]")
LEGEND = (
    "ΣP_s and ∏(1−P_s) are over the cells entered, by the belief in flight.\n"
    "Both chances are for a flight without a strike."
)


def flight_table(summary: dict[str, Any]) -> FittedTable:
    """Return a table with a row for each vehicle, and lines about the swarm below."""
    vehicles = summary["vehicles"]
    has_bounds = any(vehicle["arrival_bound_kept"] is not None for vehicle in vehicles)
    columns = (
        Column("vehicle", "left"), Column("flown\n[m]"), Column("time\n[s]"), *[BOUND] * has_bounds,
        Column("ΣP_s", rank=3), Column("∏\n(1−P_s)", rank=4), Column("chance at\ntake-off"),
        Column("95 %\ninterval", rank=6), Column("by true\nhostiles", rank=2), Column("strikes"),
        Column("replans", rank=1), Column("messages\nsent", rank=5),
        Column("outcome", "left", wraps_at=OUTCOME_WIDTH),
    )  # fmt: skip
    table = FittedTable(columns, caption=[LEGEND, *swarm_lines(summary)], elsewhere="summary.json")
    for vehicle in vehicles:
        time_s = "–" if vehicle["flight_time_s"] is None else f"{vehicle['flight_time_s']:.0f}"
        true_chance = vehicle["chance_among_true_hostiles"]
        table.add_row(
            vehicle["name"],
            f"{vehicle['flown_m']:.0f}",
            time_s,
            *([_arrival_text(vehicle)] if has_bounds else []),
            f"{vehicle['exposure_sum_at_decisions']:.3f}",
            product_text(vehicle["safety_factor_at_decisions"]),
            *_chance(vehicle["at_takeoff"]),
            "–" if true_chance is None else f"{true_chance:.3f}",
            str(vehicle["strikes"]),
            str(vehicle["replans"]),
            str(vehicle["messages_sent"]),
            vehicle["outcome"],
        )
    return table


def swarm_lines(summary: dict[str, Any]) -> list[str]:
    """Return lines about mission changes, arrival, separation and groups of the swarm."""
    separation, arrival, lines = summary["separation"], summary["arrival"], swap_lines(summary["vehicles"])
    if arrival is not None and arrival["spread_s"] is not None:
        how = "kept" if arrival["kept"] else "not kept"
        lines.append(
            f"spread at arrival: {arrival['spread_s']:.1f} s (tolerance {arrival['tolerance_s']:g} s, {how})"
        )
    if (least := separation["least_distance"]) is not None:
        one, other = least["vehicles"]
        when = "" if least["at_flight_s"] is None else f", {least['at_flight_s']:.0f} s after take-off"
        horizontal_m, vertical_m = least["horizontal_m"], least["vertical_m"]
        lines.append(
            f"least distance in the air: {least['distance_m']:.1f} m ({horizontal_m:.1f} m horizontal, "
            f"{vertical_m:.1f} m vertical),\n  {one} and {other}{when}"
        )
    for pair in separation["too_close"]:
        lines.append(f"{' and '.join(pair['vehicles'])} were too close for {pair['seconds']:.1f} s")
    first, plans = separation["first_routes"], separation["plans_in_flight"]
    if first is not None and first["predicted"]:
        lines.append(
            f"pairs of first routes too close horizontally at the same time: {first['predicted']}; separated "
            f"by height: {first['by_height']}"
        )
    if plans["predicted"]:
        lines.append(
            f"plan conflicts predicted in flight: {plans['predicted']}; {plans['by_height']} resolved by "
            f"height, {plans['by_route']} by route,\n  {plans['by_waiting']} by waiting, "
            f"{plans['ceased']} by the other vehicle, {plans['unresolved']} unresolved"
        )
    if separation["alarms"]:
        lines.append(
            f"separation alarms: {separation['alarms']}; vehicles held {separation['held']} times and "
            f"climbed {separation['climbed']} times to give way"
        )
    return [*lines, *map(_formation_line, summary["formations"])]


def _formation_line(group: dict[str, Any]) -> str:
    """Return two lines about a group: leaders, errors, changes, and vehicles that never joined."""
    members = [m for m in group["members"].values() if m["rms_error_m"]["along"] is not None]
    if not members:
        return f"group {group['name']} ({group['approach']}): no member reached its place"
    along_m, across_m = (max(m["rms_error_m"][axis] for m in members) for axis in ("along", "across"))
    led = ", ".join(f"{name} for {led_s:.0f} s" for name, led_s in group["led_s"].items()) or "nobody"
    apart = [name for name, m in group["members"].items() if not m["joins"] and name not in group["led_s"]]
    in_place_s = [m["time_in_place_s"] for name, m in group["members"].items() if name not in apart]
    never = f"; {' and '.join(apart)} never joined" if apart else ""
    return (
        f"group {group['name']} ({group['approach']}): led by {led}; members in place for "
        f"{min(in_place_s):.0f} to {max(in_place_s):.0f} s;\n  "
        f"largest RMS error {along_m:.1f} m along, {across_m:.1f} m across; "
        f"changes of leader {group['leader_changes']}, of shape {group['shape_changes']}, "
        f"splits {group['splits']}{never}"
    )


def _arrival_text(vehicle: dict[str, Any]) -> Text:
    """Return a vehicle's arrival time and time bound, in red if the bound was not kept; – without a bound."""
    if vehicle["arrival_bound_kept"] is None:
        return Text("–")
    after_s, within_s, arrived_s = vehicle["arrive_after_s"], vehicle["arrive_within_s"], vehicle["arrived_s"]
    bound = "" if within_s is None else f"{within_s:g}"
    bound = f"{after_s:g}–{bound}" if after_s > 0.0 else bound
    arrived = "–" if arrived_s is None else f"{arrived_s:.1f}"
    return Text(f"{arrived} / {bound}", style="" if vehicle["arrival_bound_kept"] else "red")


def missed_bounds(summary: dict[str, Any]) -> list[str]:
    """Return the names of the vehicles that have a time bound and did not arrive within the bound."""
    return [vehicle["name"] for vehicle in summary["vehicles"] if vehicle["arrival_bound_kept"] is False]


def network_lines(summary: dict[str, Any]) -> list[str]:
    """Return a line for each vehicle that refused messages or flagged contradictory observations."""
    names = {str(vehicle["sysid"]): vehicle["name"] for vehicle in summary["vehicles"]}
    lines = []
    for vehicle in summary["vehicles"]:
        refused, flagged = vehicle["network"]["refused"], vehicle["network"]["flagged"]
        parts = []
        if refused:
            by_reason = ", ".join(f"{why} {n}" for why, n in refused.items())
            parts.append(f"refused {sum(refused.values())} messages ({by_reason})")
        for uav, n in flagged.items():
            parts.append(f"has observations of {n} cells that {names.get(uav, f'vehicle {uav}')} contradicts")
        if parts:
            lines.append(f"{vehicle['name']} {' and '.join(parts)}")
    return lines


def _chance(at_takeoff: dict[str, Any] | None) -> tuple[str, str]:
    if at_takeoff is None:
        return "–", ""
    chance = at_takeoff["chance_by_simulation"]
    return estimate_texts(
        ProbabilityEstimate(chance["estimate"], chance["low_95"], chance["high_95"], chance["worlds"])
    )
