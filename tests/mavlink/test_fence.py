"""The geofence on both autopilots: uploaded, read back equal, or not believed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
from fleet_bench import PLACE, FleetBench
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmctl.mavlink.fence import MAX_VERTICES, fence_differences, fence_items, put_fence, read_fence
from swarmctl.mavlink.mission_download import DownloadOutcome

BOTH = pytest.mark.parametrize("personality", ["ardupilot", "px4"])
LAT, LON = PLACE
SQUARE = (
    (LAT - 0.01, LON - 0.01),
    (LAT - 0.01, LON + 0.01),
    (LAT + 0.01, LON + 0.01),
    (LAT + 0.01, LON - 0.01),
)
TRIANGLE = ((LAT - 0.02, LON), (LAT + 0.01, LON + 0.02), (LAT + 0.01, LON - 0.02))


def put(bench: FleetBench, polygon) -> str | None:
    return bench.do("put fence", partial(put_fence, items=fence_items(polygon))).failure


def keeps(bench: FleetBench, polygon) -> bool:
    """Whether that is the fence by the vehicle's own memory."""
    found = [(item.x, item.y) for item in bench.vehicle.fence.items]
    return found == [(round(lat * 1e7), round(lon * 1e7)) for lat, lon in polygon]


@BOTH
def test_a_fence_is_uploaded_and_read_back_equal(personality):
    bench = FleetBench(personality)
    assert put(bench, SQUARE) is None
    assert keeps(bench, SQUARE)
    assert bench.vehicle.fence.zones[0].inclusion
    found = bench.do("read fence", read_fence)
    assert found.outcome is DownloadOutcome.COMPLETE
    assert fence_differences(fence_items(SQUARE), found.items) == ()


@BOTH
def test_the_mission_is_not_touched(personality):
    bench = FleetBench(personality)
    before = bench.vehicle.mission.count
    assert put(bench, TRIANGLE) is None
    assert bench.vehicle.mission.count == before


@BOTH
def test_a_fence_replaces_the_one_before(personality):
    bench = FleetBench(personality)
    assert put(bench, SQUARE) is None
    assert put(bench, TRIANGLE) is None
    assert keeps(bench, TRIANGLE)


@BOTH
def test_a_vehicle_that_refuses_is_not_believed(personality):
    bench = FleetBench(personality, faults=("mission_refused:result=no_space",))
    assert "upload rejected: NO_SPACE" in put(bench, SQUARE)


@BOTH
def test_no_fence_goes_up_to_an_armed_vehicle(personality):
    bench = FleetBench(personality)
    bench.vehicle.body.arm(True)
    bench.run(2.0)
    sent = len(bench.sent)
    assert "it is armed" in put(bench, SQUARE)
    assert len(bench.sent) == sent


def test_another_fence_differs():
    sent = fence_items(SQUARE)
    assert fence_differences(sent, sent) == ()
    assert fence_differences(sent, sent[:3]) == ("3 items instead of 4",)
    (gap,) = fence_differences(sent, (*sent[:3], replace(sent[3], x=sent[3].x + 1)))
    assert gap.startswith("vertex 3: sent (46.059")
    (gap,) = fence_differences(sent, (replace(sent[0], command=5002), *sent[1:]))
    assert "of command 5002" in gap, "to stay out of is not to stay inside of"


def test_what_no_vehicle_would_keep_is_not_sent():
    with pytest.raises(ValueError, match="2 vertices: expected 3 to 60"):
        fence_items(SQUARE[:2])
    with pytest.raises(ValueError, match="61 vertices"):
        fence_items([(LAT, LON + i / 1e4) for i in range(MAX_VERTICES + 1)])


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    loss=st.floats(0.0, 0.4), seed=st.integers(0, 10_000), personality=st.sampled_from(["ardupilot", "px4"])
)
def test_over_a_bad_link_success_is_never_claimed_wrongly(loss, seed, personality):
    bench = FleetBench(personality, loss=loss, seed=seed)
    if put(bench, SQUARE) is None:
        assert keeps(bench, SQUARE)
