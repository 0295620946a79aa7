"""A launch whose way another vehicle blocks while it is under way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from bench import Bench, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import Copter, Script

from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.outcome import Done, LaunchBlocked

ARM, START = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_MISSION_START
WHY = "its first route would meet that of vehicle 7 in 9 s"


def launched(bench: Bench, blocked_by: Callable[[], str]) -> Done:
    bench.upload(plan(north=4))
    result: Done = bench.do("launch", lambda ctx: basic.launch(ctx, blocked_by))
    return result


def given(bench: Bench) -> list[tuple[int, float]]:
    """The commands to arm, to disarm and to start, with their first parameters, in order."""
    return [(number, params[0]) for number, params in bench.copter.commands if number in (ARM, START)]


def test_obstacles_are_checked_before_arming_and_before_the_take_off() -> None:
    bench, asked = Bench().prepared(), list[bool]()

    def clear() -> str:
        asked.append(bench.copter.armed)
        return ""

    assert launched(bench, clear).failure is None
    assert asked == [False, True]


def test_an_obstacle_before_arming_leaves_the_vehicle_unchanged() -> None:
    bench = Bench().prepared()
    assert launched(bench, lambda: WHY) == LaunchBlocked(WHY)
    assert given(bench) == []


def test_an_obstacle_before_the_take_off_disarms_the_vehicle() -> None:
    bench = Bench().prepared()
    reasons: Iterator[str] = iter(["", WHY])
    assert launched(bench, lambda: next(reasons)) == LaunchBlocked(WHY, was_armed=True)
    assert given(bench) == [(ARM, 1.0), (ARM, 0.0)]
    assert not bench.copter.armed


def test_a_vehicle_that_does_not_disarm_has_a_failed_launch() -> None:
    bench = Bench().prepared()
    arms = bench.copter.arm
    bench.copter.arm = lambda p1, *rest: arms(p1, *rest) if p1 else 4  # type: ignore[method-assign]
    reasons: Iterator[str] = iter(["", WHY])
    result = launched(bench, lambda: next(reasons))
    assert not isinstance(result, LaunchBlocked)
    assert result.failure is not None
    assert WHY in result.failure
    assert "[no-disarming]" in result.failure


def test_a_vehicle_that_stays_on_the_ground_and_armed_is_reported_so() -> None:
    bench = Bench(Script(stays_on_ground=True)).prepared()
    arms = bench.copter.arm
    bench.copter.arm = lambda p1, *rest: arms(p1, *rest) if p1 else 4  # type: ignore[method-assign]
    assert "[no-disarming]" in (launched(bench, lambda: "").failure or "")


@pytest.mark.parametrize("lost", [1, 2])
def test_an_unanswered_arming_is_followed_to_its_end(lost: int) -> None:
    """The command may have been taken: obstacles are checked again before the take-off."""
    bench, n_lost = Bench().prepared(), 0
    on_command = bench.copter.on_command_long

    def drop_the_first(message: Any) -> None:
        nonlocal n_lost
        if message.command == ARM and n_lost < lost:
            n_lost += 1
        else:
            on_command(message)

    bench.copter.on_command_long = drop_the_first  # type: ignore[method-assign]
    reasons: Iterator[str] = iter(["", WHY])
    assert launched(bench, lambda: next(reasons)) == LaunchBlocked(WHY, was_armed=True)
    assert not bench.copter.armed


@pytest.mark.parametrize("blocked", [False, True], ids=["it does not rise", "its way is blocked"])
@pytest.mark.parametrize("landed", [Landed.UNDEFINED, Landed.IN_AIR, Landed.TAKEOFF, Landed.LANDING])
def test_a_vehicle_that_may_be_in_the_air_is_never_disarmed(
    landed: Landed, blocked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It tells that it flies, or not that it stands; by its height it has not left the ground."""
    monkeypatch.setattr(Copter, "landed_state", landed)
    bench = Bench(Script(stays_on_ground=True)).prepared()
    reasons: Iterator[str] = iter(["", WHY if blocked else ""])
    result = launched(bench, lambda: next(reasons))
    assert bench.session.state.landed is landed
    assert given(bench) == [(ARM, 1.0), *([] if blocked else [(START, 0.0)])]
    assert bench.copter.armed
    assert not isinstance(result, LaunchBlocked)
    assert result.failure is not None
    assert "[no-take-off]" in result.failure
    assert "[no-disarming]" in result.failure
