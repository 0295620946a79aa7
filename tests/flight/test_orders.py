"""Operators' orders: an agent's answers by phase, and the operator service."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from agent_stories import Story, orders
from flights import small
from operator_station import AnswerTo, StubAgent

from swarmctl.agent.phases import Phase
from swarmctl.bus import directory, keys, operator_service
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.operator_service import (
    AgentCommand,
    CommandCounts,
    OperatorService,
)
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.core import events as ev
from swarmctl.core.events import FlightOrder
from swarmctl.core.messages import (
    BadMessage,
    GiveOrder,
    OperatorAnswer,
    SetWeights,
    VehicleAnswer,
    decode_answer,
    encode,
)
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.answers import order_line
from swarmctl.station import client

pytestmark = pytest.mark.virtual

GARBAGE_PER_S = 50

# --- the agent


def waiting() -> Story:
    return Story()


def uploading() -> Story:
    story = Story()
    story(ev.Ready())
    story.swap()
    return story


def standby() -> Story:
    return Story().standby()


def replanning() -> Story:
    story = standby()
    story.hear((4, 4, True))
    story.swap()
    return story


def lost_on_the_ground() -> Story:
    story = standby()
    story(ev.LinkLost(4.0))
    return story


def launching() -> Story:
    return Story().launching()


def breaking_off() -> Story:
    story = Story().launching()
    story(ev.OperatorCommand(FlightOrder.HOLD))
    return story


def flying() -> Story:
    return Story().flying()


def lost() -> Story:
    story = flying()
    story(ev.LinkLost(4.0))
    return story


def landing() -> Story:
    story = flying()
    story.over((4, 8))
    return story


def holding() -> Story:
    story = flying()
    story(ev.OperatorCommand(FlightOrder.HOLD, 1))
    return story


def held() -> Story:
    story = holding()
    story(ev.OrderDone(FlightOrder.HOLD))
    story.over((4, 1), mode="GUIDED", mode_role="hold")
    return story


def held_over_the_goal() -> Story:
    story = landing()
    story(ev.OperatorCommand(FlightOrder.HOLD, 1))
    story(ev.OrderDone(FlightOrder.HOLD))
    story.over((4, 8), mode="GUIDED", mode_role="hold")
    return story


def held_without_link() -> Story:
    story = held()
    story(ev.LinkLost(4.0))
    return story


def leaving() -> Story:
    story = flying()
    story(ev.OperatorCommand(FlightOrder.RETURN, 1))
    return story


def released() -> Story:
    story = flying()
    story.over((4, 1), mode="LOITER", mode_role="other")
    return story


def done() -> Story:
    story = landing()
    story.over((4, 8), armed=False)
    return story


HOLD, RETURN, LAND, LAUNCH = FlightOrder.HOLD, FlightOrder.RETURN, FlightOrder.LAND, FlightOrder.LAUNCH
RESUME = FlightOrder.RESUME
STAYS, DOWN = "[stays-on-ground]", "[launch-aborted]"
MATRIX: list[tuple[Callable[[], Story], FlightOrder, str, str, list[FlightOrder], Phase]] = [
    # state, order, answer, note of the answer, order to the vehicle, next state
    (waiting, LAUNCH, "refused", "waiting [not-ready]", [], Phase.WAITING),
    (uploading, LAUNCH, "refused", "uploading [not-ready]", [], Phase.UPLOADING),
    (standby, LAUNCH, "taken", "", [LAUNCH], Phase.LAUNCHING),
    (replanning, LAUNCH, "taken", "[after-upload]", [], Phase.STANDBY),
    (lost_on_the_ground, LAUNCH, "refused", "[launch-without-link]", [], Phase.STANDBY),
    (launching, LAUNCH, "taken", "[launching]", [], Phase.LAUNCHING),
    (breaking_off, LAUNCH, "refused", "[launch-aborted]", [], Phase.LEAVING),
    (flying, LAUNCH, "taken", "[launched-already]", [], Phase.FLYING),
    (landing, LAUNCH, "taken", "[launched-already]", [], Phase.LANDING),
    (holding, LAUNCH, "refused", "[not-resumed]", [], Phase.HOLDING),
    (leaving, LAUNCH, "refused", "[not-resumed]", [], Phase.LEAVING),
    (released, LAUNCH, "over", "LOITER", [], Phase.RELEASED),
    (standby, RESUME, "refused", "[not-resumed]", [], Phase.STANDBY),
    (flying, RESUME, "refused", "[not-resumed]", [], Phase.FLYING),
    (holding, RESUME, "refused", "[not-resumed]", [], Phase.HOLDING),
    (held, RESUME, "taken", "", [], Phase.FLYING),
    (held_over_the_goal, RESUME, "taken", "", [LAND], Phase.LANDING),
    (held_without_link, RESUME, "refused", "[not-resumed]", [], Phase.HOLDING),
    (leaving, RESUME, "refused", "[not-resumed]", [], Phase.LEAVING),
    (released, RESUME, "over", "LOITER", [], Phase.RELEASED),
    (done, LAUNCH, "over", "done, arrived", [], Phase.DONE),
    (waiting, HOLD, "taken", STAYS, [], Phase.WAITING),
    (uploading, RETURN, "taken", STAYS, [], Phase.UPLOADING),
    (standby, LAND, "taken", STAYS, [], Phase.STANDBY),
    (launching, HOLD, "taken", DOWN, [LAND], Phase.LEAVING),
    (launching, RETURN, "taken", DOWN, [LAND], Phase.LEAVING),
    (breaking_off, HOLD, "refused", "[launch-aborted]", [], Phase.LEAVING),
    (flying, HOLD, "taken", "", [HOLD], Phase.HOLDING),
    (flying, RETURN, "taken", "", [RETURN], Phase.LEAVING),
    (flying, LAND, "taken", "", [LAND], Phase.LEAVING),
    (lost, HOLD, "taken", "[waits-for-link]", [HOLD], Phase.HOLDING),
    (landing, HOLD, "taken", "", [HOLD], Phase.HOLDING),
    (holding, RETURN, "taken", "", [RETURN], Phase.LEAVING),
    (leaving, HOLD, "taken", "", [HOLD], Phase.HOLDING),
    (released, LAND, "taken", "[sent-once]", [LAND], Phase.RELEASED),
    (done, HOLD, "over", "done, arrived", [], Phase.DONE),
]


@pytest.mark.parametrize(
    ("begun", "order", "outcome", "note", "sent", "phase"),
    MATRIX,
    ids=[f"{begun.__name__}-{order}" for begun, order, *_ in MATRIX],
)
def test_an_agent_answers_an_order_by_its_phase(
    begun: Callable[[], Story],
    order: FlightOrder,
    outcome: str,
    note: str,
    sent: list[FlightOrder],
    phase: Phase,
) -> None:
    story = begun()
    effects = story(ev.OperatorCommand(order, 7))
    (answer,) = (e for e in effects if isinstance(e, ev.Answer))
    assert (answer.command, answer.answer.uav, answer.answer.name) == (7, 1, "uav1")
    assert answer.answer.outcome == outcome
    assert note in answer.answer.note
    assert bool(note) == bool(answer.answer.note)
    assert orders(effects) == sent
    assert story.state.phase is phase


def test_a_vehicle_that_resumes_plans_anew_from_its_hold() -> None:
    story = held()
    story.hear((4, 4, True))
    story(ev.OperatorCommand(RESUME, 2))
    swap = story.swap()
    assert (swap.plan.from_hold, swap.plan.leaves_ahead) == (True, False)
    assert swap.cells[0] == (4, 1)
    assert (4, 4) not in swap.cells


def test_orders_from_the_agents_own_process_get_no_answer() -> None:
    for begun in (waiting, standby, flying, done):
        for order in FlightOrder:
            assert not [e for e in begun()(ev.OperatorCommand(order)) if isinstance(e, ev.Answer)]


def test_the_agents_own_process_does_not_launch_a_vehicle_that_an_operator_holds() -> None:
    story = standby()
    story(ev.OperatorCommand(HOLD, 1))
    assert story(ev.OperatorCommand(LAUNCH)) == []
    assert story.state.phase is Phase.STANDBY
    assert orders(story(ev.OperatorCommand(LAUNCH, 2))) == [LAUNCH]


def test_a_hold_cancels_a_launch_that_waits_for_a_plan() -> None:
    story = replanning()
    story(ev.OperatorCommand(LAUNCH, 1))
    story(ev.OperatorCommand(HOLD, 2))
    assert orders(story.accept()) == []
    assert story.state.phase is Phase.STANDBY


def test_a_reboot_cancels_a_launch_that_waits_for_a_plan() -> None:
    """The order came before the reboot, and the situation around the vehicle may have changed since."""
    story = replanning()
    story(ev.OperatorCommand(LAUNCH, 1))
    story(ev.Rebooted())
    story(ev.Ready())
    story.swap()
    assert orders(story.accept()) == []


# --- the operator service


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


class Ground:
    """The service of one vehicle whose agent takes every command, unless it is slow."""

    def __init__(
        self,
        bus: MemoryBus,
        *,
        slow: bool = False,
        closed: str = "",
        authentication: Authentication = NO_AUTHENTICATION,
    ) -> None:
        self.said: list[str] = []
        self.posted: list[AgentCommand] = []
        self.slow = slow
        self.service = OperatorService(
            bus,
            "test",
            self.said.append,
            {2: StubAgent("uav2", self._command)},
            uav=2,
            refusal=lambda command: closed if isinstance(command, GiveOrder) else "",
            authentication=authentication,
        )

    def _command(self, event: AgentCommand, answer_to: AnswerTo) -> None:
        self.posted.append(event)
        if not self.slow:
            answer_to(VehicleAnswer(2, "uav2", "taken"))


ORDER, WEIGHTS = "swarmctl/test/uav/2/request/order/operator", "swarmctl/test/uav/2/request/weights/operator"
TAKEN = OperatorAnswer((VehicleAnswer(2, "uav2", "taken"),))


async def asked(bus: MemoryBus, key: str, command: GiveOrder | SetWeights) -> OperatorAnswer:
    (answer,) = await bus.ask(key, encode(command), 5.0)
    return decode_answer(answer)


def test_orders_and_weights_have_keys_of_their_own() -> None:
    assert keys.request("test", "order", 2) == ORDER
    assert keys.request("test", "weights", 2) == WEIGHTS

    async def scene() -> None:
        bus = MemoryBus()
        ground = Ground(bus)
        assert await asked(bus, ORDER, GiveOrder((2,), "hold")) == TAKEN
        assert await asked(bus, WEIGHTS, SetWeights(("uav2",), w=0.2)) == TAKEN
        assert ground.posted == [ev.OperatorCommand(HOLD, 1), ev.WeightsChanged(2, 0.2)]
        for key, command in ((WEIGHTS, GiveOrder(None, "land")), (ORDER, SetWeights(None, w=0.2))):
            assert key in (await asked(bus, key, command)).refused
        assert "2 (uav2)" in (await asked(bus, ORDER, GiveOrder((3,), "land"))).refused
        assert len(ground.posted) == 2

    run_virtual(scene())


def test_orders_do_not_wait_for_weights() -> None:
    """An order waits neither for an agent that is slow to accept weights, nor for a flood of weights."""

    async def scene() -> None:
        bus = MemoryBus()
        ground = Ground(bus, slow=True)
        first = asyncio.create_task(asked(bus, WEIGHTS, SetWeights(None, w=0.2)))
        for _ in range(3 * operator_service.BURST):
            await asyncio.sleep(0.001)
            assert (await asked(bus, WEIGHTS, SetWeights(None, w=0.3))).refused
        ground.slow = False
        assert await asked(bus, ORDER, GiveOrder(None, "land")) == TAKEN
        assert [type(event) for event in ground.posted] == [ev.WeightsChanged, ev.OperatorCommand]
        assert (await first).vehicles[0].outcome == "unconfirmed"

    run_virtual(scene())


def test_a_service_closed_for_orders_gives_the_reason_and_takes_weights() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        ground = Ground(bus, closed="closed [orders-need-keys]")
        assert (await asked(bus, ORDER, GiveOrder(None, "launch"))).refused == "closed [orders-need-keys]"
        assert await asked(bus, WEIGHTS, SetWeights(None, w=0.2)) == TAKEN
        assert len(ground.posted) == 1

    run_virtual(scene())


def test_an_unsigned_order_is_refused() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        ground = Ground(bus, authentication=Guarded())
        command = encode(GiveOrder(None, "land"))
        (data,) = await bus.ask(ORDER, command, 5.0)
        answer = decode_answer(data.removeprefix(OF_UAV2 + ORDER.encode() + command))
        assert answer.refused == f"no participant of this swarm signed the payload under {ORDER}"
        assert ground.posted == []
        (line,) = ground.said
        assert "(1 " in line
        assert line.endswith(answer.refused)

    run_virtual(scene())


def test_a_flood_of_unsigned_requests_does_not_delay_the_operators_orders() -> None:
    """Neither the order nor its answer waits, and unverifiable requests are not reported singly."""

    async def scene() -> None:
        bus, garbage = MemoryBus(), GARBAGE_PER_S * 4
        ground = Ground(bus, authentication=Guarded())
        served = bus._served[ORDER]
        for n in range(garbage):
            served(ORDER, b"nonsense", lambda _: None)
            await asyncio.sleep(1.0 / GARBAGE_PER_S)
            if n % GARBAGE_PER_S == 0:
                answer = await client.ask(bus, STATION, GiveOrder((2,), "land"), Operators())
                assert answer == TAKEN
        assert len(ground.posted) == 4
        assert ground.service.counts == CommandCounts(passed_on=4, refused=garbage)
        assert len(ground.said) <= operator_service.SHOWN_BURST + 1

    run_virtual(scene())


def test_requests_beyond_the_rate_limit_are_counted_and_not_answered() -> None:
    async def scene() -> None:
        bus, answers = MemoryBus(), []
        ground = Ground(bus, authentication=Guarded())
        for _ in range(5000):
            bus._served[ORDER](ORDER, b"nonsense", answers.append)
        assert len(answers) == operator_service.CHECKED_BURST
        assert ground.service.counts.refused == 5000

    run_virtual(scene())


def test_without_keys_the_rate_limit_is_shared_by_all_senders() -> None:
    async def scene() -> None:
        bus, answers = MemoryBus(), []
        ground = Ground(bus)
        for _ in range(operator_service.BURST + 3):
            bus._served[ORDER](ORDER, b"nonsense", answers.append)
        assert answers[-3:] == [operator_service.TOO_FAST] * 3
        assert ground.said[-1].endswith("[commands-too-fast]")

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
    return encode(OperatorAnswer((VehicleAnswer(2, "uav2", "taken", note="forged"),)))


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
            Ground(bus, authentication=Guarded(), closed="not now")
        (answer,) = (await client.ask(bus, STATION, GiveOrder((2,), "hold"), Operators())).vehicles
        return answer

    answer = run_virtual(scene(is_there=True))
    assert answer.outcome == "refused"
    assert answer.note.startswith("not now; ")
    answer = run_virtual(scene(is_there=False))
    assert answer.outcome == "unconfirmed"
    assert "1 answer" in answer.note


def test_two_answers_for_one_swarm_are_both_discarded() -> None:
    async def scene() -> None:
        bus = Crowd(forged)
        bus.serve("swarmctl/test/station/request/weights/operator", lambda _k, _p, r: r(forged("", b"")))
        alone = client.FlightEndpoints("test", BusEndpoint("127.0.0.1", 7447))
        with pytest.raises(client.NoValidAnswer, match=r"^2 processes"):
            await client.ask(bus, alone, SetWeights(None, w=0.2))

    run_virtual(scene())


STATION = client.FlightEndpoints(
    "test", BusEndpoint("127.0.0.1", 7447), agents={1: "uav1", 2: "uav2", 3: "uav3", 4: "uav4"}
)


def test_each_agent_sends_its_own_answer_without_delaying_others() -> None:
    async def scene() -> tuple[OperatorAnswer, float]:
        bus = MemoryBus()
        Ground(bus)
        bus.serve(keys.request("test", "order", 3), lambda _key, _payload, _reply: None)
        bus.serve(keys.request("test", "order", 4), lambda _key, _payload, reply: reply(b"\x01nonsense"))
        answer = await client.ask(bus, STATION, GiveOrder(None, "hold"))
        return answer, asyncio.get_running_loop().time()

    answer, took_s = run_virtual(scene())
    assert [(v.name, v.outcome) for v in answer.vehicles] == [
        ("uav1", "silent"),
        ("uav2", "taken"),
        ("uav3", "unconfirmed"),
        ("uav4", "unconfirmed"),
    ]
    assert took_s == pytest.approx(client.TIMEOUT_S)
    assert client.has_failed(GiveOrder(None, "hold"), answer)
    lines = [order_line("hold", vehicle) for vehicle in answer.vehicles]
    assert [line.split()[:2] for line in lines] == [[f"uav{n}:", "hold"] for n in (1, 2, 3, 4)]
    for line, vehicle in zip(lines, answer.vehicles, strict=True):
        assert line.endswith(vehicle.note)
    assert lines[0].endswith("[agent-silent]")
    results = [tuple(line.split()[2:4]) for line in lines]
    assert results[2] == results[3]
    assert len(set(results)) == 3, "refused, taken and unconfirmed differ"


def test_an_order_for_an_unknown_vehicle_asks_no_agent() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        ground = Ground(bus)
        with pytest.raises(client.BadOptions, match=r"\b9\b.*\[unknown-vehicle\]"):
            await client.ask(bus, STATION, GiveOrder((2, 9), "launch"))
        assert ground.posted == []

    run_virtual(scene())


@pytest.mark.parametrize("word", ["uav4", "4"])
def test_the_vehicle_to_ignore_is_sent_by_system_id(word: str) -> None:
    async def scene() -> None:
        bus = MemoryBus()
        ground = Ground(bus)
        await client.ask(bus, STATION, GiveOrder((2,), "launch", ignore=(word,)))
        assert ground.posted == [ev.OperatorCommand(LAUNCH, 1, ignore=(4,))]
        with pytest.raises(client.BadOptions, match=r"\buav9\b.*\[unknown-vehicle\]"):
            await client.ask(bus, STATION, GiveOrder((2,), "launch", ignore=("uav9",)))
        # An agent knows no names but its own.
        refused = (await asked(bus, ORDER, GiveOrder(None, "launch", ignore=("uav4",)))).refused
        assert refused.endswith("[unknown-vehicle]")
        assert len(ground.posted) == 1

    run_virtual(scene())


def test_an_order_that_ignores_no_vehicle_is_readable_by_earlier_versions() -> None:
    assert b"past" not in encode(GiveOrder((2,), "launch"))
    for order in ("hold", "return", "land"):
        with pytest.raises(ValueError, match=rf"ignore .*{order}"):
            GiveOrder((2,), order, ignore=(4,))  # type: ignore[arg-type]


def test_an_answer_for_another_vehicle_does_not_count() -> None:
    async def scene() -> OperatorAnswer:
        bus = MemoryBus()
        reply_of_another = encode(OperatorAnswer((VehicleAnswer(9, "uav9", "taken"),)))
        bus.serve(ORDER, lambda _key, _payload, reply: reply(reply_of_another))
        return await client.ask(bus, STATION, GiveOrder((2,), "launch"))

    (vehicle,) = run_virtual(scene()).vehicles
    assert (vehicle.uav, vehicle.outcome) == (2, "unconfirmed")


@pytest.mark.parametrize("order", ["takeoff", "", None, 3])
def test_an_unknown_order_is_refused(order: object) -> None:
    async def scene() -> None:
        bus = MemoryBus()
        ground = Ground(bus)
        strange: GiveOrder = GiveOrder(None, order)  # type: ignore[arg-type]
        assert (await asked(bus, ORDER, strange)).refused.endswith("[invalid-message]")
        assert ground.posted == []

    run_virtual(scene())


APART: dict[str, object] = {"router": "tcp/10.0.0.1:7447"}
MESHED: dict[str, object] = {"mesh": {"uav1": "tcp/10.0.0.1:7447", "uav2": "tcp/10.0.0.2:7447"}}
VEHICLES = {1: "uav1", 2: "uav2", 3: "uav3"}
ROUTER, OTHER = BusEndpoint("10.0.0.1", 7447), BusEndpoint("10.0.0.2", 7447)


@pytest.fixture
def no_other_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def meant(communication: dict[str, object], connect: str | None = None) -> client.FlightEndpoints:
    config = small(communication={"bus": "zenoh", **communication}).config
    return client.find(None, config, connect)


@pytest.mark.usefixtures("no_other_flight")
def test_agents_in_several_processes_are_asked_at_the_router_or_in_the_mesh() -> None:
    assert meant(APART) == client.FlightEndpoints("small", ROUTER, agents=VEHICLES)
    assert meant(MESHED) == client.FlightEndpoints("small", ROUTER, (OTHER,), VEHICLES)
    assert meant(APART, "tcp/10.0.0.2:7447") == client.FlightEndpoints("small", OTHER, agents=VEHICLES)


@pytest.mark.usefixtures("no_other_flight")
def test_a_flight_of_one_process_on_this_machine_comes_first() -> None:
    here = BusEndpoint("127.0.0.1", 4001)
    with directory.registered("small", here, "token"):
        assert meant(APART) == client.FlightEndpoints("small", here)
    with directory.registered("another", here, "token"):
        assert meant(APART).agents == VEHICLES
