"""Taking over the vehicles of a run whose program died in flight.

Each vehicle goes its own way: connect, permission, comparison with the record, then its agent goes on, lets
it go, or prepares it on the ground. A vehicle that does not answer delays no other.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from swarmctl.agent.phases import ENDED, ON_GROUND, Phase
from swarmctl.config.flight import FlightSection
from swarmctl.core import events as ev
from swarmctl.flight import proof
from swarmctl.flight.own_vehicle import OwnVehicle
from swarmctl.flight.proof import Finding
from swarmctl.links.base import LinkError
from swarmctl.report.unfinished_run import RecordedVehicle

LAUNCH_WAIT_S = 15.0
"""longest wait for an armed vehicle to take off or to disarm itself, which copters do after 10 s"""
RETRY_S = 1.0
"""time between two attempts to connect or to compare [s]"""
LET_GO = (
    "the program sends it no command of its own; use another ground station, or `swarmctl order` "
    "[not-taken-over]"
)


class Takeover:
    """The takeover of a run's vehicles; `run` takes over one vehicle."""

    def __init__(
        self,
        recorded: Mapping[int, RecordedVehicle],
        flight: FlightSection,
        *,
        unix_s: Callable[[], float],
        speedup: float,
        say: Callable[[str], None],
    ) -> None:
        """`speedup`: seconds of the vehicles' clocks in one second of the loop's clock."""
        self._recorded = recorded
        self._flight = flight
        self._unix_s = unix_s
        self._speedup = speedup
        self._say = say

    async def run(self, vehicle: OwnVehicle, permit: Callable[[OwnVehicle], None]) -> None:
        """Take over a vehicle or let it go. `permit` raises PreflightFailed if the vehicle must not fly."""
        if not vehicle.runner.is_untaken:
            return  # no event of this vehicle was recorded, so its flight is new
        try:
            events = await self._events(vehicle, permit)
        except asyncio.CancelledError:
            vehicle.runner.take_up([ev.Restarted(reason="the takeover was stopped")])
            raise
        restarted = next(event for event in events if isinstance(event, ev.Restarted))
        self._report(vehicle, restarted)
        vehicle.runner.take_up(events)

    async def _events(self, vehicle: OwnVehicle, permit: Callable[[OwnVehicle], None]) -> list[ev.Event]:
        recorded = self._recorded[vehicle.spec.sysid]
        state, clock = recorded.state, asyncio.get_running_loop().time
        if state.phase in ENDED and not state.vehicle.armed:
            return [ev.Restarted(on_ground=True)]
        until_s, failure, is_permitted = clock() + self._flight.lost_timeout_s, "", False
        decided_s = clock() + LAUNCH_WAIT_S
        while clock() < until_s or not failure:
            try:
                if vehicle.identity is None:
                    await vehicle.connect(self._flight.connect_timeout_s)
                if vehicle.runner.sysid_conflict:
                    return [ev.Restarted(reason=vehicle.runner.sysid_conflict)]
                if not is_permitted:
                    permit(vehicle)
                    is_permitted = True
                found = await self._find(vehicle, recorded)
            except LinkError as error:
                if not failure:
                    self._say(f"{error}; trying for {self._flight.lost_timeout_s:g} s")
                failure = str(error)
            else:
                if not proof.is_undecided(state, found.state) or clock() >= decided_s:
                    return proof.take_over(recorded, found, self._speedup)
                failure = "the vehicle is armed on the ground, and does not take off"
            await asyncio.sleep(RETRY_S)
        silent_s = min(vehicle.runner.link.age_s(), max(self._unix_s() - recorded.last_unix_s, 0.0))
        is_lost = silent_s > self._flight.connect_timeout_s
        return [ev.Restarted(reason=failure), *([ev.LinkLost(silent_s)] if is_lost else [])]

    async def _find(self, vehicle: OwnVehicle, recorded: RecordedVehicle) -> Finding:
        link, state = vehicle.runner.link, recorded.state
        identity = await link.identify(self._flight.connect_timeout_s)
        stored = await link.recognise(recorded.plans, proof.candidates(state))
        return Finding(identity, link.state(), self._unix_s(), stored)

    def _report(self, vehicle: OwnVehicle, restarted: ev.Restarted) -> None:
        state = self._recorded[vehicle.spec.sysid].state
        if restarted.reason:
            self._say(f"{vehicle.name}: not taken over: {restarted.reason}; {LET_GO}")
        elif state.phase in ENDED:
            self._say(f"{vehicle.name}: its flight had ended before: {state.outcome or state.phase}")
        elif state.phase in ON_GROUND or (restarted.on_ground and state.phase is Phase.LAUNCHING):
            self._say(f"{vehicle.name}: on the ground; it is prepared for its launch as in a new flight")
        else:
            self._say(f"{vehicle.name}: taken over in phase {state.phase} [taken-up]")
