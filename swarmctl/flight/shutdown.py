"""Shutdown: the orderly early end of a flight. All vehicles hold, then return or land in turn."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence

from swarmctl.agent.orders import position_for_return
from swarmctl.agent.phases import IN_FLIGHT, Phase
from swarmctl.agent.traffic.return_schedule import MIN_HORIZONTAL_M, describe_schedule, schedule_for
from swarmctl.agent.traffic.wait import WaitFor
from swarmctl.config.flight import FlightSection
from swarmctl.core import events as ev
from swarmctl.core.geo import distance_m
from swarmctl.flight.member import POLL_S, Member, names, until
from swarmctl.flight.return_queue import ReturnQueue
from swarmctl.report.final_state import HEARTBEATS_END, is_released_in_air

HOLD_DEADLINE_S = 8.0
RETURN_NOW = "{}: the deadline is over; returning now, with other vehicles in the air [return-now]"


class Shutdown:
    """The shutdown of this process's vehicles.

    `return_queue`: for a process that flies one vehicle of a swarm; None: this process flies all vehicles.
    """

    def __init__(
        self,
        members: Sequence[Member],
        flight: FlightSection,
        say: Callable[[str], None],
        return_queue: ReturnQueue | None,
    ) -> None:
        self._members = members
        self._flight = flight
        self._say = say
        self._return_queue = return_queue

    async def run(self) -> None:
        """Hold all vehicles, then return or land them as configured; each step has a time limit."""
        in_flight = [
            m for m in self._members if m.state.phase in IN_FLIGHT or m.state.phase is Phase.LAUNCHING
        ]
        order = ev.FlightOrder(self._flight.on_exit)
        # Before a return, a vehicle that already returns or lands, or waits to return, gets no order to hold.
        leaving = [m for m in in_flight if order is ev.FlightOrder.RETURN and _is_leaving(m)]
        to_hold = [m for m in in_flight if m not in leaving]
        if released := [m for m in self._members if is_released_in_air(m.state)]:
            self._say(
                f"{names(released)}: released in the air, and therefore without an order; {HEARTBEATS_END} "
                "[released-in-air]"
            )
        self._say(f"stopping: {names(to_hold) or 'no vehicle'} ordered to hold [stopping]")
        self._order([m for m in self._members if m not in leaving], ev.FlightOrder.HOLD)
        await self._within(HOLD_DEADLINE_S, _holds, to_hold)
        if order is ev.FlightOrder.HOLD:
            return
        flying = [m for m in in_flight if not m.state.ended]
        self._say(f"{names(flying) or 'no vehicle'} ordered to {order}")
        if order is ev.FlightOrder.LAND:
            await self._land(flying)
            return
        began_s = asyncio.get_running_loop().time()
        self._order(await self._await_clear_paths(flying), order)
        waited_s = asyncio.get_running_loop().time() - began_s
        remaining_s = self._flight.on_exit_deadline_s - waited_s
        if self._return_queue is not None:
            remaining_s = max(remaining_s, HOLD_DEADLINE_S)
        await self._within(remaining_s, lambda m: m.state.ended, flying)
        late = [m for m in flying if m.state.phase is Phase.HOLDING and m.state.is_waiting]
        if late:
            self._say(RETURN_NOW.format(names(late)))
            for member in late:
                member.runner.post(ev.OperatorCommand(ev.FlightOrder.RETURN))
            await self._within(HOLD_DEADLINE_S, _returns, late)

    async def _await_clear_paths(self, flying: Sequence[Member]) -> list[Member]:
        """Wait until the paths home are clear of other processes' vehicles, or the deadline is over.

        Return the vehicles to order home. A vehicle that left its hold during the wait (low battery, or an
        operator's order) gets no order.
        """
        if self._return_queue is None:
            return list(flying)
        clock, queue = asyncio.get_running_loop().time, self._return_queue
        until_s = clock() + self._flight.on_exit_deadline_s
        reported = False
        held = [m for m in flying if m.state.phase is Phase.HOLDING]
        for member in held:
            while (
                member.state.phase is Phase.HOLDING
                and (place := position_for_return(member.state)) is not None
            ):
                if queue.may_return(place, clock()):
                    break
                if clock() >= until_s:
                    self._say(RETURN_NOW.format(member.name))
                    break
                if not reported:
                    self._say(f"{member.name}: holding until the path home is clear of vehicles [waiting]")
                reported = True
                await asyncio.sleep(POLL_S)
        return [m for m in flying if m not in held or m.state.phase is Phase.HOLDING]

    async def _land(self, flying: Sequence[Member]) -> None:
        """Land each vehicle where it holds, the lower of two vehicles above each other first."""
        waiting = [m for m in flying if self._is_above_another(m, flying)]
        if waiting:
            self._say(f"{names(waiting)}: landing after the vehicles below have landed [waits-to-land]")
        self._order([m for m in flying if m not in waiting], ev.FlightOrder.LAND)

        def has_ended(member: Member) -> bool:
            # Each poll also orders a landing of vehicles with a clear descent.
            for held in [m for m in waiting if not self._is_above_another(m, flying)]:
                waiting.remove(held)
                self._order([held], ev.FlightOrder.LAND)
            return member.state.ended

        await self._within(self._flight.on_exit_deadline_s, has_ended, flying)
        if waiting:
            self._say(f"{names(waiting)}: the deadline is over; landing now, with vehicles below [land-now]")
            self._order(waiting, ev.FlightOrder.LAND)
            await self._within(HOLD_DEADLINE_S, _lands, waiting)

    def _is_above_another(self, member: Member, flying: Sequence[Member]) -> bool:
        """Return whether an airborne vehicle of any process is in the way of this vehicle's descent."""
        place = position_for_return(member.state)
        if place is None or self._return_queue is None:
            return bool(_vehicles_below(member, flying))
        return not self._return_queue.may_land(place, asyncio.get_running_loop().time())

    def _order(self, members: Iterable[Member], order: ev.FlightOrder) -> None:
        members = list(members)
        returning = [m.spec.sysid for m in members] if order is ev.FlightOrder.RETURN else []
        delays_s = return_delays_s(self._members, self._say, returning)
        for member in members:
            after_s = delays_s.get(member.spec.sysid, 0.0)
            member.runner.post(ev.OperatorCommand(order, after_s=after_s))

    async def _within(
        self, deadline_s: float, condition: Callable[[Member], bool], members: Sequence[Member]
    ) -> None:
        try:
            async with asyncio.timeout(deadline_s):
                await until(condition, members)
        except TimeoutError:
            if late := [m for m in members if not condition(m)]:
                text = f"the order was not completed within {deadline_s:g} s; the shutdown continues"
                self._say(f"{names(late)}: {text} [deadline]")


def _is_leaving(member: Member) -> bool:
    return member.state.phase is Phase.LEAVING or member.state.waits_for(WaitFor.RETURN_PATH)


def _holds(member: Member) -> bool:
    """Return whether the vehicle follows the order to hold, or needs no order because its flight ends."""
    state = member.state
    return (
        (state.phase is Phase.HOLDING and state.order.is_followed) or state.ended or state.launch.is_aborted
    )


def _returns(member: Member) -> bool:
    """Return whether the vehicle returns without waiting for a turn, or has ended its flight."""
    state = member.state
    return state.ended or (not state.is_waiting and state.order.is_followed)


def _lands(member: Member) -> bool:
    return member.state.ended or member.state.order.is_followed


def _vehicles_below(member: Member, flying: Sequence[Member]) -> list[Member]:
    """Return the lower airborne vehicles in the way of this vehicle's descent.

    At equal height the vehicle with the lower system id counts as the lower vehicle.
    """
    place = position_for_return(member.state)
    if place is None:
        return []
    here, found = (place.lat_deg, place.lon_deg), []
    for other in flying:
        other_place = position_for_return(other.state)
        if other is member or other.state.ended or other_place is None:
            continue
        apart_m = max(MIN_HORIZONTAL_M, place.min_separation_m[0], other_place.min_separation_m[0])
        lower = (other_place.alt_amsl_m, other.spec.sysid) < (place.alt_amsl_m, member.spec.sysid)
        if lower and distance_m(here, (other_place.lat_deg, other_place.lon_deg)) < apart_m:
            found.append(other)
    return found


def return_delays_s(
    members: Sequence[Member], say: Callable[[str], None], uavs: Sequence[int]
) -> Mapping[int, float]:
    """Return how long each vehicle of `uavs` waits for its turn to return [s]; report the order of turns."""
    returning = [m for m in members if m.spec.sysid in uavs or m.state.phase is Phase.LEAVING]
    places = {m.spec.sysid: position_for_return(m.state) for m in returning}
    turns = schedule_for({uav: place for uav, place in places.items() if place is not None})
    if any(turns.begins_s.values()) or turns.height_only:
        schedule = describe_schedule(turns, {m.spec.sysid: m.name for m in returning})
        say(f"returning: {schedule} [return-schedule]")
    # Vehicles without a known position return after all other vehicles have landed.
    return {uav: turns.begins_s.get(uav, turns.all_landed_s) for uav in uavs}
