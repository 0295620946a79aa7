"""Swaps over a link with one second of delay each way: the vehicle flies on, and never back."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count, pairwise
from typing import Any

import pytest
from flying_bench import BOTH, FlyingBench
from metric_plans import most_backwards_m, place, plan
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import FlightPlan
from swarmctl.core.planar import PlanarPoint, distance_to_leg, distance_to_track
from swarmctl.mavlink.procedures import basic

SET_CURRENT = int(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT)
DELAY_S = 1.0
BACK_M = 1.0
"""Accuracy of the reported and flown positions [m]."""
TURNS_WITHIN_M = 8.0
"""Greatest distance from the route in a corner of 90 degrees [m]."""


def corners(east_m: float, *norths_m: float) -> list[PlanarPoint]:
    return [(east_m, north_m) for north_m in norths_m]


OLD = corners(0.0, 80.0, 160.0, 700.0)
"""A straight route to the north; the vehicle flies to the second waypoint first."""


def progress_m(way: list[PlanarPoint], at: PlanarPoint, since_m: float) -> float:
    """Return the distance along a route of the point nearest to `at`, within 100 m of `since_m` [m]."""
    best, along_m = (math.inf, since_m), 0.0
    for a, b in pairwise(way):
        leg_m = math.dist(a, b)
        share = ((at[0] - a[0]) * (b[0] - a[0]) + (at[1] - a[1]) * (b[1] - a[1])) / leg_m**2
        here_m = along_m + min(max(share, 0.0), 1.0) * leg_m
        if abs(here_m - since_m) < 100.0:
            best = min(best, (distance_to_leg(at, a, b), here_m))
        along_m += leg_m
    return best[1]


def swapped(bench: FlyingBench, new: FlightPlan, way: list[PlanarPoint]) -> tuple[basic.Swapped, float]:
    """Return the swap's result and the longest way back along `way` until the landing [m]."""
    farthest_m, back_m = 0.0, 0.0
    result = None
    bench.begin_swap(new)

    def watch() -> bool:
        nonlocal farthest_m, back_m, result
        here_m = progress_m(way, place(bench), farthest_m)
        back_m = max(back_m, farthest_m - here_m)
        farthest_m = max(farthest_m, here_m)
        if result is None and bench.session.busy_with is None:
            result = bench.result
        return not bench.vehicle.armed

    assert bench.run(400.0, watch), "the vehicle does not land"
    return result, back_m


def flying(personality: str, delay_s: float = DELAY_S) -> FlyingBench:
    bench = FlyingBench(personality).flying(plan(*OLD))
    bench.delay_s = delay_s
    bench.run(2.0)
    return bench


def norths_until(bench: FlyingBench, limit_s: float, ends: Callable[[], bool]) -> list[float]:
    """Return the vehicle's north coordinates [m] until `ends()` holds, within the limit."""
    norths_m: list[float] = []

    def watch() -> bool:
        norths_m.append(place(bench)[1])
        return ends()

    assert bench.run(limit_s, watch), f"not within {limit_s:g} s"
    return norths_m


@BOTH
@pytest.mark.parametrize("delay_s", [*full_only(0.02, 0.2), DELAY_S])
def test_a_plan_that_leaves_the_old_one_ahead_is_flown_without_a_stop_or_a_turn_back(
    personality: str, delay_s: float
) -> None:
    bench = flying(personality, delay_s)
    turns_m = place(bench)[1] + 40.0 + 250.0 * delay_s
    new = [(0.0, turns_m), (150.0, turns_m), (150.0, turns_m + 80.0)]
    result, back_m = swapped(bench, plan(*new, leaves_ahead=True), [(0.0, 0.0), *new])
    assert (result.failure, result.flying, result.stood_still_s) == (None, "new", 0.0)
    assert back_m < BACK_M
    assert place(bench) == pytest.approx(new[-1], abs=3.0)


@BOTH
def test_common_corners_are_flown_from_any_position(personality: str) -> None:
    """The old plan has a corner before the splice point."""
    bench = FlyingBench(personality)
    bend = [(0.0, 60.0), (0.0, 150.0), (400.0, 150.0)]
    bench.flying(plan(*bend))
    bench.delay_s = DELAY_S
    bench.run(2.0)
    new = [(0.0, 150.0), (300.0, 150.0), (300.0, 300.0)]
    result, back_m = swapped(bench, plan(*new, leaves_ahead=True), [(0.0, 0.0), *new])
    assert (result.failure, result.flying, result.stood_still_s) == (None, "new", 0.0)
    assert back_m < BACK_M
    assert place(bench) == pytest.approx(new[-1], abs=3.0)


@BOTH
def test_a_vehicle_past_the_splice_point_flies_on_along_its_old_plan(personality: str) -> None:
    bench = flying(personality)
    turns_m = place(bench)[1] + 20.0
    new = [(0.0, turns_m), (150.0, turns_m)]
    result, back_m = swapped(bench, plan(*new, leaves_ahead=True), [(0.0, 0.0), *OLD])
    assert (result.flying, result.is_late, result.stood_still_s) == ("old", True, 0.0)
    assert result.took_s is None
    assert back_m < BACK_M
    assert place(bench) == pytest.approx(OLD[-1], abs=3.0)


@pytest.mark.parametrize("personality", ["ardupilot", *full_only("px4")])
@pytest.mark.parametrize("ahead_m", [40.0, *full_only(20.0, 30.0, 60.0, 80.0, 100.0)])
def test_a_vehicle_near_the_splice_point_never_turns_back(personality: str, ahead_m: float) -> None:
    """Both routes lead north; the new one turns east at the corner."""
    bench = flying(personality)
    turns_m = place(bench)[1] + ahead_m
    new = [(0.0, turns_m), (150.0, turns_m)]
    bench.begin_swap(plan(*new, leaves_ahead=True))
    norths_m = norths_until(bench, 400.0, lambda: not bench.vehicle.armed)
    flown_to = {"new": new, "old": OLD}[bench.result.flying]
    assert place(bench) == pytest.approx(flown_to[-1], abs=3.0)
    assert most_backwards_m(norths_m) < TURNS_WITHIN_M


@pytest.mark.parametrize(
    ("personality", "delay_s", "holds", "ahead_m", "flying_then"),
    [
        ("ardupilot", 0.0, False, 9.0, "old"),  # it would stop far past the corner, and fly back
        ("ardupilot", 0.0, False, 22.0, "new"),
        ("ardupilot", 0.0, True, 17.0, "old"),
        ("ardupilot", 0.0, True, 30.0, "new"),
        ("px4", 0.5, False, 13.0, "old"),  # the last item would come after the corner
        ("px4", 0.5, False, 27.0, "new"),
    ],
)
def test_the_time_until_the_splice_point_decides_on_the_plan(
    personality: str, delay_s: float, holds: bool, ahead_m: float, flying_then: str
) -> None:
    """The vehicle flies at 10 m/s. Without partial lists an ArduCopter holds for the swap."""
    bench = flying(personality, delay_s)
    turns_m = place(bench)[1] + ahead_m
    new = plan((0.0, turns_m), (150.0, turns_m), leaves_ahead=True)
    aims = {"old": {(item.x, item.y) for item in bench.session.items}}
    aims["new"] = {(item.x, item.y) for item in bench.session.mission_items(new)} - aims["old"]
    bench.block = lambda m: holds and m.get_type() == "MISSION_WRITE_PARTIAL_LIST"
    norths_m: list[float] = []
    bench.begin_swap(new)
    bench.run(20.0, lambda: norths_m.append(place(bench)[1]))
    result = bench.result
    assert (result.flying, result.is_late) == (flying_then, flying_then == "old")
    assert bench.aim in aims[flying_then]
    assert most_backwards_m(norths_m) < TURNS_WITHIN_M


def test_a_new_plan_from_the_passed_corner_on_does_not_lead_back_to_that_corner() -> None:
    bench = flying("px4", 0.0)
    new = plan(OLD[0], (0.0, 150.0), (150.0, 150.0), leaves_ahead=True)
    result = bench.swap(new)
    second = bench.session.mission_items(new)[bench.session.dialect.first_waypoint_seq + 1]
    assert (result.failure, result.flying) == (None, "new")
    assert bench.aim == (second.x, second.y)


@pytest.mark.parametrize("n_lost", [*full_only(0, 1), 3])
def test_a_vehicle_with_a_command_after_the_corner_stays_on_a_known_route(n_lost: int) -> None:
    """The vehicle does not cross between the routes, where neither plan leads."""
    bench = flying("ardupilot")
    turns_m = place(bench)[1] + 90.0
    new = [(0.0, turns_m), (150.0, turns_m)]
    orders = count()
    bench.block = lambda m: getattr(m, "command", 0) == SET_CURRENT and next(orders) < n_lost
    bench.begin_swap(plan(*new, leaves_ahead=True))
    beside_m: list[float] = []

    def is_down() -> bool:
        beside_m.append(min(distance_to_track(place(bench), way) for way in ([(0.0, 0.0), *OLD], new)))
        return not bench.vehicle.armed

    assert bench.run(400.0, is_down), "the vehicle does not land"
    assert max(beside_m) < TURNS_WITHIN_M


def test_the_time_of_a_swap_is_measured_by_the_vehicles_clock() -> None:
    """Each of the five exchanges takes 2 s: upload, read-back (two), heartbeat and current item."""
    bench = flying("ardupilot")
    north_m = place(bench)[1] + 290.0
    new = [(0.0, north_m), (150.0, north_m)]
    result, _ = swapped(bench, plan(*new, leaves_ahead=True), [(0.0, 0.0), *new])
    assert 6.0 <= result.took_s <= 12.0


def block_read_back(bench: FlyingBench, until: Callable[[], bool]) -> None:
    """Drop the items that the vehicle sends until the condition holds."""
    bench.block_down = lambda m: m.get_type() == "MISSION_ITEM_INT" and not until()


def test_a_plan_flown_to_its_end_before_the_read_back_is_reported() -> None:
    bench = flying("px4")
    goal = (0.0, place(bench)[1] + 60.0)
    block_read_back(bench, lambda: not bench.vehicle.armed)
    result = bench.swap(plan(goal))
    assert not bench.vehicle.armed
    assert (result.failure, result.flying) == (None, "new")
    assert place(bench) == pytest.approx(goal, abs=3.0)


@pytest.mark.parametrize("later_s", [12.0, *full_only(6.0, 25.0)])
def test_a_vehicle_that_passed_corners_before_the_read_back_is_not_sent_back(
    later_s: float,
) -> None:
    """PX4 follows the new plan at the last item; the upload marks the first item to fly."""
    bench = flying("px4")
    north_m = place(bench)[1]
    new = [(30.0, north_m + 30.0), (30.0, north_m + 60.0), (30.0, north_m + 90.0), (30.0, north_m + 600.0)]
    until_s = bench.now + 8.0 + later_s
    block_read_back(bench, lambda: bench.now > until_s)
    result, back_m = swapped(bench, plan(*new), [(0.0, north_m), *new])
    assert (result.failure, result.flying, result.stood_still_s) == (None, "new", 0.0)
    assert back_m < BACK_M
    assert place(bench) == pytest.approx(new[-1], abs=3.0)


@BOTH
@pytest.mark.parametrize("blind_s", [1.0, *full_only(0.0, 0.5, 2.0, 3.0, 5.0)])
def test_a_vehicle_without_a_position_during_a_swap_is_never_sent_back(
    personality: str, blind_s: float
) -> None:
    """On a slow radio positions may be missing during an upload."""
    bench = flying(personality, 0.3)
    north_m = place(bench)[1]
    new = [(0.0, north_m + 30.0), (0.0, north_m + 250.0), (150.0, north_m + 250.0)]
    since_s = bench.now + blind_s
    bench.block_down = lambda m: m.get_type() == "GLOBAL_POSITION_INT" and bench.now > since_s
    bench.begin_swap(plan(*new, leaves_ahead=True))
    norths_m = norths_until(
        bench, 120.0, lambda: bench.session.busy_with is None and bench.now > since_s + 60.0
    )
    assert most_backwards_m(norths_m) < TURNS_WITHIN_M
    assert bench.result.flying in ("old", "new")


@pytest.mark.parametrize("ahead_m", [40.0, *full_only(60.0)])
def test_a_vehicle_that_passes_the_corner_without_a_position_keeps_its_old_plan(ahead_m: float) -> None:
    bench = flying("px4")
    north_m = place(bench)[1] + ahead_m
    new = [(0.0, north_m), *((150.0, north_m + 20.0 * i) for i in range(28))]
    since_s = bench.now + 1.0
    bench.block_down = lambda m: m.get_type() == "GLOBAL_POSITION_INT" and bench.now > since_s
    result = bench.swap(plan(*new, leaves_ahead=True))
    assert (result.flying, result.is_late) == ("old", False)
    assert "[no-position]" in result.failure
    assert place(bench)[0] == pytest.approx(0.0, abs=1.0)


def test_a_held_vehicle_without_a_position_gets_no_plan_that_begins_midway() -> None:
    bench = flying("ardupilot", 0.0)
    turns_m = place(bench)[1] + 200.0
    new = plan((0.0, turns_m), (150.0, turns_m), leaves_ahead=True)
    bench.block = lambda m: m.get_type() == "MISSION_WRITE_PARTIAL_LIST"
    bench.block_down = lambda m: m.get_type() == "GLOBAL_POSITION_INT"
    bench.run(4.0)
    result = bench.swap(new)
    assert result.flying == "hold"
    assert "[no-position]" in result.failure
    assert bench.mode == bench.session.dialect.hold_mode
    assert not bench.holds(bench.session.mission_items(new))


@pytest.mark.parametrize("silence_s", [8.0, 20.0, *full_only(3.0, 14.0)])
def test_a_vehicle_that_is_silent_after_a_complete_upload_is_not_sent_back(silence_s: float) -> None:
    """PX4 follows the new plan at once; the splice point is passed before the silence ends."""
    bench = flying("px4", 0.2)
    north_m = place(bench)[1]
    new = [(0.0, north_m + 60.0), (60.0, north_m + 80.0), (150.0, north_m + 100.0), (150.0, north_m + 600.0)]
    begins_s: list[float] = []

    def is_lost(message: Any) -> bool:
        if message.get_type() == "MISSION_ACK" and not begins_s:
            begins_s.append(bench.now)
        return bool(begins_s) and bench.now < begins_s[0] + silence_s

    bench.block_down = is_lost
    bench.begin_swap(plan(*new, leaves_ahead=True))
    norths_m = norths_until(bench, 200.0, lambda: bench.session.busy_with is None)
    until_s = bench.now + 20.0
    norths_m += norths_until(bench, 21.0, lambda: bench.now >= until_s)
    assert most_backwards_m(norths_m) < BACK_M
    if silence_s < 15.0:
        assert (bench.result.failure, bench.result.flying) == (None, "new")
        assert 0.0 < bench.result.took_s < 10.0, "the time ends with the upload, not with the read-back"
