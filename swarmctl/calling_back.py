"""An operator calls back a swarm: each vehicle in its turn, so that no two that return meet."""

from __future__ import annotations

import asyncio

import msgspec

from swarmctl import operate
from swarmctl.bus.base import Transport
from swarmctl.bus.zenoh_config import Credentials
from swarmctl.core.messages import GiveOrder, OperatorAnswer, Request, VehicleAnswer
from swarmctl.core.returns import turns_of
from swarmctl.operate import UNSEALED, Seals, Station

UNTOLD_S = 120.0
"""After this a vehicle returns that holds and was told no turn: whoever called it back is gone."""


async def give(
    station: Station,
    command: Request,
    credentials: Credentials | None = None,
    seals: Seals = UNSEALED,
) -> OperatorAnswer:
    """As `operate.give`, but that returns take turns. Raises BusError, Unclear and NoAnswer."""
    with operate.visited(station, credentials) as bus:
        return await ask(bus, station, command, seals)


async def ask(bus: Transport, station: Station, command: Request, seals: Seals = UNSEALED) -> OperatorAnswer:
    """The same on a bus that is open."""
    # One process that flies all gives them their turns itself.
    if not (station.agents and isinstance(command, GiveOrder) and command.order == "return"):
        return await operate.ask(bus, station, command, seals)
    held = await operate.ask(bus, station, msgspec.structs.replace(command, after_s=UNTOLD_S), seals)
    called = [v for v in held.vehicles if v.outcome == "taken"]
    turns = turns_of({v.uav: v.place for v in called if v.place is not None})

    async def told(vehicle: VehicleAnswer) -> VehicleAnswer:
        # Nobody knows where the others are: they come when all else is down.
        after_s = turns.begins_s.get(vehicle.uav, turns.down_s)
        turn = msgspec.structs.replace(command, uavs=(vehicle.uav,), after_s=after_s)
        (answer,) = (await operate.ask(bus, station, turn, seals)).vehicles
        if answer.outcome == "taken":
            return answer
        # It has taken the first, and returns when that time is over.
        note = f"it holds, and returns after {UNTOLD_S:g} s, whoever else is in the air: {answer.note}"
        return msgspec.structs.replace(vehicle, note=note)

    answers = {answer.uav: answer for answer in await asyncio.gather(*map(told, called))}
    return OperatorAnswer(tuple(answers.get(vehicle.uav, vehicle) for vehicle in held.vehicles))
