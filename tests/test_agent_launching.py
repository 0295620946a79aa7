"""Who is ordered to launch while others are in the air, told as stories."""

from __future__ import annotations

from typing import Any

import pytest
from test_agent import GRID, Story, orders
from test_agent_intents import AMSL_M, MID_M, told

from swarmctl.agent import Phase
from swarmctl.agent.intents import MAX_AGE_S
from swarmctl.agent.launching import WAITS_FOR_S
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentPoint, IntentShared

LAUNCH = ev.Order.LAUNCH
GROUND = {
    "armed": False,
    "alt_rel_m": 0.0,
    "alt_amsl_m": AMSL_M - 30.0,
    "mode": "GUIDED",
    "mode_role": "hold",
}


class Standing(Story):
    """Vehicle 2 stands at the west end of row 4, with a mission to the east end of it."""

    def __init__(self, **changes: Any) -> None:
        super().__init__(uav=2, **changes)
        self(ev.Ready())
        self.swap()
        self.accept()
        self.stands()

    def stands(self) -> list[ev.Effect]:
        return self.over((4, 0), **GROUND)

    def other(self, *points: tuple[float, float, float, float]) -> list[ev.Effect]:
        """Vehicle 7 tells that it will be at (seconds from then, east, north, up above home)."""
        path = tuple(
            IntentPoint(t, *GRID.frame.to_geodetic(e, n), AMSL_M - 30.0 + up) for t, e, n, up in points
        )
        return self(ev.Intents(((7, 0.0, IntentShared(1, path)),)))

    def hovers(self) -> list[ev.Effect]:
        """Over the middle of the row, at the height of vehicle 2's mission."""
        return self.other((0.0, *MID_M, 30.0), (120.0, *MID_M, 30.0))

    def ordered(self, command: int | None = 1) -> list[ev.Effect]:
        return self(ev.OperatorCommand(LAUNCH, command))


def test_it_launches_where_it_would_meet_nobody() -> None:
    story = Standing()
    story.other((0.0, *MID_M, 60.0), (120.0, *MID_M, 60.0))
    assert orders(story.ordered()) == [LAUNCH]


@pytest.mark.parametrize("command", [1, None], ids=["by an operator", "by its own process"])
def test_it_waits_on_the_ground_while_somebody_is_in_its_way_and_says_so_once(command: int | None) -> None:
    story = Standing()
    story.hovers()
    effects = story.ordered(command)
    assert orders(effects) == []
    (text,) = told(effects)
    assert text.startswith("its first route would meet that of vehicle 7 in ")
    assert text.endswith(": it waits on the ground, for 180 s at most")
    assert [e.answer.note for e in effects if isinstance(e, ev.Answer)] == [text] * (command is not None)
    assert told(story.stands()) == []
    story.other((0.0, *MID_M, 30.0), (60.0, *MID_M, 200.0))
    effects = story.stands()
    assert orders(effects) == [LAUNCH]
    assert told(effects) == ["clear of the others: it launches"]
    assert (story.state.phase, story.state.trouble) == (Phase.LAUNCHING, "")


def test_who_passes_over_the_place_where_it_climbs_is_let_by() -> None:
    story = Standing()
    east_m, north_m = GRID.centre_m((4, 0))
    story.other((0.0, east_m, north_m - 100.0, 20.0), (20.0, east_m, north_m + 100.0, 20.0))
    assert orders(story.ordered()) == []
    story.now += 12.0
    assert orders(story.stands()) == [LAUNCH]


def test_of_whom_nothing_is_heard_any_more_it_does_not_wait() -> None:
    story = Standing()
    story.hovers()
    story.ordered()
    story.now += MAX_AGE_S
    assert orders(story.stands()) == [LAUNCH]


def waits_in_vain(command: int | None) -> tuple[Standing, list[str]]:
    story = Standing()
    story.hovers()
    story.ordered(command)
    said = []
    for _ in range(int(WAITS_FOR_S)):
        story.hovers()
        story.now -= 1.0
        effects = story.stands()
        assert orders(effects) == []
        said += told(effects)
    return story, said


def test_after_a_time_it_stands_by_again_and_a_later_order_is_looked_at_anew() -> None:
    story, said = waits_in_vain(1)
    (text,) = said
    assert text.startswith("not launched: its first route would meet that of vehicle 7 in ")
    assert text.endswith("; it stands by for another order")
    assert story.state.phase is Phase.STANDBY
    story.now += MAX_AGE_S
    assert orders(story.stands()) == []
    assert orders(story.ordered()) == [LAUNCH]


def test_what_its_own_process_launches_stays_on_the_ground_for_good() -> None:
    story, _ = waits_in_vain(None)
    assert story.state.phase is Phase.FAILED
    assert story.state.outcome.startswith("not launched: ")


@pytest.mark.parametrize(("command", "phase"), [(1, Phase.WAITING), (None, Phase.FAILED)])
def test_one_that_boots_while_it_waits_is_not_launched_by_that_order(
    command: int | None, phase: Phase
) -> None:
    story = Standing()
    story.hovers()
    story.ordered(command)
    story(ev.Rebooted())
    assert story.state.phase is phase


@pytest.mark.parametrize("order", [ev.Order.HOLD, ev.Order.RETURN])
def test_it_is_called_back_while_it_waits(order: ev.Order) -> None:
    story = Standing()
    story.hovers()
    story.ordered()
    story(ev.OperatorCommand(order, 2))
    story.now += MAX_AGE_S
    assert orders(story.stands()) == []
    assert story.state.phase is Phase.STANDBY


def test_a_launch_that_was_forbidden_before_anything_was_sent_may_be_ordered_again() -> None:
    story = Standing()
    story.ordered()
    effects = story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    assert told(effects) == ["not launched: battery: found 40 %; it stands by for another order"]
    assert orders(story.stands()) == []
    assert orders(story.ordered()) == [LAUNCH]


def test_one_that_somebody_has_armed_meanwhile_is_brought_down() -> None:
    story = Standing()
    story.ordered()
    story.over((4, 0))
    effects = story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    assert orders(effects) == [ev.Order.LAND]
