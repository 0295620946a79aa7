"""Plans with a splice point ahead of the vehicle, over wires that lose, double and fail.

After any loss the vehicle follows one of the two plans or holds, and never flies back.
"""

from __future__ import annotations

from typing import Any

from flying_bench import BOTH, Faults, FlyingBench, wires
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from metric_plans import most_backwards_m, place, plan
from profiles import examples

from swarmctl.core.planar import PlanarPoint, distance_to_track

BACK_M = {"px4": 8.0, "ardupilot": 60.0}
"""Greatest way back around a corner [m].

An ArduCopter brakes and flies back if the order to turn at a corner arrives behind that corner.
"""
BESIDE_M = 8.0
OLD: list[PlanarPoint] = [(0.0, 60.0), (0.0, 120.0), (0.0, 900.0)]

outages = st.lists(
    st.tuples(st.floats(0.0, 8.0), st.sampled_from([0.5, 3.0, 9.0, 14.0])).map(lambda o: (o[0], o[0] + o[1])),
    max_size=2,
)

stalls = st.lists(
    st.tuples(st.floats(0.0, 8.0), st.sampled_from([1.0, 5.0, 20.0])).map(lambda s: (s[0], s[0] + s[1])),
    max_size=2,
)
"""(from, until) of stalls of the ground station, from the begin of the swap"""


@BOTH
@settings(
    deadline=None,
    derandomize=True,
    max_examples=examples(24, 4),
    suppress_health_check=list(HealthCheck),
    database=None,
)
@given(
    wire=wires,
    cuts=outages,
    stops=stalls,
    delay_s=st.sampled_from([0.0, 0.2, 1.0]),
    leaves_m=st.floats(20.0, 400.0),
)
def test_a_vehicle_follows_the_old_or_new_route_and_never_turns_back(
    personality: str,
    wire: Faults,
    cuts: list[tuple[float, float]],
    stops: list[tuple[float, float]],
    delay_s: float,
    leaves_m: float,
) -> None:
    bench = FlyingBench(personality).flying(plan(*OLD))
    bench.run(2.0)
    north_m = place(bench)[1] + leaves_m
    new = [(0.0, north_m), (80.0, north_m + 40.0), (80.0, north_m + 120.0), (150.0, 1200.0)]
    bench.delay_s = delay_s
    bench.spoil(wire, *cuts)
    bench.stalls = [(bench.now + begin, bench.now + end) for begin, end in stops]
    bench.begin_swap(plan(*new, leaves_ahead=True))
    norths_m: list[float] = []
    beside_m: list[float] = []

    def watch() -> bool:
        here = place(bench)
        norths_m.append(here[1])
        beside_m.append(min(distance_to_track(here, way) for way in ([(0.0, 0.0), *OLD], new)))
        return bench.session.busy_with is None or not bench.vehicle.armed

    assert bench.run(900.0, watch), "the swap does not end"
    bench.run(20.0, lambda: watch() and False)
    assert most_backwards_m(norths_m) < BACK_M[personality]
    assert max(beside_m) < BESIDE_M
    if bench.session.busy_with is None:
        result: Any = bench.result
        assert (result.failure is None) == (result.flying == "new")
        bench.heal()
        if bench.session.items:
            assert bench.holds(bench.session.items)
