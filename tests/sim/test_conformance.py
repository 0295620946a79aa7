"""The conformance suite on the virtual clock: the simulator passes, what is not allowed is not done."""

import json
import math
from typing import Any

import pytest
import typer
from bent_vehicle import GROUND, BentWire, Obstinate, conform, fleet, met, named, told
from fleet_wire import FleetWire
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc
from typer.testing import CliRunner

from sim_vehicle.conformance import flying, parameters, plans
from sim_vehicle.conformance.cli import conformance
from sim_vehicle.conformance.guard import Forbidden, permission_for
from sim_vehicle.conformance.peer import STATION, Peer
from sim_vehicle.conformance.registry import CATEGORIES, Check, all_checks, check, select
from sim_vehicle.conformance.report import as_json
from sim_vehicle.conformance.runner import Outcome, permissions, run
from sim_vehicle.conformance.words import Skip

VEHICLES = [(name, kind) for name in ("ardupilot", "px4") for kind in ("copter", "plane")]


# -- the registry ----------------------------------------------------------------------------------------


def test_there_are_at_least_150_checks_with_unique_names_and_a_sentence_each() -> None:
    checks = all_checks()
    assert len(checks) >= 150
    assert len({found.name for found in checks}) == len(checks)
    assert {found.category for found in checks} == set(CATEGORIES)
    assert [found.name for found in checks if not found.says.endswith((".", "?"))] == []


def test_a_name_is_given_once_and_a_need_is_a_known_one() -> None:
    with pytest.raises(ValueError, match=r"two checks are named 'heartbeat\.arrives'"):
        all_checks() and check("heartbeat.arrives")
    with pytest.raises(ValueError, match="needs"):
        check("heartbeat.new", needs=["money"])
    with pytest.raises(ValueError, match=r"no CATEGORY\.NAME"):
        check("nothing.new")


def test_a_pattern_is_a_category_a_beginning_or_a_shell_pattern() -> None:
    assert {found.category for found in select(["fence"])} == {"fence"}
    assert {found.name.rpartition(".")[0] for found in select(["mission.upload"])} == {"mission.upload"}
    assert all("unknown" in found.name for found in select(["*unknown*"]))
    with pytest.raises(ValueError, match=r"no check fits 'nonsense'.*--list"):
        select(["nonsense"])


def has_a_mission(peer: Peer, items: list[plans.Item]) -> None:
    """The vehicle's own, from before anybody examined it."""
    peer.saved.add(plans.MISSION)
    plans.put(peer, items)
    peer.saved.clear()


def one_check(function: Any, *, category: str = "parameters", limit_s: float = 60.0) -> Check:
    """A check that is in no registry."""
    return Check(f"{category}.made_up", function, frozenset(), (), frozenset(), None, False, "", limit_s)


# -- the simulator passes --------------------------------------------------------------------------------


@pytest.mark.virtual
@pytest.mark.parametrize(("personality", "kind"), VEHICLES)
def test_the_simulator_passes_everything(personality: str, kind: str) -> None:
    report = conform(FleetWire(fleet(personality, kind)))
    assert told(report) == ""
    assert report.notes == ()
    assert len(report.results) == len(all_checks())
    assert report.count(Outcome.PASSED) >= 150
    assert [r.check.name for r in report.results if "battery is at" in r.seen] == []


def test_two_runs_are_equal() -> None:
    first, second = (as_json(conform(FleetWire(fleet(ready_s=0.0)), *GROUND), "") for _ in range(2))
    assert first == second
    assert json.loads(first)["counts"]["failed"] == 0


def test_the_plans_and_the_battery_of_before_are_put_back() -> None:
    peer = met(FleetWire(fleet(ready_s=0.0)))
    items, capacity = plans.sample_plan(peer, 6), parameters.read(peer, "BATT_CAPACITY").value
    has_a_mission(peer, items)
    report = run(
        peer, select(["mission.upload.one_item", "mission.clear.empties", "flight.status_is_active"])
    )
    assert report.count(Outcome.PASSED) == 3
    assert report.notes == ()
    peer.fresh()
    assert plans.body(peer, plans.download(peer)) == plans.body(peer, items)
    assert parameters.read(peer, "BATT_CAPACITY").value == capacity
    assert not peer.armed


# -- what is not allowed is not done ---------------------------------------------------------------------


def a_real_one(message: Any) -> list[Any]:
    """Hide who the simulator is."""
    if message.get_type() == "AUTOPILOT_VERSION":
        message.uid2 = bytes(18)
        message.uid = 7
    return [message]


@pytest.mark.virtual
def test_a_vehicle_that_is_not_the_simulator_is_not_armed_rebooted_or_altered() -> None:
    inner = fleet(ready_s=0.0)
    wire = BentWire(inner, a_real_one)
    report = conform(wire)
    assert not report.facts.simulator
    assert not wire.armed_seen
    assert list(inner.boots()) == [1]
    guarded = {found.name for found in all_checks() if found.needs}
    assert guarded <= named(report, Outcome.SKIPPED)
    assert report.count(Outcome.PASSED) >= 150
    assert told(report) == ""


def test_permission_is_asked_for_what_it_is_needed_for() -> None:
    def long(command: int, *params: float) -> Any:
        return mavlink.MAVLink_command_long_message(1, 1, command, 0, *params, *[0.0] * (7 - len(params)))

    assert permission_for(long(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)) == "arm"
    assert permission_for(long(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, float("nan"))) == "arm"
    assert permission_for(long(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)) is None
    assert permission_for(long(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)) == "reboot"
    assert permission_for(mavlink.MAVLink_log_erase_message(1, 1)) == "alter"
    assert permission_for(long(mavlink.MAV_CMD_REQUEST_MESSAGE, 1)) is None


def test_ground_only_holds_for_the_simulator_too() -> None:
    inner = fleet(ready_s=0.0)
    peer = Peer(FleetWire(inner))
    facts = peer.meet()
    assert facts.simulator
    peer.permits = set(permissions(facts, frozenset({"arm"}), ground_only=True))
    report = run(peer, select(["arming", "flight"]))
    assert named(report, Outcome.PASSED) == set()
    assert not inner.truth().armed[0]


def test_an_autopilot_nobody_knows_is_held_to_the_specification() -> None:
    def bend(message: Any) -> list[Any]:
        if message.get_type() == "HEARTBEAT":
            message.autopilot = mavlink.MAV_AUTOPILOT_GENERIC
        return [message]

    wire = BentWire(fleet("px4", ready_s=0.0), bend)
    report = conform(wire, *GROUND, "mission", "telemetry", "robustness")
    assert told(report) == ""
    habits = {
        "mission.trouble.abandoned_upload",
        "mission.readback.altitude",
        "commands.target.other_component",
    }
    assert habits <= named(report, Outcome.SKIPPED)
    assert report.count(Outcome.PASSED) >= 100


def test_a_vehicle_that_somebody_flies_is_left_alone() -> None:
    inner = fleet(ready_s=0.0)
    wire = FleetWire(inner)
    codec = mavlink.MAVLink(None, 200, 190)
    for command, param1, param2 in (
        (mavlink.MAV_CMD_DO_SET_MODE, 1, 4),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0),
    ):
        wire.receive(5.0)
        wire.send(
            mavlink.MAVLink_command_long_message(1, 1, command, 0, param1, param2, *[0.0] * 5).pack(codec)
        )
    while not inner.truth().armed[0]:
        wire.receive(1.0)
        assert wire.now_s() < 60
    report = conform(wire, "mission", "modes", "flight")
    assert report.count(Outcome.SKIPPED) == len(report.results) > 0
    assert report.notes == ("the vehicle was armed before the suite began",)


# -- other vehicles on the link --------------------------------------------------------------------------


@pytest.mark.virtual
@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
def test_another_vehicle_on_the_link_stays_as_it_is(personality: str) -> None:
    class Watched(FleetWire):
        armed_seen = False

        def receive(self, timeout_s: float) -> bytes | None:
            self.armed_seen |= bool(self.fleet.truth().armed[1])
            return super().receive(timeout_s)

    inner = fleet(personality, ready_s=0.0, count=2)
    wire = Watched(inner)
    other = met(wire, sysid=2)
    has_a_mission(other, items := plans.sample_plan(other))
    flying.ready_mode(other)
    before, mode = parameters.fetch_all(other), other.mode
    report = run(met(wire, sysid=1), all_checks())
    assert [r.check.name for r in report.results if "Forbidden" in r.seen] == []
    assert report.count(Outcome.PASSED) >= 150
    assert not wire.armed_seen
    assert inner.boots()[1] == 1
    other = met(wire, sysid=2)
    assert parameters.fetch_all(other) == before
    assert plans.body(other, plans.download(other)) == plans.body(other, items)
    assert other.mode == mode


def arm_message(sysid: int) -> Any:
    return mavlink.MAVLink_command_long_message(sysid, 1, 400, 0, 1, *[0.0] * 6)


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
def test_nothing_that_changes_another_vehicle_can_be_sent(message: Any) -> None:
    class Deaf(FleetWire):
        sent = 0

        def send(self, data: bytes) -> None:
            self.sent += 1
            super().send(data)

    wire = Deaf(fleet(ready_s=0.0, count=2))
    peer = met(wire, sysid=1)
    sent = wire.sent
    codec = mavlink.MAVLink(None, *STATION)
    old = bytes(message.pack(codec, force_mavlink1=True)) if message.id < 256 else b""
    new = bytes(message.pack(codec))
    flagged = b"\xfd" + new[1:2] + b"\x40" + new[3:]
    for data in (new, old, b"\xfd\x90hello" + new, flagged[:-2] + crc(flagged, message)):
        if data:
            with pytest.raises(Forbidden):
                peer.send_raw(data)
    with pytest.raises(Forbidden):
        peer.send(message)
    peer.send_raw(new[:7])
    with pytest.raises(Forbidden):
        peer.send_raw(new[7:])
    assert wire.sent == sent + 1  # half a frame


def crc(frame: bytes, message: Any) -> bytes:
    return int(x25crc(frame[1:-2] + bytes([message.crc_extra])).crc).to_bytes(2, "little")


def test_nothing_but_questions_is_sent_before_a_vehicle_is_met() -> None:
    peer = Peer(FleetWire(fleet(ready_s=0.0)), permits=("arm", "simulator"))
    for sysid in (0, 1):
        with pytest.raises(Forbidden):
            peer.send(arm_message(sysid))
    peer.send(mavlink.MAVLink_command_long_message(0, 0, 512, 0, 148, *[0.0] * 6))


def test_bytes_are_held_to_the_permissions_as_messages_are() -> None:
    peer = Peer(FleetWire(fleet(ready_s=0.0)))
    peer.meet()
    with pytest.raises(Skip, match="--allow-arm"):
        peer.send_raw(peer.pack(arm_message(1)))


def test_a_stranger_is_a_system_nobody_has_heard() -> None:
    wire = FleetWire(fleet(ready_s=0.0, count=20))
    peer = met(wire, sysid=5)
    peer.wait(2.0)
    assert peer.stranger() == 21


# -- a plan of which there is no copy --------------------------------------------------------------------


@pytest.mark.parametrize("patterns", [("mission.clear", "rally.upload"), ("modes",), ("robustness.flood",)])
def test_a_mission_that_could_not_be_saved_is_not_overwritten(patterns: tuple[str, ...]) -> None:
    state = {"broken": False}

    def bend(message: Any) -> list[Any]:
        if message.get_type() == "MISSION_ITEM_INT" and message.mission_type == 0 and state["broken"]:
            return []
        return a_real_one(message)

    wire = BentWire(fleet(ready_s=0.0), bend)
    peer = met(wire)
    items = plans.sample_plan(peer, 6)
    has_a_mission(peer, items)
    state["broken"] = True
    report = run(peer, select(patterns))
    state["broken"] = False
    peer.fresh()
    assert plans.body(peer, plans.download(peer)) == plans.body(peer, items)
    assert [note for note in report.notes if "the mission could not be saved" in note]
    own = [r for r in report.results if r.check.category in ("mission", "modes")]
    assert [r.outcome for r in own if r.outcome is not Outcome.SKIPPED] == [Outcome.FAILED][: len(own)]
    assert all("could not be saved" in r.seen for r in own)
    if "rally.upload" in patterns:
        assert [r for r in report.results if r.check.category == "rally" and r.outcome is Outcome.PASSED]


def test_every_category_that_writes_a_plan_saves_it_first() -> None:
    """`--only` may name any one of them."""
    for category in CATEGORIES:
        peer = met(FleetWire(fleet(ready_s=0.0)))
        items = plans.sample_plan(peer, 4)
        has_a_mission(peer, items)
        report = run(peer, [c for c in select([category]) if c.limit_s <= 120 and not c.airborne][:12])
        assert [r.check.name for r in report.results if "could not be saved" in r.seen] == []
        peer.fresh()
        assert plans.body(peer, plans.download(peer)) == plans.body(peer, items), category


# -- however a run ends ----------------------------------------------------------------------------------


class Interrupted(FleetWire):
    """Ctrl-C in the air, and again while it comes down."""

    left = 1

    def receive(self, timeout_s: float) -> bytes | None:
        if self.left and self.fleet.truth().height_m[0] > 10:
            self.left -= 1
            raise KeyboardInterrupt
        return super().receive(timeout_s)


@pytest.mark.parametrize("times", [1, 2, 3])
def test_an_interrupted_flight_is_ended_on_the_ground(times: int) -> None:
    inner = fleet(ready_s=0.0)
    wire = Interrupted(inner)
    wire.left = times
    said: list[int] = []
    report = run(met(wire), select(["flight.hold"]), on_interrupt=lambda: said.append(1))
    assert report.interrupted
    assert report.notes == ()
    assert len(said) == times
    assert not inner.truth().airborne[0]
    assert not inner.truth().armed[0]


def test_who_interrupts_the_landing_again_and_again_is_obeyed_and_told() -> None:
    wire = Interrupted(fleet(ready_s=0.0))
    wire.left = 99
    report = run(met(wire), select(["flight.hold"]))
    assert report.interrupted
    assert any("it may fly" in note for note in report.notes)


def test_clean_up_that_fails_does_not_hide_an_interrupt() -> None:
    class Dead(FleetWire):
        dead = False

        def send(self, data: bytes) -> None:
            if not self.dead:
                super().send(data)

    wire = Dead(fleet(ready_s=0.0))

    def interrupted(peer: Peer) -> str:
        with parameters.changed(peer, "RTL_ALT", 1600):
            wire.dead = True
            raise KeyboardInterrupt

    report = run(met(wire), [one_check(interrupted), *select(["heartbeat"])])
    assert report.interrupted
    assert report.results == ()
    assert any("RTL_ALT could not be put back" in note for note in report.notes)


def test_a_flight_that_nobody_can_be_told_of_ends_on_the_ground() -> None:
    def nobody_reads(_result: Any) -> None:
        raise BrokenPipeError

    inner = fleet(ready_s=0.0)
    with pytest.raises(BrokenPipeError):
        run(met(FleetWire(inner)), select(["flight.hold"]), on_result=nobody_reads)
    assert not inner.truth().airborne[0]
    assert not inner.truth().armed[0]


class Gap(FleetWire):
    """Neither way gets anything through from the moment it is `up_m` high on, for so long."""

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


@pytest.mark.parametrize(("up_m", "lasts_s"), [(1.0, 120.0), (10.0, 120.0), (19.5, 50.0)])
def test_a_vehicle_that_is_heard_again_is_brought_down_and_put_back(up_m: float, lasts_s: float) -> None:
    inner = fleet(ready_s=0.0)
    peer = met(Gap(inner, up_m=up_m, lasts_s=lasts_s))
    items, capacity = plans.sample_plan(peer, 6), parameters.read(peer, "BATT_CAPACITY").value
    has_a_mission(peer, items)
    report = run(peer, select(["flight.hold", "flight.return"]))
    assert any("fell silent" in note for note in report.notes)
    assert len(report.notes) == 1
    assert not inner.truth().airborne[0]
    assert not inner.truth().armed[0]
    peer.fresh()
    assert plans.body(peer, plans.download(peer)) == plans.body(peer, items)
    assert parameters.read(peer, "BATT_CAPACITY").value == capacity


def test_of_a_vehicle_that_stays_silent_is_said_what_is_left_of_it() -> None:
    report = conform(Gap(fleet(ready_s=0.0), up_m=10.0, lasts_s=math.inf), "flight.hold")
    assert any("last it was armed" in note and "BATT_CAPACITY, mission" in note for note in report.notes)


def test_a_parameter_is_put_back_though_time_is_up_and_the_link_loses_it() -> None:
    state = {"late": False, "lost": 0}

    def lost(message: Any) -> bool:
        if state["late"] and message.get_type() == "PARAM_SET" and state["lost"] < 2:
            state["lost"] += 1
            return True
        return False

    def too_slow(peer: Peer) -> str:
        with parameters.changed(peer, "RTL_ALT", 1600):
            state["late"] = True
            peer.wait(100.0)
        return "never"

    peer = met(Obstinate(fleet(ready_s=0.0), lost))
    before = parameters.read(peer, "RTL_ALT").value
    report = run(peer, [one_check(too_slow, limit_s=10.0)])
    assert [result.seen for result in report.results] == ["not done in time"]
    assert state["lost"] == 2
    assert report.notes == ()
    peer.fresh()
    assert parameters.read(peer, "RTL_ALT").value == before


def test_a_vehicle_that_falls_silent_ends_the_run() -> None:
    class Dying(FleetWire):
        def receive(self, timeout_s: float) -> bytes | None:
            data = super().receive(timeout_s)
            return data if self.now_s() < 30 else None

    report = conform(Dying(fleet(ready_s=0.0)), "heartbeat", "version")
    assert not report.passed
    assert any("fell silent" in note for note in report.notes)
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
    ("arguments", "words"),
    [
        (["carrier-pigeon"], "is not understood"),
        (["--only", "nonsense", "udpin:127.0.0.1:14599"], "no check fits"),
        ([], "a URL is needed"),
    ],
)
def test_bad_input_is_said_in_words(arguments: list[str], words: str) -> None:
    result = command(*arguments)
    assert result.exit_code == 2
    assert words in result.output
