"""Two vehicles that meet at a gap, and flights without the comparison of plans."""

from __future__ import annotations

from typing import Any

import pytest
from flights import AREA, small

from swarmctl.agent import step
from swarmctl.agent.replan import mission_changes
from swarmctl.config.scenario import Scenario

GAP = ([0, 3], [1, 3], [2, 3], [6, 3], [7, 3], [8, 3])
"""unknown hostiles with a gap half-way between the first routes of two copters"""


def through_the_gap(**sections: Any) -> Scenario:
    """Return two copters at one height, 200 m apart.

    Both see the hostiles ahead at the same time and change to a route through the gap.
    """
    return small(
        area={**AREA, "rows": 9},
        simulate={"count": 2, "ready_s": 3.0, "start_distance_m": 40.0},
        flight={"altitude_m": 15.0, "altitude_step_m": 0.0},
        threats={"count": len(GAP), "hostiles": GAP},
        planner={"w": 0.9},
        **sections,
    )


def compare_no_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    """Switch off the comparison of plans between vehicles; alarms and the last resort remain."""
    monkeypatch.setattr(mission_changes, "deconflict", lambda _before, decided, _now: decided)
    monkeypatch.setattr(step, "check_own_route", lambda state: (state, []))
