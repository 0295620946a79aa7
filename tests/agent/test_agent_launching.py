"""Launches while other vehicles are in the air, as stories."""

from __future__ import annotations

import re
from typing import Any

import pytest
from agent_stories import (
    AMSL_M,
    GRID,
    MID_M,
    Story,
    answers,
    codes,
    intent_path,
    operator_texts,
    orders,
    publications,
)

from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.prediction import MAX_AGE_S
from swarmctl.agent.traffic.wait import RULES, WaitFor
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentShared

LONGEST_S = RULES[WaitFor.FIRST_ROUTE].longest_s

LAUNCH = ev.FlightOrder.LAUNCH
GROUND = {
    "armed": False,
    "alt_rel_m": 0.0,
    "alt_amsl_m": AMSL_M - 30.0,
    "mode": "GUIDED",
    "mode_role": "hold",
}


class OnGround(Story):
    """Vehicle 2 on the ground at the west end of row 4, with a mission to its east end."""

    def __init__(self, **changes: Any) -> None:
        super().__init__(uav=2, **changes)
        self.standby()
        self.wait_on_ground()

    def wait_on_ground(self) -> list[ev.Effect]:
        return self.over((4, 0), **GROUND)

    def other(self, *points: tuple[float, float, float, float]) -> list[ev.Effect]:
        """Receive an intent of vehicle 7: points (seconds from then, east, north, up above home)."""
        path = intent_path(*((t, e, n, AMSL_M - 30.0 + up) for t, e, n, up in points))
        return self.told(intents=((7, 0.0, IntentShared(1, path)),))

    def hovers(self) -> list[ev.Effect]:
        """Receive an intent over the middle of the row, at the height of vehicle 2's mission."""
        return self.other((0.0, *MID_M, 30.0), (120.0, *MID_M, 30.0))

    def ordered(self, command: int | None = 1, ignore: tuple[int, ...] = ()) -> list[ev.Effect]:
        return self(ev.OperatorCommand(LAUNCH, command, ignore=ignore))

    def postpone(self, *, was_armed: bool = False) -> list[ev.Effect]:
        """Postpone the launch as the runner does before arming and before take-off."""
        why = self.state.launch.conflict
        assert why
        return self(ev.LaunchPostponed(why, was_armed))


def test_a_clear_first_route_launches() -> None:
    story = OnGround()
    story.other((0.0, *MID_M, 60.0), (120.0, *MID_M, 60.0))
    assert orders(story.ordered()) == [LAUNCH]


@pytest.mark.parametrize("command", [1, None], ids=["by an operator", "by the own process"])
def test_a_conflict_keeps_the_vehicle_on_the_ground_and_is_reported_once(command: int | None) -> None:
    story = OnGround()
    story.hovers()
    effects = story.ordered(command)
    assert orders(effects) == []
    (text,) = operator_texts(effects)
    assert codes(effects) == ["launch-waits"]
    assert "vehicle 7 " in text
    assert "180 s" in text
    assert ("`order launch --uav 2 --ignore 7`" in text) is (command is not None)
    assert [answer.note for answer in answers(effects)] == [text] * (command is not None)
    assert operator_texts(story.wait_on_ground()) == []
    effects = story.other((0.0, *MID_M, 30.0), (60.0, *MID_M, 200.0))
    assert orders(effects) == [LAUNCH]
    assert codes(effects) == ["launch-clear"]
    assert (story.state.phase, story.state.trouble) == (Phase.LAUNCHING, "")


def test_a_launch_waits_for_a_vehicle_that_crosses_the_climb() -> None:
    story = OnGround()
    east_m, north_m = GRID.centre_m((4, 0))
    story.other((0.0, east_m, north_m - 100.0, 20.0), (20.0, east_m, north_m + 100.0, 20.0))
    assert orders(story.ordered()) == []
    story.now += 12.0
    assert orders(story.wait_on_ground()) == [LAUNCH]


def test_a_silent_vehicle_does_not_delay_the_launch() -> None:
    story = OnGround()
    story.hovers()
    story.ordered()
    story.now += MAX_AGE_S
    assert orders(story.wait_on_ground()) == [LAUNCH]


def wait_until_the_limit(command: int | None) -> tuple[OnGround, list[str]]:
    story = OnGround()
    story.hovers()
    story.ordered(command)
    texts = []
    for _ in range(int(LONGEST_S)):
        story.hovers()
        story.now -= 1.0
        effects = story.wait_on_ground()
        assert orders(effects) == []
        texts += operator_texts(effects)
    return story, texts


def test_after_the_longest_wait_the_vehicle_stands_by_for_a_new_order() -> None:
    story, texts = wait_until_the_limit(1)
    (text,) = texts
    assert "vehicle 7 " in text
    assert "`order launch --uav 2 --ignore 7`" in text
    assert text.endswith("[not-launched]")
    assert story.state.phase is Phase.STANDBY
    story.now += MAX_AGE_S
    assert orders(story.wait_on_ground()) == []
    assert orders(story.ordered()) == [LAUNCH]


def test_a_launch_by_the_own_process_fails_after_the_longest_wait() -> None:
    story, _ = wait_until_the_limit(None)
    assert story.state.phase is Phase.FAILED
    assert "vehicle 7 " in story.state.outcome


@pytest.mark.parametrize(("command", "phase"), [(1, Phase.WAITING), (None, Phase.FAILED)])
def test_a_reboot_during_the_wait_cancels_the_launch(command: int | None, phase: Phase) -> None:
    story = OnGround()
    story.hovers()
    story.ordered(command)
    story(ev.Rebooted())
    assert story.state.phase is phase


@pytest.mark.parametrize("order", [ev.FlightOrder.HOLD, ev.FlightOrder.RETURN])
def test_an_order_during_the_wait_cancels_the_launch(order: ev.FlightOrder) -> None:
    story = OnGround()
    story.hovers()
    story.ordered()
    story(ev.OperatorCommand(order, 2))
    story.now += MAX_AGE_S
    assert orders(story.wait_on_ground()) == []
    assert story.state.phase is Phase.STANDBY


def test_a_refused_launch_may_be_ordered_again() -> None:
    story = OnGround()
    story.ordered()
    effects = story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    assert codes(effects) == ["not-launched"]
    assert "40 %" in operator_texts(effects)[0]
    assert orders(story.wait_on_ground()) == []
    assert orders(story.ordered()) == [LAUNCH]


def about_to_take_off(command: int | None = 1) -> OnGround:
    """Return a vehicle with a conflict that appears after the launch order."""
    story = OnGround()
    assert orders(story.ordered(command)) == [LAUNCH]
    story.wait_on_ground()
    assert story.state.launch.conflict == ""
    story.hovers()
    return story


@pytest.mark.parametrize("command", [1, None], ids=["by an operator", "by the own process"])
def test_a_conflict_before_arming_makes_the_vehicle_wait(command: int | None) -> None:
    story = about_to_take_off(command)
    assert "vehicle 7 " in story.state.launch.conflict
    effects = story.postpone()
    assert story.state.phase is Phase.STANDBY
    assert orders(effects) == []
    assert codes(effects) == ["launch-waits"]
    assert "180 s" in operator_texts(effects)[0]
    assert [intent.points for intent in publications(effects, IntentShared)] == [()]
    assert orders(story.wait_on_ground()) == []
    effects = story.other((0.0, *MID_M, 30.0), (60.0, *MID_M, 200.0))
    assert orders(effects) == [LAUNCH]
    assert codes(effects) == ["launch-clear"]


def test_attempts_do_not_extend_the_longest_wait() -> None:
    """Launch attempts during the wait do not restart the wait."""
    story = about_to_take_off()
    began_s = story.now
    while story.state.phase is not Phase.STANDBY or story.state.launch.is_ordered:
        if story.state.phase is Phase.LAUNCHING:
            story.hovers()
            texts = operator_texts(story.postpone())
            story.now += 10.0
        else:
            story.other((0.0, *MID_M, 30.0), (60.0, *MID_M, 200.0))
            texts = operator_texts(story.wait_on_ground())
    assert story.now - began_s == pytest.approx(LONGEST_S, abs=15.0)
    assert "vehicle 7 " in texts[-1]
    assert texts[-1].endswith("[not-launched]")


@pytest.mark.parametrize(("command", "phase"), [(1, Phase.STANDBY), (None, Phase.FAILED)])
def test_one_launch_order_arms_once(command: int | None, phase: Phase) -> None:
    story = about_to_take_off(command)
    story.over((4, 0), alt_rel_m=0.0, alt_amsl_m=AMSL_M - 30.0, mode="GUIDED", mode_role="hold")
    effects = story.postpone(was_armed=True)
    assert orders(effects) == []
    assert story.state.phase is phase
    story.now += MAX_AGE_S
    assert orders(story.wait_on_ground()) == []
    assert story.state.phase is phase
    if command is not None:
        assert orders(story.ordered()) == [LAUNCH]


@pytest.mark.parametrize(
    ("uav", "may_change", "waits"), [(7, True, False), (1, True, True), (7, False, True)]
)
def test_of_simultaneous_launches_the_higher_system_id_waits(uav: int, may_change: bool, waits: bool) -> None:
    """If both waited, none would fly. A vehicle that is armed already goes first."""
    path = intent_path((0.0, *MID_M, AMSL_M), (120.0, *MID_M, AMSL_M))
    announced = ((uav, 0.0, IntentShared(1, path, may_change=may_change, on_ground=True)),)
    story = OnGround()
    story.ordered()
    story.told(intents=announced)
    assert bool(story.state.launch.conflict) is waits
    later = OnGround()
    later.told(intents=announced)
    assert bool(orders(later.ordered())) is not waits


def test_take_off_is_announced_before_and_after() -> None:
    story = OnGround()
    story.ordered()

    def announced() -> list[bool]:
        return [intent.on_ground for intent in publications(story.effects, IntentShared)]

    story.wait_on_ground()
    assert announced() == [True]
    story(ev.OrderDone(LAUNCH))
    story.over((4, 0), alt_rel_m=1.0, alt_amsl_m=AMSL_M - 29.0)
    assert announced() == [False]


# --- launches that ignore other vehicles


def test_an_ignored_vehicle_does_not_delay_the_launch() -> None:
    story, _ = wait_until_the_limit(1)
    story.hovers()
    assert orders(story.ordered()) == []
    effects = story.ordered(ignore=(7,))
    assert orders(effects) == [LAUNCH]
    assert codes(effects)[1:] == ["launch-ignores"]
    assert "vehicle 7 " in operator_texts(effects)[1]
    assert story.state.launch.conflict == ""


def test_a_vehicle_can_be_ignored_during_the_launch() -> None:
    story = OnGround()
    assert orders(story.ordered()) == [LAUNCH]
    story.hovers()
    assert story.state.launch.conflict
    (answer,) = answers(story.ordered(2, ignore=(7,)))
    assert answer.note.endswith("[launching]")
    assert story.state.launch.conflict == ""


def test_other_vehicles_still_delay_the_launch() -> None:
    story = OnGround()
    story.hovers()
    effects = story.ordered(ignore=(6, 8))
    assert orders(effects) == []
    assert "`order launch --uav 2 --ignore 6 --ignore 7 --ignore 8`" in story.state.trouble


def test_a_repeated_order_does_not_restart_the_wait() -> None:
    story = OnGround()
    story.hovers()
    story.ordered()
    for _ in range(60):
        story.hovers()
        story.now -= 1.0
        story.wait_on_ground()
    effects = story.ordered()
    assert orders(effects) == []
    (answer,) = answers(effects)
    assert "vehicle 7 " in answer.note
    left_s = float(re.findall(r"(\d+) s", answer.note)[-1])
    assert left_s == pytest.approx(LONGEST_S - 60.0, abs=4.0)


def test_ignored_vehicles_count_for_one_launch() -> None:
    story = OnGround()
    story.hovers()
    story.ordered(ignore=(7,))
    story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    story.hovers()
    assert orders(story.ordered()) == []


def test_a_vehicle_armed_during_the_launch_lands() -> None:
    story = OnGround()
    story.ordered()
    story.over((4, 0))
    effects = story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    assert orders(effects) == [ev.FlightOrder.LAND]


def test_a_conflict_during_the_launch_is_reported_at_its_beginning_and_its_end() -> None:
    story = OnGround()
    story.ordered()
    (found,) = (e for e in story.hovers() if isinstance(e, ev.LaunchConflict))
    assert "vehicle 7 " in found.text
    assert ev.LaunchConflict("") in story.told(intents=((7, 0.0, IntentShared(2, ())),))
