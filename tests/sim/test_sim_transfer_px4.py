"""The mission protocol of PX4 1.15, message by message."""

import math
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from transfer_bench import (
    CIRCLE,
    EXCLUDED,
    FENCE,
    MISSION,
    POLYGON,
    RALLY,
    RALLY_POINT,
    ardupilot,
    fields,
    kinds,
    px4,
    requests,
    results,
    square,
    waypoints,
)

from sim_vehicle.vehicle.injected_faults import MissionRefusal

OTHER = (254, 190)
ACCEPTED, ERROR = 0, 1


@pytest.mark.autopilots("2 requests", of="px4")
def test_the_first_request_is_a_legacy_one() -> None:
    bench = px4()
    assert kinds(bench.count(3)) == ["MISSION_REQUEST"]
    assert kinds(bench.item(fields(0))) == ["MISSION_REQUEST_INT"]
    bench.item(fields(1))
    bench.item(fields(2))
    assert kinds(bench.count(1)) == ["MISSION_REQUEST_INT"]
    bench.machine.reset()
    assert kinds(bench.count(1)) == ["MISSION_REQUEST"]


@pytest.mark.autopilots("2 re-upload in AUTO", "2 shorter mission", of="px4")
def test_a_shorter_mission_moves_the_index_to_its_last_item_and_a_marked_one_there() -> None:
    bench = px4()
    bench.upload(waypoints(8))
    bench.mission.set_current(bench.pilot, 5)
    bench.upload(waypoints(3))
    assert bench.mission.index == 2
    bench.upload([fields(0), fields(1, current=1, z=9.0), fields(2)])
    assert bench.mission.index == 1


def test_the_same_mission_again_changes_nothing() -> None:
    bench = px4()
    bench.upload(waypoints(3))
    before = bench.mission.items[0]
    bench.mission.set_current(bench.pilot, 2)
    assert bench.upload(waypoints(3)) == ACCEPTED
    assert bench.mission.items[0] is before
    assert bench.mission.index == 2


@pytest.mark.autopilots("2 second GCS / download during upload", of="px4")
def test_another_count_during_an_upload_is_an_error_except_at_item_0() -> None:
    bench = px4()
    bench.count(4)
    assert requests(bench.count(2)) == [0]
    for seq in range(3):
        assert requests(bench.item(fields(seq))) == [seq + 1]
        assert results(bench.count(2)) == [ERROR]
        assert results(bench.count(2, peer=OTHER)) == [ERROR]
    assert results(bench.item(fields(3))) == [ACCEPTED]
    assert bench.mission.count == 4


@pytest.mark.autopilots("2 wrong / duplicate item", of="px4")
def test_a_wrong_item_is_ignored_in_an_upload_and_an_error_after_it() -> None:
    bench = px4()
    bench.count(3)
    for seq in (0, 2, 1):
        assert results(bench.item(fields(seq))) == []
    assert results(bench.item(fields(2))) == [ACCEPTED]
    assert results(bench.item(fields(1))) == [ERROR]
    assert bench.texts == ["IGN MISSION_ITEM: No transfer"]


@pytest.mark.autopilots("2 error codes", of="px4")
def test_counts_beyond_the_storage_are_refused() -> None:
    bench = px4()
    assert results(bench.count(65_535)) == [mavlink.MAV_MISSION_NO_SPACE]
    assert results(bench.count(129, FENCE)) == [mavlink.MAV_MISSION_NO_SPACE]


@pytest.mark.autopilots("2 read-back", of="px4")
def test_a_nan_altitude_autocontinue_and_coordinates_are_kept() -> None:
    bench = px4()
    sent = [
        fields(0, frame=3, z=math.nan),
        fields(1, frame=5, autocontinue=0),
        fields(2, command=178, frame=2, param1=1.0, param2=7.5, x=3, y=4, z=5.5),
    ]
    assert bench.upload(sent) == ACCEPTED
    kept = bench.download()
    assert [m.frame for m in kept] == [6, 5, 2]
    assert [m.autocontinue for m in kept] == [1, 0, 1]
    assert math.isnan(kept[0].z)
    assert (kept[2].param2, kept[2].x, kept[2].y, kept[2].z) == (7.5, 3, 4, 5.5)
    assert [m.current for m in kept] == [1, 0, 0]


@pytest.mark.autopilots("2 MISSION_SET_CURRENT", of="px4")
def test_mission_set_current_reports_failures() -> None:
    bench = px4()
    bench.upload(waypoints(4))
    bench.send(mavlink.MAVLink_mission_set_current_message(1, 1, 4))
    bench.count(2)
    bench.send(mavlink.MAVLink_mission_set_current_message(1, 1, 1))
    assert bench.texts == ["WPM: WP CURR CMD: Not in list", "WPM: IGN WP CURR CMD: Busy"]


@pytest.mark.autopilots("2 fence", of="px4")
def test_a_fence_in_frame_3_is_read_back_in_frame_5() -> None:
    bench = px4()
    circle = fields(4, CIRCLE, frame=3, param1=50.5)
    assert bench.upload([*square(frame=3), circle], FENCE) == ACCEPTED
    kept = bench.download(FENCE)
    assert [(m.command, m.frame, m.param1, m.autocontinue) for m in kept] == [
        *[(POLYGON, 5, 4.0, 0)] * 4,
        (CIRCLE, 5, 50.5, 0),
    ]
    assert all(m.mission_type == FENCE for m in kept)
    assert bench.calls[-1] == ("changed", FENCE)


@pytest.mark.autopilots("2 fence", of="px4")
def test_a_fence_with_a_wrong_vertex_count_bounds_nothing() -> None:
    bench = px4()
    assert bench.upload(square(vertices=6), FENCE) == ACCEPTED
    assert bench.fence.zones == ()


@pytest.mark.autopilots("2 types 2 / 3 / 255", of="px4")
def test_rally_points_are_kept_with_their_frame() -> None:
    bench = px4()
    sent = [fields(seq, RALLY_POINT, frame=frame) for seq, frame in enumerate((3, 0))]
    assert bench.upload(sent, RALLY) == ACCEPTED
    kept = bench.download(RALLY)
    assert [(m.command, m.frame, m.z) for m in kept] == [(RALLY_POINT, 6, 20.0), (RALLY_POINT, 5, 20.0)]


@pytest.mark.autopilots("2 types 2 / 3 / 255", of="px4")
def test_clear_all_clears_every_list() -> None:
    bench = px4()
    bench.upload(waypoints(3))
    bench.upload(square(), FENCE)
    bench.upload([fields(0, RALLY_POINT)], RALLY)
    assert 0 not in bench.machine.ids
    assert bench.clear(255) == [ACCEPTED]
    assert [len(bench.download(kind)) for kind in (MISSION, FENCE, RALLY)] == [0, 0, 0]
    assert bench.machine.ids == (0, 0, 0)


def test_a_mission_count_of_0_leaves_the_fence() -> None:
    bench = px4()
    bench.upload(waypoints(3))
    bench.upload(square(EXCLUDED), FENCE)
    assert results(bench.count(0)) == [ACCEPTED]
    assert len(bench.download(FENCE)) == 4


def test_ack_and_count_have_the_same_opaque_id() -> None:
    bench = px4()
    bench.count(2)
    bench.item(fields(0))
    sent: list[Any] = []
    bench.machine._send = sent.append
    bench.item(fields(1))
    bench.ask_list()
    codec = mavlink.MAVLink(None)
    ack, count = (message.pack(codec) for message in sent)
    (mission_id, _, _) = bench.machine.ids
    assert mission_id != 0
    assert ack[10:-2] == bytes([255, 190, 0, 0]) + struct.pack("<I", mission_id)
    assert count[10:-2] == struct.pack("<HBBB", 2, 255, 190, 0) + struct.pack("<I", mission_id)


def test_equal_lists_have_equal_ids_and_different_lists_do_not() -> None:
    one, two, three = px4(), px4(), px4()
    one.upload(waypoints(4))
    two.upload(waypoints(4))
    three.upload(waypoints(4, z=21.0))
    assert one.machine.ids == two.machine.ids != three.machine.ids


def test_a_ground_station_can_reject_legacy_requests() -> None:
    bench = px4()
    assert kinds(bench.count(2)) == ["MISSION_REQUEST"]
    assert kinds(bench.ack(mavlink.MAV_MISSION_UNSUPPORTED)) == ["MISSION_REQUEST_INT"]


def test_a_download_asks_in_order_and_an_unexpected_request_ends_it() -> None:
    bench = px4()
    bench.upload(waypoints(3))
    bench.ask_list()
    for seq in (0, 0, 1):
        assert [m.seq for m in bench.read(seq)] == [seq]
    assert results(bench.read(0)) == [ERROR]
    assert bench.texts == ["WPM: REJ. CMD: Req. WP was unexpected"]
    assert bench.read(0) == []  # no transfer: silence


def test_a_second_ground_station_is_rejected_with_a_text() -> None:
    bench = px4()
    bench.count(2)
    assert bench.item(fields(0), peer=OTHER) == []
    assert bench.read(0, peer=OTHER) == []
    bench.ack(15, peer=OTHER)
    assert bench.texts == [
        "REJ. MIS ITEM: partner id mismatch",
        "WPM: REJ. CMD: partner id mismatch",
        "REJ. WP CMD: partner id mismatch",
    ]
    assert bench.upload(waypoints(2)) == ACCEPTED


def test_a_count_during_a_download_is_busy_until_the_ground_station_acknowledges() -> None:
    bench = px4()
    bench.upload(waypoints(2))
    bench.ask_list()
    assert results(bench.count(2)) == [ERROR]
    bench.read(0)
    bench.read(1)
    bench.ack()
    assert requests(bench.count(2)) == [0]


def test_an_item_of_another_list_is_an_error_and_the_upload_continues() -> None:
    bench = px4()
    bench.count(1)
    assert results(bench.item(fields(0), FENCE)) == [ERROR]
    assert results(bench.item(fields(0))) == [ACCEPTED]
    assert bench.upload(square()) == ERROR  # vertices are not for a mission


def test_messages_to_another_autopilot_are_ignored() -> None:
    bench = px4()
    for system, component in ((0, 0), (2, 1), (1, 154)):
        assert bench.send(mavlink.MAVLink_mission_count_message(system, component, 2, 0)) == []
    for component in (0, 1, 190):
        assert requests(bench.send(mavlink.MAVLink_mission_count_message(1, component, 2, 0))) == [0]


# -- both autopilots ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "kept", "told"), [(ardupilot, 1, [("stored", MISSION, 3)]), (px4, 0, [])])
def test_a_fault_refuses_a_mission_at_once_or_at_an_item(make: Any, kept: int, told: list[Any]) -> None:
    bench = make()
    bench.refusal = MissionRefusal(mavlink.MAV_MISSION_DENIED)
    assert bench.upload(waypoints(3)) == mavlink.MAV_MISSION_DENIED
    bench.refusal = MissionRefusal(mavlink.MAV_MISSION_NO_SPACE, at_item=1)
    assert bench.upload(waypoints(3)) == mavlink.MAV_MISSION_NO_SPACE
    assert len(bench.mission.items) == kept
    bench.refusal = None
    assert bench.upload(waypoints(3)) == mavlink.MAV_MISSION_ACCEPTED
    assert bench.calls[-1:] == told
