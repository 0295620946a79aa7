"""An order to hold and an order to resume, in whole flights."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from flights import Ui, small
from wings_flights import winged

from swarmctl.agent.state import ARRIVED
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.config.scenario import Scenario
from swarmctl.core.messages import GiveOrder, OperatorAnswer
from swarmctl.flight import app
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.outcome import FlightReport
from swarmctl.station import client

pytestmark = pytest.mark.virtual

STATION = client.FlightEndpoints("small", BusEndpoint("127.0.0.1", 7447))
HELD_S = 20.0


def winged_by(*autopilots: str) -> Scenario:
    return winged(simulate={"autopilot": list(autopilots)})


@pytest.mark.parametrize(
    "scenario",
    [
        pytest.param(small(simulate={"count": 2, "ready_s": 3.0}), id="ardupilot"),
        pytest.param(winged_by("arduplane", "px4"), id="arduplane-px4", marks=pytest.mark.full),
        pytest.param(winged_by("px4plane", "ardupilot"), id="px4plane-ardupilot", marks=pytest.mark.full),
    ],
)
def test_a_vehicle_arrives_after_a_hold_and_an_order_to_resume(scenario: Scenario, tmp_path: Path) -> None:
    answers: list[OperatorAnswer] = []

    async def scene() -> FlightReport:
        bus = MemoryBus()
        flight = asyncio.create_task(
            app.fly(scenario, tmp_path, Ui(), clock="virtual", permission=lambda _: None, bus=bus)
        )
        await asyncio.sleep(45.0)
        for order in ("hold", "resume"):
            answers.append(await client.ask(bus, STATION, GiveOrder(None, order)))
            await asyncio.sleep(HELD_S)
        return await flight

    report = run_virtual(scene())
    assert report.bug is None
    assert [vehicle.outcome for answer in answers for vehicle in answer.vehicles] == ["taken"] * 4
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 2
    assert all(state.plans.swaps.n_failed == 0 for state in report.states.values())
