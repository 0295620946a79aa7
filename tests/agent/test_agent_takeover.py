"""Ownership of a vehicle: no command overrides a foreign mode, and an operator's order stays in force."""

from __future__ import annotations

import pytest
from agent_stories import GRID, MID_M, ApproachStory, Story, orders, publications, swaps

from swarmctl.agent.phases import Phase
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.core.planned_mission import PlannedMission

HOLD = {"mode": "GUIDED", "mode_role": "hold", "ground_speed_m_s": 0.0}


def swapping() -> tuple[Story, PlannedMission]:
    story = Story().flying()
    story.hear((4, 3, True), (4, 4, True), (4, 2, True))
    return story, story.swap()


def wait(story: Story, seconds: int, **vehicle: object) -> list[ev.Effect]:
    effects: list[ev.Effect] = []
    for _ in range(seconds):
        effects += story.over((4, 1), **vehicle)
        effects += story.tick()
    return effects


def test_a_takeover_during_a_mission_change_releases_the_vehicle() -> None:
    story, swap = swapping()
    assert ev.Release() in story(ev.MissionFailed(swap.plan_id, "theirs", "its mode is GUIDED"))
    assert story.state.phase is Phase.RELEASED
    assert "its mode is GUIDED" in story.state.outcome
    assert not [e for e in wait(story, 10, **HOLD) if isinstance(e, ev.SwapMission | ev.Command)]


def test_a_failsafe_hold_after_an_interrupted_mission_change_is_not_overridden() -> None:
    story, swap = swapping()
    story(ev.LinkLost(5.0))
    story(ev.MissionFailed(swap.plan_id, "unknown", "no heartbeat for 5 s"))
    story.now += 10.0
    story(ev.LinkRestored())
    effects = wait(story, 10, **HOLD)
    assert ev.Release() in effects
    assert swaps(effects) == []


def test_a_mission_change_that_ended_in_hold_is_resumed() -> None:
    story, swap = swapping()
    story(ev.MissionFailed(swap.plan_id, "hold", "the vehicle does not hold the new mission"))
    (again,) = swaps(wait(story, 12, **HOLD))
    assert again.plan.from_hold
    assert not swap.plan.from_hold
    story(ev.MissionAccepted(again.plan_id))
    assert ev.Release() in wait(story, 10, **HOLD), "a second hold is that of another operator"


def test_a_refused_return_is_not_repeated_against_a_pilots_hold() -> None:
    story = Story().flying()
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    story(ev.OrderFailed(ev.FlightOrder.RETURN, "DO_SET_MODE: TEMPORARILY_REJECTED"))
    effects = wait(story, 20, **HOLD)
    assert orders(effects) == []
    assert ev.Release() in effects


def test_a_refused_return_is_repeated_in_mission_mode() -> None:
    story = Story().flying()
    (first,) = (e for e in story(ev.OperatorCommand(ev.FlightOrder.RETURN)) if isinstance(e, ev.Command))
    story(ev.OrderFailed(ev.FlightOrder.RETURN, "DO_SET_MODE: TEMPORARILY_REJECTED"))
    again = [e for e in wait(story, 10) if isinstance(e, ev.Command)]
    assert first.by_person
    assert again
    assert not again[0].by_person, "a repetition by the agent needs a check of the mode"


@pytest.mark.parametrize("number", [1, None], ids=["operator", "this process"])
def test_an_ordered_hold_outlasts_giving_way(number: int | None) -> None:
    story = ApproachStory()
    story.crossing(1)
    story.at(125.0)
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    effects = story(ev.OperatorCommand(ev.FlightOrder.HOLD, number))
    assert [e for e in effects if isinstance(e, ev.Command)] == [
        ev.Command(ev.FlightOrder.HOLD, by_person=True)
    ]
    flies_on: list[ev.Effect] = []
    for second in range(30):
        story.other(1, MID_M[0], MID_M[1] - 90.0 + 10.0 * second, (0.0, 10.0, 0.0))
        story.at(140.0, east_m_s=0.0, **HOLD)
        flies_on += swaps(story.tick())
    assert story.state.phase is Phase.HOLDING
    assert flies_on == []


def test_a_released_vehicle_obeys_an_operator_and_stays_released() -> None:
    story = Story().flying()
    wait(story, 3, mode="LOITER", mode_role="other")
    assert story.state.phase is Phase.RELEASED
    effects = story(ev.OperatorCommand(ev.FlightOrder.RETURN, 7))
    assert [e for e in effects if isinstance(e, ev.Command)] == [
        ev.Command(ev.FlightOrder.RETURN, by_person=True)
    ]
    assert story.state.phase is Phase.RELEASED
    (message,) = story(ev.OrderFailed(ev.FlightOrder.RETURN, "DO_SET_MODE: DENIED"))
    assert isinstance(message, ev.NotifyOperator)
    assert "DENIED" in message.text
    assert orders(wait(story, 10, mode="LOITER", mode_role="other")) == []
    assert orders(story(ev.OperatorCommand(ev.FlightOrder.RETURN))) == [], (
        "the end of this process sends no order"
    )


def test_a_released_vehicle_shares_its_position_while_armed() -> None:
    story = Story().flying()
    story.over((4, 1), mode="LOITER", mode_role="other")
    assert story.state.phase is Phase.RELEASED
    (message,) = publications(story.over((4, 2), mode="LOITER", mode_role="other"), StateShared)
    assert message.phase == "released"
    assert GRID.cell_at(message.lat_deg, message.lon_deg) == (4, 2)
    assert publications(story.over((4, 2), mode="LOITER", mode_role="other", armed=False), StateShared) == []
