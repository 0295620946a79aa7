"""Fixed-wing motion: take-off, legs, circles, turns, stall, glide and landing, with and without wind."""

import math

import numpy as np
import physics_bench
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.physics.body import Body
from sim_vehicle.physics.motion import GRAVITY_M_S2
from sim_vehicle.physics.wind import WindSettings
from sim_vehicle.physics.world import World

UP_M = physics_bench.GROUND_M + 50


def from_centre_m(body: Body, centre_m: tuple[float, float] = (0.0, 0.0)) -> float:
    return math.hypot(body.position_m[0] - centre_m[0], body.position_m[1] - centre_m[1])


def test_a_plane_rolls_takes_off_climbs_straight_and_circles() -> None:
    world, body = physics_bench.lone_plane(None)
    body.loiter(0, 0, UP_M)
    took_s = physics_bench.until(world, lambda: body.airborne)
    assert took_s == pytest.approx(1.2 * 8.0 / 4.0, abs=0.2)  # 1.2 times the stall speed at 4 m/s2
    assert body.position_m[1] == pytest.approx((1.2 * 8.0) ** 2 / (2 * 4.0), abs=1.5)
    physics_bench.until(world, lambda: body.position_m[2] > physics_bench.GROUND_M + 14)
    assert body.position_m[0] == pytest.approx(0, abs=0.01)
    assert body.heading_rad == pytest.approx(0, abs=1e-6)
    physics_bench.until(world, lambda: body.reached)
    assert abs(body.position_m[2] - UP_M) <= 5


def test_a_plane_without_an_order_stays_on_the_ground() -> None:
    world, body = physics_bench.lone_plane(None)
    physics_bench.wait(world, 5.0)
    assert body.position_m == pytest.approx((0, 0, physics_bench.GROUND_M))
    assert not body.airborne


@pytest.mark.parametrize("radius_m", [-60.0, 100.0])
def test_a_plane_loiters_on_a_circle(radius_m: float) -> None:
    world, body = physics_bench.lone_plane()
    body.loiter(200, 100, UP_M, radius_m)
    physics_bench.until(world, lambda: body.reached)
    physics_bench.wait(world, 30.0)
    off_m, turned_rad, headings = [], 0.0, [body.heading_rad]

    def watch() -> None:
        nonlocal turned_rad
        off_m.append(from_centre_m(body, (200, 100)) - abs(radius_m))
        turned_rad += math.remainder(body.heading_rad - headings[-1], 2 * math.pi)
        headings.append(body.heading_rad)

    physics_bench.wait(world, 30.0, watch)
    assert max(map(abs, off_m)) < 1.0
    assert turned_rad == pytest.approx(30 * 15.0 / radius_m, rel=0.02)
    assert world.dynamics.airspeed_m_s[0] == pytest.approx(15.0, abs=1e-6)
    bank = math.atan(15.0**2 / (GRAVITY_M_S2 * radius_m))
    assert world.dynamics.attitude_rad[0, 0] == pytest.approx(bank, abs=0.02)


def test_the_bank_limit_sets_the_narrowest_turn() -> None:
    world, body = physics_bench.lone_plane()
    body.limit(bank_limit_deg=30.0)
    body.loiter(0, 0, UP_M, 5.0)  # narrower than the bank limit allows
    physics_bench.wait(world, 20.0)
    places = []
    physics_bench.wait(world, 15.0, lambda: places.append(body.position_m[:2]))
    wide_m = 15.0**2 / (GRAVITY_M_S2 * math.tan(math.radians(30.0)))
    steps = np.diff(np.array(places), axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
    fastest = np.abs(np.diff(headings)).max() / physics_bench.STEP_S
    assert 15.0 / fastest == pytest.approx(wide_m, rel=0.02)


def test_a_plane_continues_along_the_leg_after_a_waypoint() -> None:
    world, body = physics_bench.lone_plane()
    body.fly_to(0, 600, UP_M)
    physics_bench.until(world, lambda: body.reached)
    assert from_centre_m(body, (0, 600)) <= 31
    physics_bench.wait(world, 20.0)
    east_m, north_m, up_m = body.position_m
    assert north_m > 800
    assert up_m == pytest.approx(UP_M, abs=0.5)
    assert body.velocity_m_s == pytest.approx((0, 15, 0), abs=0.5) or abs(east_m) > 1


def test_the_next_leg_begins_where_the_last_one_ended() -> None:
    world, body = physics_bench.lone_plane()
    body.fly_to(0, 600, UP_M)
    physics_bench.until(world, lambda: body.reached)
    body.fly_to(800, 600, UP_M)
    physics_bench.wait(world, 25.0)
    assert body.position_m[1] == pytest.approx(600, abs=2.0)  # on the leg, not on a line from where it turned


def test_a_plane_in_a_crosswind_holds_its_track() -> None:
    world, body = physics_bench.lone_plane(wind=WindSettings(8.0, 270.0))
    body.fly_to(0, 300, UP_M)
    physics_bench.until(world, lambda: body.reached)
    body.fly_to(0, 3000, UP_M)
    physics_bench.wait(world, 40.0)
    # The wind triangle: the plane heads to the left of its track by asin(8 / 15).
    assert body.position_m[0] == pytest.approx(0, abs=0.5)
    assert math.remainder(body.heading_rad, 2 * math.pi) == pytest.approx(-math.asin(8.0 / 15.0), abs=0.01)
    assert body.velocity_m_s[:2] == pytest.approx((0, math.sqrt(15.0**2 - 8.0**2)), abs=0.05)


def test_a_headwind_above_the_airspeed_blows_a_plane_back() -> None:
    world, body = physics_bench.lone_plane()
    body.fly_to(0, 5000, UP_M)
    physics_bench.wait(world, 20.0)
    body.set_wind(20.0, 0.0)
    physics_bench.wait(world, 30.0)
    assert body.velocity_m_s[1] == pytest.approx(-5.0, abs=0.3)
    assert body.airborne


def test_a_circle_over_the_ground_stays_round_in_wind() -> None:
    world, body = physics_bench.lone_plane(wind=WindSettings(6.0, 300.0))
    physics_bench.wait(world, 40.0)
    off_m = []
    physics_bench.wait(world, 40.0, lambda: off_m.append(from_centre_m(body) - 60))
    assert max(map(abs, off_m)) < 5.0


def test_a_plane_climbs_and_sinks_within_its_limits() -> None:
    world, body = physics_bench.lone_plane()
    rates = []
    body.loiter(0, 0, UP_M + 100)
    took_s = physics_bench.until(world, lambda: body.position_m[2] > UP_M + 90)
    assert took_s == pytest.approx(90 / 4.0, abs=2.0)
    physics_bench.wait(world, 20.0)
    body.loiter(0, 0, UP_M)
    physics_bench.wait(world, 40.0, lambda: rates.append(body.velocity_m_s[2]))
    assert min(rates) == pytest.approx(-4.0, abs=0.01)
    assert body.position_m[2] == pytest.approx(UP_M, abs=0.5)


@pytest.mark.parametrize(("asked_m_s", "flown_m_s"), [(40.0, 22.0), (2.0, 10.0)])
def test_a_plane_flies_at_the_requested_airspeed_within_its_limits(
    asked_m_s: float, flown_m_s: float
) -> None:
    world, body = physics_bench.lone_plane()
    body.limit(speed_m_s=asked_m_s)
    physics_bench.wait(world, 10.0)
    assert world.dynamics.airspeed_m_s[0] == pytest.approx(flown_m_s, abs=1e-6)


def test_a_plane_below_the_stall_speed_sinks() -> None:
    world, body = physics_bench.lone_plane()
    body.limit(airspeed_min_m_s=4.0, speed_m_s=5.0)
    physics_bench.wait(world, 30.0)
    after_30_s_m = body.position_m[2]
    assert after_30_s_m < UP_M - 10
    physics_bench.wait(world, 30.0)
    assert body.position_m[2] < after_30_s_m - 10 or not body.airborne


@pytest.mark.parametrize("cause", ["motor", "battery", "disarmed"])
def test_a_plane_without_power_glides_eight_metres_forward_for_one_down(cause: str) -> None:
    world, body = physics_bench.lone_plane()
    body.fly_to(0, 3000, UP_M)
    physics_bench.wait(world, 20.0)
    if cause == "motor":
        world.dynamics.motors_lost[0] = 1
    elif cause == "battery":
        world.batteries.used_mah[0] = 1e6
    else:
        body.arm(False)
    physics_bench.wait(world, 8.0)
    before_m = body.position_m
    physics_bench.wait(world, 10.0)
    forward_m, down_m = body.position_m[1] - before_m[1], before_m[2] - body.position_m[2]
    assert forward_m / down_m == pytest.approx(8.0, rel=0.05)
    assert forward_m / 10 == pytest.approx(1.3 * 8.0, abs=0.3)  # best glide: 1.3 times the stall speed
    assert world.dynamics.throttle[0] == 0
    physics_bench.until(world, lambda: not body.airborne)
    assert body.take_touchdown_m_s() < 1.0  # after a flare
    assert not body.crashed


def test_a_plane_lands_along_a_slope_flares_and_rolls_out() -> None:
    world, body = physics_bench.lone_plane(wind=WindSettings(5.0, 90.0, 1.0))
    body.fly_to(0, -600, UP_M)
    physics_bench.until(world, lambda: body.reached)
    body.fly_to(0, -500, UP_M)
    physics_bench.wait(world, 15.0)
    body.land_at(0, 0)
    physics_bench.until(world, lambda: not body.airborne)
    assert from_centre_m(body) < 50
    assert body.take_touchdown_m_s() < 1.0
    assert math.hypot(*body.velocity_m_s[:2]) > 3
    body.rest()
    physics_bench.wait(world, 10.0)
    assert world.dynamics.velocity_m_s[0].tolist() == [0, 0, 0]
    assert body.position_m[2] == physics_bench.GROUND_M
    assert not body.crashed


def test_a_sinking_plane_continues_on_its_circle() -> None:
    world, body = physics_bench.lone_plane()
    body.move_vertically(-2.0)
    physics_bench.wait(world, 10.0)
    assert body.velocity_m_s[2] == pytest.approx(-2.0, abs=0.01)
    assert from_centre_m(body) == pytest.approx(60, abs=2)
    physics_bench.until(world, lambda: not body.airborne)
    assert body.take_touchdown_m_s() < 1.0


def test_a_velocity_is_a_course_and_a_climb() -> None:
    world, body = physics_bench.lone_plane(wind=WindSettings(5.0, 0.0))
    body.move((10.0, 0.0, 2.0))
    physics_bench.wait(world, 10.0)
    east, north, up = body.velocity_m_s
    assert math.degrees(math.atan2(east, north)) == pytest.approx(90, abs=1)
    assert up == pytest.approx(2.0, abs=1e-6)
    assert world.dynamics.airspeed_m_s[0] == pytest.approx(15.0, abs=1e-6)


def test_a_stopped_plane_circles_at_its_position() -> None:
    world, body = physics_bench.lone_plane()
    body.fly_to(0, 2000, UP_M)
    physics_bench.wait(world, 20.0)
    here_m = body.position_m[:2]
    body.stop()
    physics_bench.wait(world, 40.0)
    assert from_centre_m(body, here_m) == pytest.approx(60, abs=2)
    assert body.reached


def _limits_kept(world: World) -> None:
    m = world.dynamics
    for array in (m.position, m.velocity, m.attitude, m.rates_rad_s, m.specific_force_m_s2, m.throttle):
        assert np.isfinite(array).all()
    assert np.abs(m.attitude[0]).max() <= math.radians(45) + 1e-9
    assert m.velocity[2].max() <= 4.0 + 1e-9


NUMBERS = st.floats(-1e4, 1e4)


@settings(max_examples=examples(15, least=5))
@given(st.lists(st.tuples(st.integers(0, 6), NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=6))
def test_any_orders_keep_a_plane_within_its_limits(orders: list[tuple[int, float, float, float]]) -> None:
    world, body = physics_bench.lone_plane(None, wind=WindSettings(7.0, 120.0, 2.0))
    body.loiter(0, 0, UP_M)
    physics_bench.wait(world, 10.0)
    for kind, a, b, c in orders:
        if kind == 0:
            body.fly_to(a, b, c, 5.0)
        elif kind == 1:
            body.loiter(a, b, c, a)
        elif kind == 2:
            body.move((a, b, c), yaw_rad=a)
        elif kind == 3:
            body.stop()
        elif kind == 4:
            body.land_at(a, b)
        elif kind == 5:
            body.move_vertically(c / 1000)
        else:
            body.arm(a > 0)
        physics_bench.wait(world, 5.0, lambda: _limits_kept(world))
