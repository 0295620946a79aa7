"""The conformance suite on the virtual clock: the simulator passes, and permissions are kept."""

import math
from typing import Any

import pytest
import typer
from bent_vehicle import (
    GROUND,
    BentWire,
    DroppingWire,
    FleetWire,
    conform,
    connected,
    describe_failures,
    fleet,
    has_mission,
    named,
    one_check,
    store_mission,
    without_simulator_mark,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc
from typer.testing import CliRunner

from sim_vehicle.conformance import parameters
from sim_vehicle.conformance.cli import conformance
from sim_vehicle.conformance.guard import Forbidden, permission_for
from sim_vehicle.conformance.outcomes import Outcome, Skip
from sim_vehicle.conformance.registry import CATEGORIES, all_checks, check, select
from sim_vehicle.conformance.runner import CHECK_S, granted_permissions, run
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.frames import STATION
from sim_vehicle.station.messages import command_long

VEHICLES = [(name, kind) for name in ("ardupilot", "px4") for kind in ("copter", "plane")]


# -- the registry ----------------------------------------------------------------------------------------


def test_duplicate_names_and_unknown_permissions_are_refused() -> None:
    def arrives(_vehicle: VehicleUnderTest) -> None:
        """A heartbeat arrives."""

    with pytest.raises(ValueError, match=r"heartbeat\.arrives"):
        all_checks() and check("heartbeat")(arrives)
    with pytest.raises(ValueError, match="money"):
        check("heartbeat.new", needs=["money"])(arrives)
    with pytest.raises(ValueError, match=r"nothing\.arrives"):
        check("nothing")(arrives)


def test_a_pattern_is_a_category_a_beginning_or_a_shell_pattern() -> None:
    assert {found.category for found in select(["fence"])} == {"fence"}
    assert {found.name.rpartition(".")[0] for found in select(["mission.upload"])} == {"mission.upload"}
    assert all("unknown" in found.name for found in select(["*unknown*"]))
    with pytest.raises(ValueError, match=r"nonsense.*--list"):
        select(["nonsense"])


# -- the simulator passes --------------------------------------------------------------------------------


@pytest.mark.autopilots("1.7", "1.9", "1.17", "2 count", "2 abandoned upload", "2 requests")
@pytest.mark.autopilots("2 wrong / duplicate item", "2 CLEAR_ALL", "2 DO_SET_MISSION_CURRENT")
@pytest.mark.autopilots("2 MISSION_SET_CURRENT")
@pytest.mark.autopilots("2 second GCS / download during upload", "2 PX4 otherwise")
@pytest.mark.autopilots("MAVSDK 5 offboard", "MAVSDK 5 takeoff")
@pytest.mark.autopilots(
    "1.5", "1.14", "1.16", "2 item 0", "2 count", "2 RTL item", "2 abandoned upload", of="px4"
)
@pytest.mark.autopilots("2 upload is atomic?", "2 second GCS / download during upload", of="px4")
@pytest.mark.autopilots("2 DO_SET_MISSION_CURRENT", "2 MISSION_WRITE_PARTIAL_LIST", of="px4")
@pytest.mark.autopilots("2 pause/continue", "2 CLEAR_ALL", "2 PX4 otherwise", of="px4")
@pytest.mark.autopilots("MAVSDK 5 hold", "MAVSDK 5 start_mission", "MAVSDK 5 mission_raw item 0", of="px4")
@pytest.mark.autopilots("MAVSDK 5 clear_mission", "MAVSDK 5 offboard", "MAVSDK 5 set_current_speed", of="px4")
@pytest.mark.virtual
@pytest.mark.parametrize(
    ("personality", "kind"),
    [pytest.param(*row, marks=pytest.mark.full if row[1] == "plane" else ()) for row in VEHICLES],
)
def test_the_simulator_passes_every_check(personality: str, kind: str) -> None:
    report = conform(FleetWire(fleet(personality, kind)))
    assert describe_failures(report) == ""
    assert report.notes == ()
    assert len(report.results) == len(all_checks())
    assert report.count(Outcome.PASSED) >= 150
    assert [r.check.name for r in report.results if "[battery-low]" in r.seen] == []


# -- permissions -----------------------------------------------------------------------------------------


@pytest.mark.virtual
def test_a_vehicle_that_is_not_the_simulator_is_not_armed_rebooted_or_altered() -> None:
    inner = fleet(ready_s=0.0)
    wire = BentWire(inner, without_simulator_mark)
    report = conform(wire)
    assert not report.identity.simulator
    assert not wire.armed_seen
    assert list(inner.boots()) == [1]
    guarded = {found.name for found in all_checks() if found.needs}
    assert guarded <= named(report, Outcome.SKIPPED)
    assert report.count(Outcome.PASSED) >= 150
    assert describe_failures(report) == ""


def test_messages_map_to_their_permissions() -> None:
    assert permission_for(command_long((1, 1), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)) == "arm"
    assert permission_for(command_long((1, 1), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, float("nan"))) == "arm"
    assert permission_for(command_long((1, 1), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)) is None
    assert permission_for(command_long((1, 1), mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)) == "reboot"
    assert permission_for(mavlink.MAVLink_log_erase_message(1, 1)) == "alter"
    assert permission_for(command_long((1, 1), mavlink.MAV_CMD_REQUEST_MESSAGE, 1)) is None


def test_ground_only_applies_to_the_simulator() -> None:
    inner = fleet(ready_s=0.0)
    vehicle = VehicleUnderTest(FleetWire(inner))
    identity = vehicle.connect()
    assert identity.simulator
    vehicle.permissions = granted_permissions(identity, frozenset({"arm"}), ground_only=True)
    report = run(vehicle, select(["arming", "flight"]))
    assert named(report, Outcome.PASSED) == set()
    assert not inner.truth().armed[0]


def test_an_unknown_autopilot_is_checked_against_the_specification_only() -> None:
    def alter(message: Any) -> list[Any]:
        if message.get_type() == "HEARTBEAT":
            message.autopilot = mavlink.MAV_AUTOPILOT_GENERIC
        return [message]

    wire = BentWire(fleet("px4", ready_s=0.0), alter)
    report = conform(wire, *GROUND, "mission", "telemetry")
    assert describe_failures(report) == ""
    habits = {
        "mission.trouble.abandoned_upload",
        "mission.readback.altitude",
        "commands.target.other_component",
    }
    assert habits <= named(report, Outcome.SKIPPED)
    assert report.count(Outcome.PASSED) >= 100


def test_a_vehicle_armed_before_the_run_is_left_alone() -> None:
    inner = fleet(ready_s=0.0)
    wire = FleetWire(inner)
    codec = mavlink.MAVLink(None, 200, 190)
    for number, *params in ((mavlink.MAV_CMD_DO_SET_MODE, 1, 4), (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)):
        wire.receive(5.0)
        wire.send(command_long((1, 1), number, *params).pack(codec))
    while not inner.truth().armed[0]:
        wire.receive(1.0)
        assert wire.now_s() < 60
    report = conform(wire, "mission", "modes", "flight")
    assert report.count(Outcome.SKIPPED) == len(report.results) > 0
    assert len(report.notes) == 1
    assert "[already-armed]" in report.notes[0]


# -- other vehicles on the link --------------------------------------------------------------------------


def arm_message(sysid: int) -> Any:
    return command_long((sysid, 1), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)


@pytest.mark.parametrize(
    "message",
    [
        arm_message(2),
        arm_message(0),
        mavlink.MAVLink_command_int_message(0, 0, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_param_set_message(2, 1, b"RTL_ALT", 900.0, 9),
        mavlink.MAVLink_mission_clear_all_message(0, 0, 0),
        mavlink.MAVLink_mission_count_message(2, 1, 3, 0),
        mavlink.MAVLink_set_mode_message(2, 1, 4),
        mavlink.MAVLink_manual_control_message(2, 0, 0, 500, 0, 0),
        mavlink.MAVLink_setup_signing_message(0, 0, bytes(32), 0),
        mavlink.MAVLink_gps_rtcm_data_message(0, 4, bytes(180)),
        mavlink.MAVLink_play_tune_message(2, 1, b"A"),
    ],
    ids=lambda message: message.get_type(),
)
def test_messages_that_change_another_vehicle_cannot_be_sent(message: Any) -> None:
    class CountingWire(FleetWire):
        sent = 0

        def send(self, data: bytes) -> None:
            self.sent += 1
            super().send(data)

    wire = CountingWire(fleet(ready_s=0.0, count=2))
    vehicle = connected(wire, sysid=1)
    sent = wire.sent
    codec = mavlink.MAVLink(None, *STATION)
    old = bytes(message.pack(codec, force_mavlink1=True)) if message.id < 256 else b""
    new = bytes(message.pack(codec))
    flagged = b"\xfd" + new[1:2] + b"\x40" + new[3:]
    for data in (new, old, b"\xfd\x90hello" + new, flagged[:-2] + crc(flagged, message)):
        if data:
            with pytest.raises(Forbidden):
                vehicle.send_raw(data)
    with pytest.raises(Forbidden):
        vehicle.send(message)
    vehicle.send_raw(new[:7])
    with pytest.raises(Forbidden):
        vehicle.send_raw(new[7:])
    assert wire.sent == sent + 1  # half a frame


def crc(frame: bytes, message: Any) -> bytes:
    return int(x25crc(frame[1:-2] + bytes([message.crc_extra])).crc).to_bytes(2, "little")


def test_only_requests_can_be_sent_before_a_vehicle_is_connected() -> None:
    vehicle = VehicleUnderTest(FleetWire(fleet(ready_s=0.0)))
    vehicle.permissions = frozenset({"arm", "simulator"})
    for sysid in (0, 1):
        with pytest.raises(Forbidden):
            vehicle.send(arm_message(sysid))
    vehicle.send(command_long((0, 0), mavlink.MAV_CMD_REQUEST_MESSAGE, 148))


def test_raw_bytes_need_the_same_permissions_as_messages() -> None:
    vehicle = VehicleUnderTest(FleetWire(fleet(ready_s=0.0)))
    vehicle.connect()
    with pytest.raises(Skip, match="--allow-arm"):
        vehicle.send_raw(vehicle.sender.pack(arm_message(1)))


def test_the_unused_system_id_is_not_on_the_link() -> None:
    wire = FleetWire(fleet(ready_s=0.0, count=20))
    vehicle = connected(wire, sysid=5)
    vehicle.wait(2.0)
    assert vehicle.unused_sysid() == 21


# -- plans without a copy --------------------------------------------------------------------------------


@pytest.mark.parametrize("patterns", [("mission.clear", "rally.upload"), ("modes",), ("robustness.flood",)])
def test_a_mission_without_a_copy_is_not_overwritten(patterns: tuple[str, ...]) -> None:
    state = {"broken": False}

    def alter(message: Any) -> list[Any]:
        if message.get_type() == "MISSION_ITEM_INT" and message.mission_type == 0 and state["broken"]:
            return []
        return without_simulator_mark(message)

    wire = BentWire(fleet(ready_s=0.0), alter)
    vehicle = connected(wire)
    items = store_mission(vehicle)
    state["broken"] = True
    report = run(vehicle, select(patterns))
    state["broken"] = False
    assert has_mission(vehicle, items)
    assert [note for note in report.notes if "mission" in note and "[plan-unsaved]" in note]
    own = [r for r in report.results if r.check.category in ("mission", "modes")]
    assert [r.outcome for r in own if r.outcome is not Outcome.SKIPPED] == [Outcome.FAILED][: len(own)]
    assert all("[plan-unsaved]" in r.seen for r in own)
    if "rally.upload" in patterns:
        assert [r for r in report.results if r.check.category == "rally" and r.outcome is Outcome.PASSED]


def test_every_category_saves_a_plan_before_writing() -> None:
    """`--only` may select each category alone."""
    for category in CATEGORIES:
        vehicle = connected(FleetWire(fleet(ready_s=0.0)))
        items = store_mission(vehicle, 4)
        report = run(vehicle, [c for c in select([category]) if not c.airborne and c.kind is None][:12])
        assert [r.check.name for r in report.results if "[plan-unsaved]" in r.seen] == []
        assert has_mission(vehicle, items), category


# -- the end of a run ------------------------------------------------------------------------------------


class InterruptingWire(FleetWire):
    """A wire that raises Ctrl-C in the air and again during the landing."""

    remaining = 1

    def receive(self, timeout_s: float) -> bytes | None:
        if self.remaining and self.fleet.truth().height_m[0] > 10:
            self.remaining -= 1
            raise KeyboardInterrupt
        return super().receive(timeout_s)


@pytest.mark.parametrize("times", [1, 2])
def test_an_interrupted_flight_ends_on_the_ground(times: int) -> None:
    inner = fleet(ready_s=0.0)
    wire = InterruptingWire(inner)
    wire.remaining = times
    interrupts: list[int] = []
    report = run(connected(wire), select(["flight.hold"]), on_interrupt=lambda: interrupts.append(1))
    assert report.interrupted
    assert report.notes == ()
    assert len(interrupts) == times
    assert not inner.truth().airborne[0]
    assert not inner.truth().armed[0]


def test_repeated_interrupts_end_the_landing_with_a_note() -> None:
    wire = InterruptingWire(fleet(ready_s=0.0))
    wire.remaining = 99
    report = run(connected(wire), select(["flight.hold"]))
    assert report.interrupted
    assert any("[not-restored]" in note for note in report.notes)


def test_a_failed_restoring_does_not_hide_an_interrupt() -> None:
    class MutedWire(FleetWire):
        dead = False

        def send(self, data: bytes) -> None:
            if not self.dead:
                super().send(data)

    wire = MutedWire(fleet(ready_s=0.0))

    def interrupted(vehicle: VehicleUnderTest) -> str:
        with parameters.changed(vehicle, "RTL_ALT", 1600):
            wire.dead = True
            raise KeyboardInterrupt

    report = run(connected(wire), [one_check(interrupted), *select(["heartbeat"])])
    assert report.interrupted
    assert report.results == ()
    assert any("RTL_ALT" in note and "[not-restored]" in note for note in report.notes)


def test_a_flight_ends_on_the_ground_when_the_output_is_closed() -> None:
    def closed_output(_result: Any) -> None:
        raise BrokenPipeError

    inner = fleet(ready_s=0.0)
    with pytest.raises(BrokenPipeError):
        run(connected(FleetWire(inner)), select(["flight.hold"]), on_result=closed_output)
    assert not inner.truth().airborne[0]
    assert not inner.truth().armed[0]


class OutageWire(FleetWire):
    """A wire that loses all messages for `lasts_s` [s] after the vehicle reaches `up_m` [m]."""

    def __init__(self, inner: Any, *, up_m: float, lasts_s: float) -> None:
        super().__init__(inner)
        self._up_m, self._lasts_s, self._began_s = up_m, lasts_s, math.inf

    @property
    def _open(self) -> bool:
        if self._began_s == math.inf and self.fleet.truth().height_m[0] > self._up_m:
            self._began_s = self.now_s()
        return not self._began_s <= self.now_s() < self._began_s + self._lasts_s

    def send(self, data: bytes) -> None:
        if self._open:
            super().send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        data = super().receive(timeout_s)
        return data if self._open else None


def test_a_vehicle_is_landed_and_restored_after_an_outage() -> None:
    inner = fleet(ready_s=0.0)
    vehicle = connected(OutageWire(inner, up_m=10.0, lasts_s=120.0))
    items, capacity = store_mission(vehicle), parameters.read(vehicle, "BATT_CAPACITY").value
    report = run(vehicle, select(["flight.hold", "flight.return"]))
    assert report.count(Outcome.FAILED) >= 1
    assert report.count(Outcome.PASSED) >= 1  # after the outage the run goes on
    assert report.notes == ()
    assert not inner.truth().airborne[0]
    assert not inner.truth().armed[0]
    assert has_mission(vehicle, items)
    assert parameters.read(vehicle, "BATT_CAPACITY").value == capacity


@pytest.mark.full
def test_the_report_lists_unrestored_changes_of_a_lost_vehicle() -> None:
    report = conform(OutageWire(fleet(ready_s=0.0), up_m=10.0, lasts_s=math.inf), "flight.hold")
    assert any("[vehicle-lost]" in note and "BATT_CAPACITY, mission" in note for note in report.notes)


def test_a_parameter_is_restored_after_the_time_limit_on_a_lossy_link() -> None:
    state = {"late": False, "lost": 0}

    def unsaved(message: Any) -> bool:
        if state["late"] and message.get_type() == "PARAM_SET" and state["lost"] < 2:
            state["lost"] += 1
            return True
        return False

    def too_slow(vehicle: VehicleUnderTest) -> str:
        with parameters.changed(vehicle, "RTL_ALT", 1600):
            state["late"] = True
            vehicle.wait(CHECK_S + 60.0)
        return "never"

    vehicle = connected(DroppingWire(fleet(ready_s=0.0), unsaved))
    before = parameters.read(vehicle, "RTL_ALT").value
    report = run(vehicle, [one_check(too_slow)])
    assert len(report.results) == 1
    assert "[time-limit]" in report.results[0].seen
    assert state["lost"] == 2
    assert report.notes == ()
    vehicle.begin_check()
    assert parameters.read(vehicle, "RTL_ALT").value == before


def test_a_vehicle_that_falls_silent_ends_the_run() -> None:
    class EndingWire(FleetWire):
        def receive(self, timeout_s: float) -> bytes | None:
            data = super().receive(timeout_s)
            return data if self.now_s() < 30 else None

    report = conform(EndingWire(fleet(ready_s=0.0)), "heartbeat", "version")
    assert not report.passed
    assert any("[vehicle-silent]" in note for note in report.notes)
    assert len(report.results) == len(select(["heartbeat", "version"]))


# -- the command -----------------------------------------------------------------------------------------


def command(*arguments: str) -> Any:
    app = typer.Typer()
    app.command()(conformance)
    return CliRunner().invoke(app, list(arguments), env={"COLUMNS": "100"})


def test_the_checks_can_be_listed() -> None:
    result = command("--list", "--only", "rally")
    assert result.exit_code == 0
    assert "read_back" in result.output
    assert f"{len(select(['rally']))} checks" in result.output
    assert max(len(line) for line in result.output.splitlines()) <= 100


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["carrier-pigeon"], "carrier-pigeon"),
        (["--only", "nonsense", "udpin:127.0.0.1:14599"], "nonsense"),
        ([], "URL"),
    ],
)
def test_a_bad_argument_is_named(arguments: list[str], found: str) -> None:
    result = command(*arguments)
    assert result.exit_code == 2
    assert found in result.output


def test_a_cameras_heartbeat_is_not_the_vehicles() -> None:
    def with_camera(message: Any) -> list[Any]:
        if message.get_type() != "HEARTBEAT":
            return [message]
        camera = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        return [message, camera]

    vehicle = connected(BentWire(fleet(), with_camera))
    assert vehicle.heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
