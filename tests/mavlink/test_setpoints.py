"""A vehicle led by set-points: entering and leaving the mode, following, and the end of set-points."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from flying_bench import BOTH, HOME, Faults, FlyingBench, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LocalFrame, distance_m
from swarmctl.core.records import replace
from swarmctl.core.setpoint import SetPoint
from swarmctl.mavlink.dialects.px4 import Px4
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.setpoint import setpoint_message
from swarmctl.mavlink.session import SessionStep

OLD, NEW = plan(north=12), plan(north=6, east=0.002)
MODE = {"ardupilot": "GUIDED", "px4": "OFFBOARD"}
HOLD = {"ardupilot": "GUIDED", "px4": "AUTO.LOITER"}
MISSION = {"ardupilot": "AUTO", "px4": "AUTO.MISSION"}
PILOT = {"ardupilot": "LOITER", "px4": "AUTO.RTL"}
"""a mode that another party sets"""
NORTH_EAST_UP = (5.0, 6.2, 0.3)
"""8 m/s over ground"""
Velocity = tuple[float, float, float]
SIM_PARAMS = {"ardupilot": {}, "px4": {"COM_OBL_RC_ACT": 5.0}}


class Leader:
    """A place that begins at the vehicle and moves at a constant velocity (east, north, up) [m/s]."""

    def __init__(self, bench: FlyingBench, velocity_m_s: Velocity) -> None:
        lat_deg, lon_deg = bench.vehicle.body.place_deg(*bench.vehicle.body.position_m[:2])
        self._frame = LocalFrame(lat_deg, lon_deg)
        self._alt_m, self._since_s, self._velocity_m_s = (
            bench.vehicle.body.position_m[2],
            bench.now,
            velocity_m_s,
        )

    def at(self, now: float) -> SetPoint:
        east_m, north_m, up_m = (v * (now - self._since_s) for v in self._velocity_m_s)
        place = self._frame.to_geodetic(east_m, north_m)
        return SetPoint(self._velocity_m_s, place, self._alt_m + up_m)


def lead(
    bench: FlyingBench,
    setpoint: Callable[[float], SetPoint],
    seconds: float,
    *,
    hz: float = 10.0,
    until: Callable[[], bool] = lambda: False,
) -> bool:
    """Send set-points for some time; return True as soon as `until()` holds."""
    for _ in range(round(seconds * hz)):
        message = bench.session.setpoint_message(setpoint(bench.now), bench.now)
        bench.take(SessionStep([message], []))
        if bench.run(1.0 / hz, until):
            return True
    return False


def follow(bench: FlyingBench, setpoint: Callable[[float], SetPoint]) -> basic.Done:
    """Enter the set-point mode while set-points stream; return the outcome."""
    lead(bench, setpoint, 0.5)
    bench.begin("follow", basic.follow_setpoints)
    assert lead(bench, setpoint, 60.0, until=lambda: bench.session.busy_with is None)
    return bench.result


def errors_m(bench: FlyingBench, setpoint: SetPoint) -> tuple[float, float]:
    """Return the true distance over ground, and the difference in height, from the place of a set-point."""
    body = bench.vehicle.body
    place = body.place_deg(*body.position_m[:2])
    return distance_m(place, setpoint.at), abs(body.position_m[2] - setpoint.alt_amsl_m)


def speed_m_s(bench: FlyingBench) -> float:
    east, north, _ = bench.vehicle.body.velocity_m_s
    return (east**2 + north**2) ** 0.5


def flying(personality: str, **params: float) -> FlyingBench:
    return FlyingBench(personality, params=SIM_PARAMS[personality] | params).flying(OLD)


def led(personality: str, velocity: Velocity = NORTH_EAST_UP, **params: float) -> Any:
    """Return a vehicle that has followed a leader for 12 s, and the leader."""
    bench = flying(personality, **params)
    leader = Leader(bench, velocity)
    assert follow(bench, leader.at).failure is None
    lead(bench, leader.at, 12)
    return bench, leader


def n_mode_commands(bench: FlyingBench) -> int:
    return bench.commands.count(mavlink.MAV_CMD_DO_SET_MODE)


# The message


@pytest.mark.parametrize(
    ("setpoint", "mask", "position", "velocity"),
    [
        (SetPoint((1.0, 2.0, 3.0), (46.5, 14.25), 310.5), 0xDC0, (46.5, 14.25, 310.5), (2.0, 1.0, -3.0)),
        (SetPoint((1.0, 2.0, 3.0)), 0xDC7, (0.0, 0.0, 0.0), (2.0, 1.0, -3.0)),
    ],
)
def test_a_set_point_is_sent_with_its_height_above_the_sea(setpoint, mask, position, velocity):
    message = setpoint_message(MavlinkPeer(7), setpoint)
    assert message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT"
    assert (message.target_system, message.target_component) == (7, 1)
    assert message.coordinate_frame == mavlink.MAV_FRAME_GLOBAL_INT
    assert message.type_mask == mask
    assert (message.lat_int / 1e7, message.lon_int / 1e7, message.alt) == position
    assert (message.vx, message.vy, message.vz) == velocity


@pytest.mark.parametrize(
    "setpoint",
    [
        SetPoint((1.0, math.nan, 0.0)),
        SetPoint((1.0, 0.0, 0.0), HOME, math.inf),
        SetPoint((1.0, 0.0, 0.0), HOME),
        SetPoint((1.0, 0.0, 0.0), None, 300.0),
    ],
)
def test_an_incomplete_set_point_is_never_sent(setpoint):
    with pytest.raises(ValueError, match="set-point"):
        setpoint_message(MavlinkPeer(1), setpoint)


@BOTH
def test_a_fixed_wing_is_not_led_by_set_points(personality):
    bench = FlyingBench(personality, "plane").connected()
    assert bench.session.dialect.setpoint_mode is None
    assert bench.session.setpoint_message(SetPoint((0.0, 0.0, 0.0)), bench.now) is None
    before = n_mode_commands(bench)
    assert bench.do("follow", basic.follow_setpoints).failure
    assert n_mode_commands(bench) == before


@pytest.mark.parametrize(
    ("personality", "mode", "role"), [("px4", "OFFBOARD", "setpoints"), ("ardupilot", "GUIDED", "hold")]
)
def test_the_role_of_the_set_point_mode(personality, mode, role):
    bench = FlyingBench(personality).connected()
    if role == "setpoints":
        lead(bench, lambda _now: SetPoint((0.0, 0.0, 0.0)), 1)
    bench.another_sets_mode(mode)
    lead(bench, lambda _now: SetPoint((0.0, 0.0, 0.0)), 2)
    assert (bench.session.state.mode, bench.session.state.mode_role) == (mode, role)


# Following


@BOTH
@pytest.mark.parametrize("hz", [5.0, 10.0])
def test_a_vehicle_follows_a_moving_place(personality, hz):
    bench = flying(personality)
    leader = Leader(bench, NORTH_EAST_UP)
    assert follow(bench, leader.at).failure is None
    assert bench.mode == MODE[personality]
    lead(bench, leader.at, 12, hz=hz)
    over_ground_m, height_m = errors_m(bench, leader.at(bench.now))
    assert over_ground_m < {10.0: 0.6, 5.0: 1.2}[hz]
    assert height_m < 0.5
    assert speed_m_s(bench) == pytest.approx(math.hypot(*NORTH_EAST_UP[:2]), abs=0.1)


@BOTH
def test_a_velocity_alone_is_flown(personality):
    bench = flying(personality)
    height_m = bench.vehicle.body.position_m[2]
    velocity = SetPoint((3.0, -4.0, 0.0))
    assert follow(bench, lambda _now: velocity).failure is None
    lead(bench, lambda _now: velocity, 12)
    assert bench.vehicle.body.velocity_m_s == pytest.approx((3.0, -4.0, 0.0), abs=0.1)
    assert bench.vehicle.body.position_m[2] == pytest.approx(height_m, abs=1.0)


@BOTH
@pytest.mark.parametrize("seed", range(3))
def test_lost_frames_do_not_end_the_flight(personality, seed):
    bench = flying(personality)
    bench.spoil(Faults(loss=0.15, max_delay_s=0.1, seed=seed))
    leader = Leader(bench, NORTH_EAST_UP)
    assert follow(bench, leader.at).failure is None
    lead(bench, leader.at, 10)
    for _ in range(20):
        lead(bench, leader.at, 1)
        assert bench.mode == MODE[personality]
        assert errors_m(bench, leader.at(bench.now))[0] < 2.5


# Entering the mode


def test_px4_without_set_points_flies_its_mission_on():
    bench = flying("px4")
    assert bench.do("follow", basic.follow_setpoints).failure
    assert bench.mode == "AUTO.MISSION"


@BOTH
def test_a_vehicle_on_the_ground_does_not_enter_the_mode(personality):
    bench = FlyingBench(personality).uploaded(OLD)
    here = SetPoint((0.0, 0.0, 2.0))
    before = n_mode_commands(bench)
    done = follow(bench, lambda _now: here)
    assert done.failure
    assert n_mode_commands(bench) == before
    assert bench.vehicle.body.position_m[2] == pytest.approx(300.0, abs=0.1)


@BOTH
@pytest.mark.parametrize("after_s", [0.05 * n for n in range(0, 40, 3)])
def test_a_takeover_at_any_moment_is_respected(personality, after_s):
    bench = flying(personality)
    bench.delay_s = 0.1
    leader = Leader(bench, (0.0, 4.0, 0.0))
    lead(bench, leader.at, 0.5)
    bench.begin("follow", basic.follow_setpoints)
    lead(bench, leader.at, after_s, hz=20.0)
    bench.another_sets_mode(PILOT[personality])
    taken_s = bench.now
    lead(bench, leader.at, 10)
    sent_s = [now for now, m in bench.sent if getattr(m, "command", 0) == mavlink.MAV_CMD_DO_SET_MODE]
    # A command and the news of the takeover may cross on the wire.
    assert all(now <= taken_s + bench.delay_s + 0.05 for now in sent_s)
    crossed = any(now > taken_s - bench.delay_s - 0.05 for now in sent_s)
    assert bench.mode == PILOT[personality] or (crossed and bench.mode == MODE[personality])


@BOTH
def test_a_hold_of_another_party_is_not_left(personality):
    bench = flying(personality)
    bench.another_sets_mode(HOLD[personality])
    bench.run(3)
    leader, before = Leader(bench, (0.0, 0.0, 0.0)), n_mode_commands(bench)
    assert "[taken-over]" in follow(bench, leader.at).failure
    assert n_mode_commands(bench) == before


# Set-points that stop


def test_after_an_order_to_hold_a_late_set_point_does_not_restore_offboard():
    bench, leader = led("px4")
    bench.run(3)
    assert bench.mode == "AUTO.LOITER"
    assert bench.do("hold", lambda c: basic.hold(c, check_mode_first=True)).failure is None
    lead(bench, leader.at, 2)
    assert bench.mode == "AUTO.LOITER"


# Orders


@BOTH
@pytest.mark.parametrize("check_mode_first", [True, False])
@pytest.mark.parametrize("faults", [Faults(), Faults(loss=0.15, max_delay_s=0.3, seed=1)])
def test_a_hold_stops_a_led_vehicle(personality, check_mode_first, faults):
    bench, _ = led(personality)
    bench.spoil(faults)
    from_m = bench.vehicle.body.position_m
    done = bench.do("hold", lambda c: basic.hold(c, check_mode_first=check_mode_first))
    assert done.failure is None
    assert bench.mode == HOLD[personality]
    bench.run(6)
    assert speed_m_s(bench) < 0.2
    # GUID_TIMEOUT alone would bring ArduPilot to rest some 40 m on
    went_m = math.dist(from_m[:2], bench.vehicle.body.position_m[:2])
    assert went_m < (25 if faults == Faults() else 35)


@BOTH
@pytest.mark.parametrize(
    ("order", "modes"),
    [
        (basic.return_home, {"ardupilot": "RTL", "px4": "AUTO.RTL"}),
        (basic.land, {"ardupilot": "LAND", "px4": "AUTO.LAND"}),
    ],
)
@pytest.mark.parametrize("check_mode_first", [True, False])
def test_an_order_ends_the_set_point_mode(personality, order, modes, check_mode_first):
    bench, leader = led(personality)
    bench.begin("order", lambda c: order(c, check_mode_first=check_mode_first))
    lead(bench, leader.at, 30, until=lambda: bench.session.busy_with is None)
    assert bench.result.failure is None
    lead(bench, leader.at, 3)
    assert bench.mode == modes[personality]


@BOTH
def test_after_the_set_point_mode_and_a_hold_a_vehicle_flies_a_new_mission(personality):
    bench, _ = led(personality)
    if personality == "px4":
        assert bench.do("hold", basic.hold).failure is None
    done = bench.swap(replace(NEW, from_hold=True))
    assert (done.failure, done.flying) == (None, "new")
    assert bench.mode == MISSION[personality]
    leader = Leader(bench, (0.0, 4.0, 0.0))
    assert follow(bench, leader.at).failure is None, "and joins again from its mission"


@BOTH
def test_after_a_hold_a_vehicle_goes_on_by_its_stored_mission_without_an_upload(personality):
    bench, _ = led(personality)
    assert bench.do("hold", basic.hold).failure is None
    n_sent, rest = len(bench.sent), OLD.track[5:]
    done = bench.swap(replace(OLD, track=rest, from_hold=True))
    assert (done.failure, done.flying, done.took_s) == (None, "new", None)
    assert not {m.get_type() for _, m in bench.sent[n_sent:]} & {"MISSION_COUNT", "MISSION_ITEM_INT"}
    assert bench.mode == MISSION[personality]
    assert bench.aim == (round(rest[0].lat_deg * 1e7), round(rest[0].lon_deg * 1e7))
    assert bench.holds(bench.session.items)
    done = bench.swap(NEW)
    assert (done.failure, done.flying) == (None, "new"), "and takes a new mission later"


def test_a_px4_far_from_the_start_of_its_stored_mission_gets_a_new_one(monkeypatch):
    """PX4 refuses to fly a mission that begins MIS_DIST_1WP or more from the vehicle."""
    bench, _ = led("px4")
    assert bench.do("hold", basic.hold).failure is None
    bench.another_sets(MIS_DIST_1WP=10.0)
    monkeypatch.setattr(Px4, "flies_stored_within_m", 10.0)
    done = bench.swap(replace(OLD, track=OLD.track[5:], from_hold=True))
    assert (done.failure, done.flying) == (None, "new")
    assert bench.mode == MISSION["px4"]


@BOTH
def test_a_plan_that_is_not_stored_is_uploaded_from_the_hold(personality):
    bench, _ = led(personality)
    assert bench.do("hold", basic.hold).failure is None
    bench.another_sends(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    bench.run(5)
    done = bench.swap(replace(OLD, track=OLD.track[5:], from_hold=True))
    assert (done.failure, done.flying) == (None, "new")
    assert bench.holds(bench.session.items)
