"""Broadcast positions of a changed plan, compared with the simulator's positions."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest
from flights import fly, small

from swarmctl.agent.commands import StepResult
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.step import step
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.core import events as ev

pytestmark = [pytest.mark.virtual, pytest.mark.full]

HOSTILES = [[2, 3], [4, 4], [2, 6], [5, 6]]
AFTER_S = (3.0, 5.0, 8.0)
MOST_M = 13.0
"""Largest position error [m]; the comparison of plans allows for 20 m at the vehicle's speed."""


class TrajectoryRecorder:
    """Record of the trajectory sent at each change of plan, and of the vehicles' positions."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._step = step
        self.plans: dict[int, list[tuple[float, Trajectory]]] = {}
        self.was: dict[int, dict[float, tuple[float, float]]] = {}
        monkeypatch.setattr("swarmctl.flight.runner.step", self)

    def __call__(self, state: AgentState, event: ev.Event, now: float) -> StepResult:
        after, effects = self._step(state, event, now)
        vehicle, uav = after.vehicle, after.task.uav
        if vehicle.lat_deg is not None and vehicle.lon_deg is not None:
            place = after.task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg)
            self.was.setdefault(uav, {})[round(vehicle.time_boot_s, 2)] = place
        changed = any(isinstance(effect, ev.SwapMission) for effect in effects)
        if changed and after.phase is Phase.FLYING and after.sent.intent is not None:
            self.plans.setdefault(uav, []).append((vehicle.time_boot_s, after.sent.intent))
        return after, effects

    def off_m(self) -> list[float]:
        """Return distances between sent and true positions, AFTER_S after each plan that was not replaced."""
        found = []
        for uav, plans in self.plans.items():
            for (at_s, path), (next_s, _) in pairwise([*plans, (math.inf, None)]):
                for t in (at_s + after_s for after_s in AFTER_S):
                    place, was = path.at(t), self.was[uav].get(round(t, 2))
                    if t < next_s and place is not None and was is not None:
                        found.append(math.dist(place[:2], was))
        return found


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_changed_plan_is_flown_at_the_broadcast_times(
    autopilot: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = TrajectoryRecorder(monkeypatch)
    scenario = small(
        threats={"count": len(HOSTILES), "hostiles": HOSTILES},
        planner={"w": 0.9},
        simulate={"count": 1, "ready_s": 3.0, "autopilot": autopilot},
    )
    report = fly(scenario, tmp_path)
    assert report.all_arrived
    off_m = recorder.off_m()
    assert len(off_m) >= 6
    assert max(off_m) <= MOST_M, [round(x, 1) for x in off_m]
