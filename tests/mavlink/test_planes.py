"""Fixed wings of both autopilots, flown by the simulator: changed in flight, held, called back and landed."""

from __future__ import annotations

from functools import partial

import pytest
from flying_bench import BOTH
from plane_flights import (
    FIRST,
    FRAME,
    GOAL,
    RADIUS_M,
    SECOND,
    START,
    away_m,
    bench,
    here,
    landed,
    nearest_m,
    plan,
)
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import distance_m
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.land import landing_items

PX4_IN_FULL_RUN = pytest.mark.parametrize("personality", ["ardupilot", *full_only("px4")])
LAST_ITEM = {"ardupilot": 8, "px4": 10}
"""The landing at the goal, as an item of FIRST."""
TO_START, TO_GOAL = [(0.0, 300.0), (0.0, 600.0)], [(0.0, 300.0), (300.0, 850.0)]


@BOTH
def test_a_launch_begins_at_the_first_item(personality) -> None:
    flown = bench(personality).uploaded(FIRST)
    flown.vehicle.mission.set_current(6)
    assert flown.do("launch", basic.launch).failure is None
    assert flown.session.state.mission_seq == flown.session.dialect.first_seq


@pytest.mark.parametrize(
    ("personality", "leaves_ahead"), [("ardupilot", False), *full_only(("px4", True), ("px4", False))]
)
def test_a_new_route_is_taken_over_without_a_stop(personality, leaves_ahead) -> None:
    flown = bench(personality).flying(FIRST)
    done = flown.swap(replace(SECOND, leaves_ahead=leaves_ahead))
    assert (done.failure, done.flying) == (None, "new")
    assert flown.mode == flown.session.dialect.mission_mode
    if personality == "px4":
        jump = next(item for item in flown.stored if item.command == mavlink.MAV_CMD_DO_JUMP)
        circle = flown.stored[int(jump.param1)]
        assert distance_m((circle.x / 1e7, circle.y / 1e7), FRAME.to_geodetic(460.0, 650.0)) < 1.0
    assert nearest_m(flown, (-200.0, 700.0), 60.0) < 45.0
    assert landed(flown)
    assert away_m(flown, GOAL) < 60.0


@BOTH
def test_a_plane_holds_in_a_circle_at_its_height(personality) -> None:
    flown = bench(personality).flying(FIRST)
    assert flown.do("hold", basic.hold).failure is None
    centre = here(flown)
    flown.run(30.0)
    distances_m, heights_m = [], []

    def measure() -> bool:
        distances_m.append(away_m(flown, centre))
        heights_m.append(flown.session.state.alt_rel_m)
        return False

    flown.run(60.0, measure)
    assert flown.mode == flown.session.dialect.hold_mode
    assert max(distances_m) < RADIUS_M + 40.0, "the circle lies a moment ahead of the command"
    assert max(heights_m) - min(heights_m) < 3.0
    assert flown.session.state.landed is Landed.IN_AIR


@PX4_IN_FULL_RUN
def test_the_route_of_a_holding_plane_is_changed(personality) -> None:
    flown = bench(personality).flying(FIRST)
    assert flown.do("hold", basic.hold).failure is None
    done = flown.swap(replace(SECOND, from_hold=True))
    assert (done.failure, done.flying) == (None, "new")
    assert landed(flown)
    assert away_m(flown, GOAL) < 60.0


@BOTH
def test_a_plane_returns_and_lands_at_home(personality) -> None:
    flown = bench(personality).flying(FIRST)
    assert flown.do("return", basic.return_home).failure is None
    assert flown.mode == flown.session.dialect.return_mode
    assert landed(flown)
    assert away_m(flown, START) < 60.0
    assert mavlink.MAV_CMD_DO_LAND_START not in flown.commands


@pytest.mark.parametrize(
    ("personality", "track", "where", "held"),
    [
        ("ardupilot", TO_START, START, False),
        *full_only(*(("px4", *row, held) for row in ((TO_START, START), (TO_GOAL, GOAL)) for held in (0, 1))),
    ],
)
def test_a_command_to_land_leads_to_the_nearest_landing(personality, track, where, held) -> None:
    flown = bench(personality).flying(plan(*track))
    if where == GOAL:
        flown.run(60.0, lambda: away_m(flown, track[-1]) < 150.0)
    if held:
        assert flown.do("hold", basic.hold).failure is None
    assert flown.do("land", basic.land).failure is None
    assert flown.mode == flown.session.dialect.mission_mode
    assert flown.session.state.mission_seq in landing_items(flown.session.items)
    assert landed(flown)
    assert away_m(flown, where) < 60.0


@PX4_IN_FULL_RUN
def test_a_command_to_land_during_a_landing_causes_no_go_around(personality) -> None:
    flown = bench(personality).uploaded(FIRST)
    assert flown.do("launch", basic.launch).failure is None
    assert flown.run(300.0, lambda: flown.session.state.mission_seq == LAST_ITEM[personality])
    n_commands, n_items_set = len(flown.commands), len(flown.of("MISSION_SET_CURRENT"))
    assert flown.do("land", basic.land).failure is None
    assert mavlink.MAV_CMD_DO_LAND_START not in flown.commands[n_commands:]
    assert len(flown.of("MISSION_SET_CURRENT")) == n_items_set
    assert landed(flown, 60.0)


@BOTH
def test_a_command_to_land_on_the_ground_disarms(personality) -> None:
    flown = bench(personality).uploaded(FIRST)
    flown.vehicle.arming.arm(flown.now, force=True)
    assert flown.run(5.0, lambda: flown.session.state.armed)
    assert flown.do("land", basic.land).failure is None
    assert not flown.vehicle.armed
    assert mavlink.MAV_CMD_DO_LAND_START not in flown.commands
    assert flown.of("MISSION_SET_CURRENT") == []


@BOTH
def test_the_set_speed_is_the_airspeed(personality) -> None:
    flown = bench(personality).flying(FIRST)
    assert flown.do("speed", partial(basic.set_speed, speed_m_s=12.0)).failure is None
    (message,) = [m for m in flown.of("COMMAND_LONG") if m.command == mavlink.MAV_CMD_DO_CHANGE_SPEED]
    assert message.param1 == mavlink.SPEED_TYPE_AIRSPEED
    flown.run(10.0)
    assert flown.session.state.ground_speed_m_s == pytest.approx(12.0, abs=0.3)
