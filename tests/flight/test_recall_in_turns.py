"""Recall in turns: one agent, and whole swarms recalled by an operator or by Ctrl-C."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from agent_stories import Story, answers, orders
from companion_world import STATION, Swarm
from flights import FaultyUi, Ui, coded, fly, fly_with_commands, small
from trouble import Trouble, interrupting, interrupts, select_mode

from sim_vehicle.truth import Truth
from swarmctl.agent.failsafes import low_battery
from swarmctl.agent.failsafes.base import ActiveRule
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED
from swarmctl.agent.traffic.return_schedule import MIN_HORIZONTAL_M
from swarmctl.agent.traffic.wait import Wait, WaitFor
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.events import FlightOrder
from swarmctl.core.geo import distance_m
from swarmctl.core.messages import GiveOrder, VehicleAnswer
from swarmctl.core.records import replace
from swarmctl.flight import virtual_simulator
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.outcome import FlightReport
from swarmctl.station import commands
from swarmctl.station.commands import Answers

pytestmark = pytest.mark.virtual

HOLD, RETURN, LAND = FlightOrder.HOLD, FlightOrder.RETURN, FlightOrder.LAND


# --- the agent


def answer_of(effects: list[ev.Effect]) -> VehicleAnswer:
    (answer,) = answers(effects)
    return answer


def queued(**changes: Any) -> Story:
    """A recalled vehicle that waits 10 s for its turn; its clock shows 100 s."""
    story = Story(**changes).flying()
    story.over((4, 1), time_boot_s=100.0)
    assert orders(story(ev.OperatorCommand(RETURN, 1, after_s=10.0))) == [HOLD]
    story(ev.OrderDone(HOLD))
    return story


def waits(story: Story, time_boot_s: float, **changes: Any) -> list[FlightOrder]:
    held = {"mode": "GUIDED", "mode_role": "hold", **changes}
    return orders(story.over((4, 1), time_boot_s=time_boot_s, **held))


def test_a_vehicle_holds_until_its_turn_and_then_returns() -> None:
    story = queued()
    note = answer_of(story(ev.OperatorCommand(RETURN, 2, after_s=10.0))).note
    assert "10 s" in note
    assert note.endswith("[return-queue]")
    assert waits(story, 109.9) == []
    assert story.state.phase is Phase.HOLDING
    assert waits(story, 110.1) == [RETURN]
    assert (story.state.phase, story.state.order.given) == (Phase.LEAVING, RETURN)


def test_a_later_turn_replaces_the_first_and_an_order_without_a_turn_begins_at_once() -> None:
    story = queued()
    assert orders(story(ev.OperatorCommand(RETURN, 2, after_s=30.0))) == []
    assert waits(story, 120.0) == []
    assert orders(story(ev.OperatorCommand(RETURN, 3))) == [RETURN]


@pytest.mark.parametrize(("order", "sent"), [(HOLD, []), (LAND, [LAND])])
def test_another_order_ends_the_wait(order: FlightOrder, sent: list[FlightOrder]) -> None:
    story = queued()
    assert orders(story(ev.OperatorCommand(order, 2))) in (sent, [HOLD])
    assert waits(story, 200.0, mode_role=order.value) == []


def test_a_low_battery_ends_the_wait() -> None:
    story = queued(rules=(ActiveRule(low_battery, low_battery.Params(seconds=0.0)),))
    assert waits(story, 101.0, battery_percent=20) == [RETURN]
    assert waits(story, 111.0, mode_role="return", battery_percent=20) == []


def test_a_vehicle_clock_that_is_set_back_ends_the_wait() -> None:
    story = queued()
    story.state = replace(story.state, wait=Wait(WaitFor.TURN, 8000.0, 9000.0))
    assert waits(story, 1.0) == [RETURN]


@pytest.mark.parametrize("order", [HOLD, RETURN, LAND])
def test_a_repeated_order_changes_nothing(order: FlightOrder) -> None:
    story = Story().flying()
    story(ev.OperatorCommand(order, 1))
    story(ev.OrderDone(order))
    effects = story(ev.OperatorCommand(order, 2))
    assert orders(effects) == []
    assert answer_of(effects).outcome == "taken"
    assert answer_of(effects).note.endswith("[already-done]")


# --- whole swarms


def gathering(**sections: object) -> Scenario:
    """Return a swarm of three vehicles with one goal.

    From 47 s to 55 s two of them may return at once, and the vehicle between them afterwards.
    """
    return small(simulate={"count": 3, "ready_s": 3.0, "goal": [4, 7]}, **sections)


def landing_together() -> Scenario:
    """Return a swarm of two vehicles with one goal, 6 m apart in height, that lands when it is stopped."""
    return small(
        simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0},
        threats={"count": 0},
        flight={"altitude_m": 15.0, "altitude_step_m": 6.0, "on_exit": "land", "on_exit_deadline_s": 200.0},
    )


@dataclass
class ReturnMonitor:
    """The start times of returns, and the least horizontal distance between returning vehicles."""

    since_s: dict[int, float] = field(default_factory=dict)
    least_m: float = float("inf")

    def __call__(self, now: float, truth: Truth) -> None:
        returning = []
        for index, mode in enumerate(truth.mode):
            if mode == "RTL" and truth.armed[index]:
                self.since_s.setdefault(int(truth.sysid[index]), now)
                returning.append((float(truth.lat_deg[index]), float(truth.lon_deg[index])))
        near = (distance_m(one, other) for one, other in combinations(returning, 2))
        self.least_m = min((self.least_m, *near))


def outcomes(answer: Answers) -> list[str]:
    return [vehicle.outcome for vehicle in answer]


def test_a_swarm_in_one_process_returns_in_turns(tmp_path: Path) -> None:
    trouble = Trouble(on_step=(monitor := ReturnMonitor()))
    back = GiveOrder(None, "return")
    report, answers = fly_with_commands(gathering(), tmp_path, (50.0, back), (65.0, back), trouble=trouble)
    assert [outcomes(answer) for answer in answers] == [["taken"] * 3] * 2
    assert any(vehicle.note.endswith("[already-done]") for vehicle in answers[1])
    assert len(set(monitor.since_s.values())) > 1
    assert monitor.least_m > MIN_HORIZONTAL_M
    assert [(state.phase, state.order.given) for state in report.states.values()] == [
        (Phase.DONE, RETURN)
    ] * 3


@pytest.mark.full
def test_one_vehicle_lands_by_order_and_the_others_fly_on(tmp_path: Path) -> None:
    land = GiveOrder(("uav2",), "land")
    report, (answer,) = fly_with_commands(gathering(), tmp_path, (35.0, land))
    assert outcomes(answer) == ["taken"]
    first, landed, third = report.states.values()
    assert first.outcome == third.outcome == ARRIVED
    assert landed.outcome != ARRIVED
    assert (landed.phase, landed.order.given) == (Phase.DONE, LAND)


@pytest.mark.full
def test_vehicles_recalled_before_the_launch_stay_on_the_ground(
    tmp_path: Path,
) -> None:
    back, launch = GiveOrder(None, "return"), GiveOrder(None, "launch")
    report, answers = fly_with_commands(gathering(), tmp_path, (3.0, back), (60.0, launch))
    assert "[stays-on-ground]" in answers[0][0].note
    assert outcomes(answers[1]) == ["taken"] * 3
    assert report.all_arrived


Presses = list[Callable[[], None]]
"""functions that press Ctrl-C, one for each agent"""


def flown_by_agents(
    scenario: Scenario,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    after_s: float,
    act: Callable[[Swarm, Presses], Awaitable[None]],
) -> list[FlightReport]:
    """Fly each vehicle by an agent of its own, and act `after_s` seconds after all of them fly."""
    presses = interrupts(monkeypatch)

    async def scene() -> list[FlightReport]:
        swarm = Swarm(folder, scenario)
        uavs = [spec.sysid for spec in scenario.specs]
        for uav in uavs:
            swarm.start(uav, "when-ready")
        for uav in uavs:
            await swarm.until(uav, Phase.FLYING)
        await asyncio.sleep(after_s)
        await act(swarm, presses)
        return list(await asyncio.gather(*swarm.flights.values()))

    return list(run_virtual(scene()))


async def press_all(_swarm: Swarm, presses: Presses) -> None:
    for press in presses:
        press()


async def order_all(swarm: Swarm, _presses: Presses) -> None:
    answers = []
    for _ in range(2):
        answers.append(await commands.ask(swarm.bus, STATION, GiveOrder(None, "return")))
        await asyncio.sleep(5.0)
    assert [outcomes(answer) for answer in answers] == [["taken"] * 3] * 2
    assert any(vehicle.note.endswith("[already-done]") for vehicle in answers[1])


@pytest.mark.parametrize(
    ("act", "ended"),
    [
        pytest.param(press_all, "stopped", id="Ctrl-C"),
        pytest.param(order_all, "ended", id="orders", marks=pytest.mark.full),
    ],
)
def test_agents_in_several_processes_return_in_turns(
    act: Callable[[Swarm, Presses], Awaitable[None]],
    ended: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No process assigns turns after Ctrl-C on each."""
    trouble = Trouble(on_step=(monitor := ReturnMonitor()))
    monkeypatch.setattr(virtual_simulator, "simulate", trouble.simulate)
    reports = flown_by_agents(gathering(), tmp_path, monkeypatch, 43.0, act)
    assert [report.ended for report in reports] == [ended] * 3
    assert len({round(at_s) for at_s in monitor.since_s.values()}) > 1
    assert monitor.least_m > MIN_HORIZONTAL_M
    states = [state for report in reports for state in report.states.values()]
    assert [(state.phase, state.order.given) for state in states] == [(Phase.DONE, RETURN)] * 3
    assert not any(state.vehicle.armed for state in states)


@pytest.mark.full
def test_ctrl_c_returns_the_vehicles_in_turns(tmp_path: Path) -> None:
    trouble, ui = interrupting(50.0), Ui()
    trouble.on_step = monitor = ReturnMonitor()
    report = fly(gathering(), tmp_path, trouble=trouble, ui=ui)
    assert report.ended == "stopped"
    assert monitor.least_m > MIN_HORIZONTAL_M
    assert len(set(monitor.since_s.values())) > 1
    assert len(coded(ui.said, "returning", "return-schedule")) == 1
    assert not any(state.vehicle.armed for state in report.states.values())


def test_at_the_deadline_all_waiting_vehicles_return(tmp_path: Path) -> None:
    scenario = gathering(flight={"altitude_m": 15.0, "on_exit_deadline_s": 3.0})
    ui = Ui()
    report = fly(scenario, tmp_path, trouble=interrupting(50.0), ui=ui)
    assert report.ended == "stopped"
    assert [line.endswith("[in-air]") and "mode RTL" in line for line in report.final_states] == [True] * 3
    (late,) = (text for text in ui.said if text.endswith("[deadline]"))
    assert "uav1, uav2, uav3" in late
    assert " 3 s" in late
    assert any(text.endswith("[exit-now]") for text in ui.said)


def test_ctrl_c_twice_returns_all_vehicles_at_the_same_time(tmp_path: Path) -> None:
    ui = Ui()
    report = fly(gathering(), tmp_path, trouble=interrupting(50.0, 50.5), ui=ui)
    assert report.ended == "abandoned"
    assert len(report.final_states) == 3
    assert all("mode RTL" in line for line in report.final_states)
    assert any("uav1, uav2, uav3" in text and text.endswith("[emergency]") for text in ui.said)


@pytest.mark.full
@pytest.mark.parametrize("by_agents", [False, True], ids=["one process", "several"])
def test_ctrl_c_lands_the_lower_of_two_vehicles_first(
    by_agents: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if by_agents:
        reports = flown_by_agents(landing_together(), tmp_path, monkeypatch, 60.0, press_all)
    else:
        reports = [fly(landing_together(), tmp_path, trouble=interrupting(66.0))]
    down_s = {uav: report.statistics.vehicles[uav].last_s for report in reports for uav in report.states}
    assert down_s[2] > down_s[1]
    for report in reports:
        assert report.final_states == ()  # both landed in their goal cell, so they have arrived
        assert report.summary["separation"]["too_close"] == []


def test_a_failed_flight_returns_the_vehicles_in_turns(tmp_path: Path) -> None:
    trouble = Trouble(on_step=(monitor := ReturnMonitor()))
    ui = FaultyUi(after_s=47.0)
    report = fly(gathering(), tmp_path, trouble=trouble, ui=ui, broken=True)
    assert isinstance(report.bug, ExceptionGroup)
    assert json.loads((tmp_path / "summary.json").read_text())["ended"] == report.ended == "failed"
    assert any("uav1, uav2, uav3" in text and text.endswith("[emergency]") for text in ui.said)
    (schedule,) = coded(ui.said, "returning", "return-schedule")
    assert re.match(r"returning: uav1, uav3 [^;]*; uav2 [^;]* \d", schedule)
    assert monitor.least_m > MIN_HORIZONTAL_M
    # The process ends when the last is sent home.
    assert trouble.modes == {1: ["AUTO", "RTL"], 2: ["AUTO", "GUIDED"], 3: ["AUTO", "RTL"]}
    assert [line.endswith("[in-air]") and "mode RTL" in line for line in report.final_states] == [True] * 3


@pytest.mark.full
def test_an_emergency_leaves_a_vehicle_alone_that_a_pilot_takes_over(tmp_path: Path) -> None:
    trouble = Trouble(actions=[(60.0, select_mode(2, "LOITER"))])
    report = fly(gathering(), tmp_path, trouble=trouble, ui=FaultyUi(after_s=47.0), broken=True)
    assert trouble.modes[2] == ["AUTO", "GUIDED", "LOITER"]
    assert ["mode RTL" in line for line in report.final_states] == [True, False, True]
