"""Groups of real autopilots in software keep their places, by the errors in `summary.json`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import yaml
from firmware import FLOWN, Airfield
from flown_cells import summary
from group_flights import in_place, turn_cells
from swarmctl_process import ROOT
from test_firmware_arrives import COPTER, FLIGHT_S, PX4

APPROACHES = ["leader_following", "virtual_structure", "behavioural"]
ROWS, COLS = 7, 14
ACROSS_M, ALONG_M = 2.0, 4.0
"""greatest RMS errors across and along straight ahead at 10 m/s, with messages 100 ms late"""
TURN_M = 8.0
"""greatest error through a turn of 90 degrees"""
SILENT_M = 10.0
"""greatest error with two seconds without messages of the leader"""


def group(n: int, approach: str, **area_changes: object) -> dict[str, Any]:
    """Return the changes of the shipped configuration for copters that fly to the east as a wedge."""
    members = [f"uav{i + 1}" for i in range(n)]
    shape = {"kind": "wedge", "spacing_m": 30.0}
    section = {"name": "alpha", "members": members, "approach": approach, "shape": shape, "speed_m_s": 10.0}
    area = yaml.safe_load((ROOT / "configs" / "formation.yaml").read_text())["area"]
    return {
        "area": {**area, "rows": ROWS, "cols": COLS, **area_changes},
        "threats": {"count": 0},
        "communication": {"delay_s": 0.1},
        "formations": [section],
        "simulated": {"speed_m_s": 12.0, "start_spacing_m": 20.0, "goal": [ROWS // 2, COLS - 1]},
    }


def assert_kept_places(field: Airfield, approach: str) -> None:
    """Check the outcome of each vehicle, and the errors of each member that flew by set-points."""
    report = summary(field.run)
    (flown,) = report["formations"]
    for name, member in flown["members"].items():
        field.keep(FLOWN, f"{name}: {member}")
    for name in field.sysids:
        if approach != "leader_following" or name != "uav1":
            member = flown["members"][name]
            assert member["time_in_place_s"] > 30.0, (name, member)
            assert member["rms_error_m"]["across"] < ACROSS_M, (name, member)
            assert member["rms_error_m"]["along"] < ALONG_M, (name, member)
    assert report["separation"]["too_close"] == []
    for account in report["vehicles"]:
        assert account["outcome"] == "arrived", account


def assert_flown_within(field_of: Any, kinds: Sequence[str], changes: dict[str, Any], most_m: float) -> None:
    """Fly, and check each member's distance from its place after all have joined."""
    with field_of(kinds, example="formation", **changes) as field:
        assert field.fly().ended(within_s=FLIGHT_S) == 0
        for uav, rows in in_place(field.run, field.scenario).items():
            largest_m = max(row.error_m for row in rows)
            field.keep(FLOWN, f"{uav}: {largest_m:.1f} m at most from its place")
            assert largest_m < most_m
        assert summary(field.run)["separation"]["too_close"] == []


def on_each_firmware(test: Any) -> Any:
    """Run a test for each approach on each firmware."""
    kinds = [
        pytest.param([COPTER] * 3, marks=pytest.mark.firmware(COPTER), id="arducopter"),
        pytest.param([PX4] * 3, marks=pytest.mark.firmware(PX4), id="px4"),
    ]
    return pytest.mark.parametrize("approach", APPROACHES)(pytest.mark.parametrize("kinds", kinds)(test))


@on_each_firmware
def test_three_members_keep_their_places(field_of: Any, kinds: Sequence[str], approach: str) -> None:
    with field_of(kinds, example="formation", **group(len(kinds), approach)) as field:
        assert field.fly().ended(within_s=FLIGHT_S) == 0
        assert_kept_places(field, approach)


@pytest.mark.firmware(COPTER)
def test_a_group_of_arducopters_does_not_stop_for_a_new_route(field_of: Any) -> None:
    changes = group(3, "leader_following")
    changes["threats"] = {"count": 1, "hostiles": [[ROWS // 2, COLS // 2]]}
    with field_of([COPTER] * 3, example="formation", **changes) as field:
        assert field.fly().ended(within_s=FLIGHT_S) == 0
        leader = in_place(field.run, field.scenario)[1]
        under_way = [row for row in leader if row.boot_s < leader[-1].boot_s - 5.0]
        slowest_m_s = min(row.speed_m_s for row in under_way)
        field.keep(
            FLOWN, f"slowest: {slowest_m_s:.1f} m/s; largest error {max(r.error_m for r in under_way):.1f} m"
        )
        assert slowest_m_s > 2.0
        assert summary(field.run)["separation"]["too_close"] == []


@on_each_firmware
def test_three_members_keep_their_places_through_a_turn(
    field_of: Any, kinds: Sequence[str], approach: str
) -> None:
    size, no_fly, goal = turn_cells()
    changes = group(len(kinds), approach, rows=size, cols=size, no_fly=no_fly)
    changes["simulated"]["goal"] = goal
    assert_flown_within(field_of, kinds, changes, TURN_M)


@on_each_firmware
def test_two_seconds_without_messages_of_the_leader(
    field_of: Any, kinds: Sequence[str], approach: str
) -> None:
    """The silence returns, because the time of the flight in formation is known only afterwards."""
    changes = group(len(kinds), approach)
    quiet = [{"uavs": ["uav1"], "from_s": at_s, "until_s": at_s + 2.0} for at_s in range(30, 300, 15)]
    changes["communication"]["quiet"] = quiet
    assert_flown_within(field_of, kinds, changes, SILENT_M)
