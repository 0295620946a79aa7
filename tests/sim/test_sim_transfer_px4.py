"""The mission protocol of PX4 1.15, message by message."""

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import acks
from transfer_station import (
    CIRCLE,
    EXCLUDED,
    FENCE,
    MISSION,
    POLYGON,
    RALLY,
    RALLY_POINT,
    Px4TransferStation,
    TransferStation,
    fields,
    kinds,
    requests,
    square,
    waypoints,
)

OTHER = (254, 190)
ACCEPTED, ERROR = 0, 1


@pytest.mark.autopilots("2 requests", of="px4")
def test_the_first_request_is_a_legacy_one() -> None:
    station = Px4TransferStation()
    assert kinds(station.count(3)) == ["MISSION_REQUEST"]
    assert kinds(station.item(fields(0))) == ["MISSION_REQUEST_INT"]
    station.item(fields(1))
    station.item(fields(2))
    assert kinds(station.count(1)) == ["MISSION_REQUEST_INT"]
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    station.wait(5)
    assert kinds(station.count(1)) == ["MISSION_REQUEST"]


@pytest.mark.autopilots("2 re-upload in AUTO", "2 shorter mission", of="px4")
def test_a_shorter_mission_moves_the_index_to_its_last_item_and_a_marked_one_there() -> None:
    station = Px4TransferStation()
    station.upload_and_wait(waypoints(8))
    station.set_current(5)
    station.upload_and_wait(waypoints(3))
    assert station.current == 2
    station.upload_and_wait([fields(0), fields(1, current=1, z=9.0), fields(2)])
    assert station.current == 1


def test_the_same_mission_again_changes_nothing() -> None:
    station = Px4TransferStation()
    items = [fields(0), fields(1, current=1), fields(2)]
    station.upload_and_wait(items)
    station.set_current(2)
    station.upload_and_wait(items)
    assert station.current == 2


@pytest.mark.autopilots("2 second GCS / download during upload", of="px4")
def test_another_count_during_an_upload_is_an_error_except_at_item_0() -> None:
    station = Px4TransferStation()
    station.count(4)
    assert requests(station.count(2)) == [0]
    for seq in range(3):
        assert requests(station.item(fields(seq))) == [seq + 1]
        assert acks(station.count(2)) == [ERROR]
        assert acks(station.count(2, peer=OTHER)) == [ERROR]
    assert acks(station.item(fields(3))) == [ACCEPTED]
    assert len(station.download()) == 4


@pytest.mark.autopilots("2 wrong / duplicate item", of="px4")
def test_a_wrong_item_is_ignored_in_an_upload_and_an_error_after_it() -> None:
    station = Px4TransferStation()
    station.count(3)
    for seq in (0, 2, 1):
        assert acks(station.item(fields(seq))) == []
    assert acks(station.item(fields(2))) == [ACCEPTED]
    assert acks(station.item(fields(1))) == [ERROR]
    assert station.texts() == ["IGN MISSION_ITEM: No transfer"]


@pytest.mark.autopilots("2 error codes", of="px4")
def test_counts_beyond_the_storage_are_refused() -> None:
    station = Px4TransferStation()
    assert acks(station.count(65_535)) == [mavlink.MAV_MISSION_NO_SPACE]
    assert acks(station.count(129, FENCE)) == [mavlink.MAV_MISSION_NO_SPACE]


@pytest.mark.autopilots("2 read-back", of="px4")
def test_a_nan_altitude_autocontinue_and_coordinates_are_kept() -> None:
    station = Px4TransferStation()
    sent = [
        fields(0, frame=3, z=math.nan),
        fields(1, frame=5, autocontinue=0),
        fields(2, command=178, frame=2, param1=1.0, param2=7.5, x=3, y=4, z=5.5),
    ]
    assert station.upload(sent) == ACCEPTED
    kept = station.download()
    assert [m.frame for m in kept] == [6, 5, 2]
    assert [m.autocontinue for m in kept] == [1, 0, 1]
    assert math.isnan(kept[0].z)
    assert (kept[2].param2, kept[2].x, kept[2].y, kept[2].z) == (7.5, 3, 4, 5.5)
    assert [m.current for m in kept] == [1, 0, 0]


@pytest.mark.autopilots("2 MISSION_SET_CURRENT", of="px4")
def test_mission_set_current_reports_failures() -> None:
    station = Px4TransferStation()
    station.upload(waypoints(4))
    station.set_current(4)
    station.count(2)
    station.set_current(1)
    assert station.texts() == ["WPM: WP CURR CMD: Not in list", "WPM: IGN WP CURR CMD: Busy"]


@pytest.mark.autopilots("2 fence", of="px4")
def test_a_fence_in_frame_3_is_read_back_in_frame_5() -> None:
    station = Px4TransferStation()
    circle = fields(4, CIRCLE, frame=3, param1=50.5)
    assert station.upload([*square(frame=3), circle], FENCE) == ACCEPTED
    kept = station.download(FENCE)
    assert [(m.command, m.frame, m.param1, m.autocontinue) for m in kept] == [
        *[(POLYGON, 5, 4.0, 0)] * 4,
        (CIRCLE, 5, 50.5, 0),
    ]
    assert all(m.mission_type == FENCE for m in kept)


@pytest.mark.autopilots("2 fence", of="px4")
def test_a_fence_with_a_wrong_vertex_count_bounds_nothing() -> None:
    station = Px4TransferStation()
    assert station.upload(square(vertices=6), FENCE) == ACCEPTED
    assert station.fleet.vehicles[0].fence.zones == ()


@pytest.mark.autopilots("2 types 2 / 3 / 255", of="px4")
def test_rally_points_are_kept_with_their_frame() -> None:
    station = Px4TransferStation()
    sent = [fields(seq, RALLY_POINT, frame=frame) for seq, frame in enumerate((3, 0))]
    assert station.upload(sent, RALLY) == ACCEPTED
    kept = station.download(RALLY)
    assert [(m.command, m.frame, m.z) for m in kept] == [(RALLY_POINT, 6, 20.0), (RALLY_POINT, 5, 20.0)]


@pytest.mark.autopilots("2 types 2 / 3 / 255", of="px4")
def test_clear_all_clears_every_list() -> None:
    station = Px4TransferStation()
    station.upload(waypoints(3))
    station.upload(square(), FENCE)
    station.upload([fields(0, RALLY_POINT)], RALLY)
    lists = (MISSION, FENCE, RALLY)
    assert 0 not in [opaque_id(station, kind) for kind in lists]
    assert station.clear(255) == [ACCEPTED]
    assert [(len(station.download(kind)), opaque_id(station, kind)) for kind in lists] == [(0, 0)] * 3


def test_a_mission_count_of_0_leaves_the_fence() -> None:
    station = Px4TransferStation()
    station.upload(waypoints(3))
    station.upload(square(EXCLUDED), FENCE)
    assert acks(station.count(0)) == [ACCEPTED]
    assert len(station.download(FENCE)) == 4


def opaque_id(station: Px4TransferStation, kind: int = MISSION) -> int:
    """Return the id of a list in MISSION_COUNT, an extension unknown to pymavlink."""
    before = len(station.raw)
    station.ask_list(kind)
    frame = station.raw[before:]
    station.ack(kind=kind)
    return int.from_bytes(frame[10 : 10 + frame[1]].ljust(9, b"\0")[5:], "little")


def test_ack_and_count_have_the_same_opaque_id() -> None:
    station = Px4TransferStation()
    station.count(2)
    station.item(fields(0))
    before = len(station.raw)
    station.item(fields(1))
    ack = station.raw[before:]
    assert ack[10:-2] == bytes([255, 190, 0, 0]) + struct.pack("<I", opaque_id(station))


def test_equal_lists_have_equal_ids_and_different_lists_do_not() -> None:
    ids = []
    for height_m in (20.0, 20.0, 21.0):
        station = Px4TransferStation()
        station.upload(waypoints(4, z=height_m))
        ids.append(opaque_id(station))
    assert ids[0] == ids[1] != ids[2]


def test_a_ground_station_can_reject_legacy_requests() -> None:
    station = Px4TransferStation()
    assert kinds(station.count(2)) == ["MISSION_REQUEST"]
    assert kinds(station.ack(mavlink.MAV_MISSION_UNSUPPORTED)) == ["MISSION_REQUEST_INT"]


def test_a_download_asks_in_order_and_an_unexpected_request_ends_it() -> None:
    station = Px4TransferStation()
    station.upload(waypoints(3))
    station.ask_list()
    for seq in (0, 0, 1):
        assert [m.seq for m in station.read(seq)] == [seq]
    assert acks(station.read(0)) == [ERROR]
    assert station.texts() == ["WPM: REJ. CMD: Req. WP was unexpected"]
    assert station.read(0) == []  # no transfer: silence


def test_a_second_ground_station_is_rejected_with_a_text() -> None:
    station = Px4TransferStation()
    station.count(2)
    assert station.item(fields(0), peer=OTHER) == []
    assert station.read(0, peer=OTHER) == []
    station.ack(15, peer=OTHER)
    assert station.texts() == [
        "REJ. MIS ITEM: partner id mismatch",
        "WPM: REJ. CMD: partner id mismatch",
        "REJ. WP CMD: partner id mismatch",
    ]
    assert station.upload(waypoints(2)) == ACCEPTED


def test_a_count_during_a_download_is_busy_until_the_ground_station_acknowledges() -> None:
    station = Px4TransferStation()
    station.upload(waypoints(2))
    station.ask_list()
    assert acks(station.count(2)) == [ERROR]
    station.read(0)
    station.read(1)
    station.ack()
    assert requests(station.count(2)) == [0]


def test_an_item_of_another_list_is_an_error_and_the_upload_continues() -> None:
    station = Px4TransferStation()
    station.count(1)
    assert acks(station.item(fields(0), FENCE)) == [ERROR]
    assert acks(station.item(fields(0))) == [ACCEPTED]
    assert station.upload(square()) == ERROR  # vertices are not for a mission


def test_messages_to_another_autopilot_are_ignored() -> None:
    station = Px4TransferStation()
    for system, component in ((0, 0), (2, 1), (1, 154)):
        assert station.send(mavlink.MAVLink_mission_count_message(system, component, 2, 0)) == []
    for component in (0, 1, 190):
        assert requests(station.send(mavlink.MAVLink_mission_count_message(1, component, 2, 0))) == [0]


# -- both autopilots ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "kept"), [(TransferStation, 1), (Px4TransferStation, 0)])
def test_a_fault_refuses_a_mission_at_once_or_at_an_item(make: type[TransferStation], kept: int) -> None:
    station = make()
    station.inject("mission_refused:result=denied,for=1")
    assert station.upload(waypoints(3)) == mavlink.MAV_MISSION_DENIED
    station.wait(1)
    station.inject("mission_refused:result=no_space,at_item=1,for=1")
    station.count(3)
    assert [acks(station.item(values)) for values in waypoints(2)] == [[], [mavlink.MAV_MISSION_NO_SPACE]]
    assert len(station.download()) == kept
    station.wait(9)
    assert acks(station.received) == [mavlink.MAV_MISSION_DENIED, mavlink.MAV_MISSION_NO_SPACE]
    assert station.upload(waypoints(3)) == mavlink.MAV_MISSION_ACCEPTED
