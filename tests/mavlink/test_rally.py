"""Number of a vehicle's rally points, where a return may end: reported or unknown."""

from __future__ import annotations

from typing import Any

import pytest
from flying_bench import BOTH, HOME, FlyingBench, on_the_ground
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures.rally import RALLY, RallyPoints, count_rally_points

POINT = mavlink.MAV_CMD_NAV_RALLY_POINT


def counted(bench: FlyingBench) -> RallyPoints:
    return bench.do("rally points", count_rally_points)


def another_uploads(bench: FlyingBench, n: int, announced: int | None = None) -> None:
    """Send `n` rally points from another ground station that announces `announced`."""
    bench.another_sends(mavlink.MAVLink_mission_count_message(1, 1, announced or n, RALLY))
    lat, lon = (round(degrees * 1e7) for degrees in HOME)
    for seq in range(n):
        place = (lat + 1000 * (seq + 1), lon, 40.0, RALLY)
        bench.another_sends(
            mavlink.MAVLink_mission_item_int_message(1, 1, seq, 3, POINT, 0, 1, 0, 0, 0, 0, *place)
        )


@BOTH
@pytest.mark.autopilots("2 types 2 / 3 / 255")
@pytest.mark.autopilots("2 types 2 / 3 / 255", of="px4")
def test_the_number_of_rally_points_is_reported(personality: str) -> None:
    bench = on_the_ground(personality)
    assert counted(bench) == RallyPoints(0)
    another_uploads(bench, 3)
    assert counted(bench) == RallyPoints(3)
    # The items are not requested, so PX4 stays free for the next transfer.
    assert bench.of("MISSION_REQUEST_INT") == []
    another_uploads(bench, 1)
    assert counted(bench) == RallyPoints(1)


def without_rally_points(personality: str) -> FlyingBench:
    """Return a vehicle whose firmware answers UNSUPPORTED."""
    bench = on_the_ground(personality)
    answer = mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_UNSUPPORTED, RALLY)

    def replace(message: Any) -> bool:
        is_count = message.get_type() == "MISSION_COUNT"
        if is_count:
            bench.vehicle.send(answer)
        return is_count

    bench.block_down = replace
    return bench


def test_an_ardupilot_built_without_rally_points_has_none() -> None:
    """ArduPilot answers UNSUPPORTED (`GCS_MAVLINK::handle_mission_request_list`)."""
    assert counted(without_rally_points("ardupilot")) == RallyPoints(0)


def test_an_unsupported_answer_of_px4_is_not_a_number() -> None:
    """Each build of PX4 has rally points."""
    counts = counted(without_rally_points("px4"))
    assert counts.count is None
    assert counts.failure.endswith("UNSUPPORTED")


@BOTH
def test_a_lost_answer_gives_no_number(personality: str) -> None:
    bench = on_the_ground(personality)
    bench.block_down = lambda m: m.get_type() == "MISSION_COUNT"
    begun_s = bench.now
    found = counted(bench)
    assert found.count is None
    assert found.failure.endswith("no answer")
    assert bench.now - begun_s == pytest.approx(12.0, abs=0.5)
    bench.block_down = lambda m: False
    assert counted(bench) == RallyPoints(0)


def test_an_answer_to_another_station_or_about_another_list_does_not_count() -> None:
    bench = on_the_ground("ardupilot")
    bench.block_down = lambda m: m.get_type() == "MISSION_COUNT" and m.target_system == 255
    other = mavlink.MAVLink_mission_request_list_message
    for kind in (RALLY, mavlink.MAV_MISSION_TYPE_MISSION):
        bench.another_sends(other(1, 1, mission_type=kind))
    assert counted(bench).count is None


def test_the_count_is_requested_again_while_another_station_uploads() -> None:
    """DENIED while an upload runs (`MissionItemProtocol::handle_mission_request_list`)."""
    bench = on_the_ground("ardupilot")
    another_uploads(bench, 1, announced=2)
    assert counted(bench) == RallyPoints(1), "the upload is not atomic: the first point stays"
