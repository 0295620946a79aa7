"""Whole jobs against a scripted copter: prepare, upload, launch, swap, hold; over good and bad wires."""

from __future__ import annotations

from dataclasses import replace

import pytest
from bench import Bench, Faults, plan
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples
from scripted_copter import Script

from swarmctl.mavlink.events import ProcedureDone, VehicleRebooted
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.telemetry.presence import LinkState

OLD, NEW = plan(north=8), plan(north=6, east=0.002, alt=33.333)
MODEST = settings(
    max_examples=examples(25),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.data_too_large],
)


def test_prepare_sets_guided_again_after_the_boot_has_undone_it():
    bench = Bench(Script(boot_s=4.0, ready_at_s=6.0)).prepared()
    assert bench.copter.mode_name == "GUIDED"
    assert bench.session.state.ready
    assert sum(command == 176 for command, _ in bench.copter.commands) >= 2
    assert bench.now >= 6.0


def test_prepare_waits_and_reports_the_reason():
    bench = Bench(Script(ready_at_s=30.0)).connected()
    bench.take(bench.session.begin("prepare", basic.prepare, bench.now))
    assert not bench.run(20, lambda: bench.session.busy_with is None)
    assert any(reason.endswith("[no-position]") for reason in bench.session.state.not_ready)
    assert bench.run(20, lambda: bench.session.busy_with is None)


def test_prepare_refuses_a_vehicle_that_is_armed():
    bench = Bench().prepared()
    bench.copter.armed = True
    bench.run(2)
    assert "[armed]" in bench.do("prepare", basic.prepare).failure


def test_an_upload_onto_a_flying_vehicle_is_refused():
    bench = Bench().flying(OLD)
    before = len(bench.sent)
    assert "[armed]" in bench.upload(NEW).failure
    assert len(bench.sent) == before


def test_launch_takes_off_and_flies_the_mission():
    bench = Bench().flying(OLD)
    assert bench.copter.mode_name == "AUTO"
    assert bench.run(120, lambda: not bench.copter.armed), "no landing at the end of the mission"
    assert bench.copter.alt == 0.0


def test_launch_without_a_mission_arms_nothing():
    bench = Bench().prepared()
    assert "[no-mission]" in bench.do("launch", basic.launch).failure
    assert not bench.copter.armed


@pytest.mark.parametrize("late", [False, True], ids=["text before the ack", "text after the ack"])
def test_a_refused_arming_is_reported_in_the_words_of_the_vehicle(late):
    bench = Bench(Script(refuse_arming="Compass not calibrated", late_texts=late)).prepared()
    bench.upload(OLD)
    failure = bench.do("launch", basic.launch).failure
    assert "COMPONENT_ARM_DISARM: FAILED" in failure
    assert failure.count("Compass not calibrated") == 1


def test_launch_that_stays_on_the_ground_ends_disarmed():
    bench = Bench(Script(stays_on_ground=True)).prepared()
    bench.upload(OLD)
    assert "[no-take-off]" in bench.do("launch", basic.launch).failure
    assert not bench.copter.armed


def test_swap_flies_the_new_plan_from_its_first_waypoint():
    bench = Bench().flying(OLD)
    result = bench.swap(NEW)
    assert (result.failure, result.flying, result.stood_still_s) == (None, "new", 0.0)
    assert 0.0 < result.took_s < 2.0
    assert bench.flies(NEW, behind=OLD)
    assert bench.copter.mode_name == "AUTO"
    assert bench.copter.seq == len(bench.items(OLD)), "the current item is not the first appended one"
    assert len(bench.session.items) == len(bench.copter.mission)


def test_a_swap_without_partial_lists_is_flown_from_its_first_waypoint():
    bench = Bench(Script(partial_lists=False)).flying(OLD)
    result = bench.swap(NEW)
    assert (result.failure, result.flying) == (None, "new")
    modes = [params[1] for command, params in bench.copter.commands if command == 176]
    assert modes[-2:] == [4.0, 3.0], "no hold during the swap"
    assert bench.mission_is(NEW)
    assert (bench.copter.mode_name, bench.copter.seq) == ("AUTO", 2)
    assert len(bench.session.items) == len(bench.items(NEW))


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
    bench, appended = Bench().flying(OLD), plan(north=6, east=0.002)
    assert bench.swap(appended).flying == "new"
    bench.copter.script = Script(partial_lists=False, refuse_item=3)
    assert bench.swap(NEW).flying == "old"
    assert bench.mission_is(appended)
    assert bench.flies(appended)


def test_a_swap_right_after_the_launch_waits_for_the_climb():
    bench = Bench(faults=Faults(max_delay_s=0.1)).prepared()
    bench.upload(OLD)
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
    assert bench.run(60, lambda: not bench.session.state.armed)
    result = bench.swap(NEW)
    assert result.flying == "old"
    assert result.failure.endswith("[not-flying]")


@pytest.mark.parametrize("mode", [5, 6, 9], ids=["LOITER", "RTL", "LAND"])
def test_a_swap_leaves_a_vehicle_alone_after_a_takeover(mode):
    bench = Bench().flying(OLD)
    bench.copter.mode = mode
    bench.run(2)
    before = len(bench.sent)
    assert bench.swap(NEW).flying == "theirs"
    assert len(bench.sent) == before
    assert bench.mission_is(OLD)


def test_a_pilot_takeover_during_the_upload_is_respected():
    bench = Bench(faults=Faults(max_delay_s=0.3)).flying(OLD)
    bench.begin_swap(NEW)
    assert bench.run(20, lambda: bench.copter.transfer is not None)
    bench.copter.mode = 5
    assert bench.run(200, lambda: bench.session.busy_with is None)
    assert bench.result.flying == "theirs"
    assert bench.copter.mode_name == "LOITER"
    assert 224 not in [command for command, _ in bench.copter.commands], "the current item was changed"


def test_a_swap_after_a_failed_one_starts_from_hold():
    bench = Bench().flying(OLD)
    bench.copter.script = Script(refuse_set_current=True)
    assert bench.swap(NEW).flying == "hold"
    bench.copter.script = Script()
    assert bench.swap(replace(NEW, from_hold=True)).flying == "new"
    assert bench.mission_is(NEW)


@pytest.mark.parametrize(
    ("procedure", "mode"),
    [(basic.hold, "GUIDED"), (basic.return_home, "RTL"), (basic.land, "LAND")],
    ids=["hold", "return_home", "land"],
)
def test_an_operators_command_is_seen_in_the_heartbeat(procedure, mode):
    bench = Bench().flying(OLD)
    assert bench.do("command", procedure).failure is None
    assert bench.copter.mode_name == mode
    assert bench.session.state.mode == mode


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
    uploaded = bench.do("upload", lambda c: basic.upload(c, bench.items(OLD)))
    assert uploaded.swap_takes_s == pytest.approx(0.0, abs=0.2)


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


def test_cancelling_an_upload_sends_a_cancellation():
    bench = Bench(faults=Faults(max_delay_s=0.5)).prepared()
    bench.take(bench.session.begin("upload", lambda c: basic.upload(c, bench.items(OLD)), bench.now))
    assert bench.run(20, lambda: bench.copter.transfer is not None and bench.copter.transfer.asked > 2)
    bench.take(bench.session.cancel(bench.now))
    bench.run(1)
    assert bench.copter.acks_received == [15]
    assert bench.session.busy_with is None
    assert bench.session.items == ()
    assert ProcedureDone("upload", Done("cancelled")) in bench.events


def test_a_lost_final_ack_is_settled_by_reading_back():
    bench = Bench().prepared()
    bench.block_down = lambda m: m.get_type() == "MISSION_ACK"
    assert bench.upload(OLD).failure is None
    assert bench.mission_is(OLD)
    assert len(bench.of("MISSION_COUNT")) == 1


def test_an_upload_during_an_unfinished_transfer_is_repeated_later():
    bench = Bench().prepared()
    bench.block = lambda m: m.get_type() == "MISSION_ITEM_INT" and m.seq == 3 and bench.now < 30
    assert bench.upload(OLD).failure is None
    counts = [now for now, m in bench.sent if m.get_type() == "MISSION_COUNT"]
    assert counts[-1] - counts[0] >= 9.0
    assert bench.mission_is(OLD)


def test_a_reboot_restarts_the_streams_and_makes_the_mission_unknown():
    bench = Bench().prepared()
    bench.upload(OLD)
    bench.run(10)
    bench.copter.boot(bench.now)
    assert bench.run(15, lambda: 33 in bench.copter.streams and VehicleRebooted() in bench.events)
    assert bench.session.items == ()
    assert bench.run(15, lambda: set(bench.copter.streams) == {33, 1, 193, 245, 42, 242})


def test_the_address_changes_only_after_the_loss_and_not_amid_a_command():
    bench = Bench().flying(OLD)
    assert not bench.session.may_change_address
    bench.silent = True
    assert bench.run(20, lambda: bench.session.link_state is LinkState.LOST)
    assert bench.session.may_change_address
    bench.take(bench.session.begin("hold", basic.hold, bench.now))
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


faults = st.builds(
    Faults,
    loss=st.sampled_from([0.0, 0.05, 0.2, 0.4]),
    doubling=st.sampled_from([0.0, 0.1, 0.5]),
    max_delay_s=st.sampled_from([0.0, 0.3, 1.5]),
    seed=st.integers(0, 2**16),
)


@MODEST
@given(faults=faults, count=st.integers(1, 12))
def test_an_upload_reports_success_only_for_the_exact_mission(faults, count):
    bench = Bench(faults=faults)
    assert bench.run(200, lambda: bench.session.state.mode != "")
    mission = plan(north=count)
    done = bench.upload(mission)
    if done.failure is None:
        assert bench.mission_is(mission)
        assert bench.session.dialect.differences(bench.items(mission), bench.session.items) == ()
    else:
        assert bench.session.items == ()


@MODEST
@given(faults=faults)
def test_successive_uploads_never_mix(faults):
    bench = Bench(faults=faults)
    assert bench.run(200, lambda: bench.session.state.mode != "")
    bench.take(bench.session.begin("upload", lambda c: basic.upload(c, bench.items(OLD)), bench.now))
    bench.run(1.0)
    bench.take(bench.session.cancel(bench.now))
    if bench.upload(NEW).failure is None:
        assert bench.mission_is(NEW)


@MODEST
@given(faults=faults, partial_lists=st.booleans())
def test_a_swap_on_a_bad_wire_flies_no_mixture_and_reports_truly(faults, partial_lists):
    bench = Bench(Script(partial_lists=partial_lists)).flying(OLD)
    bench.spoil(faults)
    mixed = []

    def watch() -> bool:
        whole = bench.flies(OLD) or bench.flies(NEW) or bench.flies(NEW, behind=OLD)
        if bench.copter.armed and bench.copter.mode_name == "AUTO" and not whole:
            mixed.append(bench.now)
        return bench.session.busy_with is None

    bench.begin_swap(NEW)
    assert bench.run(600, watch)
    assert mixed == []
    flying = bench.result.flying
    if flying == "new":
        assert bench.flies(NEW) or bench.flies(NEW, behind=OLD)
    if flying == "old":
        assert bench.flies(OLD)
    if flying == "hold":
        assert bench.copter.mode_name == "GUIDED"
