"""Mission changes in flight, in the summary and below the table."""

from __future__ import annotations

import re

from swarmctl.core import events as ev
from swarmctl.report.swaps import MAX_FAILURES, MAX_LISTED, SwapStatistics, swap_lines


def after(*events: ev.MissionAccepted | ev.MissionFailed) -> SwapStatistics:
    swaps = SwapStatistics()
    for event in events:
        swaps.count(event)
    return swaps


STOOD = after(
    ev.MissionAccepted(2, 0.5, 0.0),
    ev.MissionAccepted(3, 4.5, 3.25),
    ev.MissionFailed(4, "old", "no answer", 1.5),
)


def test_changes_failures_and_standstills_are_counted() -> None:
    assert STOOD.summary() == {
        "changed": 2,
        "failed": 1,
        "failures": [{"plan": 4, "reason": "no answer"}],
        "stood_still": 2,
        "stood_still_s": 4.75,
        "longest_stood_still_s": 3.25,
        "took_s": {"p50": 2.5, "max": 4.5},
    }


def test_lines_below_the_table_name_failures_and_standstills() -> None:
    vehicles = [
        {"name": "uav1", "swaps": STOOD.summary()},
        {"name": "uav2", "swaps": after(ev.MissionAccepted(2, 0.5, 0.0)).summary()},
    ]
    total, failure, standstill = swap_lines(vehicles)
    assert re.findall(r"\d+", total)[:2] == ["4", "1"]
    assert failure.startswith("  uav1, plan 4")
    assert failure.endswith("no answer")
    assert "uav1" in standstill
    assert re.findall(r"[0-9.]+", standstill.partition("uav1")[2]) == ["2", "3", "4.8", "3.2"]
    (alone,) = swap_lines(vehicles[1:])
    assert re.findall(r"\d+", alone) == ["1"]


def test_many_failures_are_limited_in_the_summary_and_below_the_table() -> None:
    swaps = after(*(ev.MissionFailed(n, "old", f"reason {n}") for n in range(2, 40)))
    summary = swaps.summary()
    assert summary["failed"] == 38
    assert [failure["plan"] for failure in summary["failures"]] == list(range(40 - MAX_FAILURES, 40))
    _, *listed, rest = swap_lines([{"name": "uav1", "swaps": summary}])
    assert len(listed) == MAX_LISTED
    assert f"{38 - MAX_LISTED} more" in rest
    assert "summary.json" in rest


def test_no_line_is_shown_without_mission_changes() -> None:
    assert swap_lines([{"name": "uav1", "swaps": SwapStatistics().summary()}]) == []
    assert SwapStatistics().summary()["took_s"] is None
