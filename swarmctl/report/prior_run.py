"""A prior from the observations of an earlier run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from swarmctl.agent.replan.decide import first_route
from swarmctl.config.scenario import Scenario, build
from swarmctl.core.geo import distance_m
from swarmctl.core.records import replace
from swarmctl.planners import Unreachable
from swarmctl.report import record, record_file

MAX_ORIGIN_DISTANCE_M = 0.01


class PriorRunError(ValueError):
    """A run that cannot serve as a prior for this area; one line gives the reason."""


def with_prior_run(scenario: Scenario, run: Path) -> tuple[Scenario, list[str]]:
    """Return the scenario with a run's observations merged into its prior, and notes for the operator.

    Raises PriorRunError.
    """
    try:
        config, observations = record.recorded_observations(run)
    except record_file.RecordError as error:
        raise PriorRunError(f"--known {error}") from error
    earlier = build(config)
    if differences := list(_area_differences(earlier, scenario)):
        text = f"--known {run}: flown over another area: {', '.join(differences)}; give a run over this area"
        raise PriorRunError(f"{text} [other-area]")
    prior = scenario.prior.merge(observations)
    lines = [f"prior: {prior.n_observed} cells with {prior.n_found} hostiles, from {run}"]
    if earlier.hostiles != scenario.hostiles:
        lines.append(
            "the earlier run had hostiles in other cells (another seed, or another list); its observations "
            "are used, but may be wrong in this configuration [other-hostiles]"
        )
    if earlier.prior.sensor != scenario.prior.sensor:
        lines.append(
            "the earlier run had another sensor model; its observations are evaluated with the sensor model "
            "of this configuration [other-sensor]"
        )
    if prior.announced_too_low:
        lines.append(
            f"more hostiles were found than announced ({prior.count}); raise threats.count [count-too-low]"
        )
    return replace(scenario, prior=prior), lines


def vehicles_without_route(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each vehicle that has no route with this prior."""
    for task in scenario.tasks:
        try:
            first_route(task, scenario.prior)
        except Unreachable as error:
            yield f"{task.name}: with this prior {error}"


def _area_differences(earlier: Scenario, scenario: Scenario) -> Iterator[str]:
    old, new = earlier.grid, scenario.grid
    for name in ("rows", "cols", "cell_size_m"):
        if getattr(old, name) != getattr(new, name):
            yield f"{name} {getattr(old, name):g}, now {getattr(new, name):g}"
    origins = (old.origin_lat_deg, old.origin_lon_deg), (new.origin_lat_deg, new.origin_lon_deg)
    if (apart_m := distance_m(*origins)) > MAX_ORIGIN_DISTANCE_M:
        yield f"the south-west corners are {apart_m:.2f} m apart"
