"""Position estimates: noise, drift, glitches and loss of GPS, and their effects."""

import math

import numpy as np
import physics_bench
import pytest

from sim_vehicle.physics.gps import FIX, NO_FIX, GpsSettings
from sim_vehicle.physics.world import World


def truth_m(world: World, index: int = 0) -> tuple[float, float]:
    return float(world.dynamics.position[0, index]), float(world.dynamics.position[1, index])


def off_m(world: World, index: int = 0) -> float:
    return math.hypot(*truth_m(world, index))


def test_a_good_receivers_estimate_is_off_by_a_little() -> None:
    world = physics_bench.world(50, gps=GpsSettings())
    errors = []
    physics_bench.wait(world, 60.0, lambda: errors.append(world.estimate_m - world.dynamics.position_m))
    level = np.hypot(np.array(errors)[..., 0], np.array(errors)[..., 1])
    assert 0.02 < level.mean() < 0.15
    assert level.max() < 0.5
    assert np.abs(np.array(errors)[..., 2]).max() < 0.3


def test_the_receiver_has_the_noise_and_drift_of_its_settings() -> None:
    world = physics_bench.world(60, gps=GpsSettings(noise_m=2.0, drift_m=1.0))
    samples = []
    for _ in range(300):
        physics_bench.wait(world, 0.2)
        samples.append((world.gps.position_m - world.dynamics.position_m)[:, :2])
    array = np.array(samples)
    assert array.std() == pytest.approx(math.hypot(2.0, 1.0), rel=0.08)
    assert np.diff(array, axis=0).std() == pytest.approx(2.0 * math.sqrt(2), rel=0.05)
    estimate = (world.estimate_m - world.dynamics.position_m)[:, :2]
    assert estimate.std() < 1.6  # filtered: the drift stays, the noise goes


def test_a_copter_with_a_noisy_estimate_holds_its_position() -> None:
    world, body = physics_bench.lone_copter(gps=GpsSettings())
    speeds = []
    physics_bench.wait(world, 60.0, lambda: speeds.append(float(np.abs(world.dynamics.velocity[:, 0]).max())))
    assert off_m(world) < 0.5
    assert max(speeds) < 0.1
    assert body.airborne


def test_a_glitch_is_rejected_at_first_and_then_moves_the_vehicle() -> None:
    world, body = physics_bench.lone_copter()
    world.gps.offset_m[0] = (40.0, 0.0, 0.0)
    physics_bench.wait(world, 5.0)
    assert world.gps.position_m[0, 0] == pytest.approx(40.0, abs=0.5)
    assert off_m(world) < 1.0
    physics_bench.wait(world, 30.0)
    assert truth_m(world) == pytest.approx((-40.0, 0.0), abs=0.5)
    assert body.position_m[:2] == pytest.approx((0, 0), abs=0.5)
    world.gps.offset_m[0] = 0.0
    physics_bench.wait(world, 40.0)
    assert off_m(world) < 0.5


def test_a_glitch_does_not_change_the_barometric_height() -> None:
    world, body = physics_bench.lone_copter()
    world.gps.offset_m[0] = (0.0, 0.0, 30.0)
    physics_bench.wait(world, 30.0)
    assert world.gps.position_m[0, 2] - world.dynamics.position_m[0, 2] == pytest.approx(30.0)
    assert body.alt_amsl_m == pytest.approx(physics_bench.GROUND_M + 50, abs=0.1)


def test_a_copter_without_gps_dead_reckons_drifts_and_loses_its_position() -> None:
    world, body = physics_bench.lone_copter()
    body.take_events()
    world.gps.lost[0] = True
    physics_bench.wait(world, 7.0)
    assert (body.gps_fix, body.position_ok) == (False, True)
    assert world.gps.fix_type[0] == NO_FIX
    assert not body.take_events()
    after_7_s_m = off_m(world)
    physics_bench.wait(world, 2.0)
    assert not world.position_ok[0]
    assert body.take_events()
    physics_bench.wait(world, 30.0)
    assert off_m(world) > 5 * after_7_s_m > 0
    world.gps.lost[0] = False
    physics_bench.wait(world, 0.5)
    assert world.position_ok[0]
    assert body.take_events()
    assert world.gps.fix_type[0] == FIX
    physics_bench.wait(world, 40.0)
    assert off_m(world) < 0.5


def test_estimated_and_true_positions_agree_with_the_map() -> None:
    world, body = physics_bench.lone_copter()
    world.gps.offset_m[0] = (3.0, 0.0, 0.0)
    physics_bench.wait(world, 60.0)
    lat_deg, lon_deg = world.geodetic()
    estimated_lat_deg, estimated_lon_deg = world.estimated_geodetic()
    assert body.lat_lon_deg == (estimated_lat_deg[0], estimated_lon_deg[0])
    east_m = (lon_deg[0] - estimated_lon_deg[0]) * 111_320 * math.cos(math.radians(physics_bench.LAT_DEG))
    assert east_m == pytest.approx(-3.0, abs=0.1)
    assert lat_deg[0] == pytest.approx(estimated_lat_deg[0], abs=1e-6)
    gps_lat_deg, gps_lon_deg = world.gps.geodetic()
    assert (gps_lat_deg[0], gps_lon_deg[0]) == pytest.approx(
        (estimated_lat_deg[0], estimated_lon_deg[0]), abs=1e-6
    )
