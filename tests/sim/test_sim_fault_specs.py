"""Faults: their text, their schedule and their descriptions."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults import FAULTS
from sim_vehicle.faults.base import VehicleAccess
from sim_vehicle.faults.failure_command import inject_failure
from sim_vehicle.faults.schedule import Schedule
from sim_vehicle.faults.sim_parameters import faults_of
from sim_vehicle.faults.spec import FaultError, FaultSpec, help_text, parameter_help, parse_fault
from sim_vehicle.vehicle.injected_faults import InjectedFaults
from sim_vehicle.wire.channel import Channel


class FaultyVehicles:
    """The vehicles of a schedule: injected faults, channels and reboots."""

    def __init__(self, *texts: str, sysids: tuple[int, ...] = (1, 2, 3)) -> None:
        self.injected_faults = [InjectedFaults(np.random.default_rng(i)) for i in range(len(sysids))]
        self.channels = [Channel() for _ in sysids]
        specs = [parse_fault(text) for text in texts]
        self.schedule = Schedule(specs, sysids, self._access, seed=3)

    def _access(self, index: int) -> VehicleAccess:
        return VehicleAccess(
            lambda: self.channels[index], self.injected_faults[index], lambda _now, _silence_s: None
        )

    def replace(self, key: Any, specs: Any, now: float) -> None:
        self.schedule.replace(0, key, specs, now)


def test_a_fault_is_parsed_from_the_command_line() -> None:
    spec = parse_fault("packet_loss:rate=0.2,at=30,for=10,sysid=2")
    assert spec == FaultSpec(fault="packet_loss", params={"rate": "0.2"}, vehicles=[2], at_s=30, for_s=10)
    assert spec.parameters().model_dump() == {"rate": 0.2, "direction": "both"}
    assert parse_fault("gps_loss") == FaultSpec(fault="gps_loss")
    assert parse_fault("gps_loss:sysid=1+4-6").vehicles == [1, 4, 5, 6]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("pakcet_loss", ["fault pakcet_loss: ", "packet_loss?", "link_outage", "[fault-name]"]),
        (
            "packet_loss:rat=1",
            ["fault packet_loss: ", "'rat'", "rate?", "rate (0 to 1, default 0.1)", "[fault-key]"],
        ),
        ("packet_loss:rate=2", ["fault packet_loss: rate=2: ", "0 to 1;", "[fault-value]"]),
        ("packet_loss:rate", ["'rate'", "key=value", "[fault-syntax]"]),
        ("packet_loss:rate=1,rate=1", ["fault packet_loss: rate ", "[fault-syntax]"]),
        ("packet_loss:rate=nan", ["rate=nan: ", "0 to 1", "[fault-value]"]),
        ("packet_loss:direction=up", ["direction=up", "both|to_vehicle|from_vehicle"]),
        ("delay:jitter_s=2", ["jitter_s 2 ", "delay_s 0.5", "[fault-value]"]),
        ("burst_loss:rate=0.9,burst_frames=2", ["rate 0.9 ", "burst_frames", "[fault-value]"]),
        ("burst_loss:rate=0.9,bad_loss=0.5", ["rate 0.9 ", "good_loss 0 ", "bad_loss 0.5", "[fault-value]"]),
        ("gps_loss:at=x", ["at=x: ", "[fault-value]"]),
        ("gps_loss:at=-1", ["at=-1: ", "seconds >= 0", "[fault-value]"]),
        ("gps_loss:for=0", ["for=0: ", "seconds > 0", "[fault-value]"]),
        ("gps_loss:sysid=a", ["sysid=a: ", "1+4", "[fault-value]"]),
        ("gps_loss:sysid=300", ["sysid=300: ", "1 to 255", "[fault-value]"]),
    ],
)
def test_an_invalid_fault_is_reported_with_the_allowed_values(text: str, parts: list[str]) -> None:
    with pytest.raises(FaultError) as caught:
        parse_fault(text)
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize("text", ["gps_loss:rate=1", "gps_loss:foo=1", "quake", ""])
def test_an_unknown_word_without_a_similar_one_gets_no_suggestion(text: str) -> None:
    with pytest.raises(FaultError, match=r"^fault ") as caught:
        parse_fault(text)
    assert "?" not in str(caught.value)


def test_every_invalid_value_is_reported_with_its_code() -> None:
    for fault in FAULTS.values():
        for parameter in parameter_help(fault):
            with pytest.raises(FaultError) as caught:
                parse_fault(f"{fault.name}:{parameter.name}=x")
            text = str(caught.value)
            assert f"{parameter.name}=x: " in text
            assert f"{parameter.allowed};" in text
            assert "[fault-value]" in text


def test_the_fields_of_a_scenario_fault_are_checked_like_the_text() -> None:
    good = {"fault": "delay", "params": {"delay_s": 1}, "vehicles": [1], "at_s": 5, "for_s": 2}
    assert str(FaultSpec.model_validate(good)) == "delay:delay_s=1,at=5,for=2,sysid=1"
    with pytest.raises(ValidationError, match=r"delay_s\?.*\[fault-key\]"):
        FaultSpec.model_validate({"fault": "delay", "params": {"delay": 1}})
    with pytest.raises(ValidationError, match=r"fault dealy: .* delay\?.*\[fault-name\]"):
        FaultSpec.model_validate({"fault": "dealy"})


@settings(max_examples=examples(200))
@given(
    st.text(max_size=40)
    | st.from_regex(r"[a-z_]{1,12}:([a-z_]{1,8}=[-0-9a-z.+]{0,6},?){0,4}", fullmatch=True)
)
def test_any_text_is_a_fault_or_a_fault_error(text: str) -> None:
    try:
        spec = parse_fault(text)
    except FaultError:
        return
    assert spec.fault in FAULTS


@settings(max_examples=examples(50))
@given(
    name=st.sampled_from(sorted(FAULTS)),
    at_s=st.integers(0, 1000),
    for_s=st.none() | st.integers(1, 1000),
    vehicles=st.none() | st.lists(st.integers(1, 255), min_size=1, max_size=5),
)
def test_a_fault_reads_back_from_its_own_text(
    name: str, at_s: int, for_s: int | None, vehicles: list[int] | None
) -> None:
    spec = FaultSpec(fault=name, at_s=at_s, for_s=for_s, vehicles=vehicles)
    assert parse_fault(str(spec)) == spec


def test_every_fault_is_described_with_its_parameters() -> None:
    described = [p for fault in FAULTS.values() for p in parameter_help(fault)]
    assert all(p.description and p.default and p.allowed for p in described)
    for name, fault in FAULTS.items():
        assert f"{name}: {fault.summary}\n" in help_text()
        assert all(f"    {p.name} " in help_text() for p in parameter_help(fault))
    units = {p.name: p.unit for p in described}
    assert units["rate_bytes_s"] == "B/s"
    assert units["air_rate_bit_s"] == "bit/s"
    assert units["sag_v"] == "V"
    assert units["rate"] == ""


# -- the schedule -----------------------------------------------------------------------------------------


def test_faults_begin_and_end_at_their_times_on_their_vehicles() -> None:
    vehicles = FaultyVehicles("gps_loss:at=10,for=5,sysid=2", "battery_sag:sag_v=2,at=12")
    seen = {}
    for now in (0.0, 9.95, 10.0, 12.0, 15.0):
        vehicles.schedule.tick(now)
        seen[now] = [(a.effect.gps_lost, a.effect.battery_sag_v) for a in vehicles.injected_faults]
    assert seen[9.95] == [(False, 0.0)] * 3
    assert seen[10.0] == [(False, 0.0), (True, 0.0), (False, 0.0)]
    assert seen[12.0] == [(False, 2.0), (True, 2.0), (False, 2.0)]
    assert seen[15.0] == [(False, 2.0)] * 3


def test_a_fault_ends_with_the_last_of_its_kind() -> None:
    vehicles = FaultyVehicles(
        "gps_loss:at=0,for=10", "gps_loss:at=5,for=10", "battery_sag:sag_v=0.1", "battery_sag:sag_v=0.2,for=9"
    )
    vehicles.schedule.tick(6.0)
    assert vehicles.injected_faults[0].effect.battery_sag_v == pytest.approx(0.3)
    vehicles.schedule.tick(12.0)
    assert vehicles.injected_faults[0].effect.gps_lost
    assert vehicles.injected_faults[0].effect.battery_sag_v == 0.1
    vehicles.schedule.tick(15.0)
    assert not vehicles.injected_faults[0].effect.gps_lost


def test_a_fault_of_an_unknown_vehicle_is_refused() -> None:
    with pytest.raises(FaultError, match=r" 9; .* 1-3, 7 \[fault-vehicle\]"):
        FaultyVehicles("gps_loss:sysid=2+9", sysids=(1, 2, 3, 7))


def test_a_system_id_on_two_links_selects_both_vehicles() -> None:
    vehicles = FaultyVehicles("gps_loss:sysid=2", sysids=(1, 2, 1, 2))
    vehicles.schedule.tick(0.0)
    assert [a.effect.gps_lost for a in vehicles.injected_faults] == [False, True, False, True]


def test_a_ramp_grows_to_its_offset_and_leaves_nothing_behind() -> None:
    vehicles = FaultyVehicles("gps_glitch:east_m=0,north_m=50,ramp_s=10,for=20")
    offsets = []
    for tick in range(400):
        vehicles.schedule.tick(tick * 0.05)
        offsets.append(vehicles.injected_faults[1].effect.gps_offset_m[1])
    assert offsets[100] == pytest.approx(25.0)
    assert offsets[200:] == [50.0] * 200
    assert np.all(np.diff(offsets) >= 0)
    vehicles.schedule.tick(20.0)
    assert vehicles.injected_faults[1].effect.gps_offset_m == (0.0, 0.0, 0.0)


def test_a_clock_keeps_its_accumulated_drift() -> None:
    vehicles = FaultyVehicles("clock_drift:drift_ppm=2000,at=100,for=50")
    for now in (0.0, 100.0):
        vehicles.schedule.tick(now)
        assert vehicles.injected_faults[0].clock_offset_s(now) == 0.0
    assert vehicles.injected_faults[0].clock_offset_s(125.0) == pytest.approx(0.05)
    vehicles.schedule.tick(150.0)
    assert vehicles.injected_faults[0].clock_offset_s(1000.0) == pytest.approx(0.1)


def test_acknowledgements_are_lost_at_their_rate() -> None:
    vehicles = FaultyVehicles("absent_ack:rate=0.5,sysid=1", "absent_ack:sysid=2")
    vehicles.schedule.tick(0.0)
    lost = [sum(a.loses_ack() for _ in range(1000)) for a in vehicles.injected_faults]
    assert 400 < lost[0] < 600
    assert lost[1:] == [1000, 0]


# -- MAV_CMD_INJECT_FAILURE -------------------------------------------------------------------------------


ACCEPTED, UNSUPPORTED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_UNSUPPORTED
OK, OFF, STUCK, WRONG = (
    mavlink.FAILURE_TYPE_OK, mavlink.FAILURE_TYPE_OFF, mavlink.FAILURE_TYPE_STUCK, mavlink.FAILURE_TYPE_WRONG,
)  # fmt: skip


def inject(vehicles: FaultyVehicles, unit: int, kind: int, instance: int = 0, now: float = 1.0) -> int:
    return inject_failure(unit, kind, instance, vehicles.replace, now)


def test_a_failure_begins_changes_and_ends() -> None:
    vehicles = FaultyVehicles()
    gps = mavlink.FAILURE_UNIT_SENSOR_GPS
    assert inject(vehicles, gps, OFF) == ACCEPTED
    assert vehicles.injected_faults[0].effect.gps_lost
    assert not vehicles.injected_faults[1].effect.gps_lost
    assert inject(vehicles, gps, WRONG) == ACCEPTED
    assert not vehicles.injected_faults[0].effect.gps_lost
    assert vehicles.injected_faults[0].effect.gps_offset_m == (100.0, 0.0, 0.0)
    assert inject(vehicles, gps, OK) == ACCEPTED
    assert vehicles.schedule.names(0) == ()
    assert vehicles.injected_faults[0].effect.gps_offset_m == (0.0, 0.0, 0.0)


def test_motors_fail_one_by_one_or_all() -> None:
    vehicles = FaultyVehicles()
    motor = mavlink.FAILURE_UNIT_SYSTEM_MOTOR
    lost = []
    for kind, instance in ((OFF, 2), (OFF, 2), (OFF, 3), (OK, 2), (OFF, 0), (OK, 0)):
        assert inject(vehicles, motor, kind, instance) == ACCEPTED
        lost.append(vehicles.injected_faults[0].effect.motors_lost)
    assert lost == [1, 1, 2, 1, 4, 0]
    assert inject(vehicles, motor, OFF, 9) == UNSUPPORTED


@pytest.mark.parametrize(
    ("unit", "kind", "bit"),
    [
        (mavlink.FAILURE_UNIT_SENSOR_GYRO, OFF, mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO),
        (mavlink.FAILURE_UNIT_SENSOR_ACCEL, STUCK, mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL),
        (mavlink.FAILURE_UNIT_SENSOR_MAG, OFF, mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG),
        (mavlink.FAILURE_UNIT_SENSOR_BARO, STUCK, mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE),
    ],
)
def test_a_failed_sensor_is_unhealthy(unit: int, kind: int, bit: int) -> None:
    vehicles = FaultyVehicles()
    assert inject(vehicles, unit, kind) == ACCEPTED
    assert vehicles.injected_faults[0].effect.unhealthy_sensors == bit


def test_a_link_switched_off_by_command_returns_after_30_seconds() -> None:
    vehicles = FaultyVehicles()
    assert inject(vehicles, mavlink.FAILURE_UNIT_SYSTEM_MAVLINK_SIGNAL, OFF) == ACCEPTED
    vehicles.schedule.tick(1.2)
    assert vehicles.schedule.names(0) == ()  # the acknowledgement is still sent
    vehicles.schedule.tick(1.4)
    assert vehicles.schedule.names(0) == ("link_outage",)
    vehicles.schedule.tick(31.4)
    assert vehicles.schedule.names(0) == ()


def test_a_failure_ended_before_its_start_never_begins() -> None:
    vehicles = FaultyVehicles()
    inject(vehicles, mavlink.FAILURE_UNIT_SYSTEM_MAVLINK_SIGNAL, OFF)
    inject(vehicles, mavlink.FAILURE_UNIT_SYSTEM_MAVLINK_SIGNAL, OK, now=1.1)
    vehicles.schedule.tick(5.0)
    assert vehicles.schedule.names(0) == ()


@settings(max_examples=examples(200))
@given(*[st.floats(width=32) | st.integers(-1, 110).map(float)] * 3)
def test_a_failure_command_with_any_parameters_is_answered(unit: float, kind: float, instance: float) -> None:
    vehicles = FaultyVehicles()
    assert inject_failure(unit, kind, instance, vehicles.replace, 1.0) in (ACCEPTED, UNSUPPORTED)


# -- SIM_ parameters --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("SIM_GPS_DISABLE", {"SIM_GPS_DISABLE": 1}, ["gps_loss"]),
        ("SIM_GPS_DISABLE", {"SIM_GPS_DISABLE": 0}, []),
        ("SIM_ENGINE_FAIL", {"SIM_ENGINE_FAIL": 5, "SIM_ENGINE_MUL": 0}, ["motor_loss:motors=2"]),
        ("SIM_ENGINE_MUL", {"SIM_ENGINE_FAIL": 5, "SIM_ENGINE_MUL": 1}, []),
        ("SIM_ENGINE_MUL", {"SIM_ENGINE_FAIL": 0, "SIM_ENGINE_MUL": 0}, []),
        (
            "SIM_GPS_GLITCH_Z",
            {"SIM_GPS_GLITCH_X": 0, "SIM_GPS_GLITCH_Y": 0, "SIM_GPS_GLITCH_Z": 12},
            ["gps_glitch:north_m=0,east_m=0,up_m=12"],
        ),
    ],
)
def test_a_simulation_parameter_is_a_fault(name: str, values: dict[str, float], expected: list[str]) -> None:
    found = faults_of(name, values.__getitem__, 60.0)
    assert [str(spec) for spec in found[1]] == expected


def test_another_parameter_is_no_fault() -> None:
    assert faults_of("WPNAV_SPEED", lambda _: 1.0, 0.0) is None


def test_a_glitch_in_longitude_shrinks_towards_the_poles() -> None:
    """ArduPilot adds SIM_GPS_GLITCH_Y to the longitude (SIM_GPS.cpp)."""
    values = {"SIM_GPS_GLITCH_X": 0.0, "SIM_GPS_GLITCH_Y": 0.001, "SIM_GPS_GLITCH_Z": 0.0}
    found = faults_of("SIM_GPS_GLITCH_Y", values.__getitem__, 60.0)
    (glitch,) = found[1]
    assert glitch.params["east_m"] == pytest.approx(0.001 * 111_319.5 / 2.0)
