"""Faults on whole vehicles, through bytes on the wire and virtual time."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import (
    ALT_M,
    LAT_DEG,
    LON_DEG,
    Station,
    acks,
    home_item,
    scenario,
    takeoff,
    waypoint,
)

from sim_vehicle.faults import FAULTS
from sim_vehicle.faults.spec import FaultError, parse_fault
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import default_scenario

GUIDED = 4
POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
MISSION = [home_item(), takeoff(20), waypoint(100, 0), waypoint(100, 100), waypoint(0, 100)]


def station(*faults: str, **fields: Any) -> Station:
    return Station(Fleet(scenario(faults=list(faults), **fields), ready_s=0.0))


def fleet(count: int, *faults: str, **fields: Any) -> Fleet:
    made = default_scenario(count, home=(LAT_DEG, LON_DEG, ALT_M), **fields)
    return Fleet(made.model_copy(update={"faults": tuple(parse_fault(text) for text in faults)}), ready_s=0.0)


def inject(there: Station, text: str) -> None:
    there.fleet.inject(parse_fault(text), there.now)


def set_parameter(there: Station, name: str, value: float) -> None:
    kind = mavlink.MAV_PARAM_TYPE_REAL32
    replies = there.send(mavlink.MAVLink_param_set_message(there.target, 1, name.encode(), value, kind))
    assert [m.param_value for m in replies if m.get_type() == "PARAM_VALUE"] == [pytest.approx(value)]


def said_nothing(there: Station, seconds: float) -> bool:
    return there.wait(seconds) == []


# -- the wire ---------------------------------------------------------------------------------------------


def test_loss_from_the_start_shows_as_gaps_in_the_sequence() -> None:
    there = station("packet_loss:rate=0.3,direction=from_vehicle,at=1")
    there.stream(POSITION, hz=10)
    there.wait(1.0)
    there.received.clear()
    there.wait(60)
    positions = len(there.of("GLOBAL_POSITION_INT"))
    assert 360 < positions < 480  # 600 less 30 %, within five standard deviations
    gaps = [
        (b.get_seq() - a.get_seq()) % 256 - 1
        for a, b in zip(there.received, there.received[1:], strict=False)
    ]
    assert 0.2 < sum(gaps) / (sum(gaps) + len(there.received)) < 0.4


def test_commands_get_lost_on_the_way_to_the_vehicle() -> None:
    there = station("one_way:dead=to_vehicle,at=5,for=5")
    assert there.set_mode(GUIDED) == 0
    there.wait(5.2)
    there.send(mavlink.MAVLink_set_mode_message(1, 1, 2))
    there.wait(1.5)
    assert there.mode == "GUIDED"
    assert there.of("HEARTBEAT")[-1].custom_mode == GUIDED  # still heard
    there.wait(4)
    there.send(mavlink.MAVLink_set_mode_message(1, 1, 2))
    assert there.mode == "ALT_HOLD"


def test_a_delay_applies_to_request_and_answer() -> None:
    there = station("delay:delay_s=0.5")
    message = mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1)
    assert there.send(message) == []
    there.wait(0.9)
    assert there.of("PARAM_VALUE") == []
    there.wait(0.2)
    assert [m.param_value for m in there.of("PARAM_VALUE")] == [255]


def test_an_outage_is_silence_in_both_directions_until_its_end() -> None:
    there = station("link_outage:at=3,for=4")
    there.wait(3.0)
    assert there.received
    assert said_nothing(there, 3.9)
    there.send(mavlink.MAVLink_set_mode_message(1, 1, GUIDED))
    there.wait(1.2)
    assert there.mode == "STABILIZE"
    assert there.of("HEARTBEAT")
    assert there.set_mode(GUIDED) == 0


def test_corrupted_commands_and_corrupted_telemetry_are_ignored() -> None:
    there = station("corruption:rate=1")
    there.send(mavlink.MAVLink_set_mode_message(1, 1, GUIDED))
    there.wait(10)
    assert there.mode == "STABILIZE"
    assert there.of("HEARTBEAT") == []
    assert len(there.raw) > 100


def test_a_bad_radio_sends_its_status_and_a_mission_upload_succeeds() -> None:
    there = station("sik_radio:rate=0.1")
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    for _ in range(10):
        there.send(beat)
        there.wait(1.0)
    radios = [m for m in there.received if m.get_type() == "RADIO_STATUS"]
    assert len(radios) == 10
    assert {m.get_srcSystem() for m in radios} == {51}
    done = len(acks(there.received))
    there.send(mavlink.MAVLink_mission_count_message(1, 1, len(MISSION), 0))
    answered: set[int] = set()
    for _ in range(600):
        if len(acks(there.received)) > done:
            break
        for request in [m for m in there.wait(0.1) if m.get_type() == "MISSION_REQUEST"]:
            answered.add(request.seq)
            there.send(there.item_message(request.seq, MISSION[request.seq]))
    assert acks(there.received)[-1] == mavlink.MAV_MISSION_ACCEPTED
    assert answered == set(range(len(MISSION)))


def heard_in(steps_s: float, *, seed: int = 3) -> dict[int, bytes]:
    """Return each vehicle's bytes over 12 s, of a fleet with many impairments."""
    troubled = fleet(
        3, "burst_loss:rate=0.2", "delay:delay_s=0.3,jitter_s=0.3", "duplication", "reordering:at=4,for=3",
        "corruption:rate=0.05,at=2", "sik_radio:sysid=2,at=6,for=3", "absent_ack:rate=0.5", seed=seed,
    )  # fmt: skip
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    out = {0: b"", 1: b"", 2: b""}
    asked = 0
    step = 0
    while step * steps_s <= 12.0:
        now = step * steps_s
        frames = troubled.step(now)
        if now >= asked:
            asked += 1
            request = mavlink.MAVLink_param_request_list_message(asked % 3 + 1, 1)
            frames += troubled.receive(request.pack(codec), now)
        for index, frame in frames:
            out[index] += frame
        step += 1
    return out


def test_equal_seeds_give_equal_bytes_and_another_seed_does_not() -> None:
    first = heard_in(0.1)
    assert first == heard_in(0.1)
    assert first != heard_in(0.1, seed=4)


def test_the_bytes_do_not_depend_on_the_size_of_a_step() -> None:
    assert heard_in(0.5) == heard_in(0.1) == heard_in(0.025)


def test_a_fault_on_one_vehicle_does_not_change_the_bytes_of_another() -> None:
    def run(*faults: str) -> dict[int, bytes]:
        out: dict[int, bytes] = {0: b"", 1: b""}
        there = fleet(2, *faults)
        for step in range(200):
            for index, frame in there.step(step * 0.1):
                out[index] += frame
        return out

    sound, spoilt = run(), run("packet_loss:rate=0.5,sysid=2,at=3", "clock_drift:sysid=2")
    assert sound[0] == spoilt[0]
    assert sound[1] != spoilt[1]


# -- what a vehicle answers -------------------------------------------------------------------------------


def test_a_refused_mission_is_not_kept() -> None:
    there = station("mission_refused:result=no_space,for=10")
    assert acks(there.count(3)) == [mavlink.MAV_MISSION_NO_SPACE]
    there.wait(10)
    assert there.upload(MISSION) == 0


def test_a_mission_refused_at_an_item_keeps_the_items_before() -> None:
    there = station()
    inject(there, "mission_refused:result=denied,at_item=2")
    assert there.upload(MISSION) == mavlink.MAV_MISSION_DENIED
    assert there.wait(9.0) is not None
    assert acks(there.received) == [mavlink.MAV_MISSION_DENIED]


def command(there: Station, number: int, *params: float) -> list[int]:
    padded = [*params, *[0.0] * (7 - len(params))]
    replies = there.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
    return [m.result for m in replies if m.get_type() == "COMMAND_ACK"]


def test_slow_acknowledgements_are_late_and_have_the_next_sequence_number() -> None:
    there = station("slow_ack:delay_s=2")
    assert command(there, mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED) == []
    assert there.mode == "GUIDED"
    there.wait(1.9)
    assert there.of("COMMAND_ACK") == []
    there.wait(0.3)
    assert [m.result for m in there.of("COMMAND_ACK")] == [0]
    sequence = [m.get_seq() for m in there.received]
    assert sequence == [(sequence[0] + i) % 256 for i in range(len(sequence))]


def test_absent_acknowledgements_leave_no_gap_in_the_sequence() -> None:
    there = station("absent_ack")
    assert command(there, mavlink.MAV_CMD_DO_SET_MODE, 1, GUIDED) == []
    there.wait(5)
    assert there.mode == "GUIDED"
    assert there.of("COMMAND_ACK") == []
    sequence = [m.get_seq() for m in there.received]
    assert sequence == [(sequence[0] + i) % 256 for i in range(len(sequence))]


@pytest.mark.parametrize(("answer", "result"), [("accepted", 0), ("refused", mavlink.MAV_RESULT_FAILED)])
def test_a_stuck_mode_stays_with_every_kind_of_answer(answer: str, result: int) -> None:
    there = station(f"stuck_mode:answer={answer},for=10")
    assert there.set_mode(GUIDED) == result
    assert there.mode == "STABILIZE"
    there.wait(10)
    assert there.set_mode(GUIDED) == 0
    assert there.mode == "GUIDED"


def test_an_unhealthy_sensor_shows_in_its_bit_and_keeps_the_vehicle_from_arming() -> None:
    there = station("sensor_unhealthy:sensor=mag,for=5")
    there.set_mode(GUIDED)
    there.wait(0.2)
    bit = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    status = there.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    assert status.onboard_control_sensors_present & bit
    assert not status.onboard_control_sensors_health & (bit | mavlink.MAV_SYS_STATUS_PREARM_CHECK)
    assert there.arm() == mavlink.MAV_RESULT_FAILED
    assert "Arm: Compass not healthy" in there.texts()
    there.wait(5)
    status = there.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    assert status.onboard_control_sensors_health & bit
    assert there.arm() == 0


def test_a_battery_with_removed_charge_continues_to_drain() -> None:
    there = station()
    there.fly(20)
    inject(there, "battery_sag:sag_v=0,at_most=0.3")
    there.wait(1)
    inject(there, "battery_sag:sag_v=0.5,at=30")
    there.wait(60)
    assert there.fleet.truth().battery_remaining[0] < 0.28


def test_a_drifting_clock_shows_in_time_since_boot_and_timesync() -> None:
    there = station("clock_drift:drift_ppm=10000,at=10")
    there.wait(110)
    assert there.ask(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME).time_boot_ms == pytest.approx(111_000, abs=100)
    replies = there.send(mavlink.MAVLink_timesync_message(0, 123))
    (sync,) = [m for m in replies if m.get_type() == "TIMESYNC" and m.ts1 == 123]
    assert sync.tc1 == pytest.approx(111e9, abs=1e8)


# -- flying -----------------------------------------------------------------------------------------------


def test_a_reboot_in_flight_causes_silence_a_fall_and_boot_text() -> None:
    there = station()
    there.fly(30)
    boots = there.fleet.boots()[0]
    inject(there, "reboot:silence_s=2")
    there.wait(0.1)
    assert said_nothing(there, 1.8)
    there.raw = b""
    there.wait(3)
    assert b"Init ArduCopter" in there.raw
    assert there.fleet.boots()[0] == boots + 1
    assert not there.armed
    there.until(lambda: there.height_m < 0.1, 20)
    assert there.heartbeat().custom_mode == 0


def test_a_gps_glitch_moves_the_true_position() -> None:
    there = station()
    there.fly(20)
    before = there.fleet.truth()
    inject(there, "gps_glitch:east_m=0,north_m=20,ramp_s=30")
    there.wait(60)
    after = there.fleet.truth()
    moved_m = (after.lat_deg[0] - before.lat_deg[0]) * 111_195.0
    assert moved_m == pytest.approx(-20.0, abs=3.0)
    seen_m = (there.ask(POSITION).lat * 1e-7 - before.lat_deg[0]) * 111_195.0
    assert seen_m == pytest.approx(0.0, abs=3.0)


def test_a_battery_sag_is_reported_and_ends() -> None:
    there = station()
    volts = there.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS).voltage_battery / 1000
    inject(there, "battery_sag:sag_v=1.5,for=5")
    there.wait(1)
    assert there.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS).voltage_battery / 1000 == pytest.approx(
        volts - 1.5, abs=0.1
    )
    there.wait(5)
    assert there.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS).voltage_battery / 1000 == pytest.approx(
        volts, abs=0.1
    )


def test_removed_charge_returns_at_the_end_of_the_fault() -> None:
    there = station()
    inject(there, "battery_sag:sag_v=0,at_most=0.3,for=5")
    there.wait(1)
    assert there.fleet.truth().battery_remaining[0] == pytest.approx(0.3, abs=0.01)
    there.wait(5)
    assert there.fleet.truth().battery_remaining[0] > 0.99


@pytest.mark.parametrize(("motors", "at_least_m_s"), [(1, 0.5), (2, 3.0)])
def test_a_copter_without_motors_comes_down(motors: int, at_least_m_s: float) -> None:
    there = station()
    there.fly(40)
    inject(there, f"motor_loss:motors={motors}")
    took_s = there.until(lambda: there.height_m < 0.1, 120)
    assert 40 / took_s > at_least_m_s


def test_a_fleet_with_all_faults_at_once_continues() -> None:
    troubled = fleet(4, *[f"{name}:at=2,for=20" for name in FAULTS], *[f"{name}:at=12" for name in FAULTS])
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    for step in range(400):
        troubled.step(step * 0.1)
        message = mavlink.MAVLink_command_long_message(step % 5, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        troubled.receive(message.pack(codec), step * 0.1)
    assert set(troubled.faults_on(0)) == set(FAULTS)


def test_a_fault_on_an_unknown_vehicle_is_refused() -> None:
    with pytest.raises(FaultError, match=r" 9; .*\[fault-vehicle\]"):
        fleet(2).inject(parse_fault("gps_loss:sysid=9"), 0.0)


# -- simulation parameters and the failure command --------------------------------------------------------


@pytest.mark.autopilots("1.20")
def test_sim_gps_disable_is_a_gps_loss() -> None:
    there = station()
    set_parameter(there, "SIM_GPS_DISABLE", 1)
    assert there.fleet.faults_on(0) == ("gps_loss",)
    set_parameter(there, "SIM_GPS_DISABLE", 0)
    assert there.fleet.faults_on(0) == ()


def test_sim_engine_fail_needs_a_multiplier() -> None:
    there = station()
    set_parameter(there, "SIM_ENGINE_FAIL", 3)
    assert there.fleet.faults_on(0) == ()
    set_parameter(there, "SIM_ENGINE_MUL", 0)
    assert there.fleet.faults_on(0) == ("motor_loss",)


def test_a_parameter_of_the_scenario_counts_from_the_start() -> None:
    vehicle = {"sysid": 1, "lat_deg": LAT_DEG, "lon_deg": LON_DEG, "params": {"SIM_GPS_DISABLE": 1}}
    there = Station(Fleet(scenario(vehicles=[vehicle]), ready_s=0.0))
    assert there.fleet.faults_on(0) == ("gps_loss",)


@pytest.mark.autopilots("MAVSDK 5 failure")
def test_ardupilot_has_no_failure_command() -> None:
    assert station().command(mavlink.MAV_CMD_INJECT_FAILURE, 4, 1, 0) == mavlink.MAV_RESULT_UNSUPPORTED


@pytest.mark.autopilots("MAVSDK 5 failure", of="px4")
def test_px4_injects_failures_only_with_sys_failure_en() -> None:
    vehicle = {"sysid": 1, "lat_deg": LAT_DEG, "lon_deg": LON_DEG, "personality": "px4"}
    there = Station(Fleet(scenario(vehicles=[vehicle]), ready_s=0.0))
    gps_off = (mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_TYPE_OFF)
    assert there.command(*gps_off) == mavlink.MAV_RESULT_DENIED
    allowed = {"params": {"SYS_FAILURE_EN": 1}}
    there = Station(Fleet(scenario(vehicles=[vehicle | allowed]), ready_s=0.0))
    assert there.command(*gps_off) == mavlink.MAV_RESULT_ACCEPTED
    assert there.fleet.faults_on(0) == ("gps_loss",)
    gps_ok = (mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SENSOR_GPS, mavlink.FAILURE_TYPE_OK)
    assert there.command(*gps_ok) == mavlink.MAV_RESULT_ACCEPTED
    assert there.fleet.faults_on(0) == ()
    servo = (mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SYSTEM_SERVO, mavlink.FAILURE_TYPE_OFF)
    assert there.command(*servo) == mavlink.MAV_RESULT_UNSUPPORTED


# -- signing ----------------------------------------------------------------------------------------------

KEY = bytes(range(100, 132))
START = 600_000_000_000


def sign(there: Station, *, out: bool = True) -> None:
    for codec in (there.codec, there._decoder):
        codec.signing.secret_key = KEY
        codec.signing.timestamp = START
    there.codec.signing.sign_outgoing = out


def signed_station() -> Station:
    there = station()
    there.send(mavlink.MAVLink_setup_signing_message(1, 1, list(KEY), START))
    return there


def test_a_trusted_link_needs_no_signature() -> None:
    there = Station(Fleet(scenario(), ready_s=0.0, trusted_links={0}))
    there.send(mavlink.MAVLink_setup_signing_message(1, 1, list(KEY), START))
    there.send(mavlink.MAVLink_set_mode_message(1, 1, GUIDED))
    assert there.mode == "GUIDED"


def test_px4_ignores_a_signing_setup() -> None:
    vehicle = {"sysid": 1, "lat_deg": LAT_DEG, "lon_deg": LON_DEG, "personality": "px4"}
    there = Station(Fleet(scenario(vehicles=[vehicle]), ready_s=0.0))
    there.send(mavlink.MAVLink_setup_signing_message(1, 1, list(KEY), START))
    assert not there.heartbeat().get_header().incompat_flags & mavlink.MAVLINK_IFLAG_SIGNED


def test_an_armed_vehicle_keeps_its_key() -> None:
    there = station()
    assert there.set_mode(GUIDED) == 0
    assert there.arm() == 0
    there.send(mavlink.MAVLink_setup_signing_message(1, 1, list(KEY), START))
    assert there.texts()[-1] == "ERROR: Won't setup signing when armed"
    assert not there.heartbeat().get_header().incompat_flags & mavlink.MAVLINK_IFLAG_SIGNED


def test_a_reboot_keeps_the_key_and_boot_text_stays_plain() -> None:
    there = signed_station()
    sign(there)
    there.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    there.raw = b""
    there.wait(4)
    assert b"Init ArduCopter" in there.raw
    assert there.of("HEARTBEAT")[-1].get_signed()
