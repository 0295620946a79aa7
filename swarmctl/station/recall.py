"""Sending of commands: tolerance for unknown names, and a recall with start times without conflicts."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence

from swarmctl.agent.traffic.return_schedule import is_plausible, schedule_for
from swarmctl.bus.authentication import NO_AUTHENTICATION, RequestSigning
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.core.messages import (
    ENDING_ORDERS,
    MAX_AFTER_S,
    GiveOrder,
    OperatorAnswer,
    Request,
    VehicleAnswer,
    refused_names,
)
from swarmctl.core.operator_text import name_problems
from swarmctl.core.records import replace
from swarmctl.station import client
from swarmctl.station.client import FlightEndpoints

FALLBACK_RETURN_S = 120.0
"""time after which a holding vehicle without a start time returns [s], because the station may be lost"""
MAX_ATTEMPTS = 3
"""largest number of times that one command is sent to a vehicle; unconfirmed returns may delay the others"""


async def send(
    flight: FlightEndpoints,
    command: Request,
    credentials: Credentials | None = None,
    signing: RequestSigning = NO_AUTHENTICATION,
) -> OperatorAnswer:
    """Send a command and return the answer; an order to return also schedules the vehicles' returns.

    Raises BusError, BadOptions and NoValidAnswer.
    """
    with client.connected(flight, credentials) as bus:
        return await ask(bus, flight, command, signing)


async def ask(
    bus: Transport, flight: FlightEndpoints, command: Request, signing: RequestSigning = NO_AUTHENTICATION
) -> OperatorAnswer:
    """Send a command over an open bus; an order to return also schedules the vehicles' returns.

    An order that ends flights goes to all vehicles with valid names, and unknown names become refused
    answers: a misspelt name must not keep the other vehicles in the air. A process that flies all vehicles
    does the same. Raises BadOptions and NoValidAnswer.
    """
    if not (isinstance(command, GiveOrder) and command.order in ENDING_ORDERS):
        return await client.ask(bus, flight, command, signing)
    words = tuple(map(str, command.uavs or ()))
    problems = name_problems(words, flight.agents) if flight.agents else {}  # the configuration has all names
    if not problems or len(problems) == len(words):
        return await _give(bus, flight, command, signing)
    valid = tuple(word for word in words if word not in problems)
    answer = await _give(bus, flight, replace(command, uavs=valid), signing)
    vehicles = (*answer.vehicles, *refused_names(problems))
    return replace(answer, vehicles=vehicles)


async def _give(
    bus: Transport, flight: FlightEndpoints, command: GiveOrder, signing: RequestSigning
) -> OperatorAnswer:
    """Send an order that ends flights; schedule the returns of several vehicles with separate agents."""
    # If one process flies all vehicles, that process schedules the returns. A single vehicle waits by itself.
    is_single = command.uavs is not None and len(command.uavs) == 1
    if not flight.agents or command.order != "return" or is_single:
        return await client.ask(bus, flight, command, signing)
    began_s = _now_s()
    first_answers = await _send_repeatedly(bus, flight, replace(command, after_s=FALLBACK_RETURN_S), signing)
    recalled = [v for v in first_answers if v.outcome == "taken"]
    places = {v.uav: v.place for v in recalled if v.place is not None and is_plausible(v.place)}
    schedule = schedule_for(places)
    landed_s = schedule.all_landed_s if len(schedule.begins_s) == len(recalled) else math.inf
    extra_delay_s = 0.0
    if any(v.outcome == "unconfirmed" for v in first_answers) and landed_s > FALLBACK_RETURN_S - (
        _now_s() - began_s
    ):
        alone = [schedule_for({uav: place}).all_landed_s for uav, place in places.items()]
        extra_delay_s = FALLBACK_RETURN_S + max(alone, default=FALLBACK_RETURN_S)

    async def send_start_time(vehicle: VehicleAnswer) -> VehicleAnswer:
        # Vehicles at unknown positions return after the expected landings of the vehicles at known positions.
        begins_s = schedule.begins_s.get(vehicle.uav, schedule.all_landed_s)
        after_s = min(extra_delay_s + begins_s, MAX_AFTER_S)
        delayed = replace(command, uavs=(vehicle.uav,), after_s=after_s)
        (answer,) = await _send_repeatedly(bus, flight, delayed, signing)
        if answer.outcome == "taken":
            return answer
        note = (
            "the vehicle holds, but has not confirmed its start time; if it did not receive the time, it "
            f"returns {FALLBACK_RETURN_S:g} s after the first command and ignores other vehicles: "
            f"{answer.note}"
        )
        return replace(vehicle, note=note)

    answers = {answer.uav: answer for answer in await asyncio.gather(*map(send_start_time, recalled))}
    return OperatorAnswer(
        tuple(answers.get(v.uav) or _with_unconfirmed_note(v, extra_delay_s) for v in first_answers)
    )


async def _send_repeatedly(
    bus: Transport, flight: FlightEndpoints, command: GiveOrder, signing: RequestSigning
) -> Sequence[VehicleAnswer]:
    """Send a command, repeat it to unconfirmed and silent vehicles, and return the answers.

    A repeated command has the remaining delay. `silent` does not replace the answer `unconfirmed`, because
    the vehicle may have taken the first command.
    """
    began_s = _now_s()
    answers = {v.uav: v for v in (await client.ask(bus, flight, command, signing)).vehicles}
    for _ in range(MAX_ATTEMPTS - 1):
        unconfirmed = tuple(uav for uav, v in answers.items() if v.outcome in ("unconfirmed", "silent"))
        if not unconfirmed:
            break
        remaining_s = max((command.after_s or 0.0) - (_now_s() - began_s), 0.0)
        repeated = replace(command, uavs=unconfirmed, after_s=remaining_s)
        for v in (await client.ask(bus, flight, repeated, signing)).vehicles:
            if v.outcome != "silent":
                answers[v.uav] = v
    return list(answers.values())


def _with_unconfirmed_note(vehicle: VehicleAnswer, extra_delay_s: float) -> VehicleAnswer:
    if vehicle.outcome != "unconfirmed":
        return vehicle
    others = "wait for its expected landing" if extra_delay_s else "are expected to have landed by then"
    note = (
        f"if the vehicle took the command, it holds and returns after {FALLBACK_RETURN_S:g} s; the other "
        f"vehicles {others}: {vehicle.note}"
    )
    return replace(vehicle, note=note)


def _now_s() -> float:
    return asyncio.get_running_loop().time()
