"""The jobs of a runner: one at a time, whatever comes in which order, and none of them lost or left over."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from flights import small

from swarmctl.agent.state import AgentState, Phase
from swarmctl.bus.network import RunClock
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.core import events as ev
from swarmctl.core.inference.sensor import PERFECT
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.network import network_of
from swarmctl.flight.runner import Runner
from swarmctl.flight.sensors.footprint import Footprint
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.mavlink.protocol.outcome import Swapped

TAKES_S = 5.0


@dataclass
class Slow:
    """A link on which everything takes its time, and that notes what begins and how it ends."""

    log: list[str] = field(default_factory=list)

    async def _do(self, name: str) -> None:
        self.log.append(f"{name} begins")
        try:
            await asyncio.sleep(TAKES_S)
        except asyncio.CancelledError:
            self.log.append(f"{name} cancelled")
            raise
        self.log.append(f"{name} done")

    async def launch(self, in_the_way: Callable[[], str]) -> None:
        await self._do("launch")

    async def hold(self, *, check_mode_first: bool) -> None:
        await self._do("hold")

    async def return_home(self, *, check_mode_first: bool) -> None:
        await self._do("return")

    async def land(self, *, check_mode_first: bool) -> None:
        await self._do("land")

    async def swap(self, plan: object) -> Swapped:
        await self._do("swap")
        return Swapped(None, "new", 0.0, 0.5)


Script = Sequence[tuple[float, Sequence[ev.Event]]]
"""what is posted at once, at which times [s]"""


def flown(script: Script) -> Slow:
    """What a vehicle in flight is told over its link; a coroutine that nobody awaits is a failure."""

    async def scene() -> Slow:
        scenario, link = small(), Slow()
        runner = Runner(
            scenario.tasks[0],
            scenario.prior,
            link,  # type: ignore[arg-type]
            Footprint(scenario.grid, frozenset(), PERFECT, np.random.default_rng(0)),
            network_of(scenario, MemoryBus(), RunClock(0.0)),
            (),
        )
        where = VehicleState(lat_deg=46.0, lon_deg=14.0, alt_rel_m=30.0, armed=True)
        runner.state = replace(runner.state, phase=Phase.FLYING, vehicle=where, armed_seen=True)
        task = asyncio.create_task(runner.run())
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


def test_of_orders_that_come_at_one_moment_the_last_is_followed() -> None:
    link = flown([(0.0, [order("hold"), order("return"), order("land")])])
    assert link.log == ["land begins", "land done"]


def test_what_ran_has_ended_before_the_last_of_several_orders_begins() -> None:
    link = flown([(0.0, [order("hold")]), (1.0, [order("return"), order("land")])])
    assert link.log == ["hold begins", "hold cancelled", "land begins", "land done"]


def test_who_is_let_go_right_after_an_order_is_sent_nothing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    # The agent lets go of what somebody else has taken over; here at the very moment of an order.
    def step(state: AgentState, event: ev.Event, now: float) -> tuple[AgentState, list[ev.Effect]]:
        orders = [ev.Command(event.order)] if isinstance(event, ev.OperatorCommand) else []
        return state, [*orders, *([ev.Release()] if event == ev.LinkRestored() else [])]

    monkeypatch.setattr("swarmctl.flight.runner.step", step)
    link = flown([(0.0, [order("hold")]), (1.0, [order("return"), ev.LinkRestored()])])
    assert link.log == ["hold begins", "hold cancelled"]


def test_an_order_waits_for_what_it_has_ended() -> None:
    link = flown([(0.0, [order("hold")]), (1.0, [order("return")]), (2.0, [order("land")])])
    begun = ["hold begins", "hold cancelled", "return begins", "return cancelled", "land begins", "land done"]
    assert link.log == begun
