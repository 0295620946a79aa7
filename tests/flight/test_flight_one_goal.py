"""Simultaneous flights to one goal on the virtual clock, checked against the simulator's positions."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import pytest
from flights import AREA, SEPARATION_WAIVED, Ui, fly, small
from profiles import full_only
from trouble import Trouble, inject

from sim_vehicle.truth import Truth
from swarmctl.agent.traffic.separation.clash import HEIGHT_TOLERANCE_M
from swarmctl.config.scenario import Scenario
from swarmctl.core.geo import distance_m
from swarmctl.report import record
from swarmctl.report.outcome import FlightReport

pytestmark = pytest.mark.virtual

UP_M = 1.0


class SeparationMonitor:
    """The times at which pairs of vehicles were too close in the air."""

    def __init__(self, scenario: Scenario) -> None:
        self.limits, self.tasks = scenario.config.separation, scenario.tasks
        self.too_close: dict[tuple[int, int], list[float]] = {}

    def look(self, now: float, truth: Truth) -> None:
        assert now < 300.0, "the flight does not end"
        up = [i for i in range(len(self.tasks)) if truth.armed[i] and truth.height_m[i] > UP_M]
        for i, j in combinations(up, 2):
            here, there = ((float(truth.lat_deg[k]), float(truth.lon_deg[k])) for k in (i, j))
            vertical_m = abs(float(truth.alt_amsl_m[i] - truth.alt_amsl_m[j]))
            near = distance_m(here, there) < self.limits.horizontal_m
            if near and vertical_m < self.limits.vertical_m - HEIGHT_TOLERANCE_M:
                self.too_close.setdefault((self.tasks[i].uav, self.tasks[j].uav), []).append(now)


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


def flown(
    scenario: Scenario, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[FlightReport, SeparationMonitor, Ui]:
    monitor, ui = SeparationMonitor(scenario), Ui()
    with monkeypatch.context() as patched:
        inject(Trouble(on_step=monitor.look), patched)
        report = fly(scenario, folder, ui=ui, options=SEPARATION_WAIVED)
    assert report.all_arrived, [state.outcome for state in report.states.values()]
    return report, monitor, ui


@pytest.mark.parametrize("swarm", [two, *full_only(three, six)])
def test_vehicles_that_arrive_at_one_goal_together_land_apart(
    swarm: Callable[[], Scenario], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, monitor, ui = flown(swarm(), tmp_path, monkeypatch)
    assert monitor.too_close == {}
    waits = [line for line in ui.said if line.endswith("[landing-queue]")]
    assert waits or any(line.endswith(("[stops-in-time]", "[plan-deferred-hold]")) for line in ui.said)
    goes_on = [line for line in ui.said if line.endswith("[descent-clear]")]
    assert len(goes_on) >= len(waits)
    assert report.summary["separation"]["plans_in_flight"]["by_waiting"] >= len(waits)
    # A vehicle in the landing queue has arrived with the others.
    assert report.summary["arrival"]["spread_s"] < 3.0
    assert record.replay(tmp_path / "run.mcap").difference == ""
