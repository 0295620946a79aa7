"""Fences, rally points and the rest of the mission protocol as ArduCopter 4.6 speaks it."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import acks, place_m, waypoint
from transfer_station import (
    CIRCLE,
    EXCLUDED,
    FENCE,
    NOT_CIRCLE,
    POLYGON,
    RALLY,
    RALLY_POINT,
    RETURN_POINT,
    WP,
    TransferStation,
    X,
    Y,
    fields,
    requests,
    square,
)

ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE = 0, 1, 2, 3, 4
INVALID_SEQUENCE, CANCELLED = 13, 15


def ring(vertices: int, command: int = POLYGON) -> list[dict[str, Any]]:
    corners = [
        (math.cos(2 * math.pi * i / vertices), math.sin(2 * math.pi * i / vertices)) for i in range(vertices)
    ]
    return [
        fields(i, command, frame=3, param1=vertices, x=X + round(1e4 * a), y=Y + round(1e4 * b))
        for i, (a, b) in enumerate(corners)
    ]


# -- fence -----------------------------------------------------------------------------------------------


@pytest.mark.autopilots("2 fence")
@pytest.mark.parametrize("frame", [3, 5, 6])
def test_a_fence_is_read_back_in_frame_0_without_altitude(frame: int) -> None:
    station = TransferStation()
    sent = [
        *square(frame=frame),
        fields(4, NOT_CIRCLE, frame=frame, param1=30.5),
        fields(5, RETURN_POINT, frame=frame),
    ]
    assert station.upload(sent, FENCE) == ACCEPTED
    kept = station.download(FENCE)
    assert [(m.command, m.frame, m.param1, m.z) for m in kept] == [
        *[(POLYGON, 0, 4.0, 0.0)] * 4,
        (NOT_CIRCLE, 0, 30.5, 0.0),
        (RETURN_POINT, 0, 0.0, 0.0),
    ]
    assert [(m.x, m.y) for m in kept] == [(values["x"], values["y"]) for values in sent]
    assert {m.mission_type for m in kept} == {FENCE}


@pytest.mark.parametrize(("radius_m", "kept_m"), [(30.0005, 30.0), (30.25, 30.25), (29.9995, 29.9995)])
def test_a_radius_just_above_a_whole_number_is_kept_as_that_number(radius_m: float, kept_m: float) -> None:
    station = TransferStation()
    station.upload([fields(0, CIRCLE, param1=radius_m)], FENCE)
    assert station.download(FENCE)[0].param1 == pytest.approx(kept_m, abs=1e-5)


@pytest.mark.autopilots("2 fence")
@pytest.mark.parametrize(
    ("sent", "result"),
    [
        pytest.param({"frame": 2}, UNSUPPORTED_FRAME, id="frame 2"),
        pytest.param({"frame": 1}, UNSUPPORTED_FRAME, id="frame 1"),
        pytest.param({"command": WP}, UNSUPPORTED, id="a waypoint"),
    ],
)
def test_a_refused_item_ends_the_upload_at_once(sent: dict[str, Any], result: int) -> None:
    station = TransferStation()
    items = square()
    items[1] |= sent
    assert station.upload(items, FENCE) == result
    assert acks(station.item(items[1], FENCE)) == [ERROR]


@pytest.mark.autopilots("2 fence")
@pytest.mark.parametrize(
    ("items", "text"),
    [
        (square(vertices=6), "Incorrect item count"),
        (square(vertices=2)[:2], "Invalid vertex count (2)"),
        ([fields(0, CIRCLE, param1=0.0)], "Non-positive circle radius"),
        ([fields(0, CIRCLE, param1=math.nan)], "Non-positive circle radius"),
        ([fields(0, RETURN_POINT), fields(1, RETURN_POINT)], "Multiple return points"),
        ([fields(0, CIRCLE, param1=5.0, x=910_000_000)], "Bad lat or lon"),
    ],
)
def test_a_wrong_fence_is_refused_at_the_end_and_the_old_one_kept(
    items: list[dict[str, Any]], text: str
) -> None:
    station = TransferStation()
    assert station.upload(square(), FENCE) == ACCEPTED
    replies = station.count(len(items), FENCE)
    for seq, values in enumerate(items):
        assert requests(replies) == [seq]
        replies = station.item(values, FENCE)
    assert acks(replies) == [ERROR]
    assert station.texts() == [text, "Fence validation failed"]
    assert len(station.download(FENCE)) == 4


def test_a_polygon_with_mixed_kinds_or_counts_is_refused() -> None:
    station = TransferStation()
    mixed = square()
    mixed[2] |= {"command": EXCLUDED}
    assert station.upload(mixed, FENCE) == ERROR
    uneven = square()
    uneven[2] |= {"param1": 5.0}
    assert station.upload(uneven, FENCE) == ERROR
    assert station.download(FENCE) == []


@pytest.mark.autopilots("2 fence")
def test_the_storage_of_a_fence_is_limited() -> None:
    station = TransferStation()
    assert acks(station.count(200, FENCE)) == [NO_SPACE]
    assert station.texts() == ["Only 70 items are supported"]
    assert station.upload(ring(69), FENCE) == ACCEPTED
    assert station.upload(ring(70), FENCE) == ERROR
    assert station.texts()[-1] == "Fence exceeds storage size"
    assert len(station.download(FENCE)) == 69


@pytest.mark.autopilots("MAVSDK 5 geofence", "2 fence")
def test_an_upload_sets_fence_total_and_does_not_enable_the_fence() -> None:
    station = TransferStation()
    triangle = [*ring(3), fields(3, RETURN_POINT)]
    for items, total in ((square(), 6), (triangle, 5), ([fields(0, CIRCLE, param1=9.0)], 0)):
        assert station.upload(items, FENCE) == ACCEPTED
        assert station.parameter("FENCE_TOTAL") == total
        assert station.parameter("FENCE_ENABLE") == 0
    assert station.clear(FENCE) == [ACCEPTED]
    assert station.parameter("FENCE_TOTAL") == 0


@pytest.mark.autopilots("2 fence")
def test_an_abandoned_fence_upload_leaves_the_old_fence() -> None:
    station = TransferStation()
    station.upload(square(), FENCE)
    station.count(3, FENCE)
    station.item(ring(3)[0], FENCE)
    replies = station.wait(9)
    assert requests(replies) == [1] * 7
    assert acks(replies) == [CANCELLED]
    assert station.texts() == ["Fence upload timeout"]
    assert len(station.download(FENCE)) == 4


def test_part_of_a_fence_can_be_replaced() -> None:
    station = TransferStation()
    station.upload(square(), FENCE)
    replies = station.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 2, 2, FENCE))
    assert requests(replies) == [2]
    assert acks(station.item(square()[2] | {"x": X + 500}, FENCE)) == [ACCEPTED]
    assert [m.x == X + 500 for m in station.download(FENCE)] == [False, False, True, False]
    station.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 4, 4, FENCE))
    assert acks(station.item(fields(4, POLYGON, param1=4.0), FENCE)) == [INVALID_SEQUENCE]


def test_an_item_beyond_the_fence_cannot_be_read() -> None:
    station = TransferStation()
    station.upload(square(), FENCE)
    assert acks(station.read(4, FENCE)) == [ERROR]
    assert acks(station.read(5, FENCE)) == [INVALID_SEQUENCE]


# -- rally points ----------------------------------------------------------------------------------------


@pytest.mark.autopilots("2 types 2 / 3 / 255")
@pytest.mark.parametrize(("frame", "kept"), [(0, 0), (3, 3), (5, 0), (6, 3), (11, 10)])
def test_rally_points(frame: int, kept: int) -> None:
    station = TransferStation()
    assert [m.count for m in station.ask_list(RALLY)] == [0]
    assert (
        station.upload([fields(seq, RALLY_POINT, frame=frame, z=25.7) for seq in range(2)], RALLY) == ACCEPTED
    )
    read = station.download(RALLY)
    assert [(m.command, m.frame, m.z, m.x) for m in read] == [
        (RALLY_POINT, kept, 25.0, X),
        (RALLY_POINT, kept, 25.0, X + 1),
    ]
    assert station.clear(RALLY) == [ACCEPTED]
    assert station.download(RALLY) == []


@pytest.mark.parametrize(
    ("sent", "result"),
    [
        pytest.param({"command": WP}, UNSUPPORTED, id="a waypoint"),
        pytest.param({"frame": 2}, UNSUPPORTED_FRAME, id="frame 2"),
        pytest.param({"x": 1_000_000_000}, 10, id="latitude 100"),
        pytest.param({"y": 1_900_000_000}, 11, id="longitude 190"),
        pytest.param({"z": 40_000.0}, 12, id="altitude"),
        pytest.param({"z": math.nan}, 12, id="NaN altitude"),
    ],
)
def test_refused_rally_points(sent: dict[str, Any], result: int) -> None:
    station = TransferStation()
    assert station.upload([fields(0, **({"command": RALLY_POINT} | sent))], RALLY) == result


def test_rally_uploads_are_limited_and_not_atomic() -> None:
    station = TransferStation()
    points = [fields(seq, RALLY_POINT) for seq in range(4)]
    station.upload(points, RALLY)
    station.count(3, RALLY)
    station.item(points[0] | {"z": 99.0}, RALLY)
    station.wait(9)
    assert station.texts() == ["Rally upload timeout"]
    assert [m.z for m in station.download(RALLY)] == [99.0, 20.0, 20.0]
    assert acks(station.count(47, RALLY)) == [NO_SPACE]
    assert acks(station.read(3, RALLY)) == [INVALID_SEQUENCE]


# -- missions --------------------------------------------------------------------------------------------


def test_an_item_with_current_2_is_a_guided_target_and_with_3_an_altitude() -> None:
    station = TransferStation()
    target = fields(0) | waypoint(30, 0, 15)
    assert acks(station.item(target | {"current": 2})) == [ERROR]
    station.fly(10)
    assert acks(station.item(target | {"current": 2})) == [ACCEPTED]
    station.until(lambda: place_m(station)[0] > 29 and station.height_m > 14, 60)
    assert acks(station.item(fields(0, current=3, z=25.0))) == [ACCEPTED]
    station.until(lambda: station.height_m > 24, 60)
    assert place_m(station)[0] == pytest.approx(30, abs=2)
    assert acks(station.item(fields(0, current=2, command=2999))) == [UNSUPPORTED]
    assert station.download() == []
