"""Takeovers by radio control: no command overrides the pilot."""

from __future__ import annotations

from functools import partial
from math import inf
from typing import Any

import pytest
from flying_bench import Faults, FlyingBench, is_partial_list, plan
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_answers import refuse, refuse_heartbeats, stay_on_ground

from swarmctl.core.records import replace
from swarmctl.mavlink.procedures import basic

OLD, NEW = plan(north=12, alt=10.0), plan(north=6, east=0.002, alt=10.0)
AUTO, GUIDED, LOITER = 3, 4, 5
MODE, ARM, START, CURRENT = 176, 400, 300, 224
DELAY_S = 0.3


WIRES: dict[str, Faults] = {
    "quick wire": Faults(max_delay_s=0.1),
    "slow wire": Faults(max_delay_s=DELAY_S, seed=1),
    "bad wire": Faults(max_delay_s=DELAY_S, doubling=0.2, loss=0.2, seed=2),
    "regular heartbeats only": Faults(max_delay_s=DELAY_S, seed=3),
    "no partial lists": Faults(max_delay_s=DELAY_S, seed=4),
}
EVERY_TENTH = [n * 0.1 for n in range(90)]


def copter() -> FlyingBench:
    return FlyingBench("ardupilot")


def spoil(bench: FlyingBench, wire: str) -> None:
    """Apply the faults of a wire, and the peculiarity of the vehicle."""
    if wire == "regular heartbeats only":
        refuse_heartbeats(bench.vehicle)
    if wire == "no partial lists":
        bench.block = is_partial_list
    bench.spoil(WIRES[wire])


def arm(vehicle: Any) -> None:
    vehicle.arming.arm(vehicle.now, force=True)


def orders(bench: FlyingBench, since: int) -> list[tuple[float, int]]:
    """Return (now, command) of each command that changes a mode or item, arms or starts."""
    sent = [(now, m.command) for now, m in bench.sent[since:] if m.get_type() == "COMMAND_LONG"]
    return [(now, command) for now, command in sent if command in (MODE, ARM, START, CURRENT)]


def taken_over(
    bench: FlyingBench, name: str, procedure, after_s: float, mode: int = LOITER
) -> tuple[list[tuple[float, int]], object]:
    """Run a procedure with a pilot takeover after `after_s`, repeated after a crossing command.

    Returns the orders sent after the last heartbeat from before the takeover had arrived, and the result.
    """
    take_s = bench.now + after_s
    window_s = bench.faults.max_delay_s + FlyingBench.STEP_S / 2
    taken_s, checked = inf, len(bench.sent)
    late: list[tuple[float, int]] = []

    def watch() -> bool:
        nonlocal taken_s, checked
        late.extend(order for order in orders(bench, checked) if order[0] - taken_s > window_s)
        checked = len(bench.sent)
        if bench.vehicle.mode.number != mode and bench.now >= take_s:
            bench.pilot(lambda vehicle: vehicle.modes.enter(mode))
            taken_s = bench.now
        return bench.session.busy_with is None

    bench.begin(name, procedure)
    assert bench.run(400, watch), f"{name} does not end"
    return late, bench.result


@pytest.mark.full
@pytest.mark.parametrize("wire", WIRES)
def test_a_pilot_takeover_at_any_moment_of_a_swap_is_respected(wire):
    foreign = 0
    for after_s in EVERY_TENTH:
        bench = copter().flying(OLD)
        spoil(bench, wire)
        late, result = taken_over(bench, "swap", partial(basic.swap, plan=NEW), after_s)
        assert late == [], f"taken over after {after_s:.1f} s: {result}"
        if result.failure is not None and "LOITER" in result.failure:
            foreign += 1
            assert result.flying == "theirs"
            assert bench.vehicle.mode.number == LOITER
    assert foreign > 0, "no takeover fell within a swap, so nothing was tested"


@pytest.mark.parametrize("wire", [*full_only("quick wire"), "slow wire"])
def test_a_pilot_takeover_by_hold_mode_during_a_swap_is_respected(wire):
    """Another station sets GUIDED. Only a swap with its own hold cannot tell the two holds apart."""
    theirs = 0
    for after_s in EVERY_TENTH[:40]:
        bench = copter().flying(OLD)
        spoil(bench, wire)
        job = partial(basic.swap, plan=NEW)
        late, result = taken_over(bench, "swap", job, after_s, GUIDED)
        assert late == [], f"taken over after {after_s:.1f} s: {result}"
        assert result.flying in ("theirs", "new")
        if result.flying == "theirs":
            theirs += 1
            assert bench.vehicle.mode.number == GUIDED
    assert theirs > 0


def test_a_swap_sends_nothing_in_a_hold_that_another_station_ordered():
    bench = copter().flying(OLD)
    bench.pilot(lambda vehicle: vehicle.modes.enter(GUIDED))
    bench.run(2)
    sent = len(bench.sent)
    assert bench.swap(NEW).flying == "theirs"
    assert orders(bench, sent) == []
    assert bench.swap(replace(NEW, from_hold=True)).flying == "new"


@pytest.mark.parametrize("wire", WIRES)
def test_a_pilot_takeover_at_any_moment_of_a_launch_is_respected(wire):
    foreign = 0
    for after_s in EVERY_TENTH[:40]:
        bench = copter().uploaded(OLD)
        spoil(bench, wire)
        late, result = taken_over(bench, "launch", basic.launch, after_s)
        assert late == [], f"taken over after {after_s:.1f} s: {result}"
        if result.failure is not None and "LOITER" in result.failure:
            foreign += 1
            assert bench.vehicle.mode.number == LOITER
    assert foreign > 0, "no takeover fell within a launch, so nothing was tested"


@pytest.mark.parametrize("command", [ARM, START, CURRENT, MODE])
def test_an_unanswered_command_is_not_repeated_against_a_pilot(command):
    """The first command is lost; the pilot takes over before the time of its repetition."""
    launches = command in (ARM, START)
    # Without partial lists the swap sets a mode, as the vehicle has to hold.
    lost = "MISSION_WRITE_PARTIAL_LIST" if command == MODE else None
    bench = copter().uploaded(OLD) if launches else copter().flying(OLD)
    bench.block = lambda m: m.get_type() == lost or getattr(m, "command", None) == command
    begun = len(bench.sent)
    job = basic.launch if launches else (lambda c: basic.swap(c, NEW))
    bench.begin("job", job)
    assert bench.run(10, lambda: command in [c for _, c in orders(bench, begun)])
    sent = len(bench.sent)
    bench.pilot(lambda vehicle: vehicle.modes.enter(LOITER))
    assert bench.run(100, lambda: bench.session.busy_with is None)
    assert orders(bench, sent) == []
    assert "LOITER" in bench.result.failure


def test_an_unanswered_command_is_repeated_unless_a_pilot_has_taken_over():
    bench = copter().flying(OLD)
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
    bench = copter().flying(OLD)
    answers = []

    def is_busy(_command) -> bool:
        answers.append(1 if len(answers) < 2 else 0)
        return bool(answers[-1])

    refuse(bench.vehicle, MODE, mavlink.MAV_RESULT_TEMPORARILY_REJECTED, when=is_busy)
    begun = len(bench.sent)
    assert bench.do("land", basic.land).failure is None
    assert answers == [1, 1, 0]
    sent = [m.command for _, m in bench.sent[begun:] if m.command in (512, MODE)]
    assert sent[:5] == [MODE, 512, MODE, 512, MODE]


def test_launch_sends_nothing_to_a_vehicle_that_is_armed_already():
    bench = copter().uploaded(OLD)
    bench.pilot(arm)
    bench.run(2)
    sent = len(bench.sent)
    assert "[armed]" in bench.do("launch", basic.launch).failure
    assert len(bench.sent) == sent


def test_launch_sends_nothing_if_a_pilot_armed_after_the_last_heartbeat():
    bench = copter().uploaded(OLD)
    bench.pilot(arm)
    sent = len(bench.sent)
    assert not bench.session.state.armed
    assert "[taken-over]" in bench.do("launch", basic.launch).failure
    assert orders(bench, sent) == []


@pytest.mark.parametrize(
    ("nth_request", "pilot", "orders_before"),
    [
        (2, arm, []),
        (4, lambda vehicle: vehicle.modes.enter(AUTO), [ARM]),
        (4, lambda vehicle: vehicle.arming.stop(), [ARM]),
    ],
    ids=["arms before the launch does", "starts the mission before the launch does", "disarms the vehicle"],
)
def test_launch_ends_if_a_pilot_arms_disarms_or_starts_the_mission(nth_request, pilot, orders_before):
    """The pilot acts just before the answer to the heartbeat request with number `nth_request`."""
    bench = copter().uploaded(OLD)
    asked = []

    def interfere(message) -> bool:
        if message.get_type() == "COMMAND_LONG" and message.command == 512:
            asked.append(message)
            if len(asked) == nth_request:
                bench.pilot(pilot)
        return False

    bench.block = interfere
    begun = len(bench.sent)
    assert "[taken-over]" in bench.do("launch", basic.launch).failure
    assert [command for _, command in orders(bench, begun)] == orders_before


def test_launch_does_not_begin_in_a_mode_chosen_by_a_pilot():
    bench = copter().uploaded(OLD)
    bench.pilot(lambda vehicle: vehicle.modes.enter(LOITER))
    sent = len(bench.sent)
    assert "LOITER" in bench.do("launch", basic.launch).failure
    assert orders(bench, sent) == []


def test_a_failed_launch_does_not_disarm_after_a_pilot_takeover():
    bench = copter().uploaded(OLD)
    stay_on_ground(bench.vehicle)
    bench.begin("launch", basic.launch)
    assert bench.run(10, lambda: bench.mode == "AUTO")
    sent = len(bench.sent)
    bench.pilot(lambda vehicle: vehicle.modes.enter(LOITER))
    assert bench.run(60, lambda: bench.session.busy_with is None)
    assert "LOITER" in bench.result.failure
    assert orders(bench, sent) == []
    assert bench.vehicle.armed


def test_prepare_sends_nothing_if_a_pilot_armed_after_the_last_heartbeat():
    bench = copter().connected()
    bench.run(3)
    bench.pilot(arm)
    bench.pilot(lambda vehicle: vehicle.modes.enter(LOITER))
    sent = len(bench.sent)
    assert "[armed]" in bench.do("prepare", basic.prepare).failure
    assert orders(bench, sent) == []


@pytest.mark.parametrize("job", [basic.hold, basic.return_home, basic.land])
def test_an_operators_order_is_sent_at_once_and_not_repeated_against_a_pilot(job):
    bench = copter().flying(OLD)
    bench.block = lambda m: m.get_type() == "COMMAND_LONG" and m.command == MODE
    sent = len(bench.sent)
    bench.begin("order", job)
    assert orders(bench, sent) == [(bench.now, MODE)]
    bench.pilot(lambda vehicle: vehicle.modes.enter(LOITER))
    assert bench.run(100, lambda: bench.session.busy_with is None)
    assert len(orders(bench, sent)) == 1
    assert "LOITER" in bench.result.failure


@pytest.mark.parametrize("job", [basic.hold, basic.return_home, basic.land])
@pytest.mark.parametrize("mode", [GUIDED, LOITER])
def test_an_automatic_command_waits_for_a_new_heartbeat(job, mode):
    """A pilot acted a moment ago, and no heartbeat has reported the change yet."""
    bench = copter().flying(OLD)
    refuse_heartbeats(bench.vehicle)
    heartbeats = bench.session.state
    bench.run(3, lambda: bench.session.state is not heartbeats)
    bench.pilot(lambda vehicle: vehicle.modes.enter(mode))
    sent = len(bench.sent)
    result = bench.do("order", partial(job, check_mode_first=True))
    assert bench.vehicle.mode.number == mode
    if job is not basic.hold or mode != GUIDED:
        assert orders(bench, sent) == []
        assert "[taken-over]" in result.failure


def test_an_automatic_command_may_follow_the_hold_of_an_interrupted_swap():
    bench = copter().flying(OLD)
    bench.block = is_partial_list
    bench.spoil(Faults(max_delay_s=DELAY_S, seed=5))
    bench.begin_swap(NEW)
    assert bench.run(20, lambda: bench.mode == "GUIDED")
    bench.take(bench.session.cancel(bench.now))
    assert bench.do("return_home", partial(basic.return_home, check_mode_first=True)).failure is None
    assert bench.mode == "RTL"


@pytest.mark.parametrize("mode", [0, 3, 4, 5, 6, 9], ids="mode {}".format)
def test_an_operators_order_is_repeated_in_the_previous_mode_and_in_own_modes(mode):
    bench = copter().flying(OLD)
    bench.pilot(lambda vehicle: vehicle.modes.enter(mode))
    bench.run(2)
    lost = []
    bench.block = lambda m: (
        m.get_type() == "COMMAND_LONG" and m.command == MODE and len(lost) < 2 and not lost.append(m)
    )
    assert bench.do("land", basic.land).failure is None
    assert bench.mode == "LAND"
    assert len(lost) == (1 if mode == 9 else 2), "a vehicle in LAND gets no second command"
