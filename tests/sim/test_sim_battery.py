"""Batteries: charge and voltage follow the load, and endurance the flight."""

import numpy as np
import physics_bench
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.physics.wind import WindSettings
from sim_vehicle.physics.world import AVIONICS_W, Batteries


def endurance_s(load_w: float, capacity_mah: float = 3300.0) -> float:
    batteries = Batteries(1)
    batteries.capacity_mah[:] = capacity_mah
    seconds = 0.0
    while not batteries.empty()[0]:
        batteries.step(1.0, np.array([load_w]))
        seconds += 1.0
    return seconds


def test_endurance_is_energy_over_load() -> None:
    # 3.3 Ah at a mean resting voltage of about 0.9 * 12.6 V, minus what the resistance eats.
    seconds = endurance_s(165.0 - AVIONICS_W)
    current_a = 165.0 / (0.9 * 12.6)
    energy_j = 3.3 * 3600 * (0.905 * 12.6 - 0.02 * current_a)
    assert seconds == pytest.approx(energy_j / 165.0, rel=0.02)


def test_the_current_rises_as_the_voltage_falls() -> None:
    batteries = Batteries(1)
    load = np.array([160.0])
    batteries.step(0.1, load)
    batteries.step(0.1, load)
    full_a = float(batteries.current_a[0])
    assert batteries.voltage_v[0] == pytest.approx(12.6 - 0.02 * full_a, abs=0.01)
    batteries.used_mah[:] = 0.95 * batteries.capacity_mah
    batteries.step(0.1, load)
    batteries.step(0.1, load)
    assert batteries.current_a[0] > 1.15 * full_a
    assert batteries.voltage_v[0] == pytest.approx(12.6 * 0.81 - 0.02 * batteries.current_a[0], abs=0.02)


def test_a_sag_is_missing_from_the_voltage_and_not_from_the_charge() -> None:
    batteries = Batteries(2)
    batteries.sag_v[1] = 1.5
    for _ in range(10):
        batteries.step(0.1, np.array([100.0, 100.0]))
    assert batteries.voltage_v[0] - batteries.voltage_v[1] == pytest.approx(1.5, abs=0.05)
    assert batteries.remaining[0] == pytest.approx(batteries.remaining[1], abs=1e-3)


@settings(max_examples=examples(30))
@given(st.lists(st.floats(0.0, 2000.0), min_size=1, max_size=50), st.floats(1.0, 6000.0))
def test_charge_never_increases_and_all_values_stay_in_range(
    loads_w: list[float], capacity_mah: float
) -> None:
    batteries = Batteries(1)
    batteries.capacity_mah[:] = capacity_mah
    before = 1.0
    for load_w in loads_w:
        batteries.step(1.0, np.array([load_w]))
        assert 0.0 <= batteries.remaining[0] <= before
        assert 0.0 <= batteries.voltage_v[0] <= 12.6
        before = float(batteries.remaining[0])
    assert batteries.used_j[0] == pytest.approx(sum(loads_w) + AVIONICS_W * len(loads_w))


def used_mah(manoeuvre: str, wind: WindSettings | None = None) -> float:
    """Charge that half a minute of a manoeuvre takes."""
    world, body = physics_bench.lone_copter(wind=wind)
    east, north, up = body.position_m
    if manoeuvre == "climb":
        body.fly_to(east, north, up + 200)
    elif manoeuvre == "fast":
        body.fly_to(east + 2000, north, up)
    physics_bench.wait(world, 5.0)
    before_mah = body.used_mah
    physics_bench.wait(world, 30.0)
    return body.used_mah - before_mah


def test_climbing_speed_and_wind_take_more_charge_than_hovering() -> None:
    hover = used_mah("hover")
    assert hover == pytest.approx(15.5 * 30 / 3.6, rel=0.05)  # about 15 A
    assert used_mah("climb") > 1.2 * hover
    assert used_mah("fast") > 1.1 * hover
    assert used_mah("hover", WindSettings(12.0, 90.0)) > 1.15 * hover


def test_a_circling_plane_takes_less_charge_than_a_hovering_copter() -> None:
    _, circling = physics_bench.lone_plane()
    assert circling.current_a < 10
    world, straight = physics_bench.lone_plane()
    straight.fly_to(0, 3000, physics_bench.GROUND_M + 50)
    physics_bench.wait(world, 20.0)
    assert straight.current_a < circling.current_a  # lift for a turn has its drag


def test_armed_motors_idle_and_disarmed_motors_rest() -> None:
    world = physics_bench.world()
    physics_bench.wait(world, 0.5)
    body = physics_bench.copter(world, height_m=None)
    resting_a = body.current_a
    physics_bench.wait(world, 0.5)
    assert resting_a == pytest.approx(AVIONICS_W / 12.6, rel=0.01)
    assert body.current_a - resting_a == pytest.approx(16.0 / 12.6, rel=0.01)
