"""Planning with what an earlier run has seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from swarmctl.agent.replan.decide import first_route
from swarmctl.config.scenario import Scenario, build
from swarmctl.core.geo import distance_m
from swarmctl.planners import Unreachable
from swarmctl.report import record

SAME_PLACE_M = 0.01


class NotKnown(ValueError):
    """A run that tells nothing about this area; one line, saying why."""


def with_known(scenario: Scenario, run: Path) -> tuple[Scenario, list[str]]:
    """The scenario with all that the vehicles of a run saw merged into its belief, and what a person should
    know of it. Raises NotKnown."""
    try:
        config, observations = record.seen(run)
    except record.RecordError as error:
        raise NotKnown(f"--known {error}") from error
    flown = build(config)
    if elsewhere := list(_elsewhere(flown, scenario)):
        raise NotKnown(f"--known {run}: it was flown over another area: {', '.join(elsewhere)}")
    prior = scenario.prior.merge(observations)
    said = [f"known: {prior.n_observed} cells, {prior.n_found} hostiles in them, from {run}"]
    if flown.hostiles != scenario.hostiles:
        said.append("the hostiles lay elsewhere in that run (another seed, or another list of them)")
    if flown.prior.sensor != scenario.prior.sensor:
        said.append("its sensors were configured otherwise; what it saw is read as by those of this one")
    if prior.announced_too_low:
        said.append(f"more hostiles were found than announced ({prior.count}): threats.count is too low")
    return replace(scenario, prior=prior), said


def without_a_way(scenario: Scenario) -> Iterator[str]:
    """The vehicles for which what is known leaves no route, and why."""
    for task in scenario.tasks:
        try:
            first_route(task, scenario.prior)
        except Unreachable as error:
            yield f"{task.name}: with what is known {error}"


def _elsewhere(flown: Scenario, planned: Scenario) -> Iterator[str]:
    there, here = flown.grid, planned.grid
    for what in ("rows", "cols", "cell_size_m"):
        if getattr(there, what) != getattr(here, what):
            yield f"{what} {getattr(there, what):g}, here {getattr(here, what):g}"
    origins = (there.origin_lat_deg, there.origin_lon_deg), (here.origin_lat_deg, here.origin_lon_deg)
    if (metres := distance_m(*origins)) > SAME_PLACE_M:
        yield f"its south-west corner lies {metres:.0f} m from the one here"
