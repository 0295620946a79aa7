"""Messages that pass between MAVSDK and a vehicle, and the end of a transfer."""

from __future__ import annotations

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.links.mavsdk_conversations import MavsdkGate, MavsdkTransfer

ROOT = Path(__file__).parents[2]


def command(number: int, *params: float) -> mavlink.MAVLink_command_long_message:
    return mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *[0.0] * (7 - len(params)))


HOLD, LAND = command(176, 1.0, 4.0), command(176, 1.0, 9.0)
COUNT = mavlink.MAVLink_mission_count_message(1, 1, 3)
REQUEST = mavlink.MAVLink_mission_request_int_message(255, 190, 0)


def test_a_command_is_sent_once_and_only_as_requested():
    gate = MavsdkGate()
    assert not gate.lets_out(HOLD, 10.0)
    gate.permit(HOLD, 10.0)
    assert not gate.lets_out(LAND, 10.0)
    assert gate.lets_out(HOLD, 10.1)
    assert not gate.lets_out(HOLD, 10.2), "a repetition by MAVSDK was sent"


def test_a_command_that_mavsdk_delays_is_dropped():
    gate = MavsdkGate()
    gate.permit(HOLD, 10.0)
    assert not gate.lets_out(HOLD, 11.5)
    assert not gate.lets_out(HOLD, 10.5), "a permission was used twice"


def test_a_number_rounded_on_the_wire_is_the_same_command():
    gate = MavsdkGate()
    gate.permit(command(178, 1.0, 12.3), 10.0)
    sent = command(178, 1.0, 12.3)
    sent.param2 = 12.300000190734863  # the float32 next to it
    assert gate.lets_out(sent, 10.0)


@pytest.mark.parametrize("code", [21196.0, 2989.0])
@pytest.mark.parametrize("arm", [0.0, 1.0])
def test_a_forced_arming_or_disarming_is_never_sent(arm, code):
    gate = MavsdkGate()
    gate.permit(command(400, 1.0), 10.0)
    assert not gate.lets_out(command(400, arm, code), 10.0)


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        mavlink.MAVLink_param_set_message(1, 1, b"FENCE_ENABLE", 0.0, 9),
        mavlink.MAVLink_set_mode_message(1, 1, 4),
        mavlink.MAVLink_mission_clear_all_message(1, 1),
        command(512, 148.0),
    ],
    ids=lambda message: message.get_type(),
)
def test_no_unrequested_message_of_mavsdk_is_sent(message):
    gate = MavsdkGate()
    gate.is_transferring = True
    assert not gate.lets_out(message, 10.0)


def test_a_mission_passes_only_during_a_transfer():
    gate = MavsdkGate()
    assert not gate.lets_out(COUNT, 10.0)
    assert not gate.lets_in(REQUEST), "a request that the link itself answers reached MAVSDK"
    gate.is_transferring = True
    assert gate.lets_out(COUNT, 10.0)
    assert gate.lets_in(REQUEST)


class Transfers:
    """MAVSDK's transfers, which end only on request."""

    def __init__(self) -> None:
        self.is_transferring, self.calls = False, []

    def begin_download(self, on_end) -> None:
        self.is_transferring = True
        self.calls.append(on_end)

    def cancel_transfer(self) -> None:
        self.calls.append("cancel")


def download(mavsdk: Transfers) -> MavsdkTransfer:
    return MavsdkTransfer(mavsdk, mavsdk.begin_download, lambda name, items: (name, items))


def test_a_transfer_that_mavsdk_never_ends_is_cancelled_at_the_limit():
    mavsdk = Transfers()
    transfer = download(mavsdk)
    transfer.start(10.0)
    transfer.tick(10.0 + transfer.LIMIT_S - 1.0)
    assert transfer.result is None
    transfer.tick(10.0 + transfer.LIMIT_S)
    assert transfer.result == ("TIMEOUT", ())
    assert mavsdk.calls[1:] == ["cancel"]


def test_a_transfer_begins_after_the_end_of_a_cancelled_one():
    mavsdk = Transfers()
    mavsdk.is_transferring = True
    transfer = download(mavsdk)
    transfer.start(10.0)
    transfer.tick(11.0)
    assert mavsdk.calls == [], "MAVSDK would answer BUSY"
    mavsdk.is_transferring = False
    transfer.tick(12.0)
    (on_end,) = mavsdk.calls
    on_end("SUCCESS", ())
    transfer.tick(13.0)
    assert transfer.result == ("SUCCESS", ())


def test_no_module_calls_mavsdks_disarming_in_flight():
    """MAVSDK 4.1.0's Action.arm_force sends a forced disarming."""
    forbidden = "arm_" + "force"
    sources = [p for folder in ("swarmctl", "benchmarks", "configs") for p in (ROOT / folder).rglob("*.py")]
    assert len(sources) > 100
    assert [str(p) for p in sources if forbidden in p.read_text(encoding="utf-8")] == []
