"""The rest of the stored mission: straight to its next waypoint, if nothing newly known is in the way."""

from __future__ import annotations

from itertools import pairwise

import pytest
from agent_stories import GRID, Story

from swarmctl.agent.replan.stored_mission import rest_of_stored
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace

BESIDE = (6, 4)
"""a cell beside the route along row 4"""


def beside_the_route(*seen: tuple[int, int, bool]) -> tuple[Story, PlannedMission]:
    """Return a vehicle beside its stored mission, with new observations, and the mission."""
    story = Story().flying()
    stored = story.state.plans.mission
    assert stored is not None
    if seen:
        story.hear(*seen)
    story.over(BESIDE)
    return story, stored


def test_the_vehicle_flies_straight_to_its_next_waypoint_and_on() -> None:
    story, stored = beside_the_route()
    rest = rest_of_stored(story.state, stored)
    assert rest is not None
    assert rest.plan.track == stored.plan.track[-len(rest.plan.track) :]
    assert rest.plan.landing == stored.plan.landing
    assert rest.plan.from_hold
    assert (rest.cells[0], rest.cells[-1]) == (BESIDE, (4, 8))
    steps = pairwise(rest.cells)
    assert all(max(abs(a - c), abs(b - d)) == 1 for (a, b), (c, d) in steps)


@pytest.mark.parametrize("is_occupied", [True, False])
def test_a_threat_newly_known_on_the_way_needs_a_new_plan(is_occupied: bool) -> None:
    story, stored = beside_the_route((5, 6, is_occupied))
    assert (rest_of_stored(story.state, stored) is None) is is_occupied


def test_a_no_fly_cell_on_the_way_needs_a_new_plan() -> None:
    story, stored = beside_the_route()
    walled = replace(story.state.task, no_fly=frozenset({(5, 6)}))
    assert rest_of_stored(replace(story.state, task=walled), stored) is None


def test_another_mission_on_the_vehicle_needs_a_new_plan() -> None:
    story, stored = beside_the_route()
    assert rest_of_stored(story.state, other_than(stored)) is None
    vehicle = replace(story.state.vehicle, other_mission=True)
    assert rest_of_stored(replace(story.state, vehicle=vehicle), stored) is None


def other_than(stored: PlannedMission) -> PlannedMission:
    """Return another mission than the one last verified on the vehicle."""
    return PlannedMission(99, stored.plan, stored.cells, (), 0.0, 0.0, 1.0, 0.0)


def test_a_vehicle_outside_of_the_area_needs_a_new_plan() -> None:
    story, stored = beside_the_route()
    lat_deg, lon_deg = GRID.frame.to_geodetic(-100.0, 0.0)
    story.over(BESIDE, lat_deg=lat_deg, lon_deg=lon_deg)
    assert rest_of_stored(story.state, stored) is None
