"""The first routes of every vehicle side by side, as a table."""

from __future__ import annotations

from rich import box
from rich.table import Table
from rich.text import Text

from swarmctl.agent.replan.route_to_mission import flown_route
from swarmctl.config.scenario import Scenario
from swarmctl.planners import Unreachable
from swarmctl.report.figures import product_text
from swarmctl.report.outputs import FirstRoute


def plan_table(scenario: Scenario, routes: dict[str, tuple[FirstRoute, ...]]) -> Table:
    """What is flown for each route of `first_routes`, which is not the route itself where routes are pulled
    straight: length, exposure and chance."""
    grid = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False)
    grid.add_column("vehicle")
    for title in ("w", Text("length [m]"), "ΣP_s", "∏(1 − P_s)", "chance by simulation, 95 %"):
        grid.add_column(title, justify="right")
    for index, spec in enumerate(scenario.specs):
        for row, (name, firsts) in enumerate(routes.items()):
            grid.add_row(
                spec.name if row == 0 else "",
                name.removeprefix("w = "),
                *_numbers(scenario, firsts[index]),
                style="bold" if name == scenario.chosen_by else "",
            )
        grid.add_section()
    return grid


def _numbers(scenario: Scenario, first: FirstRoute) -> tuple[str, str, str, str]:
    task = first.task
    try:
        flown = flown_route(task, first.problem, first.route)
    except Unreachable:
        return "–", "–", "–", f"has no turns of {task.turn_radius_m:g} m"
    return (
        f"{flown.length_cells * scenario.grid.cell_size_m:.0f}",
        f"{flown.exposure_sum:.3f}",
        product_text(flown.safety_factor),
        str(scenario.survival_probability(task.uav, scenario.prior, task.strength, flown.cells)),
    )
