"""The basis of a verdict: flown goals and missions, evaluated checks, assembled texts, readiness."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.scenarios.file import parse_scenario
from sim_vehicle.scenarios.runner import Run, Verdict
from sim_vehicle.station.messages import GAP, StatusTexts

HOME = "home: {lat_deg: 46.0490, lon_deg: 14.5060, alt_amsl_m: 300}\nready_s: 0\n"
BOTH = pytest.mark.parametrize("personality", ["ardupilot", "px4"])


def flown(text: str, **changes: Any) -> Verdict:
    return Run(parse_scenario(HOME + text, "test.yaml").model_copy(update=changes)).run()


def verdicts(verdict: Verdict) -> dict[str, bool]:
    assert not verdict.steps_failed, verdict.steps_failed
    return {check.check: check.passed for check in verdict.checks}


def at(height_m: float, east_m: float) -> str:
    return f"{{waypoint: {{east_m: {east_m}, north_m: 0, height_m: {height_m}}}}}"


# -- evaluation ------------------------------------------------------------------------------------------


def test_a_check_after_the_end_of_the_run_fails() -> None:
    text = "count: 1\nchecks: [max_height_m: {metres: 1, from_s: 20}, no_crash: {from_s: 3, until_s: 4}]"
    verdict = flown(text, until_s=5.0)
    assert verdicts(verdict) == {"max_height_m 1, from 20 s": False, "no_crash, from 3 s, until 4 s": True}
    assert "[not-evaluated]" in verdict.checks[0].failures[0].found


# -- goals -----------------------------------------------------------------------------------------------

ROUND = f"mission: [takeoff: 10, {at(10, 60)}, {at(10, 0)}, land]"


def test_a_goal_at_the_start_is_reached_by_returning() -> None:
    verdict = flown(
        f"vehicles: [{{{ROUND}}}]\nscript: [fly_mission]\n"
        "checks: [reached_goal: {within_m: 3, by_s: 16}, reached_goal: {within_m: 3}, airborne: {by_s: 16}]\n"
        "until_s: 120"
    )
    assert verdicts(verdict) == {
        "reached_goal 3, by 16 s": False,
        "reached_goal 3": True,
        "airborne, by 16 s": True,
    }
    assert verdict.checks[0].failures[0].found.endswith("not bound for the goal yet")


# -- texts -----------------------------------------------------------------------------------------------


def test_words_across_two_chunks_are_found() -> None:
    verdict = flown(
        "vehicles: [{personality: px4}]\nscript: [{arm: , expect: any, timeout_s: 3}]\n"
        "checks: [never_says: failures first, heard_text: health failures first]\nuntil_s: 15",
        ready_s=30.0,
    )
    assert verdicts(verdict) == {"never_says failures first": False, "heard_text health failures first": True}


@pytest.mark.parametrize(
    ("chunks", "expected"),
    [
        ([(0, 0, "one"), (0, 0, "one")], ["one", "one"]),
        ([(1, 0, "a"), (1, 1, "b"), (0, 0, "x"), (1, 2, "c")], ["abc", "x"]),
        ([(1, 0, "a"), (1, 0, "a"), (1, 1, "b"), (1, 1, "b")], ["ab"]),
        ([(1, 1, "b"), (1, 0, "a")], ["ab"]),
        ([(1, 0, "a"), (1, 2, "c")], [f"a{GAP}c"]),
        ([(1, 0, "a"), (2, 0, "c"), (1, 1, "b"), (2, 1, "d")], ["ab", "cd"]),
        ([(1, 0, "a"), (1, 1, "b"), (1, 0, "c"), (1, 1, "d")], ["ab", "cd"]),
    ],
)
def test_chunks_are_assembled(chunks: list[tuple[int, int, str]], expected: list[str]) -> None:
    texts, codec, parser = StatusTexts(), mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None)
    for text_id, chunk, text in chunks:
        frame = mavlink.MAVLink_statustext_message(6, text.encode(), text_id, chunk).pack(codec)
        for message in parser.parse_buffer(bytes(frame)) or ():
            texts.receive(message)
    assert texts.texts == expected


# -- missions --------------------------------------------------------------------------------------------

LAPS = f"[takeoff: 10, {at(10, 15)}, {at(10, 30)}, jump: {{to: 2, times: 2}}]"
RETURN = "item: {command: NAV_RETURN_TO_LAUNCH, frame: 2}"
FLY = "[fly_mission]"
ONCE = f"takeoff: 6, {at(6, 15)}"
ENDLESS = LAPS.replace("times: 2", "times: -1")


@pytest.mark.parametrize(
    ("personality", "mission", "script", "complete"),
    [
        ("px4", f"[{ONCE}, land]", FLY, True),
        ("ardupilot", f"[{ONCE}, delay_s: 1]", FLY, True),
        ("px4", f"[{ONCE}, {RETURN}]", FLY, True),
        # three rounds of the jumps, and endless rounds
        ("ardupilot", LAPS, FLY, True),
        ("px4", LAPS, FLY, True),
        ("ardupilot", ENDLESS, FLY, False),
        # uploaded and not flown
        ("px4", "[rtl]", "[upload_mission]", False),
        ("px4", "[rtl]", "[upload_mission, {takeoff: 10}, {at_s: 15, rtl: }]", False),
    ],
)
def test_a_mission_is_complete_after_its_last_item(
    personality: str, mission: str, script: str, complete: bool
) -> None:
    vehicles = f"vehicles: [{{personality: {personality}, mission: {mission}}}]\n"
    verdict = flown(vehicles + f"script: {script}\nchecks: [mission_complete]\nuntil_s: 80")
    assert verdicts(verdict) == {"mission_complete": complete}


def test_an_early_landing_does_not_complete_the_mission() -> None:
    text = f"vehicles: [{{mission: [takeoff: 6, {at(6, 10)}, land, takeoff: 6, {at(6, 20)}, rtl]}}]\n"
    verdict = flown(text + "script: [fly_mission]\nchecks: [mission_complete, landed]\nuntil_s: 90")
    assert verdicts(verdict) == {"mission_complete": False, "landed": True}


def test_a_mission_beyond_a_new_fence_is_not_complete() -> None:
    fence = "fence: [keep_in_circle: {east_m: 0, north_m: 0, radius_m: 400}]"
    vehicle = f"{{personality: px4, type: plane, mission: [takeoff: 30, {at(30, 900)}], {fence}}}"
    script = "[fly_mission, {at_s: 16, upload_fence: }]"
    verdict = flown(f"vehicles: [{vehicle}]\nscript: {script}\nchecks: [mission_complete]\nuntil_s: 40")
    assert verdicts(verdict) == {"mission_complete": False}


# -- both autopilots by one script -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "personality", "mode"), [("copter", "px4", "Return"), ("plane", "ardupilot", "RTL")]
)
def test_mode_names_map_to_the_numbers_of_each_autopilot(kind: str, personality: str, mode: str) -> None:
    vehicle = f"{{personality: {personality}, type: {kind}}}"
    script = f"[{{takeoff: 30}}, {{at_s: 20, mode: {mode}}}]"
    verdict = flown(f"vehicles: [{vehicle}]\nscript: {script}\nchecks: [mode_is: {mode}]\nuntil_s: 40")
    assert verdict.passed, verdict


# -- ready to be armed -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("personality", "script"), [("ardupilot", "fly_mission"), ("px4", "takeoff: 9"), ("ardupilot", "arm")]
)
def test_arming_waits_for_readiness(personality: str, script: str) -> None:
    text = (
        f"vehicles: [{{personality: {personality}, mission: [takeoff: 9, rtl]}}]\nscript: [{script}]\n"
        "checks: [armed: {by_s: 27}]\nuntil_s: 30"
    )
    scenario = parse_scenario(HOME.replace("ready_s: 0", "ready_s: 20") + text, "test.yaml")
    attempts: list[float] = []

    def record(_index: int, frame: bytes, now: float) -> None:
        (message,) = mavlink.MAVLink(None).parse_buffer(frame)
        if message.get_type() == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            attempts.append(now)

    run = Run(scenario, on_frame=record)
    assert run.run().passed
    assert len(attempts) == 1
    assert not [text for text in run.station.contacts[0].texts if text.startswith("Arm:")]


def test_arming_is_tried_without_readiness_and_the_refusal_has_the_reason() -> None:
    text = "count: 1\nfaults: ['sensor_unhealthy:sensor=mag']\nscript: [{arm: , timeout_s: 20}]\nuntil_s: 40"
    (step,) = flown(text).steps_failed
    assert step.t_s == pytest.approx(23, abs=1.5)
    assert "ompass" in step.text or "mag" in step.text.lower()


def test_an_expected_refusal_does_not_wait_for_readiness() -> None:
    text = "count: 1\nscript: [mode: GUIDED, {arm: , expect: refused, timeout_s: 5}]\nuntil_s: 12"
    scenario = parse_scenario(HOME.replace("ready_s: 0", "ready_s: 30") + text, "test.yaml")
    assert Run(scenario).run().passed


@BOTH
def test_goto_heights_are_above_home_on_each_autopilot(personality: str) -> None:
    text = (
        f"vehicles: [{{personality: {personality}}}]\n"
        "script: [takeoff: 10, {at_s: 18, goto: {east_m: 10, north_m: 0, height_m: 15}}]\n"
        "checks: [min_height_m: {metres: 14, from_s: 28, until_s: 30}, max_height_m: 16]\nuntil_s: 30"
    )
    assert all(verdicts(flown(text)).values())
