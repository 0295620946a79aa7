"""Rows of (state, input, now) -> (output, deadline): reading a mission back."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_texts import PEER, kinds, mission_ack, mission_count

from swarmctl.mavlink.protocol.mission_download import Download, DownloadOutcome


def started_download(**more: Any) -> Download:
    download = Download(PEER, **more)
    download.start(0.0)
    return download


def test_a_download_requests_item_by_item_and_acknowledges():
    download = Download(PEER)
    assert kinds(download.start(0.0)) == ["MISSION_REQUEST_LIST"]
    sent = download.receive(mission_count(2), 0.1)
    for seq in (0, 1):
        assert [m.seq for m in sent] == [seq]
        sent = download.receive(item(seq), 0.2)
        assert seq == 1 or download.receive(item(seq), 0.2) == [], "a duplicate is ignored"
    assert [m.type for m in sent] == [0]
    assert download.result.outcome is DownloadOutcome.COMPLETE
    assert [i.x for i in download.result.items] == [10, 11]


@pytest.mark.parametrize(
    ("system", "component", "takes"),
    [(255, 190, True), (0, 0, True), (255, 0, True), (254, 190, False), (255, 191, False)],
)
def test_an_answer_counts_if_its_target_is_this_station_or_left_0(system, component, takes):
    download = started_download()
    sent = download.receive(mavlink.MAVLink_mission_count_message(system, component, 2, 0), 0.1)
    assert kinds(sent) == ["MISSION_REQUEST_INT"] * takes


def item(seq: int):
    return mavlink.MAVLink_mission_item_int_message(
        255, 190, seq, 3, 16, 0, 1, 0, 0, 0, 0, 10 + seq, 20, 30.0, 0
    )


def counted_download(n_items: int, *, in_order: bool) -> tuple[Download, list[int]]:
    """Return a download over a link with 2 s to an answer, and the items requested first."""
    download = started_download(window=8, in_order=in_order)
    asked = download.receive(mission_count(n_items), 2.0)
    return download, [m.seq for m in asked]


@pytest.mark.parametrize("in_order", [False, True])
def test_a_download_requests_eight_items_at_a_time(in_order):
    download, asked = counted_download(10, in_order=in_order)
    assert asked == list(range(8))
    for seq in range(10):
        assert download.next_deadline > 4.0, "the answer is on its way"
        sent = download.receive(item(seq), 4.0)
        assert [m.seq for m in sent[:1] if m.get_type() == "MISSION_REQUEST_INT"] == [8 + seq] * (seq < 2)
    assert [i.x for i in download.result.items] == list(range(10, 20))


def test_a_missing_item_is_requested_again_from_a_vehicle_that_serves_any_order():
    download, _asked = counted_download(3, in_order=False)
    download.receive(item(0), 4.0)
    download.receive(item(2), 4.0)
    assert [m.seq for m in download.tick(download.next_deadline)] == [1]


def test_a_late_count_does_not_lengthen_the_wait_for_an_item():
    download = started_download(window=8)
    download.receive(mission_count(3), 9.5)
    assert download.next_deadline == 13.5


def test_a_missing_item_is_not_requested_again_from_a_vehicle_that_serves_in_order():
    download, _asked = counted_download(3, in_order=True)
    download.receive(item(0), 4.0)
    (closing,) = download.tick(download.next_deadline)
    assert (closing.get_type(), closing.type) == ("MISSION_ACK", 15)
    assert download.result.outcome is DownloadOutcome.BROKEN_OFF


def test_copies_of_a_request_precede_the_next_request():
    """PX4 answers a repeated request for its last item, but none for an earlier item."""
    download = started_download(window=3, copies=2, in_order=True)
    asked = download.receive(mission_count(5), 2.0)
    assert [m.seq for m in asked] == [0, 0, 1, 1, 2, 2]
    assert [m.seq for m in download.receive(item(0), 4.0)] == [3, 3]
    assert download.receive(item(0), 4.0) == [], "the answer to the copy is ignored"
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
def test_a_download_ends_only_at_its_own_errors(code, outcome):
    download = started_download()
    download.receive(mission_ack(code), 0.1)
    assert (download.result and download.result.outcome) == outcome


def test_requests_in_the_wrong_order_are_refused_with_an_error():
    download, _asked = counted_download(3, in_order=True)
    download.receive(mission_ack(1), 3.0)
    assert download.result.outcome is DownloadOutcome.REFUSED


def test_an_unrequested_item_is_ignored_as_one_of_an_earlier_download():
    download = started_download()
    download.receive(mission_count(2), 0.1)
    assert download.receive(item(1), 0.2) == []
    assert [m.seq for m in download.receive(item(0), 0.3)] == [1]


def test_an_empty_mission_is_a_complete_download():
    download = started_download()
    download.receive(mission_count(0), 0.1)
    assert download.result.items == ()
    assert download.result.outcome is DownloadOutcome.COMPLETE


@pytest.mark.parametrize("counted", [False, True], ids=["no count", "no item"])
def test_a_download_repeats_each_request_twelve_times(counted):
    download = Download(PEER)
    sent = download.start(0.0)
    if counted:
        sent = download.receive(mission_count(2), 0.0)
    while download.result is None:
        sent += download.tick(download.next_deadline)
    wanted = "MISSION_REQUEST_INT" if counted else "MISSION_REQUEST_LIST"
    assert kinds(sent) == [wanted] * 12 + ["MISSION_ACK"]
    ended = DownloadOutcome.BROKEN_OFF if counted else DownloadOutcome.NO_ANSWER
    assert download.result.outcome is ended
