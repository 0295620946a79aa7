"""Takeovers by radio control: no command overrides the pilot."""

from __future__ import annotations

from functools import partial
from math import inf

import pytest
from bench import STEP_S, Bench, Faults, north_of_home
from scripted_copter import Script

from swarmctl.core.records import replace
from swarmctl.mavlink.procedures import basic

OLD, NEW = north_of_home(8), north_of_home(6, east=0.002)
GUIDED, LOITER = 4, 5
MODE, ARM, START, CURRENT = 176, 400, 300, 224
DELAY_S = 0.3
WIRES = [
    (Script(), Faults()),
    (Script(), Faults(max_delay_s=DELAY_S, seed=1)),
    (Script(), Faults(max_delay_s=DELAY_S, doubling=0.2, loss=0.2, seed=2)),
    (Script(heartbeats_unasked_only=True), Faults(max_delay_s=DELAY_S, seed=3)),
    (Script(partial_lists=False), Faults(max_delay_s=DELAY_S, seed=4)),
]
WIRE_NAMES = ["perfect wire", "slow wire", "bad wire", "regular heartbeats only", "no partial lists"]
EVERY_TENTH = [n * 0.1 for n in range(90)]


def orders(bench: Bench, since: int) -> list[tuple[float, int]]:
    """Return (now, command) of each command that changes a mode or item, arms or starts."""
    sent = [(now, m.command) for now, m in bench.sent[since:] if m.get_type() == "COMMAND_LONG"]
    return [(now, command) for now, command in sent if command in (MODE, ARM, START, CURRENT)]


def taken_over(
    bench: Bench, name: str, procedure, after_s: float, mode: int = LOITER
) -> tuple[list[tuple[float, int]], object]:
    """Run a procedure with a pilot takeover after `after_s`, repeated after a crossing command.

    Returns the orders sent after the last heartbeat from before the takeover had arrived, and the result.
    """
    take_s = bench.now + after_s
    window_s = bench.faults.max_delay_s + STEP_S / 2
    taken_s, checked = inf, len(bench.sent)
    late: list[tuple[float, int]] = []

    def watch() -> bool:
        nonlocal taken_s, checked
        late.extend(order for order in orders(bench, checked) if order[0] - taken_s > window_s)
        checked = len(bench.sent)
        if bench.copter.mode != mode and bench.now >= take_s:
            bench.copter.mode, taken_s = mode, bench.now
        return bench.session.busy_with is None

    bench.begin(name, procedure)
    assert bench.run(400, watch), f"{name} does not end"
    return late, bench.result


@pytest.mark.full
@pytest.mark.parametrize(("script", "faults"), WIRES, ids=WIRE_NAMES)
def test_a_pilot_takeover_at_any_moment_of_a_swap_is_respected(script, faults):
    foreign = 0
    for after_s in EVERY_TENTH:
        bench = Bench(script).flying(OLD)
        bench.spoil(faults)
        late, result = taken_over(bench, "swap", partial(basic.swap, plan=NEW), after_s)
        assert late == [], f"taken over after {after_s:.1f} s: {result}"
        if result.failure is not None and "LOITER" in result.failure:
            foreign += 1
            assert result.flying == "theirs"
            assert bench.copter.mode == LOITER
    assert foreign > 0, "no takeover fell within a swap, so nothing was tested"


@pytest.mark.parametrize(
    ("script", "faults"),
    [
        pytest.param(*WIRES[0], marks=pytest.mark.full, id=WIRE_NAMES[0]),
        pytest.param(*WIRES[1], id=WIRE_NAMES[1]),
    ],
)
def test_a_pilot_takeover_by_hold_mode_during_a_swap_is_respected(script, faults):
    """Another station sets GUIDED. Only a swap with its own hold cannot tell the two holds apart."""
    theirs = 0
    for after_s in EVERY_TENTH[:40]:
        bench = Bench(script).flying(OLD)
        bench.spoil(faults)
        job = partial(basic.swap, plan=NEW)
        late, result = taken_over(bench, "swap", job, after_s, GUIDED)
        assert late == [], f"taken over after {after_s:.1f} s: {result}"
        assert result.flying in ("theirs", "new")
        if result.flying == "theirs":
            theirs += 1
            assert bench.copter.mode == GUIDED
    assert theirs > 0


def test_a_swap_sends_nothing_in_a_hold_that_another_station_ordered():
    bench = Bench().flying(OLD)
    bench.copter.mode = GUIDED
    bench.run(2)
    sent = len(bench.sent)
    assert bench.swap(NEW).flying == "theirs"
    assert orders(bench, sent) == []
    assert bench.swap(replace(NEW, from_hold=True)).flying == "new"


@pytest.mark.parametrize(("script", "faults"), WIRES, ids=WIRE_NAMES)
def test_a_pilot_takeover_at_any_moment_of_a_launch_is_respected(script, faults):
    foreign = 0
    for after_s in EVERY_TENTH[:40]:
        bench = Bench(script).uploaded(OLD)
        bench.spoil(faults)
        late, result = taken_over(bench, "launch", basic.launch, after_s)
        assert late == [], f"taken over after {after_s:.1f} s: {result}"
        if result.failure is not None and "LOITER" in result.failure:
            foreign += 1
            assert bench.copter.mode == LOITER
    assert foreign > 0, "no takeover fell within a launch, so nothing was tested"


@pytest.mark.parametrize("command", [ARM, START, CURRENT, MODE])
def test_an_unanswered_command_is_not_repeated_against_a_pilot(command):
    """The first command is lost; the pilot takes over before the time of its repetition."""
    launches = command in (ARM, START)
    # Without partial lists the swap sets a mode, as the vehicle has to hold.
    script = Script(partial_lists=command != MODE)
    bench = Bench(script).uploaded(OLD) if launches else Bench(script).flying(OLD)
    bench.block = lambda m: m.get_type() == "COMMAND_LONG" and m.command == command
    begun = len(bench.sent)
    job = basic.launch if launches else (lambda c: basic.swap(c, NEW))
    bench.begin("job", job)
    assert bench.run(10, lambda: command in [c for _, c in orders(bench, begun)])
    sent = len(bench.sent)
    bench.copter.mode = LOITER
    assert bench.run(100, lambda: bench.session.busy_with is None)
    assert orders(bench, sent) == []
    assert "LOITER" in bench.result.failure


def test_an_unanswered_command_is_repeated_unless_a_pilot_has_taken_over():
    bench = Bench().flying(OLD)
    lost = []

    def block(message) -> bool:
        if message.get_type() == "COMMAND_LONG" and message.command in (MODE, CURRENT) and len(lost) < 3:
            lost.append(message.confirmation)
            return True
        return False

    bench.block = block
    result = bench.swap(NEW)
    assert (result.flying, lost) == ("new", [0, 1, 2])


def test_a_temporarily_rejected_command_is_repeated_after_a_new_heartbeat():
    bench = Bench().flying(OLD)
    set_mode, answers = bench.copter.set_mode, []

    def busy_twice(*params) -> int:
        answers.append(1 if len(answers) < 2 else 0)
        return answers[-1] or set_mode(*params)

    bench.copter.set_mode = busy_twice
    begun = len(bench.sent)
    assert bench.do("land", basic.land).failure is None
    assert answers == [1, 1, 0]
    sent = [m.command for _, m in bench.sent[begun:] if m.command in (512, MODE)]
    assert sent[:5] == [MODE, 512, MODE, 512, MODE]


def test_launch_sends_nothing_to_a_vehicle_that_is_armed_already():
    bench = Bench().uploaded(OLD)
    bench.copter.armed = True
    bench.run(2)
    sent = len(bench.sent)
    assert "[armed]" in bench.do("launch", basic.launch).failure
    assert len(bench.sent) == sent


def test_launch_sends_nothing_if_a_pilot_armed_after_the_last_heartbeat():
    bench = Bench().uploaded(OLD)
    bench.copter.armed = True
    sent = len(bench.sent)
    assert not bench.session.state.armed
    assert "[taken-over]" in bench.do("launch", basic.launch).failure
    assert orders(bench, sent) == []


@pytest.mark.parametrize(
    ("nth_request", "pilot", "orders_before"),
    [(2, {"armed": True}, []), (4, {"mode": 3}, [ARM]), (4, {"armed": False}, [ARM])],
    ids=["arms before the launch does", "starts the mission before the launch does", "disarms the vehicle"],
)
def test_launch_ends_if_a_pilot_arms_disarms_or_starts_the_mission(nth_request, pilot, orders_before):
    """The pilot acts just before the answer to the heartbeat request with number `nth_request`."""
    bench = Bench().uploaded(OLD)
    asked = []

    def interfere(message) -> bool:
        if message.get_type() == "COMMAND_LONG" and message.command == 512:
            asked.append(message)
            if len(asked) == nth_request:
                vars(bench.copter).update(pilot)
        return False

    bench.block = interfere
    begun = len(bench.sent)
    assert "[taken-over]" in bench.do("launch", basic.launch).failure
    assert [command for _, command in orders(bench, begun)] == orders_before


def test_launch_does_not_begin_in_a_mode_chosen_by_a_pilot():
    bench = Bench().uploaded(OLD)
    bench.copter.mode = LOITER
    sent = len(bench.sent)
    assert "LOITER" in bench.do("launch", basic.launch).failure
    assert orders(bench, sent) == []


def test_a_failed_launch_does_not_disarm_after_a_pilot_takeover():
    bench = Bench(Script(stays_on_ground=True)).uploaded(OLD)
    bench.begin("launch", basic.launch)
    assert bench.run(10, lambda: bench.copter.mode_name == "AUTO")
    sent = len(bench.sent)
    bench.copter.mode = LOITER
    assert bench.run(60, lambda: bench.session.busy_with is None)
    assert "LOITER" in bench.result.failure
    assert orders(bench, sent) == []
    assert bench.copter.armed


def test_prepare_sends_nothing_if_a_pilot_armed_after_the_last_heartbeat():
    bench = Bench().connected()
    bench.run(3)
    bench.copter.mode, bench.copter.armed = LOITER, True
    sent = len(bench.sent)
    assert "[armed]" in bench.do("prepare", basic.prepare).failure
    assert orders(bench, sent) == []


@pytest.mark.parametrize("job", [basic.hold, basic.return_home, basic.land])
def test_an_operators_order_is_sent_at_once_and_not_repeated_against_a_pilot(job):
    bench = Bench().flying(OLD)
    bench.block = lambda m: m.get_type() == "COMMAND_LONG" and m.command == MODE
    sent = len(bench.sent)
    bench.begin("order", job)
    assert orders(bench, sent) == [(bench.now, MODE)]
    bench.copter.mode = LOITER
    assert bench.run(100, lambda: bench.session.busy_with is None)
    assert len(orders(bench, sent)) == 1
    assert "LOITER" in bench.result.failure


@pytest.mark.parametrize("job", [basic.hold, basic.return_home, basic.land])
@pytest.mark.parametrize("mode", [GUIDED, LOITER])
def test_an_automatic_command_waits_for_a_new_heartbeat(job, mode):
    """A pilot acted a moment ago, and no heartbeat has reported the change yet."""
    bench = Bench(Script(heartbeats_unasked_only=True)).flying(OLD)
    heartbeats = bench.session.state
    bench.run(3, lambda: bench.session.state is not heartbeats)
    bench.copter.mode = mode
    sent = len(bench.sent)
    result = bench.do("order", partial(job, check_mode_first=True))
    assert bench.copter.mode == mode
    if job is not basic.hold or mode != GUIDED:
        assert orders(bench, sent) == []
        assert "[taken-over]" in result.failure


def test_an_automatic_command_may_follow_the_hold_of_an_interrupted_swap():
    bench = Bench(Script(partial_lists=False), Faults(max_delay_s=DELAY_S, seed=5)).flying(OLD)
    bench.begin_swap(NEW)
    assert bench.run(20, lambda: bench.copter.mode == GUIDED)
    bench.take(bench.session.cancel(bench.now))
    assert bench.do("return_home", partial(basic.return_home, check_mode_first=True)).failure is None
    assert bench.copter.mode_name == "RTL"


@pytest.mark.parametrize("mode", [0, 3, 4, 5, 6, 9], ids="mode {}".format)
def test_an_operators_order_is_repeated_in_the_previous_mode_and_in_own_modes(mode):
    bench = Bench().flying(OLD)
    bench.copter.mode = mode
    bench.run(2)
    lost = []
    bench.block = lambda m: (
        m.get_type() == "COMMAND_LONG" and m.command == MODE and len(lost) < 2 and not lost.append(m)
    )
    assert bench.do("land", basic.land).failure is None
    assert bench.copter.mode_name == "LAND"
    assert len(lost) == (1 if mode == 9 else 2), "a vehicle in LAND gets no second command"
