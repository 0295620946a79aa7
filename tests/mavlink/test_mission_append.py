"""Rows of (state, input, now) -> (output, deadline): appending items to a mission."""

from __future__ import annotations

import re

import pytest
from vehicle_texts import ITEMS, PEER, kinds, mission_ack, mission_count, request

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.mission_append import Append


def announced(messages) -> list[tuple[int, int]]:
    partial = [m for m in messages if m.get_type() == "MISSION_WRITE_PARTIAL_LIST"]
    return [(m.start_index, m.end_index) for m in partial]


def items_of(messages) -> list[int]:
    return [m.seq for m in messages if m.get_type() == "MISSION_ITEM_INT"]


MANY = tuple(MissionItem(16, 3, 460_000_000 + i, 145_000_000, 20.0 + i) for i in range(12))


def started_append(items: tuple[MissionItem, ...] = ITEMS) -> Append:
    append = Append(PEER, 7, items)
    append.start(0.0)
    return append


@pytest.mark.parametrize("asks", [True, False])
def test_each_appended_item_is_announced_and_sent_with_or_without_a_request(asks):
    """ArduPilot requests only the items that have not arrived by its next transmission."""
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
    assert append.result.round_trip_s == pytest.approx(0.1)


def test_eight_of_many_items_are_under_way():
    append = Append(PEER, 7, MANY)
    assert items_of(append.start(0.0)) == list(range(7, 15))
    assert items_of(append.receive(mission_ack(0), 0.1)) == [15]
    assert items_of(append.receive(mission_ack(0), 0.1)) == [16]


def test_an_item_that_is_requested_again_is_sent_again():
    append = started_append()
    assert append.receive(request(7), 0.1) == []
    assert items_of(append.receive(request(7), 1.1)) == [7]


def test_an_item_that_overtook_its_announcement_is_sent_on_request():
    append = started_append()
    append.receive(mission_ack(1), 0.1)
    assert items_of(append.receive(request(7), 0.2)) == [7]


def test_a_count_request_after_a_loss_finds_the_missing_items():
    append = started_append()
    append.receive(mission_ack(0), 0.1)
    append.receive(mission_ack(1), 0.1)  # for the last announcement, as the second was lost
    assert kinds(append.tick(0.6)) == ["MISSION_REQUEST_LIST"]
    out = append.receive(mission_count(8), 0.7)
    assert announced(out) == [(8, 8)] * 2 + [(9, 9)] * 2, "each twice from now on"
    assert items_of(out) == [8, 8, 9, 9]
    append.receive(mission_ack(0), 0.8)
    assert append.receive(mission_ack(1), 0.8) == [], "the refusal of the copy is ignored"
    assert kinds(append.receive(mission_ack(0), 0.8)) == ["MISSION_REQUEST_LIST"] * 2
    assert append.result is None, "the vehicle may acknowledge both copies"
    append.receive(mission_count(10), 0.9)
    assert append.result.failure is None


def test_fewer_items_are_under_way_when_each_is_sent_several_times():
    append = started_append(MANY)
    append.tick(0.5)
    assert items_of(append.receive(mission_count(8), 0.6)) == [seq for seq in range(8, 16) for _ in range(2)]
    append.tick(append.next_deadline)
    assert items_of(append.receive(mission_count(8), 9.0)) == [seq for seq in range(8, 13) for _ in range(3)]


def test_missing_items_are_announced_again_while_the_vehicle_waits_for_one():
    append = started_append()
    append.receive(mission_ack(0), 0.1)
    append.tick(0.6)
    assert announced(append.receive(mission_ack(14), 0.7)) == [(8, 8)] * 2 + [(9, 9)] * 2


def test_refusals_of_several_requests_on_a_slow_link_do_not_end_the_append():
    """The vehicle gets two count requests before its first answer arrives and refuses both."""
    append = started_append()
    append.receive(mission_ack(0), 0.1)
    assert kinds(append.tick(0.6)) == ["MISSION_REQUEST_LIST"]
    assert kinds(append.tick(append.next_deadline)) == ["MISSION_REQUEST_LIST"]
    assert announced(append.receive(mission_ack(14), 2.6)) == [(8, 8)] * 2 + [(9, 9)] * 2
    assert append.receive(mission_ack(14), 3.6) == []
    assert append.result is None
    append.receive(mission_ack(0), 4.6)
    append.receive(mission_ack(0), 4.6)
    append.receive(mission_count(10), 6.6)
    assert append.result.failure is None


def test_a_refusal_of_an_earlier_request_does_not_end_the_append():
    append = started_append()
    append.receive(mission_ack(0), 0.1)
    assert append.receive(mission_ack(14), 0.2) == []
    assert kinds(append.tick(append.next_deadline)) == ["MISSION_REQUEST_LIST"]
    assert announced(append.receive(mission_count(8), 0.9)) == [(8, 8)] * 2 + [(9, 9)] * 2
    append.receive(mission_ack(0), 1.0)
    append.receive(mission_ack(0), 1.0)
    append.receive(mission_count(10), 1.1)
    assert append.result.failure is None


def test_a_misattributed_acknowledgement_is_corrected():
    append = started_append()
    append.receive(mission_ack(0), 0.1)
    append.receive(mission_ack(0), 0.2)
    assert append.receive(mission_ack(13), 0.3) == []
    append.tick(0.8)
    assert announced(append.receive(mission_count(8), 0.9)) == [(8, 8)] * 2 + [(9, 9)] * 2


def test_lost_acknowledgements_do_not_matter_if_the_items_are_stored():
    append = started_append()
    append.tick(0.5)
    append.receive(mission_count(10), 0.6)
    assert append.result.failure is None


def test_a_slow_link_gets_no_request_before_an_answer_is_possible():
    append = started_append(MANY)
    assert kinds(append.tick(0.5)) == ["MISSION_REQUEST_LIST"]
    append.receive(mission_ack(0), 2.0)
    assert append.next_deadline == 5.0


def test_requests_for_stored_items_are_not_answered():
    append = started_append()
    assert append.receive(request(6), 0.1) == []
    assert append.receive(request(10), 0.1) == []
    assert append.receive(mission_ack(1), 0.1) == [], "an acknowledgement from before"
    assert append.receive(mission_count(7), 0.1) == [], "no count was requested"
    assert append.result is None


def test_a_vehicle_without_partial_lists_is_recognised_by_its_count():
    append = started_append()
    append.tick(0.5)
    assert announced(append.receive(mission_count(7), 0.6)) == [(seq, seq) for seq in (7, 7, 8, 8, 9, 9)]
    append.tick(append.next_deadline)
    append.receive(mission_count(7), 2.0)
    assert "[no-append]" in append.result.failure


def test_an_append_without_any_answer_ends():
    append = started_append()
    now = 0.0
    while append.result is None:
        now = append.next_deadline
        append.tick(now)
    assert now == 5.0
    assert "[no-answer]" in append.result.failure


@pytest.mark.parametrize("held", [6, 11])
def test_a_list_of_another_length_than_expected_ends_the_append(held):
    append = started_append()
    append.tick(0.5)
    append.receive(mission_count(held), 0.6)
    assert "[mission-changed]" in append.result.failure
    assert {str(held), "7"} <= set(re.findall(r"\d+", append.result.failure))


@pytest.mark.parametrize(("code", "goes_on"), [(1, True), (13, True), (15, True), (5, False), (4, False)])
def test_a_refused_item_ends_the_append_and_a_refused_duplicate_does_not(code, goes_on):
    append = started_append()
    append.receive(mission_ack(code), 0.1)
    assert (append.result is None) == goes_on


def test_an_append_without_enough_progress_ends_with_its_progress():
    append = started_append()
    append.receive(mission_ack(0), 0.2)
    now = 0.2
    while append.result is None:
        now = append.next_deadline
        append.tick(now)
    assert "1 of 3 items" in append.result.failure
    assert "[append-stuck]" in append.result.failure
    assert now == 30.2
