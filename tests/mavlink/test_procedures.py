"""Whole jobs against a scripted copter: prepare, upload, launch, swap, hold; over good and bad wires."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
from bench import Bench, Faults, north_of_home
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import Script
from wire_bench import wires

from swarmctl.core.events import Rebooted
from swarmctl.mavlink.procedures import basic

OLD, NEW = north_of_home(8), north_of_home(6, east=0.002, alt=33.333)
MODEST = settings(
    max_examples=examples(25),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.data_too_large],
)


def test_an_upload_onto_a_flying_vehicle_is_refused():
    bench = Bench().flying(OLD)
    before = len(bench.sent)
    assert "[armed]" in bench.upload(NEW).failure
    assert len(bench.sent) == before


@pytest.mark.parametrize("late", [False, True], ids=["text before the ack", "text after the ack"])
def test_a_refused_arming_is_reported_in_the_words_of_the_vehicle(late):
    bench = Bench(Script(refuse_arming="Compass not calibrated", late_texts=late)).uploaded(OLD)
    failure = bench.do("launch", basic.launch).failure
    assert "COMPONENT_ARM_DISARM: FAILED" in failure
    assert failure.count("Compass not calibrated") == 1


def test_launch_that_stays_on_the_ground_ends_disarmed():
    bench = Bench(Script(stays_on_ground=True)).uploaded(OLD)
    assert "[no-take-off]" in bench.do("launch", basic.launch).failure
    assert not bench.copter.armed


@pytest.mark.parametrize(
    ("script", "flying", "part"),
    [
        (Script(refuse_item=3), "old", "INVALID"),
        (Script(refuse_item=3, refusals_left=99), "hold", "INVALID"),
        (Script(refuse_mode="GUIDED"), "old", "Mode change to GUIDED failed"),
        (Script(refuse_mode="AUTO"), "hold", "Mode change to AUTO failed"),
        (Script(refuse_set_current=True), "hold", "DO_SET_MISSION_CURRENT: DENIED"),
        (Script(spoil_item=4), "hold", "item 4: sent"),
        (Script(never_moves=True), "hold", "[not-flying-on]"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_failed_swap_leaves_and_reports_a_whole_plan_or_hold(script, flying, part):
    bench = Bench().flying(OLD)
    bench.copter.script = replace(script, partial_lists=False)
    result = bench.swap(NEW)
    assert result.flying == flying
    assert part in result.failure
    assert bench.copter.mode_name == ("GUIDED" if flying == "hold" else "AUTO")
    if flying == "old":
        assert bench.mission_is(OLD)


def test_the_return_to_an_appended_plan_skips_the_plans_before_that_plan():
    bench, appended = Bench().flying(OLD), north_of_home(6, east=0.002)
    assert bench.swap(appended).flying == "new"
    bench.copter.script = Script(partial_lists=False, refuse_item=3)
    assert bench.swap(NEW).flying == "old"
    assert bench.mission_is(appended)
    assert bench.copter.seq < len(bench.copter.mission)


def test_a_swap_right_after_the_launch_waits_for_the_climb():
    bench = Bench(faults=Faults(max_delay_s=0.1)).uploaded(OLD)
    assert bench.do("launch", basic.launch).failure is None
    assert bench.copter.alt < 5.0
    bench.begin_swap(NEW)
    assert bench.run(60, lambda: bench.of("MISSION_WRITE_PARTIAL_LIST") != [])
    assert bench.copter.alt == OLD.takeoff_alt_m
    assert bench.run(60, lambda: bench.session.busy_with is None)
    assert bench.result.flying == "new"


def test_a_landing_vehicle_keeps_its_mission():
    bench = Bench().flying(OLD)
    assert bench.run(120, lambda: bench.session.state.landed == 4)
    result = bench.swap(NEW)
    assert (result.flying, "[landing]" in result.failure) == ("old", True)
    assert bench.of("MISSION_WRITE_PARTIAL_LIST") == []


def test_an_operators_command_is_repeated_after_a_boot_undoes_the_mode():
    bench = Bench(Script(boot_s=4.0)).connected()
    assert bench.do("hold", basic.hold).failure is None
    assert bench.copter.mode_name == "GUIDED"


@pytest.mark.parametrize(
    ("script", "limit_s"),
    [(Script(), 1.0), (Script(heartbeats_unasked_only=True), 8.0)],
    ids=["heartbeats on request", "regular heartbeats only"],
)
def test_a_swap_on_a_perfect_wire_is_quick(script, limit_s):
    bench = Bench(script).flying(OLD)
    before = bench.now
    assert bench.swap(NEW).flying == "new"
    assert bench.now - before < limit_s


def test_an_upload_on_a_perfect_wire_predicts_a_quick_swap():
    bench = Bench().prepared()
    assert bench.upload(OLD).swap_takes_s == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize("partial_lists", [True, False])
def test_a_swap_on_a_lost_link_reports_the_last_known_mission(partial_lists):
    bench = Bench(Script(partial_lists=partial_lists), Faults(max_delay_s=0.3)).flying(OLD)
    bench.begin_swap(NEW)
    assert bench.run(20, lambda: bench.copter.transfer is not None)
    bench.silent = True
    assert bench.run(400, lambda: bench.session.busy_with is None)
    assert bench.result.flying == ("unknown" if partial_lists else "hold")
    if partial_lists:
        landed = bench.run(200, lambda: not bench.copter.armed)
        assert landed, "the old plan is not flown to its end"
        assert bench.copter.position[0] == pytest.approx(OLD.landing.lat_deg, abs=1e-4)
    else:
        assert bench.copter.mode_name == "GUIDED", "the stored mixture is flown"


def test_a_swap_without_an_answer_to_the_last_mode_command_does_not_report_hold():
    bench = Bench(Script(partial_lists=False)).flying(OLD)
    bench.block_down = lambda m: bench.copter.mode_name == "AUTO" and bench.mission_is(NEW)
    assert bench.swap(NEW).flying == "unknown"
    assert bench.copter.mode_name == "AUTO"


def test_a_speed_from_before_the_hold_does_not_show_that_the_vehicle_flies_on():
    bench = Bench(Script(partial_lists=False)).flying(OLD)
    bench.copter.script.never_moves = True
    follows = lambda: bench.copter.mode_name == "AUTO" and bench.mission_is(NEW)  # noqa: E731
    bench.block_down = lambda m: m.get_type() == "GLOBAL_POSITION_INT" and not follows()
    result = bench.swap(NEW)
    assert result.flying != "new"
    assert "[not-flying-on]" in result.failure


def test_a_reboot_restarts_the_streams_and_makes_the_mission_unknown():
    bench = Bench().uploaded(OLD)
    bench.run(10)
    bench.copter.boot(bench.now)
    assert bench.run(15, lambda: 33 in bench.copter.streams and Rebooted() in bench.events)
    assert bench.session.items == ()
    assert bench.run(15, lambda: set(bench.copter.streams) == {33, 1, 193, 245, 42, 242})


def test_the_address_changes_only_after_the_loss_and_not_amid_a_command():
    bench = Bench().flying(OLD)
    assert not bench.session.may_change_address
    bench.silent = True
    assert bench.run(20, lambda: bench.session.may_change_address)
    assert bench.session.age_s(bench.now) > 4.9
    bench.begin("hold", basic.hold)
    assert not bench.session.may_change_address
    assert bench.run(20, lambda: bench.session.busy_with is None)
    assert bench.session.may_change_address


def test_a_vehicle_that_rebooted_while_lost_gets_its_stream_requests_at_once():
    bench = Bench().prepared()
    bench.silent = True
    bench.run(60)
    bench.copter.boot(bench.now)
    bench.silent = False
    assert bench.run(3, lambda: set(bench.copter.streams) == {33, 1, 193, 245, 42, 242})


@MODEST
@given(faults=wires, count=st.integers(1, 12))
def test_an_upload_reports_success_only_for_the_exact_mission(faults, count):
    bench = Bench(faults=faults)
    assert bench.run(200, lambda: bench.session.state.mode != "")
    mission = north_of_home(count)
    done = bench.upload(mission)
    if done.failure is None:
        assert bench.mission_is(mission)
        items = bench.session.mission_items(mission)
        assert bench.session.dialect.differences(items, bench.session.items) == ()
    else:
        assert bench.session.items == ()


@MODEST
@given(faults=wires)
def test_successive_uploads_never_mix(faults):
    bench = Bench(faults=faults)
    assert bench.run(200, lambda: bench.session.state.mode != "")
    bench.begin("upload", lambda c: basic.upload(c, bench.session.mission_items(OLD)))
    bench.run(1.0)
    bench.take(bench.session.cancel(bench.now))
    if bench.upload(NEW).failure is None:
        assert bench.mission_is(NEW)


# Speed

CHANGE_SPEED = mavlink.MAV_CMD_DO_CHANGE_SPEED


def speeds_sent(bench: Bench) -> list:
    return [m for _, m in bench.sent if m.get_type() == "COMMAND_LONG" and m.command == CHANGE_SPEED]


def test_the_ground_speed_is_sent_once_and_a_refusal_is_reported():
    bench = Bench(Script(speeds=False)).flying(north_of_home(8))
    assert (
        bench.do("set_speed", partial(basic.set_speed, speed_m_s=6.5)).failure
        == "DO_CHANGE_SPEED: UNSUPPORTED"
    )
    (message,) = speeds_sent(bench)
    assert (message.param1, message.param2, message.param3) == (mavlink.SPEED_TYPE_GROUNDSPEED, 6.5, -1.0)


def test_no_speed_is_sent_to_a_vehicle_that_does_not_fly_its_mission():
    bench = Bench().flying(north_of_home(8))
    bench.copter.mode = 4
    bench.run(3)
    assert "GUIDED" in bench.do("set_speed", partial(basic.set_speed, speed_m_s=6.5)).failure
    assert speeds_sent(bench) == []


def test_an_unanswered_speed_is_repeated_a_limited_number_of_times():
    bench = Bench().flying(north_of_home(8))
    bench.block = lambda message: getattr(message, "command", None) == CHANGE_SPEED
    assert "no answer" in bench.do("set_speed", partial(basic.set_speed, speed_m_s=6.5)).failure
    assert [m.confirmation for m in speeds_sent(bench)] == [0, 1, 2, 3, 4]
