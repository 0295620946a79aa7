"""Who is ordered to launch while others are in the air, told as stories."""

from __future__ import annotations

from typing import Any

import pytest
from agent_stories import GRID, Story, orders, publications
from traffic_stories import AMSL_M, MID_M, told

from swarmctl.agent.state import Phase
from swarmctl.agent.traffic.intents import MAX_AGE_S
from swarmctl.agent.traffic.launching import MAX_LAUNCH_WAIT_S, launch_conflict
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentPoint, IntentShared

LAUNCH = ev.FlightOrder.LAUNCH
GROUND = {
    "armed": False,
    "alt_rel_m": 0.0,
    "alt_amsl_m": AMSL_M - 30.0,
    "mode": "GUIDED",
    "mode_role": "hold",
}


class Priority(Story):
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

    def ordered(self, command: int | None = 1, past: tuple[int, ...] = ()) -> list[ev.Effect]:
        return self(ev.OperatorCommand(LAUNCH, command, ignore=past))

    def put_off(self, *, was_armed: bool = False) -> list[ev.Effect]:
        """As the runner tells, who asks before it is armed and before it takes off."""
        why = launch_conflict(self.state)
        assert why
        return self(ev.LaunchPostponed(why, was_armed))


def test_it_launches_where_it_would_meet_nobody() -> None:
    story = Priority()
    story.other((0.0, *MID_M, 60.0), (120.0, *MID_M, 60.0))
    assert orders(story.ordered()) == [LAUNCH]


@pytest.mark.parametrize("command", [1, None], ids=["by an operator", "by its own process"])
def test_it_waits_on_the_ground_while_somebody_is_in_its_way_and_says_so_once(command: int | None) -> None:
    story = Priority()
    story.hovers()
    effects = story.ordered(command)
    assert orders(effects) == []
    (text,) = told(effects)
    assert text.startswith("its first route would meet that of vehicle 7 in ")
    how = "" if command is None else " (`order launch --uav 2 --past 7` does not wait)"
    assert text.endswith(f": it waits on the ground, for 180 s at most{how}")
    assert [e.answer.note for e in effects if isinstance(e, ev.Answer)] == [text] * (command is not None)
    assert told(story.stands()) == []
    story.other((0.0, *MID_M, 30.0), (60.0, *MID_M, 200.0))
    effects = story.stands()
    assert orders(effects) == [LAUNCH]
    assert told(effects) == ["clear of the others: it launches"]
    assert (story.state.phase, story.state.trouble) == (Phase.LAUNCHING, "")


def test_who_passes_over_the_place_where_it_climbs_is_let_by() -> None:
    story = Priority()
    east_m, north_m = GRID.centre_m((4, 0))
    story.other((0.0, east_m, north_m - 100.0, 20.0), (20.0, east_m, north_m + 100.0, 20.0))
    assert orders(story.ordered()) == []
    story.now += 12.0
    assert orders(story.stands()) == [LAUNCH]


def test_of_whom_nothing_is_heard_any_more_it_does_not_wait() -> None:
    story = Priority()
    story.hovers()
    story.ordered()
    story.now += MAX_AGE_S
    assert orders(story.stands()) == [LAUNCH]


def waits_in_vain(command: int | None) -> tuple[Priority, list[str]]:
    story = Priority()
    story.hovers()
    story.ordered(command)
    said = []
    for _ in range(int(MAX_LAUNCH_WAIT_S)):
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
    assert text.endswith(" (`order launch --uav 2 --past 7` does not wait); it stands by for another order")
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
    story = Priority()
    story.hovers()
    story.ordered(command)
    story(ev.Rebooted())
    assert story.state.phase is phase


@pytest.mark.parametrize("order", [ev.FlightOrder.HOLD, ev.FlightOrder.RETURN])
def test_it_is_called_back_while_it_waits(order: ev.FlightOrder) -> None:
    story = Priority()
    story.hovers()
    story.ordered()
    story(ev.OperatorCommand(order, 2))
    story.now += MAX_AGE_S
    assert orders(story.stands()) == []
    assert story.state.phase is Phase.STANDBY


def test_a_launch_that_was_forbidden_before_anything_was_sent_may_be_ordered_again() -> None:
    story = Priority()
    story.ordered()
    effects = story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    assert told(effects) == ["not launched: battery: found 40 %; it stands by for another order"]
    assert orders(story.stands()) == []
    assert orders(story.ordered()) == [LAUNCH]


def about_to_take_off(command: int | None = 1) -> Priority:
    """Its way was clear when it was ordered, and is no more."""
    story = Priority()
    assert orders(story.ordered(command)) == [LAUNCH]
    story.stands()
    assert launch_conflict(story.state) == ""
    story.hovers()
    return story


@pytest.mark.parametrize("command", [1, None], ids=["by an operator", "by its own process"])
def test_who_comes_into_the_way_before_it_is_armed_is_waited_for(command: int | None) -> None:
    story = about_to_take_off(command)
    assert launch_conflict(story.state).startswith("its first route would meet that of vehicle 7 in ")
    effects = story.put_off()
    assert story.state.phase is Phase.STANDBY
    assert orders(effects) == []
    (text,) = told(effects)
    assert ": it waits on the ground, for 180 s at most" in text
    assert [m.points for m in publications(effects) if isinstance(m, IntentShared)] == [()]
    assert orders(story.stands()) == []
    story.other((0.0, *MID_M, 30.0), (60.0, *MID_M, 200.0))
    effects = story.stands()
    assert orders(effects) == [LAUNCH]
    assert told(effects) == ["clear of the others: it launches"]


def test_all_its_waiting_for_one_launch_is_bounded_once() -> None:
    """However often it is about to take off in between."""
    story = about_to_take_off()
    began_s = story.now
    while story.state.phase is not Phase.STANDBY or story.state.launch_ordered:
        if story.state.phase is Phase.LAUNCHING:
            story.hovers()
            said = told(story.put_off())
            story.now += 10.0
        else:
            story.other((0.0, *MID_M, 30.0), (60.0, *MID_M, 200.0))
            said = told(story.stands())
    assert story.now - began_s == pytest.approx(MAX_LAUNCH_WAIT_S, abs=15.0)
    assert said[-1].startswith("not launched: its first route would meet that of vehicle 7 in ")


@pytest.mark.parametrize(("command", "phase"), [(1, Phase.STANDBY), (None, Phase.FAILED)])
def test_one_that_was_armed_by_then_is_not_armed_again_by_that_order(
    command: int | None, phase: Phase
) -> None:
    story = about_to_take_off(command)
    story.over((4, 0), alt_rel_m=0.0, alt_amsl_m=AMSL_M - 30.0, mode="GUIDED", mode_role="hold")
    effects = story.put_off(was_armed=True)
    assert orders(effects) == []
    assert story.state.phase is phase
    assert "; it is disarmed again" in story.state.trouble
    story.now += MAX_AGE_S
    assert orders(story.stands()) == []
    assert story.state.phase is phase
    if command is not None:
        assert orders(story.ordered()) == [LAUNCH]


def test_two_that_were_ordered_at_one_moment_do_not_wait_for_each_other() -> None:
    """Each would tell the other that it is about to take off, and neither would fly."""
    story = Priority()
    story.ordered()
    path = tuple(IntentPoint(t, *GRID.frame.to_geodetic(*MID_M), AMSL_M) for t in (0.0, 120.0))
    story(ev.Intents(((7, 0.0, IntentShared(1, path, on_ground=True)),)))
    assert launch_conflict(story.state) == ""
    later = Priority()
    later(ev.Intents(((7, 0.0, IntentShared(1, path, on_ground=True)),)))
    assert orders(later.ordered()) == []


def test_it_tells_that_it_is_about_to_take_off_and_at_once_that_it_is_up() -> None:
    story = Priority()
    story.ordered()

    def says() -> list[bool]:
        return [m.on_ground for m in publications(story.effects) if isinstance(m, IntentShared)]

    story.stands()
    assert says() == [True]
    story(ev.OrderDone(LAUNCH))
    story.over((4, 0), alt_rel_m=1.0, alt_amsl_m=AMSL_M - 29.0)
    assert says() == [False]


# --- who keeps it on the ground for ever


def test_an_order_that_names_whom_not_to_wait_for_launches_it_past_that_one_and_says_so() -> None:
    story, _ = waits_in_vain(1)
    story.hovers()
    assert orders(story.ordered()) == []
    effects = story.ordered(past=(7,))
    assert orders(effects) == [LAUNCH]
    (text,) = told(effects)[1:]
    assert text.startswith("its first route would meet that of vehicle 7 in ")
    assert text.endswith(": it launches all the same, as ordered")
    assert launch_conflict(story.state) == ""


def test_whom_not_to_wait_for_may_be_named_while_it_is_about_to_take_off() -> None:
    story = Priority()
    assert orders(story.ordered()) == [LAUNCH]
    story.hovers()
    assert launch_conflict(story.state)
    (note,) = (e.answer.note for e in story.ordered(2, past=(7,)) if isinstance(e, ev.Answer))
    assert note == "it is about to take off"
    assert launch_conflict(story.state) == ""


def test_and_past_nobody_else() -> None:
    story = Priority()
    story.hovers()
    effects = story.ordered(past=(6, 8))
    assert orders(effects) == []
    assert "(`order launch --uav 2 --past 6 --past 7 --past 8` does not wait)" in story.state.trouble


def test_an_order_that_is_repeated_while_it_waits_changes_nothing_and_is_told_for_how_long() -> None:
    story = Priority()
    story.hovers()
    story.ordered()
    for _ in range(60):
        story.hovers()
        story.now -= 1.0
        story.stands()
    effects = story.ordered()
    assert orders(effects) == []
    (note,) = (e.answer.note for e in effects if isinstance(e, ev.Answer))
    assert "that of vehicle 7 in " in note
    left_s = float(note.partition("for ")[2].partition(" s at most")[0])
    assert left_s == pytest.approx(MAX_LAUNCH_WAIT_S - 60.0, abs=4.0)


def test_an_order_for_one_launch_is_none_for_the_next() -> None:
    story = Priority()
    story.hovers()
    story.ordered(past=(7,))
    story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    story.hovers()
    assert orders(story.ordered()) == []


def test_one_that_somebody_has_armed_meanwhile_is_brought_down() -> None:
    story = Priority()
    story.ordered()
    story.over((4, 0))
    effects = story(ev.OrderFailed(LAUNCH, "battery: found 40 %", nothing_sent=True))
    assert orders(effects) == [ev.FlightOrder.LAND]
