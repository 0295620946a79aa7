"""The early end of a flight: all hold, then do what is configured, and nobody meets another on the way."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from swarmctl.agent.orders import place_for_return
from swarmctl.agent.state import IN_FLIGHT, Phase
from swarmctl.agent.traffic.return_turns import LEAST_APART_M, describe_schedule, schedule_for
from swarmctl.config.model import FlightSection
from swarmctl.core import events as ev
from swarmctl.core.geo import distance_m
from swarmctl.core.messages import VehiclePosition
from swarmctl.flight.member import POLL_S, Member, names, until
from swarmctl.report.final_state import HEARTBEATS_END, is_released_in_air

HOLD_DEADLINE_S = 8.0


class Elsewhere(Protocol):
    """What the vehicles do that other processes fly, seen from the only one of this process. Times are of the
    loop [s]."""

    def may_go(self, place: VehiclePosition, now_s: float) -> bool:
        """Whether it may begin its return from this place."""

    def may_land(self, place: VehiclePosition, now_s: float) -> bool:
        """Whether nobody is under it."""


class Shutdown:
    """Of the vehicles of this process. `elsewhere`: of its only one, for others that are flown elsewhere."""

    def __init__(
        self,
        members: Sequence[Member],
        flight: FlightSection,
        say: Callable[[str], None],
        elsewhere: Elsewhere | None,
    ) -> None:
        self._members = members
        self._flight = flight
        self._say = say
        self._elsewhere = elsewhere

    async def leave(self) -> None:
        """Hold all, then what the configuration says, within its deadline."""
        in_flight = [
            m for m in self._members if m.state.phase in IN_FLIGHT or m.state.phase is Phase.LAUNCHING
        ]
        order = ev.FlightOrder(self._flight.on_exit)
        # Who returns already, or waits for its turn to as long as its battery lets it, is not stopped, only
        # to be sent home again.
        on_its_way = [m for m in in_flight if order is ev.FlightOrder.RETURN and _goes_home(m)]
        stopped = [m for m in in_flight if m not in on_its_way]
        if theirs := [m for m in self._members if is_released_in_air(m.state)]:
            self._say(f"{names(theirs)}: let go in the air, so it is ordered nothing; {HEARTBEATS_END}")
        self._say(f"stopping: {names(stopped) or 'no vehicle'} in flight to hold")
        self._order([m for m in self._members if m not in on_its_way], ev.FlightOrder.HOLD)
        await self._within(HOLD_DEADLINE_S, _holds, stopped)
        if order is ev.FlightOrder.HOLD:
            return
        flying = [m for m in in_flight if not m.state.ended]
        self._say(f"{names(flying) or 'no vehicle'} to {order}")
        if order is ev.FlightOrder.LAND:
            await self._land(flying)
            return
        began_s = asyncio.get_running_loop().time()
        self._order(await self._when_others_are_clear(flying), order)
        waited_s = asyncio.get_running_loop().time() - began_s
        left_s = self._flight.on_exit_deadline_s - waited_s
        if self._elsewhere is not None:
            left_s = max(left_s, HOLD_DEADLINE_S)
        await self._within(left_s, lambda m: m.state.ended, flying)
        late = [m for m in flying if m.state.return_turn_boot_s is not None]
        if late:
            self._say(f"{names(late)} to return now, whoever else is in the air")
            for member in late:
                member.runner.post(ev.OperatorCommand(ev.FlightOrder.RETURN))
            await self._within(HOLD_DEADLINE_S, _returns, late)

    async def _when_others_are_clear(self, flying: Sequence[Member]) -> list[Member]:
        """Wait while others that are flown elsewhere are on the way home and would meet one of these.

        Who has left its hold meanwhile, its battery being low or an operator having ordered it, is left out.
        """
        if self._elsewhere is None:
            return list(flying)
        clock, elsewhere = asyncio.get_running_loop().time, self._elsewhere
        until_s = clock() + self._flight.on_exit_deadline_s
        said = False
        held = [m for m in flying if m.state.phase is Phase.HOLDING]
        for member in held:
            while member.state.phase is Phase.HOLDING and (place := place_for_return(member.state)) is not None:
                if elsewhere.may_go(place, clock()):
                    break
                if clock() >= until_s:
                    self._say(f"{member.name} to return now, whoever else is in the air")
                    break
                if not said:
                    self._say(f"{member.name} holds until its way home is clear of the others'")
                said = True
                await asyncio.sleep(POLL_S)
        return [m for m in flying if m not in held or m.state.phase is Phase.HOLDING]

    async def _land(self, flying: Sequence[Member]) -> None:
        """Each where it holds; who holds above another waits until that is down."""
        waiting = [m for m in flying if self._has_under_it(m, flying)]
        if waiting:
            self._say(f"to land when those under them are down: {names(waiting)}")
        self._order([m for m in flying if m not in waiting], ev.FlightOrder.LAND)

        def all_down(member: Member) -> bool:
            for held in [m for m in waiting if not self._has_under_it(m, flying)]:
                waiting.remove(held)
                self._order([held], ev.FlightOrder.LAND)
            return member.state.ended

        await self._within(self._flight.on_exit_deadline_s, all_down, flying)
        if waiting:
            self._say(f"{names(waiting)} to land now, whoever is under them")
            self._order(waiting, ev.FlightOrder.LAND)
            await self._within(HOLD_DEADLINE_S, _lands, waiting)

    def _has_under_it(self, member: Member, flying: Sequence[Member]) -> bool:
        """Whether somebody in the air is where it would come down, wherever that is flown."""
        place = place_for_return(member.state)
        if place is None or self._elsewhere is None:
            return bool(_under(member, flying))
        return not self._elsewhere.may_land(place, asyncio.get_running_loop().time())

    def _order(self, members: Iterable[Member], order: ev.FlightOrder) -> None:
        members = list(members)
        called = [m.spec.sysid for m in members] if order is ev.FlightOrder.RETURN else []
        turns = return_delays_s(self._members, self._say, called)
        for member in members:
            after_s = turns.get(member.spec.sysid, 0.0)
            member.runner.post(ev.OperatorCommand(order, after_s=after_s))

    async def _within(
        self, deadline_s: float, condition: Callable[[Member], bool], members: Sequence[Member]
    ) -> None:
        try:
            async with asyncio.timeout(deadline_s):
                await until(condition, members)
        except TimeoutError:
            late = [m for m in members if not condition(m)]
            self._say(f"not within {deadline_s:g} s: {names(late)}")


def _goes_home(member: Member) -> bool:
    return member.state.phase is Phase.LEAVING or member.state.returns_when_clear


def _holds(member: Member) -> bool:
    """It follows the order to hold, or has something better to do: it is down, or on its way down."""
    state = member.state
    return (state.phase is Phase.HOLDING and state.order_followed) or state.ended or state.launch_aborted


def _returns(member: Member) -> bool:
    """It follows the order to return, and waits for no turn; or it is over."""
    state = member.state
    return state.ended or (state.return_turn_boot_s is None and state.order_followed)


def _lands(member: Member) -> bool:
    return member.state.ended or member.state.order_followed


def _under(member: Member, flying: Sequence[Member]) -> list[Member]:
    """Those in the air under one, so near over ground that it would come down on them; of two at one height
    the lower system id is under the other."""
    place = place_for_return(member.state)
    if place is None:
        return []
    here, found = (place.lat_deg, place.lon_deg), []
    for other in flying:
        there = place_for_return(other.state)
        if other is member or other.state.ended or there is None:
            continue
        apart_m = max(LEAST_APART_M, place.keeps_m[0], there.keeps_m[0])
        lower = (there.alt_amsl_m, other.spec.sysid) < (place.alt_amsl_m, member.spec.sysid)
        if lower and distance_m(here, (there.lat_deg, there.lon_deg)) < apart_m:
            found.append(other)
    return found


def return_delays_s(
    members: Sequence[Member], say: Callable[[str], None], uavs: Sequence[int]
) -> Mapping[int, float]:
    """How long each of these waits for its turn [s], by system id; who waits is said."""
    called = [m for m in members if m.spec.sysid in uavs or m.state.phase is Phase.LEAVING]
    places = {m.spec.sysid: place_for_return(m.state) for m in called}
    turns = schedule_for({uav: place for uav, place in places.items() if place is not None})
    if any(turns.begins_s.values()) or turns.not_apart:
        say(f"returning: {describe_schedule(turns, {m.spec.sysid: m.name for m in called})}")
    # Nobody knows where the others are: they come when all else is down.
    return {uav: turns.begins_s.get(uav, turns.down_s) for uav in uavs}
