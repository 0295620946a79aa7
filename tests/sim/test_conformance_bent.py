"""The conformance suite against a vehicle that is bent: it fails where it is bent, and nowhere else."""

from typing import Any

import pytest
from bent_vehicle import GROUND, bent, conform, fleet, named
from fleet_wire import FleetWire
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.registry import select
from sim_vehicle.conformance.runner import Outcome


def unchanged(message: Any) -> list[Any]:
    return [message]


def test_bending_nothing_fails_nothing() -> None:
    assert bent(unchanged, *GROUND, "fence", "mission.readback") == set()


def test_lost_acknowledgements_are_noticed() -> None:
    def bend(message: Any) -> list[Any]:
        return [] if message.get_type() == "COMMAND_ACK" else [message]

    every = {found.name for found in select(["commands.ack", "commands.unknown", "heartbeat.arrives"])}
    assert bent(bend, "commands.ack", "commands.unknown", "heartbeat.arrives") == every - {
        "heartbeat.arrives"
    }


def test_a_second_acknowledgement_is_noticed() -> None:
    def bend(message: Any) -> list[Any]:
        return [message] * (2 if message.get_type() == "COMMAND_ACK" else 1)

    assert bent(bend, "commands.ack", "commands.target") == {"commands.ack.comes_once"}


def test_a_mission_that_comes_back_otherwise_is_noticed() -> None:
    def bend(message: Any) -> list[Any]:
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == 3:
            message.x += 1
        return [message]

    assert bent(bend, "mission.download", "mission.upload") == {
        "mission.download.places_are_exact",
        "mission.download.by_second_station",
        "mission.upload.many_items",
        "mission.upload.is_announced_twice",
        "mission.upload.replaces",
    }


def test_an_answer_about_a_parameter_that_is_not_there_is_noticed() -> None:
    """The vehicle cannot be made to answer from outside, so its next heartbeat brings the answer."""

    def bend(message: Any) -> list[Any]:
        if message.get_type() != "HEARTBEAT":
            return [message]
        value = mavlink.MAVLink_param_value_message(b"NO_SUCH_PARAM", 1.0, 9, 900, 65_535)
        return [message, value]

    assert bent(
        bend, "parameters.read.unknown_name", "parameters.set.unknown_name", "parameters.read.by_name"
    ) == {
        "parameters.read.unknown_name",
        "parameters.set.unknown_name",
    }


def test_a_parameter_that_is_acknowledged_and_not_set_is_noticed() -> None:
    class Forgetful(FleetWire):
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

    report = conform(Forgetful(fleet(ready_s=0.0)), "parameters.set")
    assert named(report, Outcome.FAILED) == {
        "parameters.set.is_kept",
        "parameters.set.fraction",
        "parameters.set.unknown_name",
        "parameters.set.wrong_type",
    }


def test_a_slow_heartbeat_is_noticed() -> None:
    state = {"count": 0}

    def bend(message: Any) -> list[Any]:
        if message.get_type() == "HEARTBEAT":
            state["count"] += 1
            return [message] if state["count"] % 3 == 0 else []
        return [message]

    failed = bent(bend, "heartbeat")
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
        ("SCALED_IMU", "zacc", -1.0, {"telemetry.imu.feels_gravity"}),
        ("GPS_RAW_INT", "satellites_visible", 0.1, {"telemetry.gps.has_a_fix"}),
    ],
)
def test_a_wrong_unit_or_sign_is_noticed(kind: str, field: str, factor: float, expected: set[str]) -> None:
    def bend(message: Any) -> list[Any]:
        if message.get_type() == kind:
            value = getattr(message, field)
            setattr(message, field, type(value)(value * factor))
        return [message]

    assert bent(bend, "telemetry") == expected
