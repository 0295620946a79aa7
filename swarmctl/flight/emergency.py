"""Emergency orders, after the agents have crashed or an operator has ended the program at once."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence

from swarmctl.agent.phases import Phase
from swarmctl.core.events import FlightOrder
from swarmctl.flight.own_vehicle import OwnVehicle, names
from swarmctl.flight.shutdown import return_delays_s
from swarmctl.links.base import LinkError

ORDER_TIMEOUT_S = 10.0


async def at_once(
    reason: str, vehicles: Sequence[OwnVehicle], order: FlightOrder, say: Callable[[str], None]
) -> None:
    """Order all armed vehicles except released vehicles at the same time: the operator does not wait."""
    armed = _armed_and_unreleased(vehicles)
    if armed:
        say(f"{reason}; {names(armed)} ordered to {order} at the same time; watch them [emergency]")
        await asyncio.gather(*(_order(vehicle, order, check_mode_first=False) for vehicle in armed))


async def in_turns(
    reason: str,
    vehicles: Sequence[OwnVehicle],
    order: FlightOrder,
    say: Callable[[str], None],
    *,
    within_s: float,
    speedup: float,
) -> None:
    """Order all armed vehicles except released vehicles, after the agents have crashed.

    Returning vehicles hold until their turns, so that no two vehicles meet; after `within_s` they return in
    any case. `speedup` is vehicle seconds in one second of the loop. No operator has given these orders, so a
    vehicle whose mode has just changed gets no order.
    """
    armed = _armed_and_unreleased(vehicles)
    if not armed:
        return
    returning = [vehicle.spec.sysid for vehicle in armed] if order is FlightOrder.RETURN else []
    turns_note = ", one after the other" if len(returning) > 1 else ""
    say(f"{reason}; {names(armed)} ordered to {order}{turns_note}; watch them [emergency]")
    turns = return_delays_s(armed, say, returning)

    async def order_in_turn(vehicle: OwnVehicle) -> None:
        after_s = min(turns.get(vehicle.spec.sysid, 0.0) / speedup, within_s)
        if after_s > 0.0:
            began_s = _now_s()
            holds = await _order(vehicle, FlightOrder.HOLD, check_mode_first=True)
            await asyncio.sleep(max(began_s + after_s - _now_s(), 0.0))
            if holds and vehicle.runner.link.state().mode_role != "hold":
                return  # a pilot or another station has chosen another mode during the wait
        await _order(vehicle, order, check_mode_first=True)

    await asyncio.gather(*map(order_in_turn, armed))


def _armed_and_unreleased(vehicles: Sequence[OwnVehicle]) -> list[OwnVehicle]:
    return [
        m
        for m in vehicles
        if m.state.vehicle.armed and m.state.phase is not Phase.RELEASED and not m.runner.is_untaken
    ]


async def _order(vehicle: OwnVehicle, order: FlightOrder, *, check_mode_first: bool) -> bool:
    """Order a vehicle and return whether telemetry shows that the vehicle follows."""
    with contextlib.suppress(LinkError, TimeoutError):
        async with asyncio.timeout(ORDER_TIMEOUT_S):
            await vehicle.runner.link.order(order, check_mode_first=check_mode_first)
            return True
    return False


def _now_s() -> float:
    return asyncio.get_running_loop().time()
