"""The first routes of every vehicle side by side, as a table."""

from __future__ import annotations

from swarmctl.agent.replan.route_to_mission import flown_route
from swarmctl.config.scenario import Scenario
from swarmctl.planners import Unreachable
from swarmctl.report.outputs import FirstRoute
from swarmctl.report.tables import Column, FittedTable, estimate_texts, product_text

COLUMNS = (
    Column("vehicle", "left"), Column("w"), Column("length\n[m]"), Column("ΣP_s", rank=1),
    Column("∏(1 − P_s)", rank=2), Column("chance by\nsimulation"), Column("95 %\ninterval", rank=3),
    Column("", "left", wraps_at=20),
)  # fmt: skip


def plan_table(scenario: Scenario, routes: dict[str, tuple[FirstRoute, ...]]) -> FittedTable:
    """Return length, exposure and chance of what is flown for each route of `first_routes`.

    That is not the route itself where routes are pulled straight. The configured choice is bold.
    """
    table = FittedTable(COLUMNS)
    for index, spec in enumerate(scenario.specs):
        for row, (name, firsts) in enumerate(routes.items()):
            is_chosen = name == scenario.chosen_by
            table.add_row(
                spec.name if row == 0 else "",
                name.removeprefix("w = "),
                *_numbers(scenario, firsts[index], is_chosen=is_chosen),
                style="bold" if is_chosen else "",
            )
        table.end_section()
    return table


def _numbers(scenario: Scenario, first: FirstRoute, *, is_chosen: bool) -> tuple[str, ...]:
    task = first.task
    try:
        flown = flown_route(task, first.problem, first.route)
    except Unreachable:
        return "–", "–", "–", "–", "", f"no turns of {task.turn_radius_m:g} m"
    return (
        f"{flown.length_cells * scenario.grid.cell_size_m:.0f}",
        f"{flown.exposure_sum:.3f}",
        product_text(flown.safety_factor),
        *estimate_texts(scenario.survival_probability(task.uav, scenario.prior, task.strength, flown.cells)),
        "← configured" if is_chosen else "",
    )
