"""The requests of the one client: repetition, answers, and their contents on the wire."""

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.station.exchanges import (
    IN_PROGRESS_S,
    RESEND_S,
    STALLED_S,
    Command,
    Exchange,
    SetParameter,
    UploadPlan,
)
from sim_vehicle.station.frames import NOISE, STATION, Receiver, Sender
from sim_vehicle.station.messages import INTEGER_RANGES, MISSION, PlanItem, command_long, from_wire, to_wire

TARGET = (1, 1)
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
ITEMS = [PlanItem(16, 460_000_000 + i, 145_000_000, 20.0) for i in range(3)]


def ack(result: int, *, to: int = STATION[0], command: int = ARM) -> Any:
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, to, 190)


def mission_ack(result: int, *, to: int = STATION[0], kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_ack_message(to, 190, result, kind)


def request(seq: int, *, to: int = STATION[0], kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_request_int_message(to, 190, seq, kind)


class Bench:
    """An exchange at time 0, and the messages that it sends."""

    def __init__(self, make: Callable[[Callable[[Any], None]], Exchange]) -> None:
        self.sent: list[bytes] = []
        self.kinds: list[Any] = []
        self.exchange = make(self._send)
        self.exchange.begin(0.0)

    def _send(self, message: Any) -> None:
        self.sent.append(bytes(message.pack(mavlink.MAVLink(None, *STATION))))
        self.kinds.append(Receiver().messages(self.sent[-1])[0])

    def until(self, end_s: float) -> int:
        """Let time pass; return the number of messages sent so far."""
        while self.exchange.due_s <= end_s and self.exchange.outcome is None:
            self.exchange.tick(self.exchange.due_s)
        return len(self.sent)


def arming(**options: Any) -> Bench:
    return Bench(lambda send: Command(send, command_long(TARGET, ARM, 1), **options))


def uploading(**options: Any) -> Bench:
    return Bench(lambda send: UploadPlan(send, TARGET, ITEMS, **options))


def test_a_command_is_repeated_with_its_confirmation_until_the_acknowledgement() -> None:
    bench = arming()
    assert bench.until(2 * RESEND_S) == 3
    assert [m.confirmation for m in bench.kinds] == [0, 1, 2]
    bench.exchange.receive(ack(mavlink.MAV_RESULT_DENIED), 3.0)
    assert (bench.exchange.outcome.accepted, bench.exchange.outcome.text) == (False, "DENIED")
    assert bench.until(100.0) == 3


@pytest.mark.parametrize(
    "message",
    [ack(0, to=254), ack(0, command=400 + 1), mission_ack(0)],
    ids=["to another station", "of another command", "of a mission"],
)
def test_another_acknowledgement_does_not_end_a_command(message: Any) -> None:
    bench = arming()
    bench.exchange.receive(message, 0.1)
    assert bench.exchange.outcome is None


def test_a_command_in_progress_is_not_repeated() -> None:
    bench = arming()
    bench.exchange.receive(ack(mavlink.MAV_RESULT_IN_PROGRESS), 1.0)
    assert bench.until(IN_PROGRESS_S) == 1
    assert bench.until(1.0 + IN_PROGRESS_S) == 2


def test_a_result_without_a_name_is_a_number() -> None:
    bench = arming()
    bench.exchange.receive(ack(200), 1.0)
    assert bench.exchange.outcome.text == "200"


def test_attempts_end_an_exchange_without_an_answer() -> None:
    bench = arming(attempts=3)
    assert bench.until(2 * RESEND_S) == 3
    assert bench.exchange.outcome is None
    assert bench.until(3 * RESEND_S) == 3
    assert bench.exchange.outcome.message is None


def test_an_upload_sends_the_requested_items() -> None:
    bench = uploading()
    for seq in (0, 1, 1, 2):
        bench.exchange.receive(request(seq), 1.0)
    bench.exchange.receive(mission_ack(mavlink.MAV_MISSION_INVALID_SEQUENCE), 1.1)  # the repeated item
    assert bench.exchange.outcome is None
    bench.exchange.receive(mission_ack(mavlink.MAV_MISSION_ACCEPTED), 1.2)
    assert bench.exchange.outcome.accepted
    assert bench.kinds[0].count == 3
    assert [m.seq for m in bench.kinds[1:]] == [0, 1, 1, 2]
    assert [m.x for m in bench.kinds[1:]] == [ITEMS[i].x for i in (0, 1, 1, 2)]


@pytest.mark.parametrize(
    "message",
    [request(0, to=254), request(0, kind=1), mission_ack(0, to=254), mission_ack(0, kind=1)],
    ids=["request of another", "request of a fence", "acknowledgement to another", "of a fence"],
)
def test_a_message_of_another_upload_has_no_effect(message: Any) -> None:
    bench = uploading()
    bench.exchange.receive(message, 0.1)
    assert (bench.exchange.outcome, len(bench.sent)) == (None, 1)


@pytest.mark.parametrize(("attempts", "restarts"), [(None, True), (8, False)])
def test_a_stalled_upload_restarts_unless_its_attempts_are_limited(
    attempts: int | None, restarts: bool
) -> None:
    bench = uploading(attempts=attempts)
    bench.exchange.receive(request(0), 0.0)
    assert bench.until(STALLED_S - 0.1) == 2
    bench.until(STALLED_S)
    assert [m.get_type() for m in bench.kinds].count("MISSION_COUNT") == 1 + restarts
    assert (bench.exchange.outcome is None) is restarts


def test_a_request_beyond_the_plan_fails_the_upload() -> None:
    bench = uploading()
    bench.exchange.receive(request(3), 0.1)
    assert not bench.exchange.outcome.accepted
    assert len(bench.sent) == 1


@pytest.mark.parametrize(("kind", "limits"), INTEGER_RANGES.items())
@pytest.mark.parametrize("byte_wise", [True, False])
def test_an_integer_survives_both_encodings(kind: int, limits: tuple[int, int], byte_wise: bool) -> None:
    for value in {limits[0], 0, 1, 100, limits[1]} if byte_wise else {0, 1, 100}:
        assert from_wire(to_wire(value, kind, byte_wise=byte_wise), kind, byte_wise=byte_wise) == value


@pytest.mark.parametrize(("answer", "accepted"), [(-1, True), (7, False)])
def test_a_parameter_is_set_when_the_vehicle_answers_with_its_value(answer: int, accepted: bool) -> None:
    bench = Bench(lambda send: SetParameter(send, TARGET, "NAV_DLL_ACT", -1.0, byte_wise=True))
    kind = mavlink.MAV_PARAM_TYPE_INT32

    def value(number: int) -> Any:
        field = to_wire(number, kind, byte_wise=True)
        return mavlink.MAVLink_param_value_message(b"NAV_DLL_ACT", field, kind, 900, 5)

    vehicle = Sender()
    first, again = Receiver().messages(vehicle.pack(value(0)) + vehicle.pack(value(answer)))
    bench.exchange.receive(first, 0.1)
    assert bench.kinds[-1].get_type() == "PARAM_SET"
    bench.exchange.receive(again, 0.2)
    assert bench.exchange.outcome.accepted is accepted


def test_an_item_of_floating_point_has_the_frame_of_such_positions() -> None:
    item = ITEMS[1].message(TARGET, 1, as_float=True)
    assert (item.get_type(), item.frame) == ("MISSION_ITEM", mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    assert (item.x, item.y) == pytest.approx((46.0000001, 14.5))


def test_a_sender_numbers_the_frames_of_each_station() -> None:
    sender, receiver = Sender(), Receiver()
    arm = command_long(TARGET, ARM, 1)
    data = sender.pack(arm) + b"noise" + sender.pack(arm) + sender.pack(arm, (254, 191))
    frames = [f for f in receiver.frames(data, 7.0) if f.kind != NOISE]
    assert [(f.sysid, f.component, f.seq, f.at_s) for f in frames] == [
        (255, 190, 0, 7.0),
        (255, 190, 1, 7.0),
        (254, 191, 0, 7.0),
    ]
    assert {f.kind for f in frames} == {"COMMAND_LONG"}
