"""The world as a whole: equal seeds, independent vehicles, events, and the wind."""

from collections.abc import Sequence

import numpy as np
import physics_bench
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.physics.body import Body
from sim_vehicle.physics.gps import GpsSettings
from sim_vehicle.physics.noise import BLOCK_ROWS, Normals
from sim_vehicle.physics.wind import GUST_TIME_S, WindSettings
from sim_vehicle.physics.world import World

WIND, GPS = WindSettings(5.0, 40.0, 1.5), GpsSettings()


def flown(planes: Sequence[bool], seeds: Sequence[int]) -> World:
    """Return a world after the same flight of each vehicle, by its seed."""
    world = physics_bench.world(len(planes), planes=planes, seeds=seeds, wind=WIND, gps=GPS)
    for index, seed in enumerate(seeds):
        make = physics_bench.plane if planes[index] else physics_bench.copter
        body = make(world, index, height_m=None)
        if planes[index]:
            body.loiter(10.0 * seed, 50.0, physics_bench.GROUND_M + 40)
        else:
            body.fly_to(10.0 * seed, 50.0, physics_bench.GROUND_M + 40)
    physics_bench.wait(world, 40.0)
    return world


def rows(world: World, index: int) -> list[list[float]]:
    m = world.dynamics
    return [
        array[index].tolist()
        for array in (
            m.position_m,
            m.velocity_m_s,
            m.attitude_rad,
            m.rates_rad_s,
            world.estimate_m,
            world.estimate_velocity_m_s,
            world.gps.position_m,
            world.wind.wind_m_s,
            np.column_stack([world.batteries.voltage_v, world.batteries.used_mah, m.airspeed_m_s]),
        )
    ]


@settings(max_examples=examples(6, least=2))
@given(st.lists(st.tuples(st.booleans(), st.integers(0, 50)), min_size=2, max_size=6))
def test_a_vehicle_flies_alike_alone_and_in_a_fleet(fleet: list[tuple[bool, int]]) -> None:
    together = flown([plane for plane, _ in fleet], [seed for _, seed in fleet])
    for index, (plane, seed) in enumerate(fleet):
        assert rows(together, index) == rows(flown([plane], [seed]), 0)


def test_draws_do_not_depend_on_the_number_of_generators() -> None:
    alone = Normals([np.random.default_rng(7)], 3)
    among = Normals([np.random.default_rng(seed) for seed in range(5, 75)], 3)
    for _ in range(3 * BLOCK_ROWS):
        assert alone.take()[:, 0].tolist() == among.take()[:, 2].tolist()


def happened(body: Body, world: World) -> bool:
    """Return True for an event, and consume it; a second call finds none."""
    shown, taken = bool(world.has_event[0]), body.take_events()
    assert shown == taken
    assert not body.take_events()
    return taken


def test_an_event_is_reported_once() -> None:
    world, body = physics_bench.lone_copter(None)
    physics_bench.wait(world, 1.0)
    assert not happened(body, world)
    body.fly_to(0, 0, physics_bench.GROUND_M + 10)
    physics_bench.wait(world, 0.1)
    assert happened(body, world)  # in the air
    physics_bench.wait(world, 1.0)
    assert not happened(body, world)
    physics_bench.until(world, lambda: body.reached)
    assert happened(body, world)
    physics_bench.wait(world, 5.0)
    assert not happened(body, world)
    body.move_vertically(-1.0)
    physics_bench.until(world, lambda: not body.airborne)
    assert happened(body, world)  # touchdown
    body.set_battery(capacity_mah=1.0, full_v=12.6)
    physics_bench.wait(world, 0.2)
    assert happened(body, world)  # empty


def test_invalid_limits_are_ignored_or_bounded() -> None:
    world, body = physics_bench.lone_plane(None)
    before = world.dynamics.speed_m_s[0]
    body.limit(
        speed_m_s=float("nan"), bank_limit_deg=float("inf"), acceptance_radius_m=-5.0, acceleration_m_s2=0.0
    )
    assert world.dynamics.speed_m_s[0] == before
    assert np.degrees(world.dynamics.bank_limit_rad[0]) == pytest.approx(45.0)
    assert world.dynamics.acceptance_radius_m[0] > 0
    assert world.dynamics.acceleration_limit_m_s2[0] > 0


@pytest.mark.parametrize("order", ["fly_to", "loiter", "land_at", "move"])
def test_an_invalid_position_is_no_order(order: str) -> None:
    world, body = physics_bench.lone_plane()
    before = rows(world, 0)
    nan = float("nan")
    if order == "move":
        body.move((nan, 0.0, 0.0))
    elif order == "land_at":
        body.land_at(nan, 0.0)
    else:
        getattr(body, order)(nan, 0.0, 0.0)
    assert rows(world, 0) == before
    physics_bench.wait(world, 5.0)
    assert np.isfinite(world.dynamics.position).all()


# -- wind ------------------------------------------------------------------------------------------------


def test_gusts_have_the_given_deviation_and_correlation_time() -> None:
    world = physics_bench.world(40, wind=WindSettings(5.0, 270.0, 2.0))
    history = []
    for _ in range(4000):
        world.wind.step(physics_bench.STEP_S)
        history.append(world.wind.wind_m_s[:, :2])
    gusts = np.array(history)[400:] - (5.0, 0.0)
    assert gusts.mean() == pytest.approx(0.0, abs=0.1)
    assert gusts.std() == pytest.approx(2.0, rel=0.05)
    later = round(GUST_TIME_S / physics_bench.STEP_S)
    kept = (gusts[later:] * gusts[:-later]).mean() / gusts.var()
    assert kept == pytest.approx(1 / np.e, abs=0.06)


def test_a_vehicle_may_have_its_own_wind_until_a_reset() -> None:
    world = physics_bench.world(2, wind=WindSettings(3.0, 0.0))
    first = physics_bench.copter(world, 0, height_m=None)
    first.set_wind(9.0, 90.0)
    physics_bench.wait(world, 20.0)
    assert world.wind.wind_m_s == pytest.approx(np.array([(-9, 0, 0), (0, -3, 0)]), abs=1e-6)
    assert world.wind.estimate == pytest.approx(world.wind.now)
    first.set_wind(None, 0.0)
    physics_bench.wait(world, 20.0)
    assert world.wind.wind_m_s == pytest.approx(np.array([(0, -3, 0)] * 2), abs=1e-6)


def test_no_airspeed_is_measured_on_the_ground() -> None:
    world = physics_bench.world(wind=WindSettings(6.0, 0.0))
    physics_bench.wait(world, 1.0)
    assert world.dynamics.airspeed_m_s[0] == 0
