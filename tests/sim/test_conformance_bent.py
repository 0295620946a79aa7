"""The conformance suite against altered vehicles: exactly the checks of the altered behaviour fail."""

import hashlib
import itertools
from collections.abc import Callable
from typing import Any

import pytest
from bent_vehicle import (
    HOME,
    DroppingWire,
    FleetWire,
    acknowledged,
    conform,
    failures_with,
    fleet,
    named,
    selects,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.checks.signing import KEY
from sim_vehicle.conformance.outcomes import Outcome
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario

Change = Callable[[Any], list[Any]]


# -- one kind of message is altered: the failures are complete ---------------------------------------------


def shifted(item: Any) -> list[Any]:
    item.x += item.seq == 3
    return [item]


def with_unknown_parameter(beat: Any) -> list[Any]:
    """Answer about an unknown parameter with the next heartbeat, because no request can cause an answer."""
    return [beat, mavlink.MAVLink_param_value_message(b"NO_SUCH_PARAM", 1.0, 9, 900, 65_535)]


def with_early_result(ack: Any) -> list[Any]:
    return [*(acknowledged(ack) if ack.result == mavlink.MAV_RESULT_IN_PROGRESS else []), ack]


def keep(is_kept: Callable[[int], bool]) -> Change:
    """Lose the other messages; they count from 1."""
    count = itertools.count(1)
    return lambda message: [message] if is_kept(next(count)) else []


def first_of_an_eighth_lost() -> Change:
    lost: set[int] = set()

    def change(value: Any) -> list[Any]:
        is_lost = value.param_index % 8 == 0 and value.param_index not in lost
        lost.add(value.param_index)
        return [] if is_lost else [value]

    return change


def scaled(field: str, factor: float) -> Change:
    def change(message: Any) -> list[Any]:
        value = getattr(message, field)
        setattr(message, field, type(value)(value * factor))
        return [message]

    return change


@pytest.mark.parametrize(
    ("kind", "change", "patterns", "failed"),
    [
        ("COMMAND_ACK", lambda _: [], "commands.ack commands.unknown heartbeat.arrives",
         "commands.ack.names_the_command commands.ack.names_the_station commands.ack.comes_once "
         "commands.ack.is_quick commands.unknown.long commands.unknown.int"),
        ("COMMAND_ACK", lambda ack: [ack, ack], "commands.ack commands.target", "commands.ack.comes_once"),
        ("COMMAND_ACK", keep(lambda n: n % 3 != 0), "commands.ack.is_quick", "commands.ack.is_quick"),
        ("COMMAND_ACK", with_early_result, "commands.progress.ends_in_a_result",
         "commands.progress.ends_in_a_result"),
        ("MISSION_ITEM_INT", shifted, "mission.download mission.upload",
         "mission.download.places_are_exact mission.download.by_second_station mission.upload.many_items "
         "mission.upload.is_announced_twice mission.upload.replaces"),
        ("HEARTBEAT", with_unknown_parameter, "parameters.read.*name parameters.set.unknown_name",
         "parameters.read.unknown_name parameters.set.unknown_name"),
        ("HEARTBEAT", keep(lambda n: n % 3 == 0), "heartbeat",
         "heartbeat.once_a_second heartbeat.no_gaps heartbeat.goes_on_without_a_station "
         "heartbeat.sequence_numbers_count"),
        ("PARAM_VALUE", first_of_an_eighth_lost(), "parameters.list.is_complete",
         "parameters.list.is_complete"),
        ("VFR_HUD", scaled("alt", 1.1), "telemetry", "telemetry.altitude.hud_agrees"),
        ("SCALED_PRESSURE", scaled("press_abs", 100.0), "telemetry",
         "telemetry.pressure.fits_the_altitude"),
        ("BATTERY_STATUS", scaled("battery_remaining", 0.5), "telemetry",
         "telemetry.battery.messages_agree"),
        ("ATTITUDE", scaled("time_boot_ms", 1e-3), "telemetry", "telemetry.time.is_milliseconds"),
        ("SCALED_IMU", scaled("zacc", -1.0), "telemetry", "telemetry.imu.measures_gravity"),
        ("GPS_RAW_INT", scaled("satellites_visible", 0.1), "telemetry", "telemetry.gps.has_a_fix"),
    ],
)  # fmt: skip
def test_exactly_the_checks_of_an_altered_message_fail(
    kind: str, change: Change, patterns: str, failed: str
) -> None:
    def alter(message: Any) -> list[Any]:
        return change(message) if message.get_type() == kind else [message]

    assert failures_with(alter, *patterns.split()) == set(failed.split())


# -- other alterations -------------------------------------------------------------------------------------


def test_an_acknowledged_but_unset_parameter_is_noticed() -> None:
    def value(sent: Any) -> list[Any]:
        name = sent.param_id.encode()
        return [mavlink.MAVLink_param_value_message(name, sent.param_value, sent.param_type, 900, 1)]

    report = conform(DroppingWire(fleet(ready_s=0.0), selects("PARAM_SET"), value), "parameters.set")
    assert named(report, Outcome.FAILED) == {
        "parameters.set.is_kept",
        "parameters.set.fraction",
        "parameters.set.unknown_name",
        "parameters.set.wrong_type",
    }


def test_a_fence_that_an_empty_upload_leaves_is_noticed() -> None:
    def accepted(message: Any) -> list[Any]:
        return [mavlink.MAVLink_mission_ack_message(255, 190, 0, message.mission_type)]

    wire = DroppingWire(fleet(ready_s=0.0), selects("MISSION_COUNT", count=0, mission_type=1), accepted)
    assert outcomes(wire, "fence.empty_upload") == {"fence.empty_upload": Outcome.FAILED}


# -- silence is no success -------------------------------------------------------------------------------


def outcomes(wire: FleetWire, *patterns: str) -> dict[str, Outcome]:
    return {result.check.name: result.outcome for result in conform(wire, *patterns).results}


def test_silence_passes_no_check() -> None:
    def alter(message: Any) -> list[Any]:
        sent = {"HEARTBEAT", "COMMAND_ACK", "AUTOPILOT_VERSION"}
        return [message] if message.get_type() in sent else []

    seen = {
        "heartbeat.sequence_numbers_count", "heartbeat.payloads_are_trimmed", "telemetry.time.goes_forward",
        "messages.interval.default", "parameters.read.unknown_name", "parameters.set.unknown_name",
        "parameters.read.another_vehicles", "parameters.list.another_vehicles", "logs.unknown_id",
        "time.timesync.answer_is_not_answered", "mission.download.another_vehicles",
    }  # fmt: skip
    assert failures_with(alter, *seen) == seen


def test_missing_frames_fail_the_framing_check() -> None:
    class PausingWire(FleetWire):
        """A wire that loses all messages for 3.5 s after the start."""

        def receive(self, timeout_s: float) -> bytes | None:
            data = super().receive(timeout_s)
            return None if 5.0 < self.now_s() < 8.5 else data

    wire = PausingWire(fleet(ready_s=0.0))
    assert outcomes(wire, "heartbeat.frames_are_mavlink2") == {
        "heartbeat.frames_are_mavlink2": Outcome.FAILED
    }


@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_an_unrestored_default_rate_is_noticed(personality: str) -> None:
    """The outcome does not depend on a rate that was set before."""
    to_default = selects("COMMAND_LONG", command=mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, param2=0)
    for before in ((), ("messages.interval.10_hz",), ("messages.interval.4_hz",)):
        wire = DroppingWire(fleet(personality, ready_s=0.0), to_default, acknowledged)
        assert outcomes(wire, *before, "messages.interval.default")["messages.interval.default"] is (
            Outcome.FAILED
        )


ENDED = "logs.download_can_be_ended"


class LateWire(DroppingWire):
    """A wire that connects to a PX4 fleet 200 s after its start; PX4 logs from its boot."""

    def __init__(self, ignored: str = "") -> None:
        inner = fleet("px4", ready_s=0.0)
        inner.step(200.0)
        super().__init__(inner, selects(ignored))
        self._now = 200.0


@pytest.mark.full
@pytest.mark.parametrize(
    ("ignored", "outcome"),
    [("", Outcome.PASSED), ("LOG_REQUEST_END", Outcome.FAILED), ("LOG_REQUEST_DATA", Outcome.FAILED)],
)
def test_a_download_without_a_start_or_an_end_is_noticed(ignored: str, outcome: Outcome) -> None:
    assert outcomes(LateWire(ignored), ENDED) == {ENDED: outcome}


def test_the_check_of_download_ends_is_skipped_without_a_log() -> None:
    assert outcomes(FleetWire(fleet(ready_s=0.0)), ENDED) == {ENDED: Outcome.SKIPPED}


class UncheckedSignatureWire(FleetWire):
    """A wire that signs frames again, as if the vehicle accepted wrong or replayed signatures."""

    stamp = 0

    def __init__(self, inner: Any, *, wrong_keys: bool = False, replays: bool = False) -> None:
        super().__init__(inner)
        self._wrong_keys, self._replays = wrong_keys, replays
        self._seen: set[bytes] = set()

    def send(self, data: bytes) -> None:
        if len(data) > 25 and data[0] == 0xFD and data[2] & 1:
            right = hashlib.sha256(KEY + data[:-6]).digest()[:6] == data[-6:]
            replayed = data in self._seen
            self._seen.add(data)
            stamp = int.from_bytes(data[-12:-6], "little")
            self.stamp = max(self.stamp + 100, stamp)
            if (self._wrong_keys and not right) or (self._replays and replayed):
                head = data[:-12] + self.stamp.to_bytes(6, "little")
                data = head + hashlib.sha256(KEY + head).digest()[:6]
        super().send(data)


@pytest.mark.parametrize(
    ("wire", "failed"),
    [
        ({"wrong_keys": True}, {"signing.refuses_the_wrong_key"}),
        ({"replays": True}, {"signing.refuses_a_replay"}),
    ],
)
def test_an_unchecked_signature_is_noticed(wire: dict[str, bool], failed: set[str]) -> None:
    report = conform(UncheckedSignatureWire(fleet(ready_s=0.0), **wire), "signing.refuses*")
    assert named(report, Outcome.FAILED) == failed
    assert named(report, Outcome.SKIPPED) == set()


def test_signature_checks_are_skipped_on_a_trusted_link() -> None:
    inner = Fleet(default_scenario(1, home=HOME, seed=1), ready_s=0.0, trusted_links=(0,))
    assert set(outcomes(FleetWire(inner), "signing.refuses*").values()) == {Outcome.SKIPPED}
