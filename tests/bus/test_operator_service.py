"""The operator service of one vehicle, and an operator's client of several agents."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest
from operator_station import Station

from swarmctl.bus import keys, operator_service
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.operator_service import CommandCounts
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.core import events as ev
from swarmctl.core.events import FlightOrder
from swarmctl.core.messages import (
    BadMessage,
    GiveOrder,
    Refusal,
    SetWeights,
    SwarmVehicles,
    VehicleAnswer,
    decode_answer,
    encode,
)
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.answers import order_line
from swarmctl.station import client, commands
from swarmctl.station.commands import Answers

pytestmark = pytest.mark.virtual

GARBAGE_PER_S = 50
SWARM = client.FlightEndpoints(
    "test", BusEndpoint("127.0.0.1", 7447), agents={1: "uav1", 2: "uav2", 3: "uav3", 4: "uav4"}
)
OPERATORS, OF_UAV2 = b"operator".ljust(64), b"uav2".ljust(64)


class Guarded:
    """Stand-in for a vehicle's authentication: checks a prefix of requests and adds a prefix to answers."""

    is_cheap = False

    def verify(self, key: str, payload: bytes) -> bytes:
        if not payload.startswith(OPERATORS):
            raise BadMessage(f"no participant of this swarm signed the payload under {key}")
        return payload.removeprefix(OPERATORS)

    def sign_answer(self, key: str, payload: bytes, answer: bytes) -> bytes:
        return OF_UAV2 + key.encode() + payload + answer


class Operators:
    """Stand-in for an operator's signing, with the same prefixes."""

    def sign(self, _uav: int | None, _key: str, command: bytes) -> bytes:
        return OPERATORS + command

    def verify_answer(self, uav: int | None, key: str, asked: bytes, data: bytes) -> bytes:
        before = f"uav{uav}".encode().ljust(64) + key.encode() + asked
        if not data.startswith(before):
            raise BadMessage("not its own")
        return data.removeprefix(before)


ORDER, WEIGHTS = "swarmctl/test/uav/2/request/order/operator", "swarmctl/test/uav/2/request/weights/operator"
TAKEN = VehicleAnswer(2, "uav2", "taken", 5)


async def asked(bus: MemoryBus, key: str, command: GiveOrder | SetWeights) -> VehicleAnswer | Refusal:
    (answer,) = await bus.ask(key, encode(command), 5.0)
    return decode_answer(answer, VehicleAnswer)


async def refused(bus: MemoryBus, key: str, command: GiveOrder | SetWeights) -> str:
    """Return the reason of a refusal."""
    answer = await asked(bus, key, command)
    assert isinstance(answer, Refusal)
    return answer.why


def test_orders_and_weights_have_keys_of_their_own() -> None:
    assert keys.request("test", "order", 2) == ORDER
    assert keys.request("test", "weights", 2) == WEIGHTS

    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, uav=2)
        assert await asked(bus, ORDER, GiveOrder((2,), "hold")) == TAKEN
        assert await asked(bus, WEIGHTS, SetWeights((2,), w=0.2)) == TAKEN
        assert station.posted == [
            (2, ev.OperatorCommand(FlightOrder.HOLD, 1)),
            (2, ev.WeightsChanged(2, 0.2)),
        ]
        # Only the process that flies all vehicles knows the swarm.
        assert await bus.ask(keys.swarm_vehicles("test"), b"", 5.0) == ()

    run_virtual(scene())


def test_orders_do_not_wait_for_weights() -> None:
    """An order waits neither for an agent that is slow to accept weights, nor for a flood of weights."""

    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, uav=2, slow=(2,))
        first = asyncio.create_task(asked(bus, WEIGHTS, SetWeights((2,), w=0.2)))
        for _ in range(3 * operator_service.BURST):
            await asyncio.sleep(0.001)
            assert await refused(bus, WEIGHTS, SetWeights((2,), w=0.3))
        station.slow = ()
        assert await asked(bus, ORDER, GiveOrder((2,), "land")) == TAKEN
        assert [type(event) for _, event in station.posted] == [ev.WeightsChanged, ev.OperatorCommand]
        answer = await first
        assert isinstance(answer, VehicleAnswer)
        assert answer.outcome == "unconfirmed"

    run_virtual(scene())


def test_a_service_closed_for_orders_gives_the_reason_and_takes_weights() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, uav=2, closed="closed [orders-need-keys]")
        assert await refused(bus, ORDER, GiveOrder((2,), "launch")) == "closed [orders-need-keys]"
        assert await asked(bus, WEIGHTS, SetWeights((2,), w=0.2)) == TAKEN
        assert len(station.posted) == 1

    run_virtual(scene())


def test_an_unsigned_order_is_refused() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, uav=2, authentication=Guarded())
        command = encode(GiveOrder((2,), "land"))
        (data,) = await bus.ask(ORDER, command, 5.0)
        answer = decode_answer(data.removeprefix(OF_UAV2 + ORDER.encode() + command), VehicleAnswer)
        assert answer == Refusal(f"no participant of this swarm signed the payload under {ORDER}")
        assert station.posted == []
        (line,) = station.said
        assert "(1 " in line
        assert line.endswith(answer.why)

    run_virtual(scene())


def test_a_flood_of_unsigned_requests_does_not_delay_the_operators_orders() -> None:
    """Neither the order nor its answer waits, and unverifiable requests are not reported singly."""

    async def scene() -> None:
        bus, garbage = MemoryBus(), GARBAGE_PER_S * 4
        station = Station(bus, uav=2, authentication=Guarded())
        served = bus._served[ORDER]
        for n in range(garbage):
            served(ORDER, b"nonsense", lambda _: None)
            await asyncio.sleep(1.0 / GARBAGE_PER_S)
            if n % GARBAGE_PER_S == 0:
                answer = await commands.ask(bus, SWARM, GiveOrder((2,), "land"), Operators())
                assert answer == (TAKEN,)
        assert len(station.posted) == 4
        assert station.counts == CommandCounts(passed_on=4, refused=garbage)
        assert len(station.said) <= operator_service.SHOWN_BURST + 1

    run_virtual(scene())


def test_requests_beyond_the_rate_limit_are_counted_and_not_answered() -> None:
    async def scene() -> None:
        bus, answers = MemoryBus(), []
        station = Station(bus, uav=2, authentication=Guarded())
        for _ in range(5000):
            bus._served[ORDER](ORDER, b"nonsense", answers.append)
        assert len(answers) == operator_service.CHECKED_BURST
        assert station.counts.refused == 5000

    run_virtual(scene())


# --- the operator's side


class Crowd(MemoryBus):
    """A bus with additional responders."""

    def __init__(self, *others: Callable[[str, bytes], bytes]) -> None:
        super().__init__()
        self._others = others

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        own = await super().ask(key, payload, timeout_s)
        return (*(other(key, payload) for other in self._others), *own)


def forged(_key: str, _payload: bytes) -> bytes:
    return encode(VehicleAnswer(2, "uav2", "taken", note="forged"))


def of_another_question(key: str, _payload: bytes) -> bytes:
    return Guarded().sign_answer(key, b"another question", forged("", b""))


def by_uav3(key: str, payload: bytes) -> bytes:
    return b"uav3".ljust(64) + key.encode() + payload + forged("", b"")


@pytest.mark.parametrize("other", [forged, of_another_question, by_uav3])
def test_only_an_answer_signed_by_the_asked_vehicle_counts(
    other: Callable[[str, bytes], bytes],
) -> None:
    async def scene(*, is_there: bool) -> VehicleAnswer:
        bus = Crowd(other)
        if is_there:
            Station(bus, uav=2, authentication=Guarded(), closed="not now")
        (answer,) = await commands.ask(bus, SWARM, GiveOrder((2,), "hold"), Operators())
        return answer

    answer = run_virtual(scene(is_there=True))
    assert answer.outcome == "refused"
    assert answer.note.startswith("not now; ")
    answer = run_virtual(scene(is_there=False))
    assert answer.outcome == "unconfirmed"
    assert "[wrong-token]" in answer.note


def test_two_answers_for_one_vehicle_are_both_discarded() -> None:
    async def scene() -> None:
        bus = Crowd(forged)
        Station(bus, uav=2)
        (answer,) = await commands.ask(bus, SWARM, GiveOrder((2,), "hold"))
        assert answer.outcome == "unconfirmed"
        assert answer.note.startswith("2 processes")

    run_virtual(scene())


def test_two_processes_that_name_the_vehicles_of_a_swarm_are_both_ignored() -> None:
    async def scene() -> None:
        bus = Crowd(lambda _key, _payload: encode(SwarmVehicles({1: "uav2", 2: "uav1"})))
        station = Station(bus)
        alone = client.FlightEndpoints("test", BusEndpoint("127.0.0.1", 7447))
        with pytest.raises(client.NoValidAnswer, match=r"^2 processes"):
            await commands.ask(bus, alone, SetWeights(None, w=0.2))
        assert station.posted == []

    run_virtual(scene())


def test_each_agent_sends_its_own_answer_without_delaying_others() -> None:
    async def scene() -> tuple[Answers, float]:
        bus = MemoryBus()
        Station(bus, uav=2)
        bus.serve(keys.request("test", "order", 3), lambda _key, _payload, _reply: None)
        bus.serve(keys.request("test", "order", 4), lambda _key, _payload, reply: reply(b"\x01nonsense"))
        answer = await commands.ask(bus, SWARM, GiveOrder(None, "hold"))
        return answer, asyncio.get_running_loop().time()

    answer, took_s = run_virtual(scene())
    assert [(v.name, v.outcome) for v in answer] == [
        ("uav1", "silent"),
        ("uav2", "taken"),
        ("uav3", "unconfirmed"),
        ("uav4", "unconfirmed"),
    ]
    assert took_s == pytest.approx(client.TIMEOUT_S)
    assert commands.has_failed(GiveOrder(None, "hold"), answer)
    lines = [order_line("hold", vehicle) for vehicle in answer]
    assert [line.split()[:2] for line in lines] == [[f"uav{n}:", "hold"] for n in (1, 2, 3, 4)]
    for line, vehicle in zip(lines, answer, strict=True):
        assert line.endswith(vehicle.note)
    assert lines[0].endswith("[agent-silent]")
    results = [tuple(line.split()[2:4]) for line in lines]
    assert results[2] == results[3]
    assert len(set(results)) == 3, "refused, taken and unconfirmed differ"


def test_an_order_for_an_unknown_vehicle_asks_no_agent() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, uav=2)
        with pytest.raises(client.NoValidAnswer, match=r"\b9\b.*\[unknown-vehicle\]"):
            await commands.ask(bus, SWARM, GiveOrder((2, 9), "launch"))
        assert station.posted == []

    run_virtual(scene())


@pytest.mark.parametrize("word", ["uav4", "4"])
def test_the_vehicle_to_ignore_is_sent_by_system_id(word: str) -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, uav=2)
        await commands.ask(bus, SWARM, GiveOrder((2,), "launch", ignore=(word,)))
        assert station.posted == [(2, ev.OperatorCommand(FlightOrder.LAUNCH, 1, ignore=(4,)))]
        with pytest.raises(client.NoValidAnswer, match=r"\buav9\b.*\[unknown-vehicle\]"):
            await commands.ask(bus, SWARM, GiveOrder((2,), "launch", ignore=("uav9",)))
        # An agent knows no names but its own.
        why = await refused(bus, ORDER, GiveOrder((2,), "launch", ignore=(4, "uav4")))
        assert why.endswith("4, uav4, expected system ids")
        assert len(station.posted) == 1

    run_virtual(scene())


def test_only_a_launch_ignores_vehicles() -> None:
    for order in ("hold", "return", "land"):
        with pytest.raises(ValueError, match=rf"ignore .*{order}"):
            GiveOrder((2,), order, ignore=(4,))  # type: ignore[arg-type]


def test_an_answer_for_another_vehicle_does_not_count() -> None:
    async def scene() -> Answers:
        bus = MemoryBus()
        reply_of_another = encode(VehicleAnswer(9, "uav9", "taken"))
        bus.serve(ORDER, lambda _key, _payload, reply: reply(reply_of_another))
        return await commands.ask(bus, SWARM, GiveOrder((2,), "launch"))

    (vehicle,) = run_virtual(scene())
    assert (vehicle.uav, vehicle.outcome) == (2, "unconfirmed")


@pytest.mark.parametrize("order", ["takeoff", "", None, 3])
def test_an_unknown_order_is_refused(order: object) -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, uav=2)
        strange: GiveOrder = GiveOrder((2,), order)  # type: ignore[arg-type]
        assert (await refused(bus, ORDER, strange)).endswith("[invalid-message]")
        assert station.posted == []

    run_virtual(scene())
