"""Faults on whole vehicles, through bytes on the wire and virtual time."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, VEHICLE, Station, place_m, scenario, station_of

from sim_vehicle.faults import FAULTS
from sim_vehicle.fleet import Fleet
from sim_vehicle.station.messages import command_long

GUIDED = 4
POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


def fleet(count: int, *faults: str) -> Fleet:
    vehicles = [VEHICLE | {"sysid": sysid} for sysid in range(1, count + 1)]
    return Fleet(scenario(vehicles=vehicles, faults=list(faults)), ready_s=0.0)


def is_silent(station: Station, seconds: float) -> bool:
    return station.wait(seconds) == []


# -- the wire ---------------------------------------------------------------------------------------------


def test_commands_get_lost_on_the_way_to_the_vehicle() -> None:
    station = station_of(faults=["one_way:dead=to_vehicle,at=5,for=5"])
    assert station.set_mode("GUIDED") == 0
    station.wait(5.2)
    station.send(mavlink.MAVLink_set_mode_message(1, 1, 2))
    station.wait(1.5)
    assert station.mode == "GUIDED"
    assert station.of("HEARTBEAT")[-1].custom_mode == GUIDED  # telemetry still arrives
    station.wait(4)
    station.send(mavlink.MAVLink_set_mode_message(1, 1, 2))
    assert station.mode == "ALT_HOLD"


def test_a_delay_applies_to_request_and_answer() -> None:
    station = station_of(faults=["delay:delay_s=0.5"])
    message = mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1)
    assert station.send(message) == []
    station.wait(0.9)
    assert station.of("PARAM_VALUE") == []
    station.wait(0.2)
    assert [m.param_value for m in station.of("PARAM_VALUE")] == [255]


def test_an_outage_is_silence_in_both_directions_until_its_end() -> None:
    station = station_of(faults=["link_outage:at=3,for=4"])
    station.wait(3.0)
    assert station.received
    assert is_silent(station, 3.9)
    station.send(mavlink.MAVLink_set_mode_message(1, 1, GUIDED))
    station.wait(1.2)
    assert station.mode == "STABILIZE"
    assert station.of("HEARTBEAT")
    assert station.set_mode("GUIDED") == 0


def test_a_fault_on_one_vehicle_does_not_change_the_bytes_of_another() -> None:
    def run(*faults: str) -> dict[int, bytes]:
        out: dict[int, bytes] = {0: b"", 1: b""}
        vehicles = fleet(2, *faults)
        for step in range(200):
            for index, frame in vehicles.step(step * 0.1):
                out[index] += frame
        return out

    sound, spoilt = run(), run("packet_loss:rate=0.5,sysid=2,at=3", "clock_drift:sysid=2")
    assert sound[0] == spoilt[0]
    assert sound[1] != spoilt[1]


# -- what a vehicle answers -------------------------------------------------------------------------------


@pytest.mark.parametrize(("fault", "results"), [("slow_ack:delay_s=2", [0]), ("absent_ack", [])])
def test_a_late_or_lost_acknowledgement_leaves_no_gap_in_the_sequence(fault: str, results: list[int]) -> None:
    station = station_of(faults=[fault])
    replies = station.send(command_long((1, 1), mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED))
    assert "COMMAND_ACK" not in {m.get_type() for m in replies}
    assert station.mode == "GUIDED"
    station.wait(1.9)
    assert station.of("COMMAND_ACK") == []
    station.wait(0.3)
    assert [m.result for m in station.of("COMMAND_ACK")] == results
    sequence = [m.get_seq() for m in station.received]
    assert sequence == [(sequence[0] + i) % 256 for i in range(len(sequence))]


@pytest.mark.parametrize(("answer", "result"), [("accepted", 0), ("refused", mavlink.MAV_RESULT_FAILED)])
def test_a_stuck_mode_stays_with_every_kind_of_answer(answer: str, result: int) -> None:
    station = station_of(faults=[f"stuck_mode:answer={answer},for=10"])
    assert station.set_mode("GUIDED") == result
    assert station.mode == "STABILIZE"
    station.wait(10)
    assert station.set_mode("GUIDED") == 0
    assert station.mode == "GUIDED"


def test_an_unhealthy_sensor_shows_in_its_bit_and_keeps_the_vehicle_from_arming() -> None:
    station = station_of(faults=["sensor_unhealthy:sensor=mag,for=5"])
    station.set_mode("GUIDED")
    station.wait(0.2)
    bit = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    status = station.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    assert status.onboard_control_sensors_present & bit
    assert not status.onboard_control_sensors_health & (bit | mavlink.MAV_SYS_STATUS_PREARM_CHECK)
    assert station.arm() == mavlink.MAV_RESULT_FAILED
    assert "Arm: Compass not healthy" in station.texts()
    station.wait(5)
    status = station.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    assert status.onboard_control_sensors_health & bit
    assert station.arm() == 0


def test_a_battery_with_removed_charge_continues_to_drain() -> None:
    station = Station()
    station.fly(20)
    station.inject("battery_sag:sag_v=0,at_most=0.3")
    station.wait(1)
    station.inject("battery_sag:sag_v=0.5,at=30")
    station.wait(60)
    assert station.fleet.truth().battery_remaining[0] < 0.28


def test_a_drifting_clock_shows_in_time_since_boot_and_timesync() -> None:
    station = station_of(faults=["clock_drift:drift_ppm=10000,at=10"])
    station.wait(110)
    assert station.ask(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME).time_boot_ms == pytest.approx(111_000, abs=100)
    replies = station.send(mavlink.MAVLink_timesync_message(0, 123))
    (sync,) = [m for m in replies if m.get_type() == "TIMESYNC" and m.ts1 == 123]
    assert sync.tc1 == pytest.approx(111e9, abs=1e8)


# -- flying -----------------------------------------------------------------------------------------------


def test_a_reboot_in_flight_causes_silence_a_fall_and_boot_text() -> None:
    station = Station()
    station.fly(30)
    boots = station.fleet.boots()[0]
    station.inject("reboot:silence_s=2")
    station.wait(0.1)
    assert is_silent(station, 1.8)
    station.raw = b""
    station.wait(3)
    assert b"Init ArduCopter" in station.raw
    assert station.fleet.boots()[0] == boots + 1
    assert not station.armed
    station.until(lambda: station.height_m < 0.1, 20)
    assert station.heartbeat().custom_mode == 0


def test_a_gps_glitch_moves_the_true_position() -> None:
    station = Station()
    station.fly(20)
    station.inject("gps_glitch:east_m=0,north_m=20,ramp_s=30")
    station.wait(60)
    assert place_m(station)[0] == pytest.approx(-20.0, abs=3.0)
    assert station.ask(POSITION).lat == pytest.approx(LAT_DEG * 1e7, abs=270)


def test_a_battery_sag_is_reported_and_ends() -> None:
    def reported_v() -> float:
        return float(station.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS).voltage_battery / 1000)

    station = Station()
    before_v = reported_v()
    station.inject("battery_sag:sag_v=1.5,for=5")
    station.wait(1)
    assert reported_v() == pytest.approx(before_v - 1.5, abs=0.1)
    station.wait(5)
    assert reported_v() == pytest.approx(before_v, abs=0.1)


def test_a_fleet_with_all_faults_at_once_continues() -> None:
    impaired = fleet(4, *[f"{name}:at=2,for=20" for name in FAULTS], *[f"{name}:at=12" for name in FAULTS])
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    for step in range(400):
        impaired.step(step * 0.1)
        message = mavlink.MAVLink_command_long_message(step % 5, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        impaired.receive(message.pack(codec), step * 0.1)
    assert set(impaired.faults_on(0)) == set(FAULTS)


# -- simulation parameters and the failure command --------------------------------------------------------


def test_a_parameter_of_the_scenario_counts_from_the_start() -> None:
    station = station_of(params={"SIM_GPS_DISABLE": 1})
    assert station.fleet.faults_on(0) == ("gps_loss",)


@pytest.mark.autopilots("MAVSDK 5 failure")
def test_ardupilot_has_no_failure_command() -> None:
    assert Station().command(mavlink.MAV_CMD_INJECT_FAILURE, 4, 1, 0) == mavlink.MAV_RESULT_UNSUPPORTED


@pytest.mark.autopilots("MAVSDK 5 failure", of="px4")
def test_px4_injects_failures_only_with_sys_failure_en() -> None:
    gps_off = (mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_TYPE_OFF)
    assert station_of(personality="px4").command(*gps_off) == mavlink.MAV_RESULT_DENIED
    station = station_of(personality="px4", params={"SYS_FAILURE_EN": 1})
    assert station.command(*gps_off) == mavlink.MAV_RESULT_ACCEPTED
    assert station.fleet.faults_on(0) == ("gps_loss",)
    gps_ok = (mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_TYPE_OK)
    assert station.command(*gps_ok) == mavlink.MAV_RESULT_ACCEPTED
    assert station.fleet.faults_on(0) == ()
    servo = (mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SYSTEM_SERVO, mavlink.FAILURE_TYPE_OFF)
    assert station.command(*servo) == mavlink.MAV_RESULT_UNSUPPORTED
