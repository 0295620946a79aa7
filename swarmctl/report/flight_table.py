"""The end of a flight as a table, from the content of `summary.json`."""

from __future__ import annotations

from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from swarmctl.core.inference.survival import ProbabilityEstimate
from swarmctl.report.figures import product_text
from swarmctl.report.swaps import swap_lines


def flight_table(summary: dict[str, Any]) -> Table:
    """What became of each vehicle."""
    grid = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 1, 0, 0))
    grid.caption, grid.caption_justify = "\n".join(swarm_lines(summary)), "left"
    grid.add_column("vehicle", no_wrap=True)
    titles = (
        "flown\n[m]", "time\n[s]", "ΣP_s", "∏\n(1−P_s)", "chance at take-off,\nsimulated, 95 %",
        "by true\nhostiles", "strikes", "re-\nplans", "sent",
    )  # fmt: skip
    vehicles = summary["vehicles"]
    bounded = any(v["arrival_bound_kept"] is not None for v in vehicles)
    for title in titles[:2] + ("over goal /\nbound [s]",) * bounded + titles[2:]:
        grid.add_column(Text(title), justify="right", no_wrap=True)
    grid.add_column("outcome", min_width=7)
    for v in vehicles:
        time_s = "–" if v["flight_time_s"] is None else f"{v['flight_time_s']:.0f}"
        true_chance = v["chance_among_true_hostiles"]
        grid.add_row(
            v["name"],
            f"{v['flown_m']:.0f}",
            time_s,
            *([_over_goal(v)] if bounded else []),
            f"{v['exposure_sum_at_decisions']:.3f}",
            product_text(v["safety_factor_at_decisions"]),
            _chance(v["at_takeoff"]),
            "–" if true_chance is None else f"{true_chance:.3f}",
            str(v["strikes"]),
            str(v["replans"]),
            str(v["messages_sent"]),
            Text(v["outcome"]),
        )
    return grid


def swarm_lines(summary: dict[str, Any]) -> list[str]:
    """What is to be said of the vehicles together, as lines."""
    separation, arrival, lines = summary["separation"], summary["arrival"], swap_lines(summary["vehicles"])
    if arrival is not None and arrival["spread_s"] is not None:
        how = "kept" if arrival["kept"] else "not kept"
        lines.append(f"spread at arrival: {arrival['spread_s']:.1f} s ({arrival['tolerance_s']:g} s {how})")
    if (least := separation["least_distance"]) is not None:
        one, other = least["vehicles"]
        when = "" if least["at_flight_s"] is None else f", {least['at_flight_s']:.0f} s after take-off"
        text = f"least distance flown: {least['distance_m']:.1f} m, {one} and {other} "
        over, high = least["horizontal_m"], least["vertical_m"]
        lines.append(f"{text}({over:.1f} m over ground, {high:.1f} m in height{when})")
    for pair in separation["too_close"]:
        lines.append(f"too close for {pair['seconds']:.1f} s: {' and '.join(pair['vehicles'])}")
    first, plans = separation["first_routes"], separation["plans_in_flight"]
    if first is not None and first["predicted"]:
        lines.append(
            f"first routes that cross over ground: {first['predicted']} pairs, {first['by_height']} of them "
            "kept apart by height"
        )
    if plans["predicted"]:
        lines.append(
            f"{plans['predicted']} conflicts of plans predicted in flight, resolved: {plans['by_height']} "
            f"by height, {plans['by_route']} by route, {plans['by_waiting']} by waiting, {plans['ceased']} "
            f"by the other; {plans['unresolved']} not"
        )
    if separation["alarms"]:
        given = f"way was given {separation['held']} times by holding, {separation['climbed']} by climbing"
        lines.append(f"{separation['alarms']} alarms of vehicles about to be too close; {given}")
    return lines


def _over_goal(v: dict[str, Any]) -> Text:
    """When a vehicle was over its goal, and when it was to be; red where it was not."""
    if v["arrival_bound_kept"] is None:
        return Text("–")
    after_s, within_s, arrived_s = v["arrive_after_s"], v["arrive_within_s"], v["arrived_s"]
    bound = "" if within_s is None else f"{within_s:g}"
    bound = f"{after_s:g}–{bound}" if after_s > 0.0 else bound
    arrived = "–" if arrived_s is None else f"{arrived_s:.1f}"
    return Text(f"{arrived} / {bound}", style="" if v["arrival_bound_kept"] else "red")


def missed_bounds(summary: dict[str, Any]) -> list[str]:
    """The vehicles that did not keep their time bounds."""
    return [v["name"] for v in summary["vehicles"] if v["arrival_bound_kept"] is False]


def network_lines(summary: dict[str, Any]) -> list[str]:
    """A line for each vehicle that did not take all it was told, or was told the contrary of what it saw."""
    names = {str(v["sysid"]): v["name"] for v in summary["vehicles"]}
    lines = []
    for v in summary["vehicles"]:
        refused, flagged = v["network"]["refused"], v["network"]["flagged"]
        parts = []
        if refused:
            by_reason = ", ".join(f"{why} {n}" for why, n in refused.items())
            parts.append(f"refused {sum(refused.values())} messages ({by_reason})")
        for uav, n in flagged.items():
            parts.append(
                f"was told by {names.get(uav, f'vehicle {uav}')} the contrary of what it saw in {n} cells"
            )
        if parts:
            lines.append(f"{v['name']} {' and '.join(parts)}")
    return lines


def _chance(at_takeoff: dict[str, Any] | None) -> str:
    if at_takeoff is None:
        return "–"
    chance = at_takeoff["chance_by_simulation"]
    return str(ProbabilityEstimate(chance["estimate"], chance["low_95"], chance["high_95"], chance["worlds"]))
