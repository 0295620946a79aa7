"""`swarmctl plan`: first routes without a flight."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.configuration import config_or_example, load_scenario_or_exit
from swarmctl.cli.console import (
    FAILED,
    USAGE,
    ConfigOrExampleOption,
    ExampleOption,
    OutOption,
    fail,
    out,
    run_folder,
    say,
    split_items,
)
from swarmctl.config.scenario import Scenario
from swarmctl.core.inference.survival import N_WORLDS
from swarmctl.core.operator_text import resolve_vehicles
from swarmctl.planners.front import MAX_LABELS
from swarmctl.report import first_plans, front, outputs
from swarmctl.report.prior_run import PriorRunError, vehicles_without_route, with_prior_run


def plan(
    config: ConfigOrExampleOption = None,
    example: ExampleOption = None,
    out_folder: OutOption = Path("runs"),
    front: Annotated[
        bool,
        typer.Option(
            "--front", help="Find all Pareto-optimal routes of length and exposure for each vehicle."
        ),
    ] = False,
    uav: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME,…",
            callback=split_items,
            help="With --front: only these vehicles (name or system id).",
            show_default=False,
        ),
    ] = None,
    max_labels: Annotated[
        int, typer.Option(min=1, help="With --front: limit on the partial routes of a vehicle's search.")
    ] = MAX_LABELS,
    known: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Plan with the observations of an earlier run over the same area."),
    ] = None,
) -> None:
    """Plan the first routes for w = 0, 0.5 and 1 without flying: a table, a map and .plan files."""
    scenario = load_scenario_or_exit(config_or_example(config, example))
    if known is not None:
        scenario = _with_prior(scenario, known)
    if front:
        _plan_front(scenario, out_folder, uav or [], max_labels)
        return
    if uav:
        fail(["--uav selects the vehicles for --front; give --front too"], USAGE)
    folder = run_folder(out_folder, f"{scenario.config.name}-plan")
    routes = first_plans.first_routes(scenario)
    outputs.write_plans(folder, scenario, routes)
    out.print(first_plans.plan_table(scenario, routes))
    out.print(
        "ΣP_s is a sum of probabilities, and ∏(1 − P_s) assumes independent cells; neither is the "
        f"probability of survival. `chance` is that probability, simulated in {N_WORLDS} worlds drawn from "
        "the belief.",
        style="bright_black",
        highlight=False,
    )
    if scenario.config.formations:
        out.print(
            "A group follows the route of its first member, which is planned for all. Every other member has "
            "a mission of its own, and flies it without the group.",
            style="bright_black",
            highlight=False,
        )
    say(f"map and missions: {folder}")


def _with_prior(scenario: Scenario, run: Path) -> Scenario:
    try:
        scenario, notes = with_prior_run(scenario, run)
    except PriorRunError as error:
        fail([str(error)], USAGE)
    for text in notes:
        say(text)
    if problems := list(vehicles_without_route(scenario)):
        fail(problems, FAILED)
    return scenario


def _plan_front(scenario: Scenario, out_folder: Path, uavs: list[str], max_labels: int) -> None:
    names = {spec.sysid: spec.name for spec in scenario.specs}
    try:
        selected = resolve_vehicles(uavs, names) if uavs else list(names)
    except ValueError as error:
        fail([f"--uav: {error}"], USAGE)
    found = front.fronts(scenario, [names[sysid] for sysid in selected], max_labels)
    folder = run_folder(out_folder, f"{scenario.config.name}-front")
    front.write_fronts(folder, scenario, found)
    out.print(front.front_table(found))
    notes = [*front.front_notes(found), front.EXPLANATION]
    if any(task.formation is not None and task.uav in selected for task in scenario.tasks):
        notes.append("The front of a member is that of its own mission; a group's route is planned for all.")
    for text in notes:
        out.print(text, style="bright_black", highlight=False, markup=False)
    say(f"all routes, with their cells, and the picture: {folder}")
