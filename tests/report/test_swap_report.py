"""How long vehicles stood still for changes of their missions: in the summary and below the table."""

from __future__ import annotations

from swarmctl.core import events as ev
from swarmctl.report.swaps import SwapStatistics, swap_lines


def after(*events: ev.MissionAccepted | ev.MissionFailed) -> SwapStatistics:
    swaps = SwapStatistics()
    for event in events:
        swaps.ended(event)
    return swaps


STOOD = after(
    ev.MissionAccepted(2, 0.5, 0.0),
    ev.MissionAccepted(3, 4.5, 3.25),
    ev.MissionFailed(4, "old", "no answer", 1.5),
)


def test_all_and_the_longest_stand_are_counted_and_what_failed_too() -> None:
    assert STOOD.summary() == {
        "changed": 2,
        "failed": 1,
        "stood_still": 2,
        "stood_still_s": 4.75,
        "longest_stood_still_s": 3.25,
        "took_s": {"p50": 2.5, "max": 4.5},
    }


def test_below_the_table_each_that_stood_still_is_named() -> None:
    vehicles = [
        {"name": "uav1", "swaps": STOOD.summary()},
        {"name": "uav2", "swaps": after(ev.MissionAccepted(2, 0.5, 0.0)).summary()},
    ]
    assert swap_lines(vehicles) == [
        "4 changes of missions in flight, 1 failed; stood still for them:",
        "  uav1: 4.8 s in 2 of 3, 3.2 s at most",
    ]
    assert swap_lines(vehicles[1:]) == ["1 changes of missions in flight: no vehicle stood still for one"]


def test_where_no_mission_was_changed_nothing_is_said() -> None:
    assert swap_lines([{"name": "uav1", "swaps": SwapStatistics().summary()}]) == []
    assert SwapStatistics().summary()["took_s"] is None
