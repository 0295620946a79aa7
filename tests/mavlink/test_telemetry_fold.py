"""Effects of messages on a vehicle's state."""

from __future__ import annotations

import re

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.events import LinkLost, LinkRestored, Rebooted, TelemetryReceived
from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects import Unsupported, dialect_for
from swarmctl.mavlink.events import FirstHeartbeat, Identity, StatusText
from swarmctl.mavlink.protocol.conversation import IllegalEvent, MavlinkPeer
from swarmctl.mavlink.protocol.wait import RequestUntil, wait
from swarmctl.mavlink.session import Session
from swarmctl.mavlink.telemetry.streams import StreamKeeper
from swarmctl.mavlink.telemetry.vehicle_state import Telemetry

COPTER, PX4 = dialect_for(3, 2), dialect_for(12, 2)
M = mavlink


def position(boot_ms: int = 1000, lat: int = 460_490_000, lon: int = 145_060_000, **kw):
    fields = {"alt": 300_000, "relative_alt": 20_500, "vx": 300, "vy": 400, "vz": -150, "hdg": 9000} | kw
    return M.MAVLink_global_position_int_message(boot_ms, lat, lon, *fields.values())


def heartbeat(mode: int = 4, armed: bool = False, autopilot: int = 3, kind: int = 2, comp: int = 1):
    message = M.MAVLink_heartbeat_message(kind, autopilot, 81 | 128 * armed, mode, 3, 3)
    message.get_header().srcSystem, message.get_header().srcComponent = 1, comp
    return message


def sys_status(ok: bool = True, percent: int = 88, millivolts: int = 15_800):
    health = M.MAV_SYS_STATUS_PREARM_CHECK * ok
    return M.MAVLink_sys_status_message(0, 0, health, 0, millivolts, 0, percent, 0, 0, 0, 0, 0, 0)


def text(words: str, severity: int = 4, msg_id: int = 0, chunk: int = 0):
    return M.MAVLink_statustext_message(severity, words.encode(), msg_id, chunk)


def folded(*messages) -> Telemetry:
    telemetry = Telemetry(COPTER)
    for message in messages:
        telemetry.receive(message, 0.0)
    return telemetry


GPS = M.MAV_SYS_STATUS_SENSOR_GPS


def of_gps(present: bool, healthy: bool):
    return M.MAVLink_sys_status_message(GPS * present, 0, GPS * healthy, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("reports", "gps_ok"),
    [
        ([], None),
        ([(False, True)], None),
        ([(True, True)], True),
        ([(True, False)], False),
        ([(True, True), (False, True)], False),
        ([(True, True), (False, False)], False),
        ([(True, True), (False, True), (True, True)], True),
    ],
    ids=[
        "no report",
        "no receiver",
        "a fix",
        "no fix",
        "PX4 reports an unused receiver as absent and healthy",
        "ArduPilot reports a silent receiver as absent",
        "a fix again",
    ],
)
def test_a_gps_receiver_that_stops_reporting_is_lost(reports, gps_ok):
    assert folded(*(of_gps(*bits) for bits in reports)).state.gps_ok is gps_ok


def test_a_gps_from_before_a_reboot_does_not_count():
    booted = folded(position(60_000), of_gps(True, True), position(1000), of_gps(False, True))
    assert booted.n_reboots == 1
    assert booted.state.gps_ok is None


def test_a_state_is_complete_with_a_position():
    telemetry = folded(heartbeat(3, armed=True), sys_status())
    assert telemetry.receive(position(), 0.0)
    state = telemetry.state
    assert (state.mode, state.armed, state.battery_percent, state.battery_v) == ("AUTO", True, 88, 15.8)
    assert (state.lat_deg, state.lon_deg, state.alt_rel_m) == (46.049, 14.506, 20.5)
    assert (state.ground_speed_m_s, state.climb_m_s, state.heading_deg) == (5.0, 1.5, 90.0)
    assert state.time_boot_s == 1.0


@pytest.mark.parametrize(
    ("message", "field", "value"),
    [
        (position(lat=0, lon=0), "lat_deg", None),
        (position(hdg=65_535), "heading_deg", None),
        (sys_status(percent=-1), "battery_percent", None),
        (sys_status(millivolts=65_535), "battery_v", None),
        (M.MAVLink_extended_sys_state_message(0, 2), "landed", Landed.IN_AIR),
        (M.MAVLink_extended_sys_state_message(0, 77), "landed", Landed.UNDEFINED),
        (M.MAVLink_mission_current_message(4, 9), "mission_seq", 4),
        (M.MAVLink_mission_current_message(4, 65_535), "mission_total", None),
        (M.MAVLink_mission_current_message(65_535, 9), "mission_seq", None),
        (heartbeat(99), "mode", "MODE 99"),
        (heartbeat(4), "mode_role", "hold"),
        (heartbeat(3), "mode_role", "mission"),
        (heartbeat(6), "mode_role", "return"),
        (heartbeat(9), "mode_role", "land"),
        (heartbeat(5), "mode_role", "other"),
        (position(), "mode_role", ""),
        (text("low battery", 4), "status_text", "low battery"),
        (text("just so", 6), "status_text", ""),
    ],
)
def test_each_field_comes_from_its_message(message, field, value):
    assert getattr(folded(message).state, field) == value


def test_a_position_older_than_the_last_one_is_dropped():
    telemetry = folded(position(5000))
    assert not telemetry.receive(position(4000, lat=1), 0.0)
    assert telemetry.state.lat_deg == 46.049
    assert telemetry.n_reboots == 0


def test_a_clock_that_goes_back_is_a_reboot_and_clears_the_state():
    telemetry = folded(heartbeat(4), sys_status(), text("STRIKE 2 over 1,1 from 1,2"), position(60_000))
    telemetry.receive(position(500), 0.0)
    assert telemetry.n_reboots == 1
    assert (telemetry.state.strikes, telemetry.state.battery_v, telemetry.state.ready) == (0, None, False)
    assert (telemetry.state.mode, telemetry.state.mode_role) == ("GUIDED", "hold")
    assert telemetry.receive(position(700), 0.0)


WRAP_S = 2**32 / 1000.0
"""`time_boot_ms` wraps to 0 after 49.7 days."""
CLOCKS: dict[str, tuple[list[tuple[float, float]], int]] = {
    "a silence": ([(0.0, 60.0), (1.0, 61.0)], 0),
    "30 s of silence": ([(0.0, 60.0), (30.0, 90.0)], 0),
    "two minutes of silence": ([(0.0, 60.0), (120.0, 180.0)], 0),
    "a clock as old as the silence": ([(0.0, 60.0), (120.0, 119.5)], 0),
    "a clock younger than the silence": ([(0.0, 60.0), (120.0, 90.0)], 1),
    "a clock younger than the silence, just ahead": ([(0.0, 60.0), (70.0, 61.0)], 1),
    "the wrap": ([(n, WRAP_S - 2.5 + n) for n in range(6)], 0),
    "ten minutes of silence over the wrap": ([(0.0, WRAP_S - 60.0), (600.0, WRAP_S + 540.0)], 0),
    "70 s of silence over the wrap": ([(0.0, WRAP_S - 60.0), (70.0, WRAP_S + 9.5)], 0),
    "a reboot in a silence before the wrap": ([(0.0, WRAP_S - 60.0), (600.0, 20.0)], 1),
    "a reboot a minute before the wrap": ([(0.0, WRAP_S - 60.0), (5.0, 4.0)], 1),
    "a reboot after the wrap": ([(0.0, WRAP_S - 0.5), (1.0, WRAP_S + 0.5), (60.0, 9.0), (61.0, 10.0)], 1),
}
"""times [s] of the receipt and on the vehicle's clock, and the number of reboots"""


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_younger_than_the_silence_shows_a_reboot(name):
    """After a silence longer than the old uptime the new clock may be ahead of the old one."""
    times_s, reboots = CLOCKS[name]
    telemetry = Telemetry(COPTER)
    for now_s, boot_s in times_s:
        telemetry.receive(position(round(boot_s * 1000) % 2**32), now_s)
    assert telemetry.n_reboots == reboots
    assert telemetry.state.time_boot_s == pytest.approx(times_s[-1][1])


@pytest.mark.parametrize("late_s", [WRAP_S - 0.2, WRAP_S - 1.2])
def test_a_late_message_from_before_the_wrap_is_dropped(late_s):
    telemetry = Telemetry(COPTER)
    for now_s, boot_s in ((0.0, WRAP_S - 0.5), (0.8, WRAP_S + 0.3), (0.9, late_s)):
        telemetry.receive(position(round(boot_s * 1000) % 2**32), now_s)
    assert telemetry.n_reboots == 0
    assert telemetry.state.time_boot_s == pytest.approx(WRAP_S + 0.3)


@pytest.mark.parametrize(
    ("messages", "strikes"),
    [
        ([text("STRIKE 1 over 3,4 from 3,5")], 1),
        ([text("STRIKE 3 over 3,4 from 3,5"), text("STRIKE 2 over 3,3 from 3,5")], 3),
        ([M.MAVLink_named_value_int_message(9, b"strikes", 5), text("STRIKE 4 over 3,4 from 3,5")], 5),
        ([M.MAVLink_named_value_int_message(9, b"other", 5)], 0),
        ([text("STRIKE x over 3,4 from 3,5"), text("a STRIKE 9 over 1,1 from 1,1")], 0),
    ],
)
def test_strikes_are_the_greatest_received_count(messages, strikes):
    assert folded(*messages).state.strikes == strikes


def test_the_parts_of_a_long_text_are_joined_and_a_missing_part_is_marked():
    a, b, c = "a" * 50, "b" * 50, "the end"
    telemetry = folded(
        text(a, 4, 7, 0), text(b, 4, 7, 1), text(c, 4, 7, 2), text(a, 4, 8, 0), text(c, 4, 8, 2)
    )
    assert list(telemetry.texts) == [(4, a + b + c), (4, f"{a} ... {c}")]


def ekf(flags: int):
    return M.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("dialect", "messages", "reasons"),
    [
        (COPTER, (heartbeat(4), sys_status(), ekf(16)), ()),
        (COPTER, (heartbeat(3), sys_status(), ekf(0x3F)), ()),
        (COPTER, (heartbeat(0), sys_status(), ekf(16)), ("STABILIZE",)),
        (COPTER, (heartbeat(4), sys_status(False), ekf(16)), ("[pre-arm]",)),
        (COPTER, (heartbeat(4), sys_status(False), ekf(16), text("PreArm: Hello")), ("PreArm: Hello",)),
        (
            COPTER,
            (heartbeat(4), text("PreArm: Hello"), sys_status(), sys_status(False), ekf(16)),
            ("[pre-arm]",),
        ),
        (COPTER, (heartbeat(4), sys_status(), ekf(15)), ("[no-position]",)),
        (PX4, (heartbeat(4 << 16 | 3 << 24), sys_status()), ()),
        (PX4, (heartbeat(3 << 16), sys_status()), ("POSCTL",)),
        (
            PX4,
            (heartbeat(4 << 16 | 3 << 24), sys_status(False), text("Preflight Fail: Gyro")),
            ("Fail: Gyro",),
        ),
    ],
)
def test_ready_is_the_pre_arm_bit_in_a_mode_without_a_pilot_and_a_position_estimate(
    dialect, messages, reasons
):
    rest = M.MAVLink_extended_sys_state_message(0, 1), M.MAVLink_mission_current_message(0, 0), position()
    telemetry = Telemetry(dialect)
    for message in (*rest, *messages):
        telemetry.receive(message, 0.0)
    found = telemetry.state.not_ready
    assert len(found) == len(reasons)
    assert all(reason in text for reason, text in zip(reasons, found, strict=True))
    assert telemetry.state.ready == (not reasons)


def test_a_vehicle_is_ready_only_after_all_messages_arrived():
    telemetry = folded(heartbeat(4), sys_status(), position())
    (reason,) = telemetry.state.not_ready
    assert "EKF_STATUS_REPORT, EXTENDED_SYS_STATE, MISSION_CURRENT" in reason
    telemetry.receive(ekf(16), 0.0)
    telemetry.receive(M.MAVLink_extended_sys_state_message(0, 1), 0.0)
    telemetry.receive(M.MAVLink_mission_current_message(0, 0), 0.0)
    assert telemetry.state.ready


@pytest.mark.parametrize(
    ("autopilot", "kind", "name"),
    [
        (12, 20, "VTOL quadrotor of PX4"),
        (3, 10, "ground rover of ArduPilot"),
        (0, 2, r"quadrotor of another autopilot \(generic\)"),
        (3, 199, "199 of ArduPilot"),
    ],
)
def test_unsupported_vehicles_are_refused_by_name(autopilot, kind, name):
    with pytest.raises(Unsupported, match=name):
        dialect_for(autopilot, kind)


# The mission of a plan

A, B = Waypoint(46.0, 14.0, 20.0), Waypoint(46.001, 14.0, 20.0)


@pytest.mark.parametrize(
    ("plan", "commands"),
    [
        (FlightPlan(20.0, (A, B), B), [16, 22, 16, 16, 21]),
        (FlightPlan(20.0, (A,), Waypoint(46.001, 14.0, 12.0)), [16, 22, 16, 16, 21]),
        (FlightPlan(20.0, (), B), [16, 22, 16, 21]),
    ],
    ids=["landing at the end of the track", "landing from another altitude", "only a landing"],
)
def test_a_plan_becomes_home_takeoff_waypoints_land(plan, commands):
    items = COPTER.mission_items(plan)
    assert [i.command for i in items] == commands
    assert {i.frame for i in items[1:]} == {3}
    assert items[1].z == 20.0
    assert (items[-1].x, items[-1].y) == (round(plan.landing.lat_deg * 1e7), 140_000_000)
    assert items[-2].z == plan.landing.alt_rel_m


@pytest.mark.parametrize(
    ("plan", "name"),
    [
        (FlightPlan(float("nan"), (A,), B), "take-off altitude"),
        (FlightPlan(20.0, (A, Waypoint(91.0, 0.0, 1.0)), B), "waypoint 1"),
        (FlightPlan(20.0, (A,), Waypoint(float("nan"), 0.0, 20.0)), "landing"),
    ],
)
def test_a_plan_that_cannot_be_flown_is_refused(plan, name):
    with pytest.raises(ValueError, match=name):
        COPTER.mission_items(plan)


WP = MissionItem(16, 3, 1, 2, 20.0)


@pytest.mark.parametrize(
    ("sent", "found", "equal"),
    [
        (MissionItem(16, 3, 1, 2, 20.3), MissionItem(16, 3, 1, 2, 20.29), True),
        (MissionItem(16, 3, 1, 2, -5.555), MissionItem(16, 3, 1, 2, -5.55), True),
        (MissionItem(16, 6, 1, 2, 20.0), WP, True),
        (MissionItem(16, 5, 1, 2, 20.0), MissionItem(16, 0, 1, 2, 20.0), True),
        (MissionItem(16, 3, 1, 2, 20.0, 2.7, 5.0, 6.0, 7.0), MissionItem(16, 3, 1, 2, 20.0, 2.0), True),
        (MissionItem(21, 3, 1, 2, 0.0), MissionItem(21, 3, 1, 2, 0.0, param4=1.0), True),
        (WP, MissionItem(16, 3, 2, 2, 20.0), False),
        (WP, MissionItem(16, 3, 1, 2, 19.9), False),
        (WP, MissionItem(16, 3, 1, 2, 20.1), False),
        (WP, MissionItem(16, 0, 1, 2, 20.0), False),
        (WP, MissionItem(17, 3, 1, 2, 20.0), False),
        (MissionItem(16, 3, 1, 2, 20.0, 9.0), WP, False),
        (MissionItem(16, 3, 1, 2, 5.0), MissionItem(16, 3, 1, 2, -5.0), False),
    ],
)
def test_read_back_is_compared_modulo_arducopters_storage(sent, found, equal):
    home = MissionItem(16, 0, 0, 0, 0.0)
    theirs = MissionItem(16, 0, 460_000_000, 145_000_000, 300.0)
    gaps = COPTER.differences((home, sent), (theirs, found))
    assert (gaps == ()) is equal
    assert all("item 1" in gap for gap in gaps)


def test_a_mission_of_another_length_is_different():
    (gap,) = COPTER.differences((WP, WP), (WP,))
    assert re.findall(r"\d+", gap) == ["1", "2"]


# Presence and streams


@pytest.mark.parametrize(
    "message",
    [heartbeat(comp=190), heartbeat(autopilot=8), heartbeat(kind=6), position()],
    ids=["another component", "no autopilot", "a ground station", "no heartbeat"],
)
def test_only_the_autopilots_heartbeat_makes_a_vehicle(message):
    message.get_header().srcSystem = 1
    session = Session(MavlinkPeer(1))
    assert session.receive(message, 0.0) == ([], [])
    assert session.age_s(0.0) == float("inf")


def test_pauses_grow_between_requests_for_missing_streams():
    keeper = StreamKeeper(MavlinkPeer(1), {33: 4.0, 1: 1.0})
    assert keeper.tick(0.0) == []
    keeper.demand(0.0)
    first = keeper.tick(0.0)
    assert [(m.command, m.param1, m.param2) for m in first] == [(511, 33, 250_000), (511, 1, 1_000_000)]
    keeper.on_message(33, 2.0)
    times = []
    for now in range(1, 100):
        keeper.on_message(33, float(now))
        times += [now for m in keeper.tick(float(now)) if m.param1 == 1]
    assert times == [3, 9, 21, 45, 75]


def events_of(session: Session, now: float, *messages) -> list:
    events = []
    for message in messages:
        message.get_header().srcSystem, message.get_header().srcComponent = 1, 1
        events += session.receive(message, now).events
    return events


def test_a_session_reports_a_closed_list_of_events():
    session = Session(MavlinkPeer(1))
    first = events_of(session, 0.0, heartbeat(0))
    assert first == [FirstHeartbeat(3, 2), TelemetryReceived(session.state)]
    assert events_of(session, 0.5, text("Init", 6)) == [StatusText(6, "Init")]
    assert events_of(session, 1.0, position()) == [TelemetryReceived(session.state)]
    assert session.next_deadline == 5.0
    found = [session.tick(0.5 * n).events for n in range(10, 15)]
    assert found == [[LinkLost(5.0)], [], [LinkLost(6.0)], [], [LinkLost(7.0)]]
    assert events_of(session, 9.0, heartbeat(0)) == [LinkRestored(), TelemetryReceived(session.state)]


def test_the_first_state_after_a_silence_has_the_mode_of_the_newest_heartbeat():
    session = Session(MavlinkPeer(1))
    events_of(session, 0.0, heartbeat(3, armed=True))
    session.tick(5.0)
    restored, changed = events_of(session, 9.0, heartbeat(5, armed=True))
    assert restored == LinkRestored()
    assert (changed.state.mode, changed.state.mode_role) == ("LOITER", "other")


def test_another_sender_with_the_autopilots_component_id_is_ignored():
    """Companions are often set up with the vehicle's system id and component 1."""
    session = Session(MavlinkPeer(1))
    events_of(session, 0.0, heartbeat(3, armed=True))
    procedure = lambda ctx: (yield RequestUntil(ctx.peer, lambda: True, 5.0))  # noqa: E731
    session.begin("heartbeat", procedure, 0.5)
    assert events_of(session, 1.0, heartbeat(0, autopilot=8, kind=18)) == []
    assert session.busy_with == "heartbeat"
    assert (session.state.mode, session.state.armed) == ("AUTO", True)
    assert session.age_s(1.0) == 1.0


def test_a_session_runs_one_procedure_at_a_time_after_the_identity_is_known():
    session = Session(MavlinkPeer(1))

    def endless(ctx):
        yield wait(1e9)

    with pytest.raises(IllegalEvent):
        session.begin("first", endless, 0.0)
    events_of(session, 0.0, heartbeat())
    session.begin("first", endless, 0.0)
    with pytest.raises(IllegalEvent, match=r"second .*first"):
        session.begin("second", endless, 0.0)


@pytest.mark.parametrize(
    ("uid2", "simulated"),
    [
        (b"sim_vehicle".ljust(17, b"\0") + b"\x07", True),
        (b"sim_vehicleX".ljust(18, b"\0"), False),
        (b"sim_vehicl".ljust(18, b"\0"), False),
        (bytes(18), False),
    ],
)
def test_only_the_mark_of_the_built_in_simulator_identifies_it(uid2, simulated):
    session = Session(MavlinkPeer(1))
    events_of(session, 0.0, heartbeat())
    version = M.MAVLink_autopilot_version_message(0, 0x040602FF, 0, 0, 0, b"", b"", b"", 0, 0, 0, list(uid2))
    identity = session.identity(version)
    assert identity == Identity(1, 3, 2, "ArduPilot 4.6.2", uid2)
    assert identity.simulated is simulated


def system_time(boot_ms: int):
    return M.MAVLink_system_time_message(0, boot_ms)


def test_a_vehicle_without_positions_still_gives_a_state_every_second():
    """PX4 sends no position without a valid estimate; battery, GPS and mode still need checks."""
    session = Session(MavlinkPeer(1))
    events_of(session, 0.0, heartbeat(3, armed=True), sys_status(), position())
    states = []
    for second in range(1, 61):
        events = events_of(session, float(second), heartbeat(3, armed=True), sys_status(percent=3))
        states += [event.state for event in events if isinstance(event, TelemetryReceived)]
    assert 55 <= len(states) <= 65
    assert states[-1].battery_percent == 3


def test_an_old_position_is_dropped_until_the_next_one_comes():
    session = Session(MavlinkPeer(1))
    events_of(session, 0.0, heartbeat(), position())
    events_of(session, 2.0, heartbeat())
    assert session.state.has_position
    events_of(session, 4.0, heartbeat())
    assert (session.state.lat_deg, session.state.lon_deg, session.state.alt_rel_m) == (None, None, None)
    assert session.state.alt_amsl_m is None
    assert session.state.position_s == 0.0
    events_of(session, 5.0, position(6000))
    assert session.state.has_position
    assert session.state.position_s == 5.0


def test_the_clock_of_a_vehicle_advances_without_a_position():
    session = Session(MavlinkPeer(1))
    events_of(session, 0.0, heartbeat(), position(1000))
    events_of(session, 1.0, heartbeat(), system_time(2000))
    assert session.state.time_boot_s == 1.0  # as of the position
    events_of(session, 9.0, heartbeat(), system_time(10_000))
    assert session.state.time_boot_s == 10.0


def test_a_clock_without_positions_shows_a_reboot_too():
    session = Session(MavlinkPeer(1))
    events_of(session, 0.0, heartbeat(), position(60_000))
    assert Rebooted() in events_of(session, 4.0, heartbeat(), system_time(3000))


def test_a_state_has_the_times_of_its_parts():
    session = Session(MavlinkPeer(1))
    events_of(session, 1.0, heartbeat())
    events_of(session, 2.0, sys_status())
    events_of(session, 3.0, position())
    state = session.state
    assert (state.heartbeat_s, state.status_s, state.position_s) == (1.0, 2.0, 3.0)


WILD = 2**31 - 1


@pytest.mark.parametrize(
    "wild",
    [
        position(lat=WILD, lon=WILD),
        position(lat=900_000_001),
        position(lon=-1_800_000_001),
        position(alt=WILD),
        position(relative_alt=-WILD),
        position(relative_alt=20_001_000),
    ],
)
def test_an_impossible_position_is_dropped(wild):
    state = folded(position(500), wild).state
    assert (state.lat_deg, state.lon_deg, state.alt_rel_m, state.alt_amsl_m) == (None,) * 4
    assert state.time_boot_s == 1.0


def test_an_impossible_home_is_dropped():
    state = folded(M.MAVLink_home_position_message(WILD, WILD, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)).state
    assert state.home_lat_deg is None


def test_only_the_last_texts_of_a_vehicle_are_kept():
    telemetry = folded(*(text(f"line {n}") for n in range(1000)))
    assert len(telemetry.texts) < 500
    assert telemetry.n_texts == 1000
    assert telemetry.texts_since(998) == [(4, "line 998"), (4, "line 999")]
    assert telemetry.texts_since(1000) == []
