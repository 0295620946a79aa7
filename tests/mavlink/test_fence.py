"""The geofence on both autopilots: uploaded, and reported only if read back equal."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

import pytest
from flying_bench import BOTH, HOME, FlyingBench, on_the_ground, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.records import replace
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.fence import (
    MAX_VERTICES,
    enable_fence,
    fence_differences,
    fence_items,
    put_fence,
    read_fence,
)
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome

LAT, LON = HOME
SQUARE = (
    (LAT - 0.01, LON - 0.01),
    (LAT - 0.01, LON + 0.01),
    (LAT + 0.01, LON + 0.01),
    (LAT + 0.01, LON - 0.01),
)


def put(bench: FlyingBench, polygon) -> str | None:
    return bench.do("put fence", partial(put_fence, items=fence_items(polygon))).failure


def keeps(bench: FlyingBench, polygon) -> bool:
    """Return true if the vehicle's own memory holds this fence."""
    found = [(item.x, item.y) for item in bench.vehicle.fence.items]
    return found == [(round(lat * 1e7), round(lon * 1e7)) for lat, lon in polygon]


@BOTH
@pytest.mark.autopilots("2 fence")
@pytest.mark.autopilots("2 fence", of="px4")
def test_a_fence_is_uploaded_and_read_back_equal(personality):
    bench = on_the_ground(personality)
    assert put(bench, SQUARE) is None
    assert keeps(bench, SQUARE)
    assert bench.vehicle.fence.zones[0].inclusion
    found = bench.do("read fence", read_fence)
    assert found.outcome is DownloadOutcome.COMPLETE
    assert fence_differences(fence_items(SQUARE), found.items) == ()


@BOTH
def test_a_refused_fence_is_not_reported_as_enforced(personality):
    bench = on_the_ground(personality)
    bench.inject("mission_refused:result=no_space")
    assert "upload rejected: NO_SPACE" in put(bench, SQUARE)


@BOTH
def test_no_fence_goes_up_to_an_armed_vehicle(personality):
    bench = on_the_ground(personality)
    bench.vehicle.body.arm(True)
    bench.run(2.0)
    sent = len(bench.sent)
    assert "[armed]" in put(bench, SQUARE)
    assert len(bench.sent) == sent


@BOTH
@pytest.mark.autopilots("2 fence")
@pytest.mark.autopilots("2 fence", of="px4")
def test_a_fence_with_a_wrong_vertex_count_differs(personality):
    """ArduPilot refuses such a fence at the end of the upload. PX4 accepts it, with unknown effect."""
    bench = on_the_ground(personality)
    items = tuple(replace(item, param1=6.0) for item in fence_items(SQUARE))
    failure = bench.do("put fence", partial(put_fence, items=items)).failure
    assert (failure is None) == (personality == "px4")
    found = bench.do("read fence", read_fence)
    assert found.outcome is DownloadOutcome.COMPLETE
    assert fence_differences(fence_items(SQUARE), found.items) != ()


@pytest.mark.full
@BOTH
@pytest.mark.autopilots("2 fence use")
def test_a_vehicle_that_returns_from_its_fence_gets_no_new_mission(personality):
    """The autopilot accepts a mission that leads outside; a command after the breach would end its return."""
    fenced = {
        "ardupilot": {"FENCE_ENABLE": 1, "FENCE_TYPE": 4, "FENCE_ACTION": 1},
        "px4": {"GF_ACTION": 3},
    }
    bench = FlyingBench(personality, params=fenced[personality])
    near = tuple(
        (LAT + north / 1000, LON + east / 1000) for north, east in ((-1, -1), (-1, 1), (2, 1), (2, -1))
    )
    bench.prepared()
    assert put(bench, near) is None
    assert bench.upload(plan(north=12)).failure is None
    assert bench.do("launch", basic.launch).failure is None
    assert bench.run(120, lambda: bench.session.state.mode_role == "return")
    sent = len(bench.sent)
    result = bench.swap(plan(north=12, east=0.0005))
    assert result.flying == "theirs"
    assert len(bench.sent) == sent
    assert bench.run(200, lambda: not bench.session.state.armed)
    assert bench.vehicle.body.lat_lon_deg == pytest.approx(HOME, abs=2e-5)


def another_station_sets(name: str, value: float) -> Callable[[FlyingBench], None]:
    return lambda bench: bench.another_sets(**{name: value})


def another_station_disables(bench: FlyingBench) -> None:
    bench.another_commands(mavlink.MAV_CMD_DO_FENCE_ENABLE, 0.0)


ON_THE_GROUND = [
    # Action on the ground, FENCE_TYPE at boot, and whether the ceiling counts while the fence is disabled.
    pytest.param(another_station_sets("FENCE_TYPE", 5.0), 4.0, False, id="FENCE_TYPE with the fence enabled"),
    pytest.param(another_station_disables, 5.0, False, id="DO_FENCE_ENABLE 0"),
    pytest.param(lambda _: None, 5.0, True, id="nothing"),
]


@pytest.mark.parametrize("enforced", [False, True])
@pytest.mark.parametrize(("action", "at_boot", "counts_anyway"), ON_THE_GROUND)
@pytest.mark.autopilots("2 fence use")
def test_the_fence_limits_in_the_parameters_are_enforced(action, at_boot, counts_anyway, enforced):
    """ArduPilot applies FENCE_TYPE when the fence is enabled; all cases read back the same (`AC_Fence`)."""
    params = {"FENCE_ENABLE": 1, "FENCE_TYPE": at_boot, "FENCE_ACTION": 1, "FENCE_ALT_MAX": 12}
    bench = FlyingBench("ardupilot", params=params).prepared()
    action(bench)
    assert (bench.params["FENCE_ENABLE"], bench.params["FENCE_TYPE"]) == (1.0, 5.0)
    if enforced:
        assert bench.do("enable fence", enable_fence).failure is None
    assert bench.upload(plan(north=4)).failure is None
    assert bench.do("launch", basic.launch).failure is None
    turned_back = bench.run(30, lambda: bench.session.state.mode_role == "return")
    assert turned_back is (enforced or counts_anyway)


def test_a_fence_is_enabled_on_the_ground_only_and_with_an_acknowledgement():
    bench = on_the_ground("ardupilot")
    bench.block_down = lambda m: m.get_type() == "COMMAND_ACK"
    assert "DO_FENCE_ENABLE: no answer" in bench.do("enable fence", enable_fence).failure
    bench.vehicle.body.arm(True)
    bench.run(2.0)
    sent = len(bench.sent)
    assert "[armed]" in bench.do("enable fence", enable_fence).failure
    assert len(bench.sent) == sent


def test_a_different_fence_is_a_difference():
    sent = fence_items(SQUARE)
    assert fence_differences(sent, sent) == ()
    (gap,) = fence_differences(sent, sent[:3])
    assert re.findall(r"\d+", gap) == ["3", "4"]
    (gap,) = fence_differences(sent, (*sent[:3], replace(sent[3], x=sent[3].x + 1)))
    assert gap.startswith("vertex 3: sent (46.059")
    (gap,) = fence_differences(sent, (replace(sent[0], command=5002), *sent[1:]))
    assert "command 5002" in gap, "inclusion and exclusion fences differ"


def test_an_impossible_fence_is_not_sent():
    with pytest.raises(ValueError, match=r"\b2\b.* 3 to 60"):
        fence_items(SQUARE[:2])
    with pytest.raises(ValueError, match=r"\b61\b"):
        fence_items([(LAT, LON + i / 1e4) for i in range(MAX_VERTICES + 1)])
