"""The first routes of every vehicle, before any observation, and their table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec

from swarmctl.agent.formation.group_planner import first_method, leads_first, shape_changes
from swarmctl.agent.formation.membership import GroupRoute
from swarmctl.agent.formation.reference import Reference, window_for
from swarmctl.agent.replan.decide import first_flight, first_problem
from swarmctl.agent.replan.length_bounds import UNBOUNDED
from swarmctl.agent.replan.route_to_mission import flown_route
from swarmctl.agent.replan.time_bound import route_within_bounds
from swarmctl.agent.state import Task
from swarmctl.config.scenario import PAPER_PLANNER, Scenario
from swarmctl.core.belief import Belief
from swarmctl.core.geo import LatLon
from swarmctl.core.records import replace
from swarmctl.planners import PLANNERS, Method, Problem, Route, Unreachable
from swarmctl.report.pictures.scene import GROUP_EVERY_S
from swarmctl.report.tables import Column, FittedTable, estimate_texts, product_text

PLAN_WEIGHTS = (0.0, 0.5, 1.0)
COLUMNS = (
    Column("vehicle", "left"), Column("w"), Column("length\n[m]"), Column("ΣP_s", rank=1),
    Column("∏(1 − P_s)", rank=2), Column("chance by\nsimulation"), Column("95 %\ninterval", rank=3),
    Column("", "left", wraps_at=20),
)  # fmt: skip


class FirstRoute(msgspec.Struct, frozen=True):
    """A vehicle's route before any observation."""

    task: Task
    """the vehicle's task, with the planner, w and time bound of this route"""
    problem: Problem
    """the planner's input"""
    route: Route


def first_routes(scenario: Scenario) -> dict[str, tuple[FirstRoute, ...]]:
    """Return the routes of all vehicles before any observation.

    The keys are labels such as `w = 0.5`: one for each w of PLAN_WEIGHTS, and `scenario.chosen_by`. The
    routes of `scenario.chosen_by` are the `configured_routes`. The paper's planner gives all other routes.
    """
    paper_method = Method("dijkstra", PAPER_PLANNER, PAPER_PLANNER.Params())
    configured = _configured(scenario)
    choices = {
        w: tuple(
            replace(task, method=paper_method, arrival=UNBOUNDED, w=w, benevolence=0.0)
            for task in scenario.tasks
        )
        for w in PLAN_WEIGHTS
    }
    planner = scenario.config.planner
    if PLANNERS[planner.name].USES_W and not planner.benevolence:
        choices[planner.w] = configured
    named = {f"w = {w:g}": tasks for w, tasks in sorted(choices.items())}
    named[scenario.chosen_by] = configured
    return {name: _first_routes(tasks, scenario.prior) for name, tasks in named.items()}


def configured_routes(scenario: Scenario) -> tuple[FirstRoute, ...]:
    """Return the configured planner's routes; for the first member of a group, the group planner's."""
    return _first_routes(_configured(scenario), scenario.prior)


def _configured(scenario: Scenario) -> tuple[Task, ...]:
    return tuple(replace(task, method=first_method(task)) for task in scenario.tasks)


def _first_routes(tasks: Iterable[Task], prior: Belief) -> tuple[FirstRoute, ...]:
    return tuple(_first_route(task, prior) for task in tasks)


def _first_route(task: Task, prior: Belief) -> FirstRoute:
    problem = first_problem(task, prior)
    return FirstRoute(task, problem, route_within_bounds(task, problem))


def planned_shapes(first: FirstRoute) -> Iterator[tuple[LatLon, ...]]:
    """Yield the places of a group's members every GROUP_EVERY_S along the first member's route.

    There are none for any other vehicle. Raises Unreachable if the route has no room for its landing.
    """
    task, frame = first.task, first.task.grid.frame
    formation, method = task.formation, task.method
    if formation is None or not leads_first(task):
        return
    track = first_flight(task, first.problem, first.route).track
    points_m = tuple(frame.to_local(point.lat_deg, point.lon_deg) for point in track)
    curve, cells = Reference.over(points_m, window_for(formation.radius_m)), first.route.cells
    centres_m = [curve.locate(task.grid.centre_m(cell)) for cell in cells]
    n = len(formation.members)
    shapes = tuple(shape_changes(formation.change_m(n), method, first.problem, cells, centres_m))
    route = GroupRoute.of(task.uav, 1, points_m, shapes, formation, task.speed_m_s)
    at_m = 0.0
    while at_m < route.reference.length_m - formation.ends_before_m:
        pose = route.reference.at(at_m)
        places = formation.places(route.shape_at(at_m), n)
        yield tuple(frame.to_geodetic(*pose.at(forward_m, right_m)) for forward_m, right_m, _ in places)
        at_m, _ = route.profile.ahead(at_m, route.profile.at(at_m), GROUP_EVERY_S)


def plan_table(scenario: Scenario, routes: dict[str, tuple[FirstRoute, ...]]) -> FittedTable:
    """Return a table with one row for each route of `first_routes`.

    A row has the numbers of the track that the vehicle would fly, or – if no track of the route has turns as
    wide as the vehicle needs. The configured choice is bold.
    """
    table = FittedTable(COLUMNS)
    for index, spec in enumerate(scenario.specs):
        for row, (name, planned) in enumerate(routes.items()):
            is_chosen = name == scenario.chosen_by
            table.add_row(
                spec.name if row == 0 else "",
                name.removeprefix("w = "),
                *_numbers(scenario, planned[index], is_chosen=is_chosen),
                style="bold" if is_chosen else "",
            )
        table.end_section()
    return table


def _numbers(scenario: Scenario, first: FirstRoute, *, is_chosen: bool) -> tuple[str, ...]:
    task = first.task
    try:
        flown = flown_route(task, first.problem, first.route)
    except Unreachable:
        return "–", "–", "–", "–", "", f"no track with turns of {task.turn_radius_m:g} m"
    return (
        f"{flown.length_cells * scenario.grid.cell_size_m:.0f}",
        f"{flown.exposure_sum:.3f}",
        product_text(flown.safety_factor),
        *estimate_texts(scenario.survival_probability(task.uav, scenario.prior, task.strength, flown.cells)),
        _choice(task) if is_chosen else "",
    )


def _choice(task: Task) -> str:
    if task.formation is None:
        return "← configured"
    group = f"group {task.formation.name}"
    return f"← {group}" if leads_first(task) else f"← without {group}"
