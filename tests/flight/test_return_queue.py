"""Ctrl-C on several agents at the same time: no process assigns turns."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from companion_world import NAMES, Swarm
from interruptions import interrupts
from recall_stories import ReturnMonitor, gathering, landing_together
from trouble import Trouble, inject

from sim_vehicle.truth import Truth
from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.return_schedule import MIN_HORIZONTAL_M
from swarmctl.config.scenario import Scenario
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.outcome import FlightReport


def pressing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scenario: Scenario, at_s: float
) -> list[FlightReport]:
    """Fly several agents and press Ctrl-C on each at the same time."""
    presses = interrupts(monkeypatch)

    async def scene() -> list[FlightReport]:
        swarm = Swarm(tmp_path, scenario)
        uavs = [uav for uav in NAMES if any(spec.sysid == uav for spec in scenario.specs)]
        for uav in uavs:
            swarm.start(uav, "when-ready")
        for uav in uavs:
            await swarm.until(uav, Phase.FLYING)
        await asyncio.sleep(at_s)
        for press in presses:
            press()
        return list(await asyncio.gather(*swarm.flights.values()))

    reports: list[FlightReport] = run_virtual(scene())
    assert [report.ended for report in reports] == ["stopped"] * len(reports)
    assert not any(s.vehicle.armed for report in reports for s in report.states.values())
    return reports


@pytest.mark.virtual
def test_ctrl_c_of_several_agents_returns_them_in_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monitor = ReturnMonitor()
    inject(Trouble(on_step=monitor), monkeypatch)
    pressing(tmp_path, monkeypatch, gathering(), 43.0)
    assert len({round(at_s) for at_s in monitor.since_s.values()}) > 1
    assert monitor.least_m > MIN_HORIZONTAL_M


@pytest.mark.full
@pytest.mark.virtual
def test_ctrl_c_of_several_agents_lands_the_lower_vehicle_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    down_s: dict[int, float] = {}

    def note(now: float, truth: Truth) -> None:
        for sysid, armed in zip(truth.sysid, truth.armed, strict=True):
            if armed:
                down_s[int(sysid)] = now

    inject(Trouble(on_step=note), monkeypatch)
    reports = pressing(tmp_path, monkeypatch, landing_together(), 60.0)
    assert down_s[2] > down_s[1]
    assert [report.summary["separation"]["too_close"] for report in reports] == [[], []]
