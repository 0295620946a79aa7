"""Rows of (state, input, now) -> (output, deadline) for each single conversation."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.command import Command, CommandOutcome, command_long
from swarmctl.mavlink.conversation import IllegalEvent, Peer, State
from swarmctl.mavlink.mission_append import Append
from swarmctl.mavlink.mission_current import SetCurrent
from swarmctl.mavlink.mission_download import Download, DownloadOutcome
from swarmctl.mavlink.mission_upload import Upload, UploadOutcome
from swarmctl.mavlink.wait import Ask, Look, Until, wait

PEER = Peer(1)
ITEMS = tuple(MissionItem(16, 3, 460_000_000 + i, 145_000_000, 20.0 + i) for i in range(3))


def ack(command: int, result: int, to: int = 255):
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, to, 190)


def request(seq: int, *, to: int = 255, kind: int = 0, legacy: bool = True):
    make = mavlink.MAVLink_mission_request_message if legacy else mavlink.MAVLink_mission_request_int_message
    return make(to, 190, seq, kind)


def mission_ack(result: int, *, to: int = 255, kind: int = 0):
    return mavlink.MAVLink_mission_ack_message(to, 190, result, kind)


def kinds(messages) -> list[str]:
    return [m.get_type() for m in messages]


# Command


@pytest.mark.parametrize(
    ("result", "outcome", "text"),
    [
        (0, CommandOutcome.ACCEPTED, "MISSION_START: ACCEPTED"),
        (2, CommandOutcome.REFUSED, "MISSION_START: DENIED"),
        (3, CommandOutcome.REFUSED, "MISSION_START: UNSUPPORTED"),
        (4, CommandOutcome.REFUSED, "MISSION_START: FAILED"),
        (99, CommandOutcome.REFUSED, "MISSION_START: MAV_RESULT 99"),
    ],
)
def test_a_command_ends_with_the_vehicles_result_by_name(result, outcome, text):
    command = Command(PEER, 300)
    command.start(0.0)
    command.receive(ack(300, result), 0.1)
    assert (command.result.outcome, command.result.text) == (outcome, text)
    assert command.next_deadline is None


def test_a_command_is_sent_once_and_waits_a_second_for_its_answer():
    command = Command(PEER, 300, confirmation=3)
    assert [m.confirmation for m in command.start(0.0)] == [3]
    assert command.next_deadline == 1.0
    assert command.tick(1.0) == []
    assert (command.result.outcome, command.result.text) == (
        CommandOutcome.NO_ANSWER,
        "MISSION_START: no answer",
    )


@pytest.mark.parametrize("other", [ack(301, 0), ack(300, 0, to=254)], ids=["other command", "other station"])
def test_an_acknowledgement_of_something_else_is_not_ours(other):
    command = Command(PEER, 300)
    command.start(0.0)
    command.receive(other, 0.1)
    assert command.result is None
    assert command.next_deadline == 1.0


def test_in_progress_extends_the_wait():
    command = Command(PEER, 300)
    command.start(0.0)
    command.receive(ack(300, 5), 0.5)
    assert command.next_deadline == 10.5
    command.receive(ack(300, 0), 1.7)
    assert command.result.outcome is CommandOutcome.ACCEPTED


def test_temporarily_rejected_is_not_now_after_a_pause():
    command = Command(PEER, 300)
    command.start(0.0)
    command.receive(ack(300, 1), 0.6)
    assert (command.result, command.next_deadline) == (None, 1.6)
    command.tick(1.6)
    assert command.result.outcome is CommandOutcome.NOT_NOW
    assert not command.result.final


@pytest.mark.parametrize("code", [21196.0, 2989.0])
@pytest.mark.parametrize("arm", [0.0, 1.0])
def test_forced_arming_and_disarming_cannot_be_written(arm, code):
    with pytest.raises(ValueError, match="never sent"):
        Command(PEER, 400, arm, code)
    with pytest.raises(ValueError, match="never sent"):
        command_long(PEER, 400, (arm, code))


# Upload


def started_upload(*, asked: int = 0) -> Upload:
    upload = Upload(PEER, ITEMS)
    upload.start(0.0)
    for seq in range(asked):
        upload.receive(request(seq), 0.1)
    return upload


@pytest.mark.parametrize("legacy", [True, False], ids=["MISSION_REQUEST", "MISSION_REQUEST_INT"])
def test_both_kinds_of_request_are_answered_with_item_int(legacy):
    upload = started_upload()
    sent = [m for seq in range(3) for m in upload.receive(request(seq, legacy=legacy), 0.1)]
    assert [(m.get_type(), m.seq, m.x) for m in sent] == [
        ("MISSION_ITEM_INT", i, ITEMS[i].x) for i in range(3)
    ]
    upload.receive(mission_ack(0), 0.2)
    assert upload.result.outcome is UploadOutcome.ACCEPTED


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
        (0, request(2), None),  # an earlier transfer goes on
        (0, request(0, kind=1), None),
        (0, request(0, to=254), None),
        (2, request(7), None),
        (2, mission_ack(0), None),  # late, of an earlier transfer: not all was sent
        (2, mission_ack(13), None),  # a duplicate; it goes on asking
        (0, mission_ack(15), None),  # the earlier transfer is given up
        (2, mission_ack(5, kind=1), None),
        (2, mission_ack(5, to=254), None),
        (2, mission_ack(5), UploadOutcome.REJECTED),
        (0, mission_ack(4), UploadOutcome.REJECTED),
        (0, mission_ack(14), UploadOutcome.DENIED),
        (2, mission_ack(15), UploadOutcome.CANCELLED),
        (3, mission_ack(13), None),
        (3, mission_ack(1), UploadOutcome.UNCONFIRMED),  # a repeated last item after a lost acceptance
        (2, mission_ack(1), None),  # the same, late, of an earlier transfer
        (3, mission_ack(0), UploadOutcome.ACCEPTED),
    ],
)
def test_what_each_answer_means_for_an_upload_of_three(asked, message, outcome):
    upload = started_upload(asked=asked)
    assert upload.receive(message, 0.2) == []
    assert (upload.result and upload.result.outcome) == outcome


LONG = ITEMS * 5


def answers(upload: Upload, seq: int, now: float) -> list[int]:
    return [item.seq for item in upload.receive(request(seq), now)]


def test_eight_items_are_on_their_way_and_the_last_goes_to_who_asks_for_it():
    upload = Upload(PEER, LONG)
    upload.start(0.0)
    assert answers(upload, 0, 2.0) == list(range(8))
    assert answers(upload, 1, 4.0) == [8]
    assert answers(upload, 5, 4.0) == [9, 10, 11, 12]
    for seq in range(6, len(LONG) - 1):
        assert len(LONG) - 1 not in answers(upload, seq, 6.0)
    assert answers(upload, len(LONG) - 1, 6.0) == [len(LONG) - 1]


def test_what_is_asked_for_again_after_an_answer_could_have_come_is_sent_again_and_all_behind_it():
    upload = Upload(PEER, LONG)
    upload.start(0.0)
    answers(upload, 0, 2.0)
    assert answers(upload, 3, 4.0) == [8, 9, 10]
    again = [seq for seq in range(3, 11) for _ in range(2)]
    assert answers(upload, 3, 5.0) == again, "an answer takes 2 s, and 3 went 3 s ago"
    assert answers(upload, 3, 5.9) == [], "it is on its way"
    assert answers(upload, 3, 6.1) == [3, 3], "but who has to wait gives up"
    assert answers(upload, 3, 7.0) == []
    assert answers(upload, 3, 8.0) == again
    assert answers(upload, 4, 10.0) == [11, 11], "twice, as long as something is lost"


def test_a_last_item_that_is_on_its_way_when_it_comes_too_late_may_still_arrive():
    late = False
    upload = Upload(PEER, ITEMS, too_late=lambda _answers_after_s: late)
    upload.start(0.0)
    answers(upload, 0, 2.0)
    assert answers(upload, 2, 4.0) == [2]
    assert answers(upload, 2, 5.0) == [2]
    late = True
    assert answers(upload, 2, 7.0) == []
    assert upload.result is None
    (farewell,) = upload.receive(request(2), 7.5)
    assert (farewell.get_type(), farewell.type) == ("MISSION_ACK", 15)
    assert upload.result.outcome is UploadOutcome.TOO_LATE


def test_on_a_slow_link_a_last_item_may_take_as_long_as_an_answer_does():
    upload = Upload(PEER, ITEMS, too_late=lambda _answers_after_s: late)
    late = False
    upload.start(0.0)
    answers(upload, 0, 4.0)
    assert answers(upload, 2, 8.0) == [2]
    late = True
    assert answers(upload, 2, 10.6) == []
    assert upload.result is None
    upload.receive(mission_ack(0), 12.0)
    assert upload.result.outcome is UploadOutcome.ACCEPTED


def test_an_error_that_cannot_be_the_answer_to_the_last_item_ends_nothing():
    """PX4 refuses a second announcement that arrives when it has the first items."""
    upload = Upload(PEER, ITEMS)
    upload.start(0.0)
    answers(upload, 0, 2.0)
    answers(upload, 2, 4.0)
    upload.receive(mission_ack(1), 4.5)
    assert upload.result is None
    upload.receive(mission_ack(0), 6.0)
    assert upload.result.outcome is UploadOutcome.ACCEPTED


def test_a_vehicle_that_begins_anew_is_answered():
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
    (farewell,) = upload.tick(6.1)
    assert (farewell.get_type(), farewell.type) == ("MISSION_ACK", 15)
    assert upload.result.outcome is outcome


def test_a_vehicle_that_asks_for_one_item_for_ever_is_given_up():
    upload, now = started_upload(asked=2), 0.0
    while upload.result is None and now < 100:
        now += 1.0
        upload.receive(request(1), now)
        upload.tick(now)
    assert upload.result.outcome is UploadOutcome.INCOMPLETE
    assert now == 31.0


def test_a_slow_link_may_take_as_long_as_it_goes_on():
    upload = Upload(PEER, ITEMS * 20)
    upload.start(0.0)
    for seq in range(60):
        for again in (0.0, 5.0):
            upload.tick(10.0 * seq + again)
            upload.receive(request(seq), 10.0 * seq + again)
    upload.receive(mission_ack(0), 600.0)
    assert upload.result.outcome is UploadOutcome.ACCEPTED


# Download


def test_a_download_asks_item_by_item_and_thanks():
    download = Download(PEER)
    assert kinds(download.start(0.0)) == ["MISSION_REQUEST_LIST"]
    sent = download.receive(mavlink.MAVLink_mission_count_message(255, 190, 2, 0), 0.1)
    for seq in (0, 1):
        assert [m.seq for m in sent] == [seq]
        sent = download.receive(item(seq), 0.2)
        assert seq == 1 or download.receive(item(seq), 0.2) == [], "a duplicate is ignored"
    assert [m.type for m in sent] == [0]
    assert download.result.outcome is DownloadOutcome.COMPLETE
    assert [i.x for i in download.result.items] == [10, 11]


def item(seq: int):
    return mavlink.MAVLink_mission_item_int_message(
        255, 190, seq, 3, 16, 0, 1, 0, 0, 0, 0, 10 + seq, 20, 30.0, 0
    )


def reading(n_items: int, *, in_order: bool) -> tuple[Download, list[int]]:
    """Eight at a time, over a link that takes 2 s to answer; and what was asked for first, at 2 s."""
    download = Download(PEER, window=8, in_order=in_order)
    download.start(0.0)
    asked = download.receive(mavlink.MAVLink_mission_count_message(255, 190, n_items, 0), 2.0)
    return download, [m.seq for m in asked]


@pytest.mark.parametrize("in_order", [False, True])
def test_a_download_asks_for_eight_items_at_a_time(in_order):
    download, asked = reading(10, in_order=in_order)
    assert asked == list(range(8))
    for seq in range(10):
        assert download.next_deadline > 4.0, "the answer is on its way"
        sent = download.receive(item(seq), 4.0)
        assert [m.seq for m in sent[:1] if m.get_type() == "MISSION_REQUEST_INT"] == [8 + seq] * (seq < 2)
    assert [i.x for i in download.result.items] == list(range(10, 20))


def test_who_tells_items_in_any_order_is_asked_again_for_the_one_that_is_missing():
    download, _asked = reading(3, in_order=False)
    download.receive(item(0), 4.0)
    download.receive(item(2), 4.0)
    assert [m.seq for m in download.tick(download.next_deadline)] == [1]


def test_a_count_that_comes_late_makes_nobody_wait_long_for_an_item():
    download = Download(PEER, window=8)
    download.start(0.0)
    download.receive(mavlink.MAVLink_mission_count_message(255, 190, 3, 0), 9.5)
    assert download.next_deadline == 13.5


def test_who_tells_them_in_order_is_asked_for_nothing_again():
    download, _asked = reading(3, in_order=True)
    download.receive(item(0), 4.0)
    (farewell,) = download.tick(download.next_deadline)
    assert (farewell.get_type(), farewell.type) == ("MISSION_ACK", 15)
    assert download.result.outcome is DownloadOutcome.BROKEN_OFF


def test_copies_of_a_question_come_before_the_next_one():
    """PX4 takes the number that it told last once more, but none before that."""
    download = Download(PEER, window=3, copies=2, in_order=True)
    download.start(0.0)
    asked = download.receive(mavlink.MAVLink_mission_count_message(255, 190, 5, 0), 2.0)
    assert [m.seq for m in asked] == [0, 0, 1, 1, 2, 2]
    assert [m.seq for m in download.receive(item(0), 4.0)] == [3, 3]
    assert download.receive(item(0), 4.0) == [], "the answer to the copy"
    for seq in range(1, 5):
        download.receive(item(seq), 4.5)
    assert [i.x for i in download.result.items] == list(range(10, 15))


@pytest.mark.parametrize(
    ("code", "outcome"),
    [
        (14, DownloadOutcome.REFUSED),
        (1, None),
        (0, None),
        (13, None),
        (15, None),
    ],
)
def test_only_errors_of_this_download_end_it(code, outcome):
    download = Download(PEER)
    download.start(0.0)
    download.receive(mission_ack(code), 0.1)
    assert (download.result and download.result.outcome) == outcome


def test_who_was_asked_for_items_in_the_wrong_order_refuses_by_error():
    download, _asked = reading(3, in_order=True)
    download.receive(mission_ack(1), 3.0)
    assert download.result.outcome is DownloadOutcome.REFUSED


def test_an_empty_mission_is_a_complete_one():
    download = Download(PEER)
    download.start(0.0)
    download.receive(mavlink.MAVLink_mission_count_message(255, 190, 0, 0), 0.1)
    assert download.result.items == ()
    assert download.result.outcome is DownloadOutcome.COMPLETE


@pytest.mark.parametrize("counted", [False, True], ids=["no count", "no item"])
def test_a_download_repeats_each_question_a_dozen_times(counted):
    download = Download(PEER)
    sent = download.start(0.0)
    if counted:
        sent = download.receive(mavlink.MAVLink_mission_count_message(255, 190, 2, 0), 0.0)
    while download.result is None:
        sent += download.tick(download.next_deadline)
    wanted = "MISSION_REQUEST_INT" if counted else "MISSION_REQUEST_LIST"
    assert kinds(sent) == [wanted] * 12 + ["MISSION_ACK"]
    ended = DownloadOutcome.BROKEN_OFF if counted else DownloadOutcome.NO_ANSWER
    assert download.result.outcome is ended


# Waiting


def test_until_sees_it_or_gives_up():
    seen = []
    until = Until(lambda: bool(seen), 3.0)
    until.start(10.0)
    assert (until.result, until.next_deadline) == (None, 13.0)
    seen.append(1)
    until.receive(ack(1, 0), 11.0)
    assert until.result is True
    pause = wait(2.0)
    pause.start(0.0)
    pause.tick(1.9)
    assert pause.result is None
    pause.tick(2.0)
    assert pause.result is False


def test_look_asks_for_a_heartbeat_and_takes_none_for_new_that_came_before():
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3)
    seen = [1]
    look = Look(PEER, lambda: bool(seen), 2.5)
    (request,) = look.start(10.0)
    assert (request.command, request.param1) == (512, 0.0)
    look.receive(ack(512, 0), 10.1)
    assert look.result is None
    seen.clear()
    look.receive(beat, 10.2)
    assert look.result is None
    assert (kinds(look.tick(11.0)), kinds(look.tick(12.0))) == (["COMMAND_LONG"], ["COMMAND_LONG"])
    assert (look.tick(12.5), look.result) == ([], False)
    again = Look(PEER, lambda: True, 2.5)
    again.start(0.0)
    again.receive(beat, 0.1)
    assert again.result is True


def test_ask_repeats_every_second_until_the_message_comes():
    ask = Ask(PEER, 148)
    assert [m.param1 for m in ask.start(0.0)] == [148.0]
    assert ask.tick(0.5) == []
    assert kinds(ask.tick(1.0)) == ["COMMAND_LONG"]
    message = mavlink.MAVLink_autopilot_version_message(0, 1, 0, 0, 0, b"", b"", b"", 0, 0, 0)
    ask.receive(message, 1.5)
    assert ask.result is message


# All


@pytest.mark.parametrize(
    "conversation",
    [
        Command(PEER, 300),
        Upload(PEER, ITEMS),
        Download(PEER),
        wait(1.0),
        Ask(PEER, 148),
        Look(PEER, bool, 1.0),
    ],
)
def test_an_illegal_event_names_the_state_and_late_words_are_ignored(conversation):
    name = type(conversation).__name__
    with pytest.raises(IllegalEvent, match=f"{name}: receive while new"):
        conversation.receive(ack(300, 0), 0.0)
    conversation.start(0.0)
    with pytest.raises(IllegalEvent, match=f"{name}: start while waiting"):
        conversation.start(0.0)
    conversation.cancel(0.1)
    assert conversation.state is State.DONE
    assert conversation.receive(ack(300, 0), 0.2) == []
    assert conversation.tick(99.0) == []
    assert (conversation.result, conversation.next_deadline) == (None, None)


# Append


def announced(messages) -> list[tuple[int, int]]:
    partial = [m for m in messages if m.get_type() == "MISSION_WRITE_PARTIAL_LIST"]
    return [(m.start_index, m.end_index) for m in partial]


def items_of(messages) -> list[int]:
    return [m.seq for m in messages if m.get_type() == "MISSION_ITEM_INT"]


def count(n: int):
    return mavlink.MAVLink_mission_count_message(255, 190, n, 0)


MANY = tuple(MissionItem(16, 3, 460_000_000 + i, 145_000_000, 20.0 + i) for i in range(12))


@pytest.mark.parametrize("asks", [True, False])
def test_items_are_appended_each_announced_by_itself_whether_they_are_asked_for_or_not(asks):
    """ArduPilot asks when it sends next, and only for what has not come by then."""
    append = Append(PEER, 7, ITEMS)
    out = append.start(0.0)
    assert announced(out) == [(7, 7), (8, 8), (9, 9)]
    assert items_of(out) == [7, 8, 9]
    for seq in (7, 8, 9):
        if asks:
            assert append.receive(request(seq), 0.1) == [], "it is on its way"
        assert append.result is None
        assert append.receive(mission_ack(0), 0.1) == []
    assert append.result.failure is None
    assert append.result.answers_after_s == pytest.approx(0.1)


def test_of_many_items_eight_are_on_their_way():
    append = Append(PEER, 7, MANY)
    assert items_of(append.start(0.0)) == list(range(7, 15))
    assert items_of(append.receive(mission_ack(0), 0.1)) == [15]
    assert items_of(append.receive(mission_ack(0), 0.1)) == [16]


def test_an_item_that_it_goes_on_asking_for_is_sent_again():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    assert append.receive(request(7), 0.1) == []
    assert items_of(append.receive(request(7), 1.1)) == [7]


def test_an_item_that_came_before_its_announcement_is_sent_when_it_is_asked_for():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(1), 0.1)
    assert items_of(append.receive(request(7), 0.2)) == [7]


def test_after_a_loss_it_is_asked_what_it_holds_and_gets_the_rest():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(0), 0.1)
    append.receive(mission_ack(1), 0.1)  # for the announcement of the last: the one before was lost
    assert kinds(append.tick(0.6)) == ["MISSION_REQUEST_LIST"]
    out = append.receive(count(8), 0.7)
    assert announced(out) == [(8, 8)] * 2 + [(9, 9)] * 2, "each twice from now on"
    assert items_of(out) == [8, 8, 9, 9]
    append.receive(mission_ack(0), 0.8)
    assert append.receive(mission_ack(1), 0.8) == [], "of the double"
    assert kinds(append.receive(mission_ack(0), 0.8)) == ["MISSION_REQUEST_LIST"] * 2
    assert append.result is None, "of doubles both may be acknowledged"
    append.receive(count(10), 0.9)
    assert append.result.failure is None


def test_of_what_goes_out_several_times_fewer_are_on_their_way():
    append = Append(PEER, 7, MANY)
    append.start(0.0)
    append.tick(0.5)
    assert items_of(append.receive(count(8), 0.6)) == [seq for seq in range(8, 16) for _ in range(2)]
    append.tick(append.next_deadline)
    assert items_of(append.receive(count(8), 9.0)) == [seq for seq in range(8, 13) for _ in range(3)]


def test_where_it_still_waits_for_an_item_what_is_missing_is_announced_anew():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(0), 0.1)
    append.tick(0.6)
    assert announced(append.receive(mission_ack(14), 0.7)) == [(8, 8)] * 2 + [(9, 9)] * 2


def test_on_a_slow_link_the_refusals_of_several_questions_do_not_end_it():
    """It is asked twice what it holds before the first answer comes, and waits for an item each time."""
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(0), 0.1)
    assert kinds(append.tick(0.6)) == ["MISSION_REQUEST_LIST"]
    assert kinds(append.tick(append.next_deadline)) == ["MISSION_REQUEST_LIST"]
    assert announced(append.receive(mission_ack(14), 2.6)) == [(8, 8)] * 2 + [(9, 9)] * 2
    assert append.receive(mission_ack(14), 3.6) == []
    assert append.result is None
    append.receive(mission_ack(0), 4.6)
    append.receive(mission_ack(0), 4.6)
    append.receive(count(10), 6.6)
    assert append.result.failure is None


def test_the_refusal_of_a_question_of_before_does_not_end_it():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(0), 0.1)
    assert append.receive(mission_ack(14), 0.2) == []
    assert kinds(append.tick(append.next_deadline)) == ["MISSION_REQUEST_LIST"]
    assert announced(append.receive(count(8), 0.9)) == [(8, 8)] * 2 + [(9, 9)] * 2
    append.receive(mission_ack(0), 1.0)
    append.receive(mission_ack(0), 1.0)
    append.receive(count(10), 1.1)
    assert append.result.failure is None


def test_an_acknowledgement_that_was_taken_for_another_is_made_good():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(0), 0.1)
    append.receive(mission_ack(0), 0.2)
    assert append.receive(mission_ack(13), 0.3) == []
    append.tick(0.8)
    assert announced(append.receive(count(8), 0.9)) == [(8, 8)] * 2 + [(9, 9)] * 2


def test_lost_acknowledgements_are_not_missed_where_the_items_are_there():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.tick(0.5)
    append.receive(count(10), 0.6)
    assert append.result.failure is None


def test_a_slow_link_is_not_asked_before_it_can_have_answered():
    append = Append(PEER, 7, MANY)
    append.start(0.0)
    assert kinds(append.tick(0.5)) == ["MISSION_REQUEST_LIST"]
    append.receive(mission_ack(0), 2.0)
    assert append.next_deadline == 5.0


def test_items_that_stand_already_are_not_answered_for():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    assert append.receive(request(6), 0.1) == []
    assert append.receive(request(10), 0.1) == []
    assert append.receive(mission_ack(1), 0.1) == [], "an acknowledgement from before"
    assert append.receive(count(7), 0.1) == [], "nor was it asked"
    assert append.result is None


def test_who_does_not_know_partial_lists_is_found_out_by_what_it_holds():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.tick(0.5)
    assert announced(append.receive(count(7), 0.6)) == [(seq, seq) for seq in (7, 7, 8, 8, 9, 9)]
    append.tick(append.next_deadline)
    append.receive(count(7), 2.0)
    assert "it does not take partial lists" in append.result.failure


def test_who_does_not_answer_is_given_up():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    now = 0.0
    while append.result is None:
        now = append.next_deadline
        append.tick(now)
    assert now == 5.0
    assert "no answer within 5 s" in append.result.failure


@pytest.mark.parametrize("held", [6, 11])
def test_a_list_of_another_length_than_was_known_ends_it(held):
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.tick(0.5)
    append.receive(count(held), 0.6)
    assert f"it holds {held} items where 7 were known" in append.result.failure


@pytest.mark.parametrize(("code", "goes_on"), [(1, True), (13, True), (15, True), (5, False), (4, False)])
def test_an_item_that_is_refused_ends_it_but_a_complaint_about_a_double_does_not(code, goes_on):
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(code), 0.1)
    assert (append.result is None) == goes_on


def test_a_link_that_brings_too_little_ends_it_with_how_far_it_came():
    append = Append(PEER, 7, ITEMS)
    append.start(0.0)
    append.receive(mission_ack(0), 0.2)
    now = 0.2
    while append.result is None:
        now = append.next_deadline
        append.tick(now)
    assert "1 of 3 items, none more for 30 s" in append.result.failure
    assert now == 30.2


# Set current


def test_a_current_item_is_set_by_message_and_seen():
    setting = SetCurrent(PEER, 3)
    assert [(m.get_type(), m.seq) for m in setting.start(0.0)] == [("MISSION_SET_CURRENT", 3)]
    assert setting.receive(mavlink.MAVLink_mission_current_message(2), 0.1) == []
    assert setting.result is None
    setting.receive(mavlink.MAVLink_mission_current_message(3), 0.2)
    assert setting.result.final


def test_a_current_item_that_is_not_seen_may_have_been_set():
    setting = SetCurrent(PEER, 3)
    setting.start(0.0)
    assert setting.next_deadline == 1.0
    assert setting.tick(1.0) == []
    assert (setting.result.final, setting.result.may_have_happened) == (False, True)


def test_the_item_to_fly_is_marked_in_an_upload():
    upload = Upload(PEER, ITEMS, current=1)
    upload.start(0.0)
    sent = [m for seq in range(3) for m in upload.receive(request(seq), 0.1)]
    assert [(m.seq, m.current) for m in sent] == [(0, 0), (1, 1), (2, 0)]
