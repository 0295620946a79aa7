"""Rows of (state, input, now) -> (output, deadline): uploading a mission, and setting its current item."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_texts import ITEMS, PEER, mission_ack, request

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.command import SetCurrent
from swarmctl.mavlink.protocol.mission_upload import Upload, UploadOutcome


def started_upload(items: tuple[MissionItem, ...] = ITEMS, *, asked: int = 0, **more: Any) -> Upload:
    upload = Upload(PEER, items, **more)
    upload.start(0.0)
    for seq in range(asked):
        upload.receive(request(seq), 0.1)
    return upload


def test_the_count_is_announced_every_second_until_the_first_request():
    upload = Upload(PEER, ITEMS)
    sent = [(0.0, m.count) for m in upload.start(0.0)]
    while upload.result is None:
        now = upload.next_deadline
        sent += [(now, getattr(m, "count", m.get_type())) for m in upload.tick(now)]
    assert sent == [*((float(t), 3) for t in range(12)), (12.0, "MISSION_ACK")]
    assert upload.result.outcome is UploadOutcome.NO_ANSWER


@pytest.mark.parametrize(
    ("asked", "message", "outcome"),
    [
        (0, request(2), None),  # from an earlier transfer
        (0, request(0, kind=1), None),
        (0, request(0, to=254), None),
        (2, request(7), None),
        (2, mission_ack(0), None),  # late, from an earlier transfer: some items are not sent yet
        (2, mission_ack(13), None),  # for a duplicate; the vehicle continues its requests
        (0, mission_ack(15), None),  # the earlier transfer is given up
        (2, mission_ack(5, kind=1), None),
        (2, mission_ack(5, to=254), None),
        (2, mission_ack(5), UploadOutcome.REJECTED),
        (0, mission_ack(4), UploadOutcome.REJECTED),
        (0, mission_ack(14), UploadOutcome.DENIED),
        (2, mission_ack(15), UploadOutcome.CANCELLED),
        (3, mission_ack(13), None),
        (3, mission_ack(1), UploadOutcome.UNCONFIRMED),  # a repeated last item after a lost acceptance
        (2, mission_ack(1), None),  # late, from an earlier transfer
        (3, mission_ack(0), UploadOutcome.ACCEPTED),
    ],
)
def test_each_acknowledgement_has_its_outcome(asked, message, outcome):
    upload = started_upload(asked=asked)
    assert upload.receive(message, 0.2) == []
    assert (upload.result and upload.result.outcome) == outcome


LONG = ITEMS * 5


def answers(upload: Upload, seq: int, now: float) -> list[int]:
    return [item.seq for item in upload.receive(request(seq), now)]


def test_eight_items_are_under_way_and_the_last_goes_out_on_request_only():
    upload = started_upload(LONG)
    assert answers(upload, 0, 2.0) == list(range(8))
    assert answers(upload, 1, 4.0) == [8]
    assert answers(upload, 5, 4.0) == [9, 10, 11, 12]
    for seq in range(6, len(LONG) - 1):
        assert len(LONG) - 1 not in answers(upload, seq, 6.0)
    assert answers(upload, len(LONG) - 1, 6.0) == [len(LONG) - 1]


def test_an_overdue_item_is_sent_again_with_all_items_behind_it():
    upload = started_upload(LONG)
    answers(upload, 0, 2.0)
    assert answers(upload, 3, 4.0) == [8, 9, 10]
    again = [seq for seq in range(3, 11) for _ in range(2)]
    assert answers(upload, 3, 5.0) == again, "an answer takes 2 s, and item 3 was sent 3 s ago"
    assert answers(upload, 3, 5.9) == [], "item 3 is on its way"
    assert answers(upload, 3, 6.1) == [3, 3], "the item is repeated, or the vehicle ends the upload"
    assert answers(upload, 3, 7.0) == []
    assert answers(upload, 3, 8.0) == again
    assert answers(upload, 4, 10.0) == [11, 11], "two copies after a loss"


def test_a_last_item_under_way_at_the_deadline_may_still_arrive():
    late = False
    upload = started_upload(too_late=lambda _round_trip_s: late)
    answers(upload, 0, 2.0)
    assert answers(upload, 2, 4.0) == [2]
    assert answers(upload, 2, 5.0) == [2]
    late = True
    assert answers(upload, 2, 7.0) == []
    assert upload.result is None
    (closing,) = upload.receive(request(2), 7.5)
    assert (closing.get_type(), closing.type) == ("MISSION_ACK", 15)
    assert upload.result.outcome is UploadOutcome.TOO_LATE


def test_a_last_item_on_a_slow_link_may_take_as_long_as_an_answer():
    late = False
    upload = started_upload(too_late=lambda _round_trip_s: late)
    answers(upload, 0, 4.0)
    assert answers(upload, 2, 8.0) == [2]
    late = True
    assert answers(upload, 2, 10.6) == []
    assert upload.result is None
    upload.receive(mission_ack(0), 12.0)
    assert upload.result.outcome is UploadOutcome.ACCEPTED


@pytest.mark.parametrize(("code", "outcome"), [(0, UploadOutcome.ACCEPTED), (1, UploadOutcome.UNCONFIRMED)])
def test_an_error_from_before_the_last_item_does_not_end_the_upload(code, outcome):
    """PX4 refuses a second announcement that arrives when it has the first items."""
    upload = started_upload()
    answers(upload, 0, 2.0)
    answers(upload, 2, 4.0)
    upload.receive(mission_ack(1), 4.5)
    assert upload.result is None
    upload.receive(mission_ack(code), 6.0)
    assert upload.result.outcome is outcome


def test_a_vehicle_that_requests_the_first_item_again_is_answered():
    upload = started_upload(asked=1)
    assert answers(upload, 2, 0.3) == [2]
    assert answers(upload, 0, 0.5) == [0, 0, 1, 1]
    assert answers(upload, 1, 0.6) == []
    assert answers(upload, 2, 0.6) == [2, 2]


@pytest.mark.parametrize(
    ("asked", "outcome"), [(2, UploadOutcome.INCOMPLETE), (3, UploadOutcome.UNCONFIRMED)]
)
def test_silence_ends_an_upload_after_six_seconds(asked, outcome):
    upload = started_upload(asked=asked)
    assert upload.next_deadline == pytest.approx(6.1)
    assert upload.tick(6.0) == []
    (closing,) = upload.tick(6.1)
    assert (closing.get_type(), closing.type) == ("MISSION_ACK", 15)
    assert upload.result.outcome is outcome


def test_endless_requests_for_one_item_end_the_upload():
    upload, now = started_upload(asked=2), 0.0
    while upload.result is None and now < 100:
        now += 1.0
        upload.receive(request(1), now)
        upload.tick(now)
    assert upload.result.outcome is UploadOutcome.INCOMPLETE
    assert now == 31.0


def test_an_upload_on_a_slow_link_has_no_time_limit_while_it_progresses():
    upload = started_upload(ITEMS * 20)
    for seq in range(60):
        for again in (0.0, 5.0):
            upload.tick(10.0 * seq + again)
            upload.receive(request(seq), 10.0 * seq + again)
    upload.receive(mission_ack(0), 600.0)
    assert upload.result.outcome is UploadOutcome.ACCEPTED


def test_a_current_item_is_set_by_message_and_confirmed():
    setting = SetCurrent(PEER, 3)
    assert [(m.get_type(), m.seq) for m in setting.start(0.0)] == [("MISSION_SET_CURRENT", 3)]
    assert setting.receive(mavlink.MAVLink_mission_current_message(2), 0.1) == []
    assert setting.result is None
    setting.receive(mavlink.MAVLink_mission_current_message(3), 0.2)
    assert setting.result.final


def test_an_unconfirmed_current_item_may_have_been_set():
    setting = SetCurrent(PEER, 3)
    setting.start(0.0)
    assert setting.next_deadline == 1.0
    assert setting.tick(1.0) == []
    assert (setting.result.final, setting.result.may_have_happened) == (False, True)


def test_the_item_to_fly_is_marked_in_an_upload():
    upload = started_upload(current=1)
    sent = [m for seq in range(3) for m in upload.receive(request(seq), 0.1)]
    assert [(m.seq, m.current) for m in sent] == [(0, 0), (1, 1), (2, 0)]
