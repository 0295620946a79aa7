"""Swaps of the mission of a simulated ArduCopter, which obeys each item as soon as it is written."""

from __future__ import annotations

import math
from typing import Any

import pytest
from flying_bench import FlyingBench, is_partial_list, plan

from swarmctl.core.mission import FlightPlan
from swarmctl.mavlink.events import ProcedureDone

M_PER_DEG = 111_195.0
OLD, NEW = plan(north=8), plan(north=5, east=0.001, alt=33.333)


def test_the_new_route_is_appended_to_the_old_one_and_flown_without_a_stop():
    bench = FlyingBench("ardupilot").flying(OLD)
    old, aimed_at = bench.session.items, bench.aim
    new = bench.session.mission_items(NEW)
    result, modes, aims = bench.watched_swap(NEW)
    assert (result.failure, result.flying, result.stood_still_s) == (None, "new", 0.0)
    assert 0.0 < result.took_s < 2.0
    assert modes == {"AUTO"}
    assert aims <= {aimed_at, (new[2].x, new[2].y)}
    assert bench.holds(bench.session.items)
    assert bench.session.items[: len(old)] == old
    assert bench.vehicle.mission.index == len(old)
    assert ProcedureDone("swap", result) in bench.events
    assert bench.run(200, lambda: not bench.session.state.armed), "no landing at the end of the new mission"
    assert bench.vehicle.body.lat_lon_deg == pytest.approx(
        (NEW.landing.lat_deg, NEW.landing.lon_deg), abs=1e-5
    )


@pytest.mark.parametrize("before_m", [45.0, 25.0, 18.0, 13.0, 9.0])
def test_a_braking_vehicle_does_not_fly_back_to_a_passed_corner(before_m: float) -> None:
    """An ArduCopter brakes over some 20 m when another item becomes current."""
    bench = FlyingBench("ardupilot").flying(OLD)
    aside = plan(north=8, east=0.002).track
    new = FlightPlan(OLD.takeoff_alt_m, (*OLD.track[1:5], *aside[4:]), aside[-1], leaves_ahead=True)
    corner_lat_deg = OLD.track[1].lat_deg
    assert bench.run(60, lambda: (corner_lat_deg - bench.session.state.lat_deg) * M_PER_DEG < before_m)
    bench.begin_swap(new)
    norths_m = []

    def watch() -> bool:
        norths_m.append(bench.session.state.north_m_s)
        seq, n_items = bench.session.state.mission_seq or 0, len(bench.session.items)
        return bench.session.busy_with is None and seq > n_items - len(aside)

    assert bench.run(200, watch)
    assert (bench.result.failure, bench.result.flying) == (None, "new")
    assert min(norths_m) > -0.3


def test_acknowledgements_without_item_requests_are_understood():
    """ArduPilot requests only the items that have not arrived by its next transmission.

    Over a quick link that is none (MissionItemProtocol.cpp, queued_request_send).
    """
    bench = FlyingBench("ardupilot").flying(OLD)
    bench.block_down = lambda m: m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT")
    result, modes, _ = bench.watched_swap(NEW)
    assert (result.failure, result.flying, result.stood_still_s) == (None, "new", 0.0)
    assert modes == {"AUTO"}


def test_successive_swaps_append_behind_each_other():
    bench = FlyingBench("ardupilot").flying(OLD)
    for n in range(3):
        new = plan(north=4 + n, east=0.0005 * (n + 1))
        assert bench.swap(new).flying == "new"
        items = bench.session.mission_items(new)
        assert bench.session.dialect.differences(items[2:], bench.session.items[-len(items[2:]) :], 2) == ()
        assert bench.holds(bench.session.items)


def test_a_list_that_would_become_too_long_is_replaced_in_hold():
    bench = FlyingBench("ardupilot").flying(OLD)
    long = plan(north=395, east=0.001)
    result, modes, _ = bench.watched_swap(long)
    assert result.flying == "new"
    assert modes == {"AUTO", "GUIDED"}
    assert result.stood_still_s > 0.0
    assert bench.holds(bench.session.mission_items(long))


def test_without_answers_to_partial_lists_the_vehicle_holds_for_the_swap():
    bench = FlyingBench("ardupilot").flying(OLD)
    bench.block = is_partial_list
    result, modes, _ = bench.watched_swap(NEW)
    assert result.flying == "new"
    assert modes == {"AUTO", "GUIDED"}
    assert 0.0 < result.stood_still_s < 2.0
    assert bench.holds(bench.session.mission_items(NEW))
    assert bench.vehicle.mission.index == 2


def test_a_refused_item_leaves_the_old_mission_in_place():
    bench = FlyingBench("ardupilot").flying(OLD)
    old, at = bench.session.items, bench.vehicle.mission.index
    new = plan(north=12, east=0.001)
    bench.inject("mission_refused:result=invalid,at_item=13")
    result, _, aims = bench.watched_swap(new)
    assert result.flying == "old"
    assert "INVALID" in result.failure
    assert bench.holds(old)
    assert bench.holds(bench.session.items)
    assert bench.vehicle.mission.index == at
    assert aims <= {(i.x, i.y) for i in old} | {None}


def test_a_swap_on_a_very_bad_link_ends_after_two_minutes_in_hold():
    """Hovering uses the battery of the flight, so the agent decides what to do instead."""
    bench = FlyingBench("ardupilot").flying(OLD)
    new = plan(north=20, east=0.001)
    last = len(bench.session.mission_items(new)) - 1
    passed_s = -math.inf

    def is_lost(message: Any) -> bool:
        """Let one item in six seconds pass, except the last; ArduPilot gives up after 8 s."""
        nonlocal passed_s
        if message.get_type() != "MISSION_ITEM_INT":
            return message.get_type() == "MISSION_WRITE_PARTIAL_LIST"
        passes = message.seq != last and bench.now >= passed_s + 6.0
        passed_s = bench.now if passes else passed_s
        return not passes

    bench.block = is_lost
    began_s = bench.now
    result = bench.swap(new)
    assert result.flying == "hold"
    assert "[hold-limit]" in result.failure
    assert bench.mode == "GUIDED"
    announced_s = [at_s for at_s, m in bench.sent if m.get_type() == "MISSION_COUNT" and at_s > began_s]
    assert max(announced_s) < began_s + 120.0
