"""Copter motion: set-points, yaw, tilt, wind, and failures."""

import math

import numpy as np
import physics_bench
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.physics.motion import GRAVITY_M_S2
from sim_vehicle.physics.wind import WindSettings


def test_a_velocity_is_reached_at_the_acceleration_limit_and_kept() -> None:
    world, body = physics_bench.lone_copter()
    body.move((3.0, 4.0, 1.0))
    took_s = physics_bench.until(world, lambda: math.hypot(*body.velocity_m_s[:2]) > 4.999)
    assert took_s == pytest.approx(5.0 / 2.5, abs=0.1)
    physics_bench.wait(world, 1.0)
    assert body.velocity_m_s == pytest.approx((3.0, 4.0, 1.0), abs=1e-6)


def test_a_velocity_above_the_limits_is_cut_and_keeps_its_direction() -> None:
    world, body = physics_bench.lone_copter()
    body.move((60.0, 80.0, -9.0))
    physics_bench.wait(world, 10.0)
    assert body.velocity_m_s == pytest.approx((6.0, 8.0, -1.5), abs=1e-6)


def test_a_copter_stops_within_the_braking_distance_and_stays() -> None:
    world, body = physics_bench.lone_copter()
    body.move((10.0, 0.0, 0.0))
    physics_bench.wait(world, 10.0)
    before_m = body.position_m[0]
    body.stop()
    physics_bench.wait(world, 15.0)
    assert body.position_m[0] - before_m == pytest.approx(10.0**2 / (2 * 2.5), abs=2.0)
    assert body.velocity_m_s == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize(("heading_deg", "rate_deg_s"), [(90.0, 30.0), (-90.0, 30.0), (170.0, 90.0)])
def test_a_copter_turns_to_a_heading_the_short_way_at_the_rate(heading_deg: float, rate_deg_s: float) -> None:
    world, body = physics_bench.lone_copter()
    body.face(math.radians(heading_deg), math.radians(rate_deg_s))
    physics_bench.wait(world, 1.0)
    assert math.degrees(world.dynamics.rates_rad_s[0, 2]) == pytest.approx(
        math.copysign(rate_deg_s, heading_deg)
    )
    physics_bench.wait(world, 7.0)
    assert math.degrees(body.heading_rad) == pytest.approx(heading_deg % 360, abs=0.01)
    assert world.dynamics.rates_rad_s[0] == pytest.approx((0, 0, 0), abs=1e-6)


def test_a_yaw_rate_lasts_until_the_next_order() -> None:
    world, body = physics_bench.lone_copter()
    body.move((0.0, 0.0, 0.0), yaw_rate_rad_s=0.5)
    physics_bench.wait(world, 10.0)
    assert body.heading_rad == pytest.approx(5.0, abs=0.1)
    body.face(None)
    physics_bench.wait(world, 5.0)
    assert world.dynamics.rates_rad_s[0, 2] == 0


def test_a_copter_faces_along_its_legs_by_default() -> None:
    world, body = physics_bench.lone_copter()
    body.fly_to(100.0, 0.0, physics_bench.GROUND_M + 50)
    physics_bench.wait(world, 3.0)
    assert math.degrees(body.heading_rad) == pytest.approx(90.0, abs=0.1)
    body.face(math.pi)
    body.fly_to(0.0, 100.0, physics_bench.GROUND_M + 50)
    physics_bench.wait(world, 3.0)
    assert math.degrees(body.heading_rad) == pytest.approx(180.0, abs=0.1)
    body.face(None)
    physics_bench.wait(world, 3.0)
    assert math.degrees(body.heading_rad) == pytest.approx(354.0, abs=3.0)  # from 10 m east


def test_tilt_follows_acceleration_and_drag_and_the_specific_force_follows_thrust() -> None:
    world, body = physics_bench.lone_copter()
    assert world.dynamics.attitude_rad[0, :2] == pytest.approx((0, 0), abs=1e-3)
    assert world.dynamics.specific_force_m_s2[0] == pytest.approx((0, 0, -GRAVITY_M_S2), abs=0.01)
    body.face(math.pi / 2)
    physics_bench.wait(world, 5.0)
    body.move((10.0, 0.0, 0.0))
    physics_bench.wait(world, 1.0)  # at 2.5 m/s, gaining 2.5 m/s2
    roll, pitch, _ = world.dynamics.attitude_rad[0]
    drag = 0.016 * 2.5**2
    assert pitch == pytest.approx(-math.atan2(2.5 + drag, GRAVITY_M_S2), abs=0.02)
    assert roll == pytest.approx(0, abs=1e-6)
    physics_bench.wait(world, 20.0)  # steady: only drag is left
    assert world.dynamics.attitude_rad[0, 1] == pytest.approx(-math.atan2(1.6, GRAVITY_M_S2), abs=1e-3)
    assert np.linalg.norm(world.dynamics.specific_force_m_s2[0]) == pytest.approx(GRAVITY_M_S2, abs=1e-6)


def test_a_copter_in_wind_tilts_and_holds_its_position() -> None:
    world, body = physics_bench.lone_copter(wind=WindSettings(10.0, 270.0))
    physics_bench.wait(world, 20.0)
    assert body.position_m == pytest.approx((0, 0, physics_bench.GROUND_M + 50), abs=0.1)
    # The copter faces north and tilts to the left, against wind from the west.
    assert world.dynamics.attitude_rad[0, 0] == pytest.approx(-math.atan2(1.6, GRAVITY_M_S2), abs=1e-3)
    assert world.dynamics.airspeed_m_s[0] == pytest.approx(10.0, abs=0.01)


def test_a_wind_above_the_tilt_limit_carries_a_copter_away() -> None:
    world, body = physics_bench.lone_copter()
    body.set_wind(30.0, 0.0)
    physics_bench.wait(world, 20.0)
    # The largest tilt is 40 degrees, which holds against sqrt(g tan(40 deg) / 0.016) = 22.7 m/s.
    assert body.velocity_m_s[1] == pytest.approx(
        -(30.0 - math.sqrt(GRAVITY_M_S2 * math.tan(0.698) / 0.016)), abs=0.1
    )


def test_gusts_move_a_copter_by_less_than_2_m() -> None:
    world = physics_bench.world(wind=WindSettings(6.0, 200.0, 2.0))
    body = physics_bench.copter(world)
    off_m = []
    physics_bench.wait(world, 60.0, lambda: off_m.append(math.hypot(*body.position_m[:2])))
    assert 0.01 < max(off_m) < 2.0


@pytest.mark.parametrize(("height_m", "contact_m_s"), [(3.0, math.sqrt(2 * 0.3 * 9.81 * 3.0)), (50.0, 8.0)])
def test_a_copter_without_one_motor_spins_and_sinks_ever_faster(height_m: float, contact_m_s: float) -> None:
    world, body = physics_bench.lone_copter(height_m)
    world.dynamics.motors_lost[0] = 1
    physics_bench.wait(world, 1.0)
    assert world.dynamics.rates_rad_s[0, 2] > math.radians(180)
    assert body.velocity_m_s[2] == pytest.approx(-0.3 * GRAVITY_M_S2, abs=0.3)
    physics_bench.until(world, lambda: not body.airborne)
    assert body.take_touchdown_m_s() == pytest.approx(contact_m_s, abs=0.3)
    assert body.crashed is (height_m > 5)


def test_a_copter_without_two_motors_falls_and_is_broken() -> None:
    world, body = physics_bench.lone_copter()
    world.dynamics.motors_lost[0] = 2
    took_s = physics_bench.until(world, lambda: not body.airborne)
    fall_s = 15.0 / GRAVITY_M_S2  # to terminal speed
    assert took_s == pytest.approx(fall_s + (50 - 15.0 * fall_s / 2) / 15.0, abs=0.2)
    assert body.crashed
    world.dynamics.motors_lost[0] = 0
    body.arm(True)
    body.fly_to(0, 0, physics_bench.GROUND_M + 20)
    physics_bench.wait(world, 5.0)
    assert not body.armed
    assert not body.airborne


def test_a_copter_with_restored_motors_returns_to_its_position() -> None:
    world, body = physics_bench.lone_copter()
    world.dynamics.motors_lost[0] = 1
    physics_bench.wait(world, 3.0)
    world.dynamics.motors_lost[0] = 0
    physics_bench.wait(world, 40.0)
    assert body.position_m == pytest.approx((0, 0, physics_bench.GROUND_M + 50), abs=0.1)


@pytest.mark.parametrize(("sink_m_s", "breaks"), [(4.9, False), (5.2, True)])
def test_a_contact_above_five_metres_a_second_breaks_a_copter(sink_m_s: float, breaks: bool) -> None:
    world, body = physics_bench.lone_copter()
    body.move_vertically(-sink_m_s)
    physics_bench.until(world, lambda: not body.airborne)
    assert body.crashed is breaks
    assert body.take_touchdown_m_s() == pytest.approx(sink_m_s, abs=0.01)
    assert body.take_touchdown_m_s() == 0


def test_a_copter_disarmed_in_the_air_falls_and_recovers_when_armed() -> None:
    world, body = physics_bench.lone_copter(100.0)
    body.limit(vertical_acceleration_m_s2=10.0)
    body.arm(False)
    physics_bench.wait(world, 1.0)
    assert body.velocity_m_s[2] == pytest.approx(-GRAVITY_M_S2, abs=0.01)
    body.arm(True)
    physics_bench.wait(world, 20.0)
    assert body.airborne
    assert body.velocity_m_s == pytest.approx((0, 0, 0), abs=1e-3)


NUMBERS = st.floats(-1e6, 1e6)


@settings(max_examples=examples(25))
@given(st.lists(st.tuples(st.integers(0, 5), NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=6))
@example([(3, 12.0, 3.0, 35.0), (0, 0.0, 120.0, 0.0), (5, 1.0, 0.0, 0.0)])  # tilts while its lift falls
def test_any_orders_keep_the_state_finite_and_within_limits(
    orders: list[tuple[int, float, float, float]],
) -> None:
    world, body = physics_bench.lone_copter(None, wind=WindSettings(8.0, 30.0, 3.0))
    body.fly_to(0, 0, physics_bench.GROUND_M + 30)
    for kind, a, b, c in orders:
        if kind == 0:
            body.fly_to(a, b, c, abs(a) % 20)
        elif kind == 1:
            body.move((a, b, c), yaw_rate_rad_s=a)
        elif kind == 2:
            body.face(a, b)
        elif kind == 3:
            body.limit(speed_m_s=a, acceleration_m_s2=b, descent_m_s=c, acceptance_radius_m=a, climb_m_s=b)
        elif kind == 4:
            body.stop()
        else:
            body.arm(a > 0)
        physics_bench.wait(world, 2.0)
        m = world.dynamics
        for array in (m.position, m.velocity, m.attitude, m.rates_rad_s, m.specific_force_m_s2, m.throttle):
            assert np.isfinite(array).all()
        assert np.abs(m.attitude[:2]).max() <= math.radians(41)
        assert abs(m.attitude[2, 0]) <= math.pi + 1e-9
        assert 0 <= m.throttle[0] <= 1
