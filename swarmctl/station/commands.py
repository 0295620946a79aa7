"""Commands to the vehicles of a flight: each agent is asked under its own key, all at once."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial

from swarmctl.agent.traffic.return_schedule import is_plausible, schedule_for
from swarmctl.bus import keys
from swarmctl.bus.authentication import NO_AUTHENTICATION, RequestSigning
from swarmctl.bus.operator_service import KINDS
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.core.messages import (
    ENDING_ORDERS,
    MAX_AFTER_S,
    GiveOrder,
    Refusal,
    Request,
    VehicleAnswer,
    decode_answer,
    encode,
)
from swarmctl.core.operator_text import extended, listed, name_problems, resolve_vehicles
from swarmctl.core.records import replace
from swarmctl.station import client
from swarmctl.station.client import FlightEndpoints, NoValidAnswer, Receiver

AGENT_SILENT = (
    "the vehicle's agent does not answer: the flight has ended, or the agent has no connection to the "
    "network, or its queue of commands is full [agent-silent]"
)
CHECK_TABLE = "The command may have had an effect; check the flight's table, or repeat the command"
FALLBACK_RETURN_S = 120.0
"""time after which a holding vehicle without a start time returns [s], because the station may be lost"""
MAX_ATTEMPTS = 3
"""largest number of times that one command is sent to a vehicle; unconfirmed returns may delay the others"""
Answers = tuple[VehicleAnswer, ...]
"""answers of the named vehicles, in the order of the swarm; then the refusals of unknown names"""
Give = Callable[[Sequence[int], Request], Awaitable[Answers]]
"""function that gives a command to vehicles, by system id, and returns their answers"""


async def send(
    flight: FlightEndpoints,
    command: Request,
    credentials: Credentials | None = None,
    signing: RequestSigning = NO_AUTHENTICATION,
) -> Answers:
    """Send a command and return the answers. Raises BusError and NoValidAnswer."""
    with client.connected(flight, credentials) as bus:
        return await ask(bus, flight, command, signing)


async def ask(
    bus: Transport, flight: FlightEndpoints, command: Request, signing: RequestSigning = NO_AUTHENTICATION
) -> Answers:
    """Send a command over an open bus; an order to return also schedules the vehicles' returns.

    An order that ends flights goes to all vehicles with valid names, and unknown names become refused
    answers: a misspelt name must not keep the other vehicles in the air. Raises NoValidAnswer.
    """
    names = await client.vehicles_of(bus, flight, signing)
    words, unknown = command.uavs, dict[str, str]()
    if words is not None and isinstance(command, GiveOrder) and command.order in ENDING_ORDERS:
        unknown = name_problems(words, names)
        words = tuple(word for word in words if str(word) not in unknown)
    try:
        uavs = list(names) if words is None else resolve_vehicles(words, names)
        if isinstance(command, GiveOrder) and command.ignore:  # an agent knows no other vehicle's name
            command = replace(command, ignore=tuple(resolve_vehicles(command.ignore, names)))
    except ValueError as error:
        raise NoValidAnswer(f"nothing was changed: {error}", "refused") from None
    give = partial(_give, bus, flight.swarm, names, signing)
    if isinstance(command, GiveOrder) and command.order == "return" and len(uavs) > 1:
        answers = await _recall(give, uavs, command)
    else:  # a single vehicle waits by itself for a clear way home
        answers = await give(uavs, command)
    refused = (VehicleAnswer(0, word, "refused", note=why) for word, why in unknown.items())
    return (*answers, *refused)


async def _give(
    bus: Transport,
    swarm: str,
    names: Mapping[int, str],
    signing: RequestSigning,
    uavs: Sequence[int],
    command: Request,
) -> Answers:
    """Send a command to the agents of `uavs`, all at once."""

    async def ask_agent(uav: int) -> VehicleAnswer:
        key = keys.request(swarm, KINDS[type(command)], uav)
        receiver = Receiver(key, "the vehicle's agent", AGENT_SILENT, CHECK_TABLE, uav)
        request, decode = encode(replace(command, uavs=(uav,))), partial(decode_answer, kind=VehicleAnswer)
        try:
            answer, dropped = await client.exchange(bus, receiver, request, signing, decode)
        except NoValidAnswer as error:
            return VehicleAnswer(uav, names[uav], error.outcome, note=str(error))
        if isinstance(answer, Refusal):
            answer = VehicleAnswer(uav, names[uav], "refused", note=answer.why)
        if answer.uav != uav:
            note = "the vehicle's agent answered for another vehicle"
            return VehicleAnswer(uav, names[uav], "unconfirmed", note=note)
        return _noted(answer, dropped)

    return tuple(await asyncio.gather(*map(ask_agent, uavs)))


async def _recall(give: Give, uavs: Sequence[int], command: GiveOrder) -> Answers:
    """Order several vehicles to return: all hold, and then each gets the start time of its return."""
    began_s = _now_s()
    first_answers = await _give_repeatedly(give, uavs, replace(command, after_s=FALLBACK_RETURN_S))
    recalled = [v for v in first_answers if v.outcome == "taken"]
    places = {v.uav: v.place for v in recalled if v.place is not None and is_plausible(v.place)}
    schedule, names = schedule_for(places), {v.uav: v.name for v in recalled}
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
        (answer,) = await _give_repeatedly(give, [vehicle.uav], replace(command, after_s=after_s))
        if answer.outcome == "taken":
            passed = listed(names[other] for uav, other in schedule.height_only if uav == vehicle.uav)
            return _noted(answer, passed and f"only height separates its way from {passed}")
        note = (
            "the vehicle holds, but has not confirmed its start time; if it did not receive the time, it "
            f"returns {FALLBACK_RETURN_S:g} s after the first command and ignores other vehicles: "
            f"{answer.note}"
        )
        return replace(vehicle, note=note)

    answers = {answer.uav: answer for answer in await asyncio.gather(*map(send_start_time, recalled))}
    return tuple(answers.get(v.uav) or _with_unconfirmed_note(v, extra_delay_s) for v in first_answers)


async def _give_repeatedly(give: Give, uavs: Sequence[int], command: GiveOrder) -> Answers:
    """Give a command, repeat it to unconfirmed and silent vehicles, and return the answers.

    A repeated command has the remaining delay. `silent` does not replace the answer `unconfirmed`, because
    the vehicle may have taken the first command.
    """
    began_s = _now_s()
    answers = {v.uav: v for v in await give(uavs, command)}
    for _ in range(MAX_ATTEMPTS - 1):
        unconfirmed = [uav for uav, v in answers.items() if v.outcome in ("unconfirmed", "silent")]
        if not unconfirmed:
            break
        remaining_s = max((command.after_s or 0.0) - (_now_s() - began_s), 0.0)
        for v in await give(unconfirmed, replace(command, after_s=remaining_s)):
            if v.outcome != "silent":
                answers[v.uav] = v
    return tuple(answers.values())


def _noted(answer: VehicleAnswer, note: str) -> VehicleAnswer:
    """Return an answer with one more note, if there is one."""
    if not note:
        return answer
    return replace(answer, note=extended(answer.note, f"; {note}") if answer.note else note)


def _with_unconfirmed_note(vehicle: VehicleAnswer, extra_delay_s: float) -> VehicleAnswer:
    if vehicle.outcome != "unconfirmed":
        return vehicle
    others = "wait for its expected landing" if extra_delay_s else "are expected to have landed by then"
    note = (
        f"if the vehicle took the command, it holds and returns after {FALLBACK_RETURN_S:g} s; the other "
        f"vehicles {others}: {vehicle.note}"
    )
    return replace(vehicle, note=note)


def has_failed(command: Request, answers: Answers) -> bool:
    """Return whether no vehicle took the command, or a vehicle has another outcome than `taken`.

    If the command is for all vehicles, the outcome `over` of some vehicles is no failure. An order that ends
    flights is fulfilled even if all flights are over.
    """
    outcomes = {vehicle.outcome for vehicle in answers}
    accepted = {"taken", "over"} if command.uavs is None else {"taken"}
    ends_flights = isinstance(command, GiveOrder) and command.order in ENDING_ORDERS
    expected = accepted if ends_flights else {"taken"}
    return not outcomes & expected or not outcomes <= accepted


def _now_s() -> float:
    return asyncio.get_running_loop().time()
