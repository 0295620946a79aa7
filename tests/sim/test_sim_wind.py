"""Wind: the strength of its gusts, and winds of single vehicles."""

import numpy as np
import physics_bench
import pytest

from sim_vehicle.physics.wind import GUST_TIME_S, WindSettings


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
