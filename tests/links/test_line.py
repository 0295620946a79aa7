"""The address of a vehicle: rows of (sender, time) -> verdict."""

from __future__ import annotations

import pytest

from swarmctl.links.line import AddressTracker, AddressVerdict

OK, MOVED, DROPPED, CONFLICT = (
    AddressVerdict.ACCEPTED,
    AddressVerdict.MOVED,
    AddressVerdict.DROPPED,
    AddressVerdict.CONFLICT,
)


def test_a_live_vehicle_keeps_its_address_through_a_silence() -> None:
    lost = False
    tracker = AddressTracker(lambda: lost)
    assert tracker.receive("a", 0.0) is OK
    assert tracker.receive("b", 9.0) is DROPPED
    lost = True
    assert tracker.receive("b", 9.1) is MOVED


@pytest.mark.parametrize(
    "story",
    [
        [("a", 0.0, OK), ("a", 1.0, OK), ("a", 9.0, OK)],
        [("a", 0.0, OK), ("b", 2.0, MOVED), ("b", 2.1, OK)],
        [("a", 0.0, OK), ("b", 0.3, DROPPED), ("b", 1.3, DROPPED), ("b", 2.3, MOVED), ("b", 3.0, OK)],
        [("a", 0.0, OK), ("b", 0.3, DROPPED), ("a", 0.5, CONFLICT), ("b", 0.7, DROPPED), ("a", 0.9, OK)],
        [
            ("a", 0.0, OK),
            ("b", 0.3, DROPPED),
            ("a", 1.9, CONFLICT),
            ("c", 2.0, DROPPED),
            ("a", 2.1, CONFLICT),
        ],
        [("a", 0.0, OK), ("b", 0.3, DROPPED), ("a", 0.4, CONFLICT), ("b", 2.4, MOVED), ("a", 2.5, DROPPED)],
    ],
    ids=[
        "one vehicle",
        "a reboot comes back from another port after a silence",
        "a quick reboot is followed once the old port has been silent",
        "two senders at once: reported once, the second dropped",
        "a third sender is reported as well",
        "the first of two senders falls silent",
    ],
)
def test_the_verdicts_on_a_sequence_of_senders(story):
    route = AddressTracker(lambda: True)
    assert [(sender, now, route.receive(sender, now)) for sender, now, _ in story] == story
