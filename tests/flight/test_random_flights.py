"""Randomly drawn flights with faults, other stations and orders: rules that no flight may break."""

from __future__ import annotations

from pathlib import Path

import pytest
from flight_monitor import FlightMonitor, findings
from flights import SEPARATION_WAIVED, Ui, fly, small
from gap_scenario import compare_no_plans, through_the_gap
from random_flights import RandomFlight, draw
from trouble import Trouble, inject, select_mode

from swarmctl.agent import step
from swarmctl.agent.commands import StepResult, command, release_vehicle
from swarmctl.agent.failsafes import enforcement
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.mavlink.dialects.ardupilot import ArduPilot

pytestmark = pytest.mark.virtual

FILES = ("run.mcap", "evidence.jsonl", "summary.json", "map.png", "uav1.plan", "uav1.tlog", "uav2.tlog")


def flown(drawn: RandomFlight, folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Fly and return a line for each broken rule."""
    monitor = FlightMonitor(drawn)
    monitor.attend()
    with monkeypatch.context() as patched:
        inject(drawn.trouble, patched)
        report = fly(drawn.scenario, folder, ui=Ui(), options=SEPARATION_WAIVED, bus=drawn.bus)
    return findings(monitor, report, folder)


@pytest.mark.parametrize("seed", range(103, 111))
def test_no_drawn_flight_breaks_a_rule(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = draw(seed)
    assert flown(drawn, tmp_path, monkeypatch) == [], drawn.story


def test_equal_seeds_leave_equal_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("one", "other"):
        flown(draw(104), tmp_path / name, monkeypatch)
    for file in FILES:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes(), file


# --- broken rules are found


def slow_wire() -> Trouble:
    return Trouble(faults=[{"fault": "delay", "params": {"delay_s": 0.3}, "vehicles": [1], "at_s": 10.0}])


@pytest.mark.full
def test_a_mission_written_over_the_flown_one_is_found_as_a_mixture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plain() -> RandomFlight:
        return RandomFlight(small(simulate={"count": 2, "ready_s": 3.0}), slow_wire())

    assert flown(plain(), tmp_path / "behind", monkeypatch) == []
    monkeypatch.setattr(ArduPilot, "uploads_atomically", True)
    found = flown(plain(), tmp_path / "over", monkeypatch)
    assert any(text.endswith("[mixture]") for text in found)


@pytest.mark.full
def test_an_order_to_a_released_vehicle_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fights(state: AgentState, why: str) -> StepResult:
        state, released = release_vehicle(state, why)
        state, ordered = command(state, ev.FlightOrder.HOLD, by_person=True)
        return state, [*released, *ordered]

    def taken_over() -> RandomFlight:
        trouble = slow_wire()
        trouble.faults.append({"fault": "absent_ack", "vehicles": [1], "at_s": 25.0})
        trouble.actions += [(30.0, select_mode(1, "LOITER")), (60.0, select_mode(1, "LAND"))]
        return RandomFlight(small(simulate={"count": 2, "ready_s": 3.0}), trouble, excused={1})

    assert flown(taken_over(), tmp_path / "let go", monkeypatch) == []
    monkeypatch.setattr(enforcement, "release_vehicle", fights)
    found = flown(taken_over(), tmp_path / "fought", monkeypatch)
    assert found
    assert all(text.endswith("[order]") for text in found)


@pytest.mark.full
def test_two_vehicles_too_close_without_a_warning_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def drawn_together() -> RandomFlight:
        return RandomFlight(through_the_gap(), Trouble())

    assert flown(drawn_together(), tmp_path / "apart", monkeypatch) == []
    compare_no_plans(monkeypatch)
    monkeypatch.setattr(step, "raise_alarms", lambda state: (state, []))
    monkeypatch.setattr(step, "stop_in_time", lambda state: (state, []))
    found = flown(drawn_together(), tmp_path / "together", monkeypatch)
    assert any("(1, 2)" in text and text.endswith("[no-warning]") for text in found)
