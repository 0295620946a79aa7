"""Properties of the motion on any plan: kept limits, reached waypoints and soft landings."""

import math

import numpy as np
import physics_bench
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG, Station, land, takeoff, waypoint

Plan = list[tuple[int, int, int]]
PLANS = st.lists(
    st.tuples(st.integers(-150, 150), st.integers(-150, 150), st.integers(5, 60)), min_size=1, max_size=6
)
RADIUS_M, SPEED_M_S, ACCELERATION_M_S2 = 2.0, 10.0, 2.5


@settings(max_examples=examples(12, least=2), derandomize=True, deadline=None)
@given(PLANS)
def test_every_plan_is_flown_to_its_end_within_the_limits(plan: Plan) -> None:
    station = Station()
    station.fly_mission([takeoff(10), *(waypoint(*point) for point in plan), land(*plan[-1][:2])])
    nearest_m = [math.inf] * len(plan)
    highest_m = 0.0

    def watch() -> bool:
        nonlocal highest_m
        truth = station.fleet.truth()
        here = (
            (truth.lat_deg[0] - LAT_DEG) * 111_195,
            (truth.lon_deg[0] - LON_DEG) * 77_450,
            truth.height_m[0],
        )
        for i, point in enumerate(plan):
            nearest_m[i] = min(nearest_m[i], math.dist(here, point))
        highest_m = max(highest_m, truth.height_m[0])
        assert truth.speed_m_s[0] <= SPEED_M_S + 0.1
        return not station.armed

    station.until(watch, limit_s=900)
    assert [m.seq for m in station.of("MISSION_ITEM_REACHED")] == list(range(1, len(plan) + 2))
    assert max(nearest_m) <= 3 * RADIUS_M + 1.0
    assert highest_m <= max(10, *(point[2] for point in plan)) + 1.0
    assert [t for t in station.texts() if "Hit ground" in t] == ["SIM Hit ground at 0.50 m/s"]
    assert station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).mission_state == mavlink.MISSION_STATE_COMPLETE


@settings(max_examples=examples(8, least=3), derandomize=True, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_accelerations_stay_within_their_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 20
    world = physics_bench.world(n)
    fleet = [physics_bench.copter(world, index, height_m=None) for index in range(n)]
    for body in fleet:
        body.fly_to(0.0, 0.0, 400.0)
    physics_bench.until(world, lambda: all(body.reached for body in fleet))
    dynamics = world.dynamics

    def watch() -> None:
        change = dynamics.acceleration_m_s2
        assert np.hypot(change[:, 0], change[:, 1]).max() <= ACCELERATION_M_S2 + 1e-9
        assert np.abs(change[:, 2]).max() <= 1.0 + 1e-9
        speed = np.hypot(dynamics.velocity_m_s[:, 0], dynamics.velocity_m_s[:, 1])
        assert speed.max() <= SPEED_M_S + 0.01

    for _ in range(5):
        for body in fleet:
            east_m, north_m, up_m = rng.uniform((-200, -200, 360), (200, 200, 440))
            kind = rng.integers(4)
            if kind == 0:
                body.move(tuple(rng.uniform(-20, 20, 3).tolist()), yaw_rate_rad_s=float(rng.uniform(-3, 3)))
            elif kind == 1:
                body.stop()
            else:
                body.fly_to(east_m, north_m, up_m, float(rng.choice((0.0, 5.0, 10.0))))
        physics_bench.wait(world, 3.0, watch)
