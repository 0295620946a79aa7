"""Simultaneous flights to one goal on the virtual clock, checked against the simulator's positions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from flight_monitor import FlightMonitor
from flights import AREA, SEPARATION_WAIVED, Ui, fly, small
from profiles import full_only
from random_flights import RandomFlight
from trouble import Trouble

from swarmctl.config.scenario import Scenario
from swarmctl.report import record

pytestmark = pytest.mark.virtual


def two() -> Scenario:
    """Return two vehicles, 3.5 m apart in height, with simultaneous arrival."""
    return small(
        seed=28,
        area={**AREA, "rows": 5},
        threats={"count": 0},
        flight={"altitude_m": 20.0, "altitude_step_m": 3.5, "any_angle": True},
        simulate={"count": 2, "ready_s": 3.0, "goal": [3, 7], "autopilot": ["ardupilot", "px4"]},
        planner={"w": 0.9},
        arrival={"mode": "simultaneous", "tolerance_s": 3},
    )


def three() -> Scenario:
    return small(
        threats={"count": 0},
        flight={"altitude_m": 20.0, "altitude_step_m": 3.5},
        simulate={"count": 3, "ready_s": 3.0, "goal": [7, 7], "autopilot": ["px4", "ardupilot", "px4"]},
        arrival={"mode": "simultaneous", "tolerance_s": 3},
    )


def six() -> Scenario:
    return small(
        seed=26,
        area={**AREA, "rows": 6},
        threats={"count": 3},
        flight={"altitude_m": 12.0, "altitude_step_m": 3.5},
        simulate={
            "count": 6,
            "ready_s": 3.0,
            "goal": [0, 7],
            "autopilot": ["px4", "px4", "ardupilot", "ardupilot", "ardupilot", "px4"],
        },
        planner={"w": 0.9},
        arrival={"mode": "simultaneous", "tolerance_s": 3},
    )


@pytest.mark.parametrize("swarm", [two, *full_only(three, six)])
def test_vehicles_that_arrive_at_one_goal_together_land_apart(
    swarm: Callable[[], Scenario], tmp_path: Path
) -> None:
    drawn, ui = RandomFlight(swarm(), Trouble()), Ui()
    monitor = FlightMonitor(drawn)
    monitor.attend()
    report = fly(drawn.scenario, tmp_path, trouble=drawn.trouble, ui=ui, options=SEPARATION_WAIVED)
    assert report.all_arrived, [state.outcome for state in report.states.values()]
    assert monitor.close == {}
    waits = [line for line in ui.said if line.endswith("[landing-queue]")]
    assert waits or any(line.endswith(("[stops-in-time]", "[plan-deferred-hold]")) for line in ui.said)
    goes_on = [line for line in ui.said if line.endswith("[descent-clear]")]
    assert len(goes_on) >= len(waits)
    assert report.summary["separation"]["plans_in_flight"]["by_waiting"] >= len(waits)
    # A vehicle in the landing queue has arrived with the others.
    assert report.summary["arrival"]["spread_s"] < 3.0
    assert record.replay(tmp_path / "run.mcap").difference == ""
