"""The jobs of a runner: one at a time, in any order of events, and none of them lost or left over."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from director_ground import StubLink, runner_of
from flights import small

from swarmctl.agent.launch import Launch
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.runner import Runner
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.mavlink.events import StatusText

TAKES_S, ENDS_S = 5.0, 0.5


Script = Sequence[tuple[float, Sequence[ev.Event]]]
"""times [s], and the events posted then"""


@dataclass
class Notes:
    """An observer that keeps the lines about a vehicle, and whether they are for the operator."""

    lines: list[tuple[str, bool]] = field(default_factory=list)

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None: ...

    def noted(self, uav: int, text: str, now: float, *, to_operator: bool) -> None:
        self.lines.append((text, to_operator))


def flying(link: StubLink, *observers: Notes) -> Runner:
    """Return the runner of a vehicle in flight."""
    runner = runner_of(small(), link, 0, *observers)
    where = VehicleState(lat_deg=46.0, lon_deg=14.0, alt_rel_m=30.0, alt_amsl_m=330.0, armed=True)
    runner.state = replace(runner.state, phase=Phase.FLYING, vehicle=where, launch=Launch(armed_boot_s=0.0))
    return runner


def flown(script: Script) -> StubLink:
    """Post the script to a vehicle in flight and return its link; a coroutine never awaited is a failure."""

    async def scene() -> StubLink:
        link = StubLink(takes_s=TAKES_S, ends_s=ENDS_S)
        task = asyncio.create_task((runner := flying(link)).run())
        for at_s, events in script:
            await asyncio.sleep(at_s - asyncio.get_running_loop().time())
            for event in events:
                runner.post(event)
        await asyncio.wait((task,), timeout=3.0 * TAKES_S)
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        return link

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        link = run_virtual(scene())
        gc.collect()
    assert [str(w.message) for w in caught] == []
    return link


def order(name: str) -> ev.OperatorCommand:
    return ev.OperatorCommand(ev.FlightOrder(name))


def test_the_last_of_simultaneous_orders_is_followed() -> None:
    link = flown([(0.0, [order("hold"), order("return"), order("land")])])
    assert link.calls == ["land"]


def test_a_job_ends_before_the_last_of_several_orders_begins() -> None:
    link = flown([(0.0, [order("hold")]), (1.0, [order("return"), order("land")])])
    assert link.calls == ["hold", "hold cancelled", "land"]


def test_a_vehicle_released_right_after_an_order_is_sent_nothing_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The agent releases a vehicle that another station has taken over, here at the moment of an order.
    def step(state: AgentState, event: ev.Event, now: float) -> tuple[AgentState, list[ev.Effect]]:
        orders = [ev.Command(event.order)] if isinstance(event, ev.OperatorCommand) else []
        return state, [*orders, *([ev.Release()] if event == ev.LinkRestored() else [])]

    monkeypatch.setattr("swarmctl.flight.runner.step", step)
    link = flown([(0.0, [order("hold")]), (1.0, [order("return"), ev.LinkRestored()])])
    assert link.calls == ["hold", "hold cancelled"]


def test_an_order_waits_for_the_end_of_the_job_it_cancels() -> None:
    link = flown([(0.0, [order("hold")]), (1.0, [order("return")]), (2.0, [order("land")])])
    assert link.calls == ["hold", "hold cancelled", "return", "return cancelled", "land"]


def test_critical_texts_of_a_flying_autopilot_are_for_the_operator() -> None:
    notes = Notes()

    async def scene() -> None:
        runner = flying(StubLink(takes_s=TAKES_S), notes)
        runner.on_link_event(StatusText(0, "Crash: Disarming"))
        runner.on_link_event(StatusText(6, "Mission: 2 WP"))
        runner.state = replace(runner.state, phase=Phase.STANDBY)
        runner.on_link_event(StatusText(2, "PreArm: Need 3D Fix"))

    run_virtual(scene())
    assert [for_operator for _, for_operator in notes.lines] == [True, False, False]
