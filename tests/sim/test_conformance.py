"""The conformance suite on the virtual clock: the simulator passes, what is not allowed is not done."""

import json
from typing import Any

import pytest
import typer
from bent_vehicle import GROUND, BentWire, conform, fleet, named, told
from fleet_wire import FleetWire
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner

from sim_vehicle.conformance import parameters, plans
from sim_vehicle.conformance.cli import conformance
from sim_vehicle.conformance.guard import permission_for
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import CATEGORIES, all_checks, check, select
from sim_vehicle.conformance.report import as_json
from sim_vehicle.conformance.runner import Outcome, permissions, run

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
    peer = Peer(FleetWire(fleet(ready_s=0.0)))
    peer.permits = set(permissions(peer.meet(), frozenset(), ground_only=False))
    items, capacity = plans.sample_plan(peer, 6), parameters.read(peer, "BATT_CAPACITY").value
    plans.put(peer, items)
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


def test_an_interrupted_flight_is_ended_on_the_ground() -> None:
    class Interrupted(FleetWire):
        once = True

        def receive(self, timeout_s: float) -> bytes | None:
            if self.once and self.fleet.truth().height_m[0] > 10:
                self.once = False
                raise KeyboardInterrupt
            return super().receive(timeout_s)

    inner = fleet(ready_s=0.0)
    report = conform(Interrupted(inner), "flight.hold")
    assert report.interrupted
    assert not inner.truth().airborne[0]
    assert not inner.truth().armed[0]


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
