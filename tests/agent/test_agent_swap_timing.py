"""Stories of swaps: their times, and the splice point of the new plan."""

from __future__ import annotations

from typing import Any

import pytest
from agent_stories import GRID, MID_M, Story, orders, swaps

from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.mission_changes import MAX_FAILED_SWAPS
from swarmctl.agent.replan.swap_times import MAX_EXPECTED_S, PRIOR_S, SwapTimes
from swarmctl.core import events as ev
from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.geo import distance_m
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.threat import FiringStrength


class SwapStory(Story):
    """A flight east along row 4 at 10 m/s, from cell (4, 0) to (4, 8), with swaps of `took_s`."""

    def __init__(self, took_s: float | None = None, **changes: Any) -> None:
        super().__init__(**changes)
        self.flying()
        if took_s is not None:
            self.swaps_took(took_s)

    def points(self, swap: PlannedMission) -> list[tuple[float, float]]:
        """Return the waypoints of a plan, east and north [m]."""
        return [GRID.frame.to_local(p.lat_deg, p.lon_deg) for p in swap.plan.track]


def run_swap(story: SwapStory, took_s: float, *cells: tuple[int, int, bool], seq: int = 1) -> PlannedMission:
    """Run one swap, from an observation to its end."""
    story.hear(*cells, seq=seq)
    swap = story.swap()
    story(ev.MissionAccepted(swap.plan_id, took_s, 0.0))
    return swap


# --- the spacing of swaps


def test_swaps_are_spaced_by_their_duration_and_the_next_plan_uses_all_observations() -> None:
    story = SwapStory()
    story.at(60.0)
    run_swap(story, 4.0, (4, 4, True))
    accepted_s = story.state.vehicle.time_boot_s
    for seq, cell in enumerate(((3, 4, True), (5, 4, True)), start=2):
        story.hear(cell, seq=seq)
        assert swaps(story.tick()) == []
    story.at(70.0, time_boot_s=accepted_s + 4.0)
    assert swaps(story.tick()) == []
    story.at(80.0, time_boot_s=accepted_s + 6.0)
    second = story.swap()
    assert second.because == ((2, 0, 2), (2, 0, 3))
    assert not {(3, 4), (4, 4), (5, 4)} & set(second.cells)


def test_a_close_wall_is_avoided_at_once() -> None:
    story = SwapStory(max_exposure=0.5)
    story.at(60.0)
    first = run_swap(story, 4.0, (4, 6, True))
    near = next(cell for cell in first.cells if cell[1] == 3)
    story.hear((*near, True), seq=2)
    assert near not in story.swap().cells


def test_a_backward_clock_jump_delays_no_plan() -> None:
    story = SwapStory()
    story.at(60.0, time_boot_s=500.0)
    run_swap(story, 4.0, (4, 4, True))
    story.at(70.0, time_boot_s=3.0)
    story.hear((3, 4, True), (5, 4, True), seq=2)
    assert len(swaps(story.tick())) == 1


# --- the splice point


@pytest.mark.parametrize("took_s", [0.4, 4.0, 8.0])
def test_the_splice_point_is_ahead_of_the_vehicle_at_the_end_of_the_swap(took_s: float) -> None:
    story = SwapStory(took_s)
    story.at(30.0)
    before = story.state.plans.mission
    assert before is not None
    story.hear((4, 7, True))
    swap = story.swap()
    assert swap.plan.leaves_ahead
    turns_m = next(east_m for east_m, north_m in story.points(swap) if abs(north_m - MID_M[1]) < 0.1)
    assert turns_m >= 30.0 + 10.0 * took_s
    kept = int(turns_m // 50.0)
    assert swap.cells[: kept + 1] == before.cells[: kept + 1]
    assert all(east_m > 30.0 for east_m, _ in story.points(swap))
    assert distance_m((swap.plan.begins.lat_deg, swap.plan.begins.lon_deg), _place(30.0)) < 0.1


@pytest.mark.parametrize(("east_m", "speed_m_s"), [(-100.0, 0.0), (10.0, 10.0)])
def test_a_plan_leaves_ahead_of_a_vehicle_on_its_way_to_the_first_centre(
    east_m: float, speed_m_s: float
) -> None:
    """The vehicle takes off 100 m west of the area, and climbs there."""
    story = SwapStory(0.4)
    home = dict(zip(("home_lat_deg", "home_lon_deg"), _place(-100.0), strict=True))
    story.at(east_m, ground_speed_m_s=speed_m_s, east_m_s=speed_m_s, **home)
    story.hear((4, 5, True))
    swap = story.swap()
    assert swap.plan.leaves_ahead
    assert story.points(swap)[0] == pytest.approx(GRID.centre_m((4, 0)), abs=0.1)


def test_a_vehicle_at_a_corner_soon_after_a_swap_is_still_on_its_route() -> None:
    """The vehicle enters the plan's second cell before the plan is accepted."""
    story = SwapStory(0.4)
    story.at(20.0)
    story.hear((4, 4, True), (4, 5, True))
    swap = story.swap()
    (_, here, there) = swap.cells[:3]
    assert abs(there[0] - here[0]) == 1
    story.at(55.0)
    story.accept()
    (e0, n0), (e1, n1) = GRID.centre_m(here), GRID.centre_m(there)
    lat_deg, lon_deg = GRID.frame.to_geodetic((e0 + e1) / 2.0 + 1.0, (n0 + n1) / 2.0)
    story.at(0.0, lat_deg=lat_deg, lon_deg=lon_deg, time_boot_s=100.0)
    assert story.state.cell not in swap.cells
    story.hear((*swap.cells[-3], True), seq=2)
    assert story.swap().plan.leaves_ahead


def _place(east_m: float) -> tuple[float, float]:
    return GRID.frame.to_geodetic(east_m, MID_M[1])


@pytest.mark.parametrize("is_ahead", [True, False])
def test_corners_before_the_splice_point_are_kept_only_ahead_of_the_vehicle(is_ahead: bool) -> None:
    story = Story(entry=(0, 0), goals=((4, 8),)).launching()
    story(ev.OrderDone(ev.FlightOrder.LAUNCH))
    assert story.state.plans.mission is not None
    cells = story.state.plans.mission.cells
    _, came, corner, goes = next(turn for turn in _turns(cells) if turn[1] != turn[3])
    (east_m, north_m), (rows, cols) = GRID.centre_m(corner), came if is_ahead else goes
    way, length = (-20.0 if is_ahead else 20.0), (rows**2 + cols**2) ** 0.5
    story.swaps_took(2.5)
    lat_deg, lon_deg = GRID.frame.to_geodetic(east_m + way * cols / length, north_m + way * rows / length)
    motion = {"ground_speed_m_s": 10.0, "east_m_s": 10.0 * cols / length, "north_m_s": 10.0 * rows / length}
    home = dict(zip(("home_lat_deg", "home_lon_deg"), GRID.centre(cells[0]), strict=True))
    story.over(corner, lat_deg=lat_deg, lon_deg=lon_deg, **motion, **home)
    story.hear((*cells[-2], True))
    swap = story.swap()
    assert swap.plan.leaves_ahead
    points = [GRID.frame.to_local(p.lat_deg, p.lon_deg) for p in swap.plan.track]
    has_corner = any(abs(e - east_m) + abs(n - north_m) < 0.1 for e, n in points)
    assert has_corner is is_ahead


def _turns(cells: tuple[tuple[int, int], ...]) -> Any:
    for i, (a, here, b) in enumerate(zip(cells, cells[1:], cells[2:], strict=False), start=1):
        yield i, (here[0] - a[0], here[1] - a[1]), here, (b[0] - here[0], b[1] - here[1])


def test_a_plan_leaves_an_old_route_into_a_wall_at_once() -> None:
    story = SwapStory(8.0, max_exposure=0.5)
    story.at(80.0)
    story.hear((4, 3, True))
    swap = story.swap()
    assert not swap.plan.leaves_ahead
    assert (4, 3) not in swap.cells


def test_a_vehicle_that_arrives_before_the_end_of_a_swap_keeps_its_route() -> None:
    story = SwapStory(8.0)
    story.at(330.0)
    story.hear((4, 8, True))
    assert swaps(story.tick()) == []
    assert not story.state.plans.is_due


def test_a_splice_point_on_a_track_is_after_the_swap_and_beside_a_centre() -> None:
    story = Story(
        any_angle=ExposureMeasure.INTEGRAL,
        entry=(0, 0),
        goals=((3, 8),),
        strength=FiringStrength(0.9, 0.002, 0.001),
    ).launching()
    story(ev.OrderDone(ev.FlightOrder.LAUNCH))
    story.over((0, 0))
    flown = story.state.plans.mission
    assert flown is not None
    assert flown.track is not None
    ends = [GRID.frame.to_local(p.lat_deg, p.lon_deg) for p in flown.plan.track]
    (e0, n0), (e1, n1) = ends[-2:]
    length_m = ((e1 - e0) ** 2 + (n1 - n0) ** 2) ** 0.5
    east, north = (e1 - e0) / length_m, (n1 - n0) / length_m
    lat_deg, lon_deg = GRID.frame.to_geodetic(e0 + 100.0 * east, n0 + 100.0 * north)
    story.swaps_took(6.0)
    motion = {"ground_speed_m_s": 10.0, "east_m_s": 10.0 * east, "north_m_s": 10.0 * north}
    story.over((0, 0), lat_deg=lat_deg, lon_deg=lon_deg, **motion)
    ahead = [cell for cell in flown.track.over if cell[1] in (6, 7)]
    story.hear(*((*cell, True) for cell in ahead))
    swap = story.swap()
    assert swap.plan.leaves_ahead
    first = GRID.frame.to_local(swap.plan.track[0].lat_deg, swap.plan.track[0].lon_deg)
    along_m = (first[0] - e0) * east + (first[1] - n0) * north
    beside_m = (first[0] - e0) * north - (first[1] - n0) * east
    assert along_m >= 160.0
    assert abs(beside_m) < 0.1
    # A point beyond the centre, where the new route begins, would make the vehicle fly back.
    (centre_e, centre_n) = GRID.centre_m(swap.cells[0])
    beyond_m = (first[0] - centre_e) * east + (first[1] - centre_n) * north
    assert abs(beyond_m) <= 0.05 * GRID.cell_size_m


# --- measured durations


def test_the_worst_of_the_last_three_swaps_is_expected() -> None:
    times = SwapTimes()
    assert (times.expected_s, times.stop_s) == (PRIOR_S, None)
    for took_s, stood_s in ((9.0, 4.0), (2.0, 0.0), (1.0, 0.1), (0.5, 0.0)):
        times = times.measured(took_s, stood_s)
    assert times.expected_s == pytest.approx(1.25 * 2.0 + 0.5)
    assert times.stop_s == 0.0


def test_after_a_late_swap_twice_the_duration_is_expected_and_the_measured_one_announced() -> None:
    times = SwapTimes().measured(2.0, 0.0)
    late = times.too_late(2.2)
    assert late.expected_s == 2.0 * times.expected_s
    assert late.likely_s == 2.2
    on_time = late.measured(2.0, 0.0).measured(2.0, 0.0).measured(2.0, 0.0)
    assert on_time.expected_s == times.expected_s
    for _ in range(20):
        late = late.too_late(2.2)
    assert late.expected_s == MAX_EXPECTED_S


def test_the_upload_on_the_ground_sets_the_expected_duration_of_the_first_swap() -> None:
    story = Story()
    story(ev.Ready())
    story(ev.MissionAccepted(story.swap().plan_id, 8.0))
    assert story.state.plans.swap_times.expected_s == pytest.approx(10.5)


def test_a_late_plan_is_replaced_at_once_by_a_plan_that_turns_farther_ahead() -> None:
    story = SwapStory(0.5)
    story.at(30.0)
    story.hear((4, 7, True))
    first = story.swap()
    for _ in range(MAX_FAILED_SWAPS + 1):
        assert story.state.plans.pending is not None
        failed = ev.MissionFailed(story.state.plans.pending.plan_id, "old", "flown past", is_late=True)
        assert orders(story(failed)) == []
        again = story.tick()
        if not again:
            break  # the vehicle would be at its goal before the splice point
    assert story.state.phase is Phase.FLYING
    assert story.state.plans.mission is not None
    assert story.state.plans.swap_times.expected_s > 2.0 * PRIOR_S
    assert first.plan_id < story.state.plans.next_plan_id - 1
