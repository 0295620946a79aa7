"""Launches that another vehicle's route blocks before arming or before the take-off."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from flying_bench import FlyingBench, north_of_home
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_answers import refuse, stay_on_ground

from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.outcome import Done, LaunchBlocked

ARM, START = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_MISSION_START
WHY = "its first route would meet that of vehicle 7 in 9 s"


def result_of_launch(bench: FlyingBench, blocked_by: Callable[[], str]) -> Done:
    bench.upload(north_of_home(4))
    result: Done = bench.do("launch", lambda ctx: basic.launch(ctx, blocked_by))
    return result


def launch_commands(bench: FlyingBench) -> list[tuple[int, float]]:
    """Return the commands to arm, disarm and start in order, with their first parameters."""
    return [(m.command, m.param1) for m in bench.of("COMMAND_LONG") if m.command in (ARM, START)]


def prepared() -> FlyingBench:
    return FlyingBench("ardupilot").prepared()


def test_obstacles_are_checked_before_arming_and_before_the_take_off() -> None:
    bench, asked = prepared(), list[bool]()

    def clear() -> str:
        asked.append(bench.vehicle.armed)
        return ""

    assert result_of_launch(bench, clear).failure is None
    assert asked == [False, True]


def test_an_obstacle_before_arming_leaves_the_vehicle_unchanged() -> None:
    bench = prepared()
    assert result_of_launch(bench, lambda: WHY) == LaunchBlocked(WHY)
    assert launch_commands(bench) == []


def test_an_obstacle_before_the_take_off_disarms_the_vehicle() -> None:
    bench = prepared()
    reasons: Iterator[str] = iter(["", WHY])
    assert result_of_launch(bench, lambda: next(reasons)) == LaunchBlocked(WHY, was_armed=True)
    assert launch_commands(bench) == [(ARM, 1.0), (ARM, 0.0)]
    assert not bench.vehicle.armed


def test_a_launch_without_confirmed_disarming_fails() -> None:
    bench = prepared()
    refuse(bench.vehicle, ARM, when=lambda command: command.param1 == 0.0)
    reasons: Iterator[str] = iter(["", WHY])
    result = result_of_launch(bench, lambda: next(reasons))
    assert not isinstance(result, LaunchBlocked)
    assert result.failure is not None
    assert WHY in result.failure
    assert "[no-disarming]" in result.failure


@pytest.mark.parametrize("lost", [1, 2])
def test_an_unanswered_arming_is_followed_to_its_end(lost: int) -> None:
    """The vehicle may have armed: obstacles are checked again before the take-off."""
    bench, n_lost = prepared(), 0

    def is_lost(message: Any) -> bool:
        nonlocal n_lost
        n_lost += getattr(message, "command", None) == ARM
        return getattr(message, "command", None) == ARM and n_lost <= lost

    bench.block = is_lost
    reasons: Iterator[str] = iter(["", WHY])
    assert result_of_launch(bench, lambda: next(reasons)) == LaunchBlocked(WHY, was_armed=True)
    assert not bench.vehicle.armed


@pytest.mark.parametrize("blocked", [False, True], ids=["the vehicle does not rise", "the route is blocked"])
@pytest.mark.parametrize("landed", [Landed.UNDEFINED, Landed.IN_AIR])
def test_a_vehicle_that_may_be_in_the_air_is_never_disarmed(landed: Landed, blocked: bool) -> None:
    """The landed state is not ON_GROUND, although the height shows a vehicle on the ground."""
    bench = FlyingBench("ardupilot")
    stay_on_ground(bench.vehicle)

    def change(message: Any) -> None:
        if message.get_type() == "EXTENDED_SYS_STATE":
            message.landed_state = landed

    bench.block_down = change
    bench.prepared()
    reasons: Iterator[str] = iter(["", WHY if blocked else ""])
    result = result_of_launch(bench, lambda: next(reasons))
    assert bench.session.state.landed is landed
    assert launch_commands(bench) == [(ARM, 1.0), *([] if blocked else [(START, 0.0)])]
    assert bench.vehicle.armed
    assert not isinstance(result, LaunchBlocked)
    assert result.failure is not None
    assert "[no-take-off]" in result.failure
    assert "[no-disarming]" in result.failure
