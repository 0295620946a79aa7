"""The conformance suite against altered vehicles: exactly the checks of the altered behaviour fail."""

import hashlib
from typing import Any

import pytest
from bent_vehicle import (
    GROUND,
    HOME,
    DroppingWire,
    FleetWire,
    acknowledged,
    conform,
    failures_with,
    fleet,
    named,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.checks.signing import KEY
from sim_vehicle.conformance.registry import select
from sim_vehicle.conformance.runner import Outcome
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario


def unchanged(message: Any) -> list[Any]:
    return [message]


def test_an_unaltered_vehicle_fails_no_check() -> None:
    assert failures_with(unchanged, *GROUND, "fence", "mission.readback") == set()


def test_lost_acknowledgements_are_noticed() -> None:
    def alter(message: Any) -> list[Any]:
        return [] if message.get_type() == "COMMAND_ACK" else [message]

    every = {found.name for found in select(["commands.ack", "commands.unknown", "heartbeat.arrives"])}
    assert failures_with(alter, "commands.ack", "commands.unknown", "heartbeat.arrives") == every - {
        "heartbeat.arrives"
    }


def test_a_second_acknowledgement_is_noticed() -> None:
    def alter(message: Any) -> list[Any]:
        return [message] * (2 if message.get_type() == "COMMAND_ACK" else 1)

    assert failures_with(alter, "commands.ack", "commands.target") == {"commands.ack.comes_once"}


def test_an_altered_mission_read_back_is_noticed() -> None:
    def alter(message: Any) -> list[Any]:
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == 3:
            message.x += 1
        return [message]

    assert failures_with(alter, "mission.download", "mission.upload") == {
        "mission.download.places_are_exact",
        "mission.download.by_second_station",
        "mission.upload.many_items",
        "mission.upload.is_announced_twice",
        "mission.upload.replaces",
    }


def test_an_answer_about_an_unknown_parameter_is_noticed() -> None:
    """The next heartbeat brings the answer, because no request can cause one."""

    def alter(message: Any) -> list[Any]:
        if message.get_type() != "HEARTBEAT":
            return [message]
        value = mavlink.MAVLink_param_value_message(b"NO_SUCH_PARAM", 1.0, 9, 900, 65_535)
        return [message, value]

    assert failures_with(
        alter, "parameters.read.unknown_name", "parameters.set.unknown_name", "parameters.read.by_name"
    ) == {
        "parameters.read.unknown_name",
        "parameters.set.unknown_name",
    }


def test_an_acknowledged_but_unset_parameter_is_noticed() -> None:
    class ForgetfulWire(FleetWire):
        def send(self, data: bytes) -> None:
            parser = mavlink.MAVLink(None)
            for message in parser.parse_buffer(data) or ():
                if message.get_type() == "PARAM_SET":
                    value = mavlink.MAVLink_param_value_message(
                        message.param_id.encode(), message.param_value, message.param_type, 900, 1
                    )
                    self._queue.append(bytes(value.pack(mavlink.MAVLink(None, 1, 1))))
                    return
            super().send(data)

    report = conform(ForgetfulWire(fleet(ready_s=0.0)), "parameters.set")
    assert named(report, Outcome.FAILED) == {
        "parameters.set.is_kept",
        "parameters.set.fraction",
        "parameters.set.unknown_name",
        "parameters.set.wrong_type",
    }


def test_a_list_with_gaps_is_noticed() -> None:
    lost: set[int] = set()

    def alter(message: Any) -> list[Any]:
        if message.get_type() != "PARAM_VALUE" or message.param_index % 8 or message.param_index in lost:
            return [message]
        lost.add(message.param_index)
        return []

    assert failures_with(alter, "parameters.list.is_complete") == {"parameters.list.is_complete"}


def test_every_third_acknowledgement_lost_is_not_quick() -> None:
    state = {"count": 0}

    def alter(message: Any) -> list[Any]:
        state["count"] += message.get_type() == "COMMAND_ACK"
        return [] if message.get_type() == "COMMAND_ACK" and state["count"] % 3 == 0 else [message]

    assert failures_with(alter, "commands.ack.is_quick") == {"commands.ack.is_quick"}


def test_a_result_before_the_end_of_a_calibration_is_noticed() -> None:
    def alter(message: Any) -> list[Any]:
        if message.get_type() == "COMMAND_ACK" and message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            early = mavlink.MAVLink_command_ack_message(message.command, 0, 0, 0, 255, 190)
            return [early, message]
        return [message]

    name = "commands.progress.ends_in_a_result"
    assert failures_with(alter, name) == {name}


def test_a_fence_that_an_empty_upload_leaves_is_noticed() -> None:
    def is_empty(message: Any) -> bool:
        return bool(message.get_type() == "MISSION_COUNT" and message.count == 0 and message.mission_type)

    def accepted(message: Any) -> list[Any]:
        return [mavlink.MAVLink_mission_ack_message(255, 190, 0, message.mission_type)]

    wire = DroppingWire(fleet(ready_s=0.0), is_empty, accepted)
    assert outcomes(wire, "fence.empty_upload") == {"fence.empty_upload": Outcome.FAILED}


def test_a_slow_heartbeat_is_noticed() -> None:
    state = {"count": 0}

    def alter(message: Any) -> list[Any]:
        if message.get_type() == "HEARTBEAT":
            state["count"] += 1
            return [message] if state["count"] % 3 == 0 else []
        return [message]

    failed = failures_with(alter, "heartbeat")
    assert {"heartbeat.once_a_second", "heartbeat.no_gaps", "heartbeat.goes_on_without_a_station"} <= failed
    assert failed <= {
        "heartbeat.once_a_second",
        "heartbeat.no_gaps",
        "heartbeat.goes_on_without_a_station",
        "heartbeat.sequence_numbers_count",
    }


@pytest.mark.parametrize(
    ("kind", "field", "factor", "expected"),
    [
        ("VFR_HUD", "alt", 1.1, {"telemetry.altitude.hud_agrees"}),
        ("SCALED_PRESSURE", "press_abs", 100.0, {"telemetry.pressure.fits_the_altitude"}),
        ("BATTERY_STATUS", "battery_remaining", 0.5, {"telemetry.battery.messages_agree"}),
        ("ATTITUDE", "time_boot_ms", 1e-3, {"telemetry.time.is_milliseconds"}),
        ("SCALED_IMU", "zacc", -1.0, {"telemetry.imu.measures_gravity"}),
        ("GPS_RAW_INT", "satellites_visible", 0.1, {"telemetry.gps.has_a_fix"}),
    ],
)
def test_a_wrong_unit_or_sign_is_noticed(kind: str, field: str, factor: float, expected: set[str]) -> None:
    def alter(message: Any) -> list[Any]:
        if message.get_type() == kind:
            value = getattr(message, field)
            setattr(message, field, type(value)(value * factor))
        return [message]

    assert failures_with(alter, "telemetry") == expected


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

    def to_default(message: Any) -> bool:
        kind = message.get_type()
        return bool(kind == "COMMAND_LONG" and message.command == 511 and message.param2 == 0)

    for before in ((), ("messages.interval.10_hz",), ("messages.interval.4_hz",)):
        wire = DroppingWire(fleet(personality, ready_s=0.0), to_default, acknowledged)
        assert outcomes(wire, *before, "messages.interval.default")["messages.interval.default"] is (
            Outcome.FAILED
        )


ENDED = "logs.download_can_be_ended"


def with_a_log() -> Fleet:
    """Return a PX4 fleet with a log; PX4 logs from its boot."""
    inner = fleet("px4", ready_s=0.0)
    inner.step(200.0)
    return inner


class LateWire(DroppingWire):
    """A wire that connects to a fleet 200 s after its start."""

    def __init__(self, ignored: str = "") -> None:
        super().__init__(with_a_log(), lambda message: message.get_type() == ignored)
        self._now = 200.0


@pytest.mark.full
def test_a_download_without_an_end_is_noticed() -> None:
    assert outcomes(LateWire(), ENDED) == {ENDED: Outcome.PASSED}
    assert outcomes(LateWire("LOG_REQUEST_END"), ENDED) == {ENDED: Outcome.FAILED}


@pytest.mark.full
def test_a_download_without_a_start_is_noticed() -> None:
    assert outcomes(LateWire("LOG_REQUEST_DATA"), ENDED) == {ENDED: Outcome.FAILED}


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
        ({}, set()),
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
