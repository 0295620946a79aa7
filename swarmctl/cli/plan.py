"""`swarmctl plan`: first routes without flying."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.console import EXPECTED, USAGE, ConfigOption, OutOption, fail, out, run_folder, say
from swarmctl.cli.loading import scenario_of
from swarmctl.config.scenario import Scenario
from swarmctl.core.inference.chance import WORLDS
from swarmctl.core.texts import meant_by
from swarmctl.planners.front import MAX_LABELS
from swarmctl.report import first_plans, front, outputs
from swarmctl.report.prior_run import NotKnown, with_known, without_a_way


def register(cli: typer.Typer) -> None:
    cli.command()(plan)


def plan(
    config: ConfigOption,
    out_folder: OutOption = Path("runs"),
    front: Annotated[
        bool,
        typer.Option("--front", help="All routes worth flying: what each metre more saves in exposure."),
    ] = False,
    uav: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="With --front: this vehicle only; a name or system id.", show_default=False
        ),
    ] = "",
    max_labels: Annotated[
        int, typer.Option(min=1, help="With --front: partial routes that a vehicle's search may cost.")
    ] = MAX_LABELS,
    known: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Plan with what an earlier run over the area has seen."),
    ] = None,
) -> None:
    """Plan the first routes for w = 0, 0.5 and 1 without flying: a table, a map and .plan files."""
    scenario = scenario_of(config)
    if known is not None:
        scenario = _with_known(scenario, known)
    if front:
        _plan_front(scenario, out_folder, uav, max_labels)
        return
    if uav:
        fail(["--uav chooses whose front is shown; give --front too"], USAGE)
    folder = run_folder(out_folder, f"{scenario.config.name}-plan")
    routes = outputs.first_routes(scenario)
    outputs.write_plans(folder, scenario, routes)
    out.print(first_plans.plan_table(scenario, routes))
    out.print(
        "ΣP_s is a sum of chances, and ∏(1 − P_s) takes cells as independent: neither is the chance of "
        f"getting through. That is simulated, in {WORLDS} worlds drawn from what is believed.",
        style="bright_black",
        highlight=False,
    )
    out.print(f"map and missions: {folder}", highlight=False, soft_wrap=True)


def _with_known(scenario: Scenario, run: Path) -> Scenario:
    try:
        scenario, said = with_known(scenario, run)
    except NotKnown as error:
        fail([str(error)], USAGE)
    for text in said:
        say(text)
    if closed := list(without_a_way(scenario)):
        fail(closed, EXPECTED)
    return scenario


def _plan_front(scenario: Scenario, out_folder: Path, uav: str, max_labels: int) -> None:
    names = {spec.sysid: spec.name for spec in scenario.specs}
    try:
        wanted = meant_by([uav], names) if uav else list(names)
    except ValueError as error:
        fail([f"--uav {uav}: {error}"], USAGE)
    found = front.fronts(scenario, [names[sysid] for sysid in wanted], max_labels)
    folder = run_folder(out_folder, f"{scenario.config.name}-front")
    front.write_fronts(folder, scenario, found)
    out.print(front.front_table(found))
    for text in [*front.left_out(found), front.WHAT_IS_WHAT]:
        out.print(text, style="bright_black", highlight=False, markup=False, soft_wrap=True)
    out.print(f"all routes, with their cells, and the picture: {folder}", highlight=False, soft_wrap=True)
