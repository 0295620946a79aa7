"""An operator calls back a swarm: each vehicle in its turn, so that no two that return meet."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence

import msgspec

from swarmctl.agent.traffic.return_turns import can_be, turns_of
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.core.messages import MAX_AFTER_S, GiveOrder, OperatorAnswer, Request, VehicleAnswer
from swarmctl.station import client
from swarmctl.station.client import UNSEALED, Seals, Station

UNTOLD_S = 120.0
"""After this a vehicle returns that holds and was told no turn: whoever called it back is gone."""
ASKED_TIMES = 3
"""One that does not answer is asked so often: what it may have taken decides when the others move."""


async def give(
    station: Station,
    command: Request,
    credentials: Credentials | None = None,
    seals: Seals = UNSEALED,
) -> OperatorAnswer:
    """As `operate.give`, but that returns take turns. Raises BusError, Unclear and NoAnswer."""
    with client.visited(station, credentials) as bus:
        return await ask(bus, station, command, seals)


async def ask(bus: Transport, station: Station, command: Request, seals: Seals = UNSEALED) -> OperatorAnswer:
    """The same on a bus that is open."""
    # One process that flies all gives them their turns itself.
    if not (station.agents and isinstance(command, GiveOrder) and command.order == "return"):
        return await client.ask(bus, station, command, seals)
    began_s = _now_s()
    held = await _asked(bus, station, msgspec.structs.replace(command, after_s=UNTOLD_S), seals)
    called = [v for v in held if v.outcome == "taken"]
    turns = turns_of({v.uav: v.place for v in called if v.place is not None and can_be(v.place)})
    down_s = turns.down_s if len(turns.begins_s) == len(called) else math.inf
    later_s = 0.0
    if any(v.outcome == "unconfirmed" for v in held) and down_s > UNTOLD_S - (_now_s() - began_s):
        later_s = UNTOLD_S + _longest_s(called)

    async def told(vehicle: VehicleAnswer) -> VehicleAnswer:
        # Nobody knows where the others are: they come when all else is down.
        after_s = min(later_s + turns.begins_s.get(vehicle.uav, turns.down_s), MAX_AFTER_S)
        turn = msgspec.structs.replace(command, uavs=(vehicle.uav,), after_s=after_s)
        (answer,) = await _asked(bus, station, turn, seals)
        if answer.outcome == "taken":
            return answer
        # It has taken the first, and returns when that time is over.
        note = f"it holds, and returns after {UNTOLD_S:g} s, whoever else is in the air: {answer.note}"
        return msgspec.structs.replace(vehicle, note=note)

    answers = {answer.uav: answer for answer in await asyncio.gather(*map(told, called))}
    return OperatorAnswer(tuple(answers.get(v.uav) or _unsure(v, later_s) for v in held))


async def _asked(
    bus: Transport, station: Station, command: GiveOrder, seals: Seals
) -> Sequence[VehicleAnswer]:
    """What each of them answers, of whom those who do not are asked again; what is left of a turn is ordered.

    Once unconfirmed is unconfirmed for good, unless it answers: it may have taken what it did not answer.
    """
    began_s = _now_s()
    answers = {v.uav: v for v in (await client.ask(bus, station, command, seals)).vehicles}
    for _ in range(ASKED_TIMES - 1):
        unsure = tuple(uav for uav, v in answers.items() if v.outcome in ("unconfirmed", "silent"))
        if not unsure:
            break
        left_s = max(command.after_s - (_now_s() - began_s), 0.0)
        again = msgspec.structs.replace(command, uavs=unsure, after_s=left_s)
        for v in (await client.ask(bus, station, again, seals)).vehicles:
            if v.outcome != "silent":
                answers[v.uav] = v
    return list(answers.values())


def _longest_s(called: Sequence[VehicleAnswer]) -> float:
    """What the return of any one vehicle takes at most, by those whose places are known [s]."""
    alone = [turns_of({v.uav: v.place}).down_s for v in called if v.place is not None]
    return max(alone, default=UNTOLD_S)


def _unsure(vehicle: VehicleAnswer, later_s: float) -> VehicleAnswer:
    if vehicle.outcome != "unconfirmed":
        return vehicle
    others = "the others wait for that" if later_s else "the others are down by then"
    note = f"if it has taken this it holds, and returns after {UNTOLD_S:g} s; {others}: {vehicle.note}"
    return msgspec.structs.replace(vehicle, note=note)


def _now_s() -> float:
    return asyncio.get_running_loop().time()
