"""Shutdown: the orderly early end of a flight. All vehicles hold, then return or land in turn."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence

from swarmctl.agent.phases import IN_FLIGHT, Phase
from swarmctl.agent.traffic.return_schedule import describe_schedule, schedule_for
from swarmctl.agent.traffic.returning import position_for_return
from swarmctl.agent.traffic.wait import WaitFor
from swarmctl.config.flight import FlightSection
from swarmctl.core import events as ev
from swarmctl.flight.own_vehicle import OwnVehicle, names, until
from swarmctl.report.final_state import HEARTBEATS_END, is_released_in_air

HOLD_DEADLINE_S = 8.0


class Shutdown:
    """The shutdown of this process's vehicles.

    `flies_all`: this process flies all vehicles of the swarm, and schedules their returns. Otherwise each
    vehicle waits by itself for a clear return path.
    """

    def __init__(
        self,
        vehicles: Sequence[OwnVehicle],
        flight: FlightSection,
        say: Callable[[str], None],
        *,
        flies_all: bool,
    ) -> None:
        self._vehicles = vehicles
        self._flight = flight
        self._say = say
        self._flies_all = flies_all

    async def run(self) -> None:
        """Hold all vehicles, then return or land them as configured; each step has a time limit."""
        in_flight = [
            m for m in self._vehicles if m.state.phase in IN_FLIGHT or m.state.phase is Phase.LAUNCHING
        ]
        order = ev.FlightOrder(self._flight.on_exit)
        # Before a return, a vehicle that already returns or lands, or waits to return, gets no order to hold.
        leaving = [m for m in in_flight if order is ev.FlightOrder.RETURN and _is_leaving(m)]
        to_hold = [m for m in in_flight if m not in leaving]
        if released := [m for m in self._vehicles if is_released_in_air(m.state)]:
            self._say(
                f"{names(released)}: released in the air, and therefore without an order; {HEARTBEATS_END} "
                "[released-in-air]"
            )
        self._say(f"stopping: {names(to_hold) or 'no vehicle'} ordered to hold [stopping]")
        self._order([m for m in self._vehicles if m not in leaving], ev.FlightOrder.HOLD)
        await self._within(HOLD_DEADLINE_S, _holds, to_hold)
        if order is ev.FlightOrder.HOLD:
            return
        flying = [m for m in in_flight if not m.state.ended]
        self._say(f"{names(flying) or 'no vehicle'} ordered to {order}")
        # A vehicle that waits to return keeps its place, unless this program schedules all returns.
        self._order([m for m in flying if self._flies_all or m not in leaving], order)
        await self._within(self._flight.on_exit_deadline_s, lambda m: m.state.ended, flying)
        late = [m for m in flying if m.state.phase is Phase.HOLDING and m.state.is_waiting]
        if late:
            self._say(f"{names(late)}: the deadline is over, and all vehicles {order} now [exit-now]")
            for vehicle in late:
                vehicle.runner.post(ev.OperatorCommand(order))
            await self._within(HOLD_DEADLINE_S, _follows, late)

    def _order(self, vehicles: Iterable[OwnVehicle], order: ev.FlightOrder) -> None:
        vehicles, delays_s = list(vehicles), dict[int, float]()
        is_scheduled = order is ev.FlightOrder.RETURN and self._flies_all
        if is_scheduled:
            delays_s = dict(return_delays_s(self._vehicles, self._say, [m.spec.sysid for m in vehicles]))
        for vehicle in vehicles:
            after_s = delays_s.get(vehicle.spec.sysid, 0.0) if is_scheduled else None
            vehicle.runner.post(ev.OperatorCommand(order, after_s=after_s))

    async def _within(
        self, deadline_s: float, condition: Callable[[OwnVehicle], bool], vehicles: Sequence[OwnVehicle]
    ) -> None:
        try:
            async with asyncio.timeout(deadline_s):
                await until(condition, vehicles)
        except TimeoutError:
            if late := [m for m in vehicles if not condition(m)]:
                text = f"the order was not completed within {deadline_s:g} s; the shutdown continues"
                self._say(f"{names(late)}: {text} [deadline]")


def _is_leaving(vehicle: OwnVehicle) -> bool:
    return vehicle.state.phase is Phase.LEAVING or vehicle.state.waits_for(WaitFor.RETURN_PATH)


def _holds(vehicle: OwnVehicle) -> bool:
    """Return whether the vehicle follows the order to hold, or needs no order because its flight ends."""
    state = vehicle.state
    return (
        (state.phase is Phase.HOLDING and state.order.is_followed) or state.ended or state.launch.is_aborted
    )


def _follows(vehicle: OwnVehicle) -> bool:
    """Return whether the vehicle returns or lands without a wait, or has ended its flight."""
    state = vehicle.state
    return state.ended or (not state.is_waiting and state.order.is_followed)


def return_delays_s(
    vehicles: Sequence[OwnVehicle], say: Callable[[str], None], uavs: Sequence[int]
) -> Mapping[int, float]:
    """Return how long each vehicle of `uavs` waits for its turn to return [s]; report the order of turns."""
    returning = [m for m in vehicles if m.spec.sysid in uavs or m.state.phase is Phase.LEAVING]
    places = {m.spec.sysid: position_for_return(m.state) for m in returning}
    turns = schedule_for({uav: place for uav, place in places.items() if place is not None})
    if any(turns.begins_s.values()) or turns.height_only:
        schedule = describe_schedule(turns, {m.spec.sysid: m.name for m in returning})
        say(f"returning: {schedule} [return-schedule]")
    # Vehicles without a known position return after all other vehicles have landed.
    return {uav: turns.begins_s.get(uav, turns.all_landed_s) for uav in uavs}
