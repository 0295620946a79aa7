"""An operator's commands on the wire: accepted and refused."""

from __future__ import annotations

import asyncio
import math
import re
from contextlib import suppress

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from operator_station import ANYWHERE, KEY, ORDER, Pair, Station, memory_pair, zenoh_pair
from profiles import examples

from swarmctl.bus import keys, operator_service
from swarmctl.bus.operator_service import CommandCounts
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import MAX_MESSAGE_BYTES, MAX_QUERY_BYTES
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.zenoh import MAX_PENDING_QUERIES, ZenohBus
from swarmctl.core import events as ev
from swarmctl.core.messages import (
    BadMessage,
    CommandOutcome,
    GiveOrder,
    Refusal,
    Request,
    SetWeights,
    SwarmVehicles,
    VehicleAnswer,
    decode_answer,
    decode_command,
    encode,
)
from swarmctl.core.operator_text import resolve_vehicles
from swarmctl.core.threat import FiringStrength
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.station import client, commands
from swarmctl.station.commands import Answers

THERE = client.FlightEndpoints("test", ANYWHERE)


def packed(**fields: object) -> bytes:
    return b"\x03" + msgspec.msgpack.encode({"type": "set_weights", **fields})


WRONG: dict[str, bytes] = {
    "empty": b"",
    "no MessagePack": b"\x03nonsense",
    "another version": b"\x02" + packed(uavs=[1], w=0.5)[1:],
    "a message of UAVs": b"\x03" + msgspec.msgpack.encode({"type": "state", "sender": 1}),
    "w above 1": packed(uavs=[1], w=1.5),
    "w below 0": packed(uavs=[1], w=-0.1),
    "w not a number": packed(uavs=[1], w=math.nan),
    "increasing strengths": packed(uavs=[1], firing_strength=[0.1, 0.3, 0.6]),
    "nothing to change": packed(uavs=[1]),
    "a negative range": packed(uavs=[1], range=-1),
    "a range in words": packed(uavs=[1], range="far"),
    "a name of a book": packed(uavs=[1], w=0.5, by="x" * 65),
    "no vehicle named": packed(uavs=[], w=0.5),
    "no vehicles": packed(w=0.5),
    "an unknown field": packed(uavs=[1], w=0.5, psi=3.0),
    "too many vehicles": packed(uavs=[1] * 255, w=0.5),
    "no system id": packed(uavs=[0], w=0.5),
    "a system id too high": packed(uavs=[255], w=0.5),
    "an empty name": packed(uavs=[""], w=0.5),
    "a name too long": packed(uavs=["x" * 33], w=0.5),
}
FOREIGN: dict[str, bytes] = {
    "another vehicle": packed(uavs=[1], w=0.5),
    "another vehicle too": packed(uavs=[2, 1], w=0.5),
    "all vehicles": packed(uavs=None, w=0.5),
    "the vehicle's name": packed(uavs=["uav2"], w=0.5),
    "another kind": encode(GiveOrder((2,), "land")),
    "a command above the length limit": packed(uavs=[1], w=0.5) + bytes(MAX_QUERY_BYTES),
}
"""Commands that only the operator service can refuse."""


@pytest.mark.parametrize("name", WRONG)
def test_an_invalid_command_is_refused(name: str) -> None:
    with pytest.raises(BadMessage):
        decode_command(WRONG[name])


@given(
    uavs=st.none()
    | st.lists(st.integers(1, 254) | st.text(min_size=1, max_size=32), min_size=1, max_size=5).map(tuple),
    w=st.floats(0.0, 1.0),
    strengths=st.none() | st.just((0.7, 0.3, 0.1)),
)
@settings(max_examples=examples(40), deadline=None, derandomize=True)
def test_a_command_survives_the_wire(
    uavs: tuple[int | str, ...] | None, w: float, strengths: tuple[float, float, float] | None
) -> None:
    command = SetWeights(uavs, w, strengths)
    assert decode_command(encode(command)) == command


@given(st.binary(max_size=60))
@settings(max_examples=examples(150), deadline=None, derandomize=True)
def test_any_bytes_are_a_command_or_refused(data: bytes) -> None:
    with suppress(BadMessage):
        decode_command(b"\x03" + data)
    with suppress(BadMessage):
        decode_answer(b"\x03" + data, VehicleAnswer)


def test_unknown_fields_of_an_answer_are_ignored() -> None:
    later = {"type": "vehicle_answer", "uav": 2, "name": "uav2", "outcome": "taken", "more": 1}
    found = decode_answer(b"\x03" + msgspec.msgpack.encode(later), VehicleAnswer)
    assert found == VehicleAnswer(2, "uav2", "taken")


def test_an_answer_of_another_kind_is_refused() -> None:
    names = encode(SwarmVehicles({2: "uav2"}))
    assert decode_answer(names, SwarmVehicles) == SwarmVehicles({2: "uav2"})
    with pytest.raises(BadMessage, match="SwarmVehicles, expected VehicleAnswer"):
        decode_answer(names, VehicleAnswer)


@pytest.fixture(params=[memory_pair, zenoh_pair])
def both(request: pytest.FixtureRequest) -> Pair:
    made: Pair = request.param
    return made


def test_a_command_reaches_the_vehicle_of_its_key_and_the_answer_returns(both: Pair) -> None:
    async def scene() -> None:
        with both() as (ground, operator):
            station = Station(ground)
            command = SetWeights((2,), firing_strength=(0.7, 0.3, 0.1))
            (answer,) = await operator.ask(KEY, encode(command), 5.0)
            assert decode_answer(answer, VehicleAnswer) == VehicleAnswer(2, "uav2", "taken", 5)
            assert station.posted == [(2, ev.WeightsChanged(1, None, FiringStrength(0.7, 0.3, 0.1)))]
            (answer,) = await operator.ask(ORDER, encode(GiveOrder((2,), "hold")), 5.0)
            assert [event.request_id for _, event in station.posted] == [1, 2]

    asyncio.run(scene())


def test_an_invalid_command_is_counted_shown_and_answered_but_reaches_no_vehicle(both: Pair) -> None:
    async def scene() -> None:
        with both() as (ground, operator):
            station = Station(ground)
            for number, payload in enumerate((WRONG["w above 1"], *FOREIGN.values()), start=1):
                (data,) = await operator.ask(KEY, payload, 5.0)
                answer = decode_answer(data, VehicleAnswer)
                assert isinstance(answer, Refusal)
                assert answer.why in station.said[-1] or number > operator_service.SHOWN_BURST
                assert station.counts == CommandCounts(passed_on=0, refused=number)
            assert len(station.said) == operator_service.SHOWN_BURST
            assert station.posted == []

    asyncio.run(scene())


def test_the_largest_valid_command_is_read() -> None:
    launch = GiveOrder((254,), "launch", ignore=tuple(range(1, 255)), by="\N{BLACK STAR}" * 64)
    assert len(encode(launch)) <= MAX_QUERY_BYTES


def test_an_oversized_query_never_reaches_the_service() -> None:
    """Zenoh drops queries above the limit of its listener; the operator gets no answer."""

    async def scene() -> None:
        with zenoh_pair() as (ground, operator):
            station = Station(ground)
            with suppress(TimeoutError):
                assert await operator.ask(KEY, bytes(4 * MAX_MESSAGE_BYTES), 0.3) == ()
            assert station.counts == CommandCounts()
            assert ground.endpoint is not None
            with ZenohBus(zenoh_config.visitor(ground.endpoint)) as another:
                assert len(await another.ask(KEY, encode(SetWeights((2,), w=0.2)), 5.0)) == 1

    asyncio.run(scene())


def test_commands_above_the_rate_limit_are_refused_and_few_are_reported() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)

        async def send(n: int) -> list[str]:
            found = [await bus.ask(KEY, encode(SetWeights((2,), w=0.2)), 5.0) for _ in range(n)]
            answers = [decode_answer(answer, VehicleAnswer) for (answer,) in found]
            return [answer.why if isinstance(answer, Refusal) else "" for answer in answers]

        for flood in (1, 2):
            refused = await send(30)
            assert refused[:8] == [""] * 8
            assert all("[commands-too-fast]" in why for why in refused[8:])
            assert station.counts == CommandCounts(passed_on=8 * flood, refused=22 * flood)
            assert len(station.posted) == 8 * flood
            await asyncio.sleep(2.0)
        assert len(station.said) == operator_service.SHOWN_BURST
        await send(8)
        await asyncio.sleep(0.5)
        assert await send(2) == ["", ""]
        await asyncio.sleep(2.0)
        for _ in range(8):
            await bus.ask(KEY, b"nonsense", 5.0)
        assert "[commands-too-fast]" in (await send(1))[0]

    run_virtual(scene())


def test_a_flood_of_weights_keeps_no_order_out() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)
        for _ in range(30):
            answers = await commands.ask(bus, THERE, SetWeights(None, w=0.2))
        assert [v.outcome for v in answers] == ["refused", "refused"]
        station.posted.clear()
        answers = await commands.ask(bus, THERE, GiveOrder(None, "hold"))
        assert [v.outcome for v in answers] == ["taken", "taken"]
        assert [uav for uav, _ in station.posted] == [1, 2]

    run_virtual(scene())


def test_wildcards_are_counted_and_few_are_reported() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)
        served = bus._served[KEY]  # the memory bus itself matches no wildcards
        for _ in range(99):
            served("**", b"", lambda _: pytest.fail("a wildcard was answered"))
        assert station.counts.refused == 99
        assert len(station.said) == operator_service.SHOWN_BURST

    run_virtual(scene())


def test_queries_do_not_displace_messages_between_vehicles() -> None:
    """Queries wait for the next turn of the loop; those above the limit are dropped without an answer."""

    async def scene() -> None:
        received: list[bytes] = []
        with ZenohBus() as bus:
            bus.subscribe("swarmctl/test/uav/1/**", lambda _, payload: received.append(payload))
            bus.serve(KEY, lambda _, payload, reply: reply(payload or b""))
            asked = [asyncio.create_task(bus.ask(KEY, b"?", 5.0)) for _ in range(5 * MAX_PENDING_QUERIES)]
            await asyncio.sleep(0)
            bus.put("swarmctl/test/uav/1/inform/state/2", b"here")
            answers = await asyncio.gather(*asked)
            assert received == [b"here"]
            assert [a for a in answers if a] == [(b"?",)] * (len(answers) - bus.dropped)
            assert bus.dropped > 0

    asyncio.run(scene())


def test_the_text_about_a_refused_command_has_no_control_characters() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)
        await bus.ask(KEY, packed(uavs=[1], **{"\x1b[2J" + "x" * 9999: 1}), 5.0)
        (text,) = station.said
        assert text.isprintable()
        assert len(text) < 500

    asyncio.run(scene())


def test_a_command_for_another_swarm_gets_no_answer(both: Pair) -> None:
    async def scene() -> None:
        with both() as (ground, operator):
            station = Station(ground)
            key = keys.request("other", "weights", 2)
            assert await operator.ask(key, encode(SetWeights((2,), w=0.2)), 5.0) == ()
            assert station.posted == []

    asyncio.run(scene())


def test_a_busy_vehicle_is_unconfirmed_after_the_time_out_and_delays_no_other() -> None:
    async def scene() -> tuple[Answers, float]:
        bus = MemoryBus()
        station = Station(bus, slow=(1,))
        began_s = asyncio.get_running_loop().time()
        asked = asyncio.create_task(commands.ask(bus, THERE, SetWeights(None, w=0.2)))
        await asyncio.sleep(0.1)
        assert [uav for uav, _ in station.posted] == [1, 2]
        return await asked, asyncio.get_running_loop().time() - began_s

    answers, took_s = run_virtual(scene())
    assert [v.outcome for v in answers] == ["unconfirmed", "taken"]
    assert "[not-handled-yet]" in answers[0].note
    assert took_s == pytest.approx(3.0)
    assert commands.has_failed(SetWeights(None, w=0.2), answers)


def test_a_busy_vehicle_gets_no_new_weights() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus, slow=(2,))
        await commands.ask(bus, THERE, SetWeights((2,), w=0.2))
        assert len(station.posted) == 1

        both_named = await commands.ask(bus, THERE, SetWeights(None, w=0.3))
        assert [(v.uav, v.outcome) for v in both_named] == [(1, "taken"), (2, "refused")]
        assert "[vehicle-busy]" in both_named[1].note
        assert commands.has_failed(SetWeights(None, w=0.3), both_named)
        assert [(uav, event.request_id) for uav, event in station.posted] == [(2, 1), (1, 2)]
        assert station.counts == CommandCounts(passed_on=2, refused=1)

        # The answer to an order does not free the vehicle.
        station.slow = ()
        await commands.ask(bus, THERE, GiveOrder((2,), "hold"))
        (again,) = await commands.ask(bus, THERE, SetWeights((2,), w=0.3))
        assert "[vehicle-busy]" in again.note

        # The late answer does not reach the operator, but the vehicle is free again.
        station.late[0]()
        await commands.ask(bus, THERE, SetWeights((2,), w=0.3))
        assert [(uav, event.request_id) for uav, event in station.posted] == [(2, 1), (1, 2), (2, 3), (2, 4)]

    run_virtual(scene())


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["alpha"], [3]), (["3"], [3]), ([3], [3]), (["7"], [5]), (["5"], [5]), (["9", "alpha", 3], [3, 9]),
        (["03"], "3 (alpha), 5 (7), 9 (3x), 11 (9x)"),
        (["Alpha"], "Alpha"),
        ([""], "3 (alpha)"),
        ([*range(20, 110)], "28, 29 and 80 more;"),
    ],
)  # fmt: skip
def test_a_name_or_system_id_selects_one_vehicle(words: list[int | str], expected: list[int] | str) -> None:
    names = {3: "alpha", 5: "7", 9: "3x", 11: "9x"}
    if isinstance(expected, list):
        assert resolve_vehicles(words, names) == expected
    else:
        with pytest.raises(ValueError, match=re.escape(expected)):
            resolve_vehicles(words, names)


def test_a_name_that_is_also_another_vehicles_system_id_is_refused() -> None:
    with pytest.raises(ValueError, match=r"3 \(alpha\), 5 \(3\)"):
        resolve_vehicles(["3"], {3: "alpha", 5: "3"})


@pytest.mark.parametrize(
    ("reply", "outcome", "reason"),
    [
        (None, "unconfirmed", r"Nothing was changed \[no-answer\]"),
        (Refusal("too fast [commands-too-fast]"), "refused", "too fast"),
        (VehicleAnswer(1, "uav1", "taken"), "unconfirmed", "expected SwarmVehicles"),
    ],
)
def test_without_the_names_of_the_vehicles_no_vehicle_is_asked(
    reply: Refusal | VehicleAnswer | None, outcome: str, reason: str
) -> None:
    async def scene() -> None:
        bus = MemoryBus()
        station = Station(bus)
        answers = (lambda _k, _p, r: None) if reply is None else (lambda _k, _p, r: r(encode(reply)))
        bus.serve(keys.swarm_vehicles("test"), answers)
        with pytest.raises(client.NoValidAnswer, match=reason) as raised:
            await commands.ask(bus, THERE, GiveOrder(None, "hold"))
        assert raised.value.outcome == outcome
        assert station.posted == []

    run_virtual(scene())


def test_without_a_flight_nothing_is_changed() -> None:
    with pytest.raises(client.NoValidAnswer, match=r"nothing was changed \[not-served\]"):
        run_virtual(commands.ask(MemoryBus(), THERE, GiveOrder(None, "hold")))


@pytest.mark.parametrize(
    ("command", "outcomes", "expected"),
    [
        (GiveOrder(None, "land"), ("taken", "over"), False),
        (GiveOrder(None, "land"), ("over", "over"), False),
        (GiveOrder(None, "land"), ("over", "refused"), True),
        (GiveOrder(None, "land"), (), True),
        (GiveOrder((1, 2), "land"), ("over", "over"), True),
        (GiveOrder(None, "launch"), ("over", "over"), True),
        (SetWeights(None, w=0.2), ("over", "over"), True),
    ],
)
def test_a_command_fails_unless_its_purpose_is_reached(
    command: Request, outcomes: tuple[CommandOutcome, ...], expected: bool
) -> None:
    answers = tuple(VehicleAnswer(1, "uav1", outcome) for outcome in outcomes)
    assert commands.has_failed(command, answers) is expected
