"""Runs of scenarios: shipped scenarios, verdicts, exit codes, files, steps of the ground station."""

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
from pymavlink import mavutil
from typer.testing import CliRunner, Result

from sim_vehicle.epoch import EPOCH_US
from sim_vehicle.scenarios import load_scenario
from sim_vehicle.scenarios.command import FOLDER, run, shipped
from sim_vehicle.scenarios.file import parse_scenario
from sim_vehicle.scenarios.runner import Run, Verdict

HOME = "home: {lat_deg: 46.0490, lon_deg: 14.5060, alt_amsl_m: 300}\nready_s: 0\n"
HOP = (
    HOME
    + """
vehicles:
  - {}
  - {personality: px4, east_m: 20}
script:
  - takeoff: 8
  - {at_s: 14, land: }
checks:
  - no_crash
  - landed
  - max_height_m: 12
until_s: 60
"""
)
# The same without a landing, and so much shorter.
HOVER = (
    HOP.replace("until_s: 60", "until_s: 10")
    .replace("  - {at_s: 14, land: }\n", "")
    .replace("  - landed\n", "")
)
app = typer.Typer(add_completion=False, rich_markup_mode=None)
app.command()(run)


def flown(text: str, **changes: Any) -> Verdict:
    return Run(parse_scenario(text, "test.yaml").model_copy(update=changes)).run()


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


# -- the shipped scenarios -------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.virtual
@pytest.mark.parametrize("path", shipped().values(), ids=shipped())
def test_a_shipped_scenario_passes(path: Path) -> None:
    lines: list[str] = []
    assert Run(load_scenario(path), on_failure=lines.append).run().passed, lines


@pytest.mark.full
@pytest.mark.virtual
@pytest.mark.parametrize("name", ["gps_loss_in_auto", "battery_failsafe", "motor_loss", "reboot_in_flight"])
def test_a_scenario_fails_without_its_faults(name: str) -> None:
    scenario = load_scenario(FOLDER / f"{name}.yaml").model_copy(update={"faults": ()})
    assert not Run(scenario).run().passed


def test_scenarios_and_checks_are_listed_with_their_descriptions_in_a_line_each() -> None:
    listed = invoke("--list", "--list-checks")
    assert listed.exit_code == 0
    assert all(line[0] != " " and (": " in line) for line in listed.stdout.splitlines())
    assert all(f"{name}: {load_scenario(path).about}" in listed.output for name, path in shipped().items())
    assert "min_separation_m" in listed.output


def test_a_shipped_scenario_can_be_printed() -> None:
    shown = invoke("--show", "clean_mission")
    assert (shown.exit_code, shown.output) == (0, (FOLDER / "clean_mission.yaml").read_text())
    unknown = invoke("--show", "clean_misson")
    assert unknown.exit_code == 2
    assert "clean_mission" in " ".join(unknown.output.split())


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("count: 1", "`checks`"),
        ("vehicles: [{mission: [takeoff: 5, rtl]}]\nchecks: [alive]", "`script: [fly_mission]`"),
        ("vehicles:\n- count: 2\n  mission: [takeoff: 5, rtl]\nscript: [{fly_mission: , vehicles: [2]}]",
         "hop.yaml:5: vehicles.0.mission: "),
        ("count: 1\nname: ../../mix\nchecks: [alive]", "name: "),
        ("count: 1\nname: ..\nchecks: [alive]", "name: "),
    ],
)  # fmt: skip
def test_an_idle_run_and_a_bad_name_are_refused(hop: Path, tmp_path: Path, text: str, found: str) -> None:
    hop.write_text(HOME + text)
    done = invoke(hop, "--out", tmp_path / "out" / "deep")
    assert done.exit_code == 2
    assert found in done.output
    assert list(tmp_path.iterdir()) == [hop]


# -- verdict, exit code, files ---------------------------------------------------------------------------


@pytest.fixture
def hop(tmp_path: Path) -> Path:
    path = tmp_path / "hop.yaml"
    path.write_text(HOP)
    return path


def test_a_passed_run_exits_with_0_and_leaves_its_files(hop: Path, tmp_path: Path) -> None:
    done = invoke(hop, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    folder = tmp_path / "out" / "hop"
    assert sorted(path.name for path in folder.iterdir()) == [
        "vehicle-1.tlog",
        "vehicle-2.tlog",
        "verdict.json",
    ]
    verdict = json.loads((folder / "verdict.json").read_text())
    assert verdict["passed"] is True
    assert [vehicle["flown_m"] > 14 for vehicle in verdict["vehicles"]] == [True, True]
    assert verdict["simulated_s"] < 50  # before `until_s`, because all have landed


def test_a_failed_run_exits_with_1_and_its_command_repeats_it(hop: Path, tmp_path: Path) -> None:
    hop.write_text(HOVER.replace("max_height_m: 12", "max_height_m: 3"))
    first = invoke(hop, "--out", tmp_path / "first", "--seed", 77)
    assert first.exit_code == 1
    assert "vehicle 2: max_height_m 3: failed, found 3." in first.output
    (command,) = [line for line in first.output.splitlines() if "python -m sim_vehicle run" in line]
    words = shlex.split(command[command.index("python") :])
    assert words[:4] == ["python", "-m", "sim_vehicle", "run"]
    assert words[-2:] == ["--seed", "77"]
    again = invoke(*words[4:], "--out", tmp_path / "again")
    assert again.exit_code == 1
    for name in ("vehicle-1.tlog", "vehicle-2.tlog", "verdict.json"):
        assert (tmp_path / "first/hop" / name).read_bytes() == (tmp_path / "again/hop" / name).read_bytes()


def test_one_failed_scenario_fails_the_run(hop: Path, tmp_path: Path) -> None:
    hop.write_text(HOVER)
    bad = tmp_path / "low.yaml"
    bad.write_text(HOVER.replace("max_height_m: 12", "max_height_m: 1"))
    done = invoke(bad, hop, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "hop: passed" in done.output
    assert "low: FAILED" in done.output


def test_a_bad_scenario_exits_with_2_before_anything_is_flown(hop: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text(HOP.replace("no_crash", "no_crsh"))
    done = invoke(hop, bad, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "bad.yaml:11: checks.0.no_crsh: unknown key" in done.output
    assert not (tmp_path / "out").exists()
    assert invoke().exit_code == 2
    assert invoke("no such file.yaml").exit_code == 2


@pytest.mark.interop
def test_speedup_paces_the_run(hop: Path, tmp_path: Path) -> None:
    hop.write_text(HOVER)
    done = invoke(hop, "--out", tmp_path / "out", "--speedup", 40)
    took_s = float(done.output.split("simulated in ")[1].split(" s")[0])
    assert took_s >= 0.25


# -- tlogs -----------------------------------------------------------------------------------------------


def test_mavutil_reads_a_tlog(hop: Path, tmp_path: Path) -> None:
    hop.write_text(HOVER + "faults: [sik_radio]\n")
    invoke(hop, "--out", tmp_path / "out")
    log = mavutil.mavlink_connection(str(tmp_path / "out/hop/vehicle-1.tlog"))
    read = []
    while (message := log.recv_match()) is not None:
        read.append(message)
    log.close()
    kinds = {message.get_type() for message in read}
    assert {"HEARTBEAT", "GLOBAL_POSITION_INT", "COMMAND_LONG", "COMMAND_ACK", "RADIO_STATUS"} <= kinds
    assert not {kind for kind in kinds if kind.startswith(("BAD_DATA", "UNKNOWN"))}
    assert {message.get_srcSystem() for message in read} == {1, 255, ord("3")}
    times = [message._timestamp for message in read]
    assert times == sorted(times)
    assert times[0] == pytest.approx(EPOCH_US / 1e6, abs=2)
    assert 8 < times[-1] - times[0] < 11


# -- the ground station's steps --------------------------------------------------------------------------


def test_a_permanent_refusal_fails_the_run() -> None:
    script = "script: [{command: {command: NAV_TAKEOFF, params: [0, 0, 0, 0, 0, 0, 9]}, timeout_s: 5}]"
    verdict = flown(HOME + "count: 1\n" + script + "\nuntil_s: 30")
    assert not verdict.passed
    (step,) = verdict.steps_failed
    assert (step.action, step.sysid, step.text.split(";")[0]) == ("command", 1, "FAILED")


def test_an_expected_refusal_passes() -> None:
    refused = "{command: {command: DO_PARACHUTE}, expect: refused}"
    accepted = "{mode: GUIDED, expect: refused, timeout_s: 5}"
    verdict = flown(HOME + f"count: 1\nscript: [{refused}, {accepted}]\nuntil_s: 30")
    assert [step.action for step in verdict.steps_failed] == ["mode"]
    assert "[not-refused]" in verdict.steps_failed[0].text


def test_a_step_without_an_answer_fails_after_its_time() -> None:
    script = "script: [{at_s: 5, disarm: , timeout_s: 4}]\nfaults: ['link_outage:at=4.5']"
    (step,) = flown(HOME + "count: 1\n" + script + "\nuntil_s: 30").steps_failed
    assert "[no-answer]" in step.text
    assert step.t_s == pytest.approx(9, abs=0.2)


@pytest.mark.parametrize(
    ("personality", "name", "value"),
    [
        ("ardupilot", "RTL_ALT", 2500),
        ("ardupilot", "WPNAV_SPEED", 512.5),
        ("px4", "RTL_RETURN_ALT", 22.5),
        ("px4", "NAV_DLL_ACT", 2),
    ],
)
def test_a_parameter_is_set_in_the_autopilots_encoding(personality: str, name: str, value: float) -> None:
    text = (
        HOME
        + f"vehicles: [{{personality: {personality}}}]\nscript: [{{param: {{{name}: {value}}}}}]\nuntil_s: 12"
    )
    flight = Run(parse_scenario(text, "test.yaml"))
    assert flight.run().passed
    assert flight.fleet.vehicles[0].params[name] == value


def test_an_unfinished_step_is_a_failure() -> None:
    verdict = flown(HOME + "count: 1\nscript: [{at_s: 9.9, reboot: }]\nuntil_s: 10\nfaults: [absent_ack]")
    assert [step.action for step in verdict.steps_failed] == ["reboot"]
    assert "[unfinished]" in verdict.steps_failed[0].text


def test_a_run_continues_until_all_checks_are_decided() -> None:
    watched = HOP.replace("- no_crash", "- no_crash: {from_s: 70}").replace("until_s: 60", "until_s: 300")
    assert 70 <= flown(watched).simulated_s < 80
