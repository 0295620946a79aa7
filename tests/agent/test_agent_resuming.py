"""An order to resume after a flight that the agent had given up: the flight goes on as a new one."""

from __future__ import annotations

from agent_stories import Story, orders

from swarmctl.agent.commands import RETRY_AFTER_S
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.mission_changes import MAX_FAILED_SWAPS
from swarmctl.core import events as ev
from swarmctl.core.vehicle import Landed

HOLD, RESUME, RETURN = ev.FlightOrder.HOLD, ev.FlightOrder.RESUME, ev.FlightOrder.RETURN


def resumed() -> Story:
    """Return a vehicle on its return after failed mission changes, stopped and resumed by an operator."""
    story = Story().flying()
    for seq in range(1, MAX_FAILED_SWAPS + 1):
        story.hear((4, 1 + seq, True), seq=seq)
        story(ev.MissionFailed(story.swap().plan_id, "hold", "refused"))
        story.now += RETRY_AFTER_S
    assert story.state.phase is Phase.LEAVING
    story(ev.OperatorCommand(HOLD, 1))
    story(ev.OrderDone(HOLD))
    story.over((4, 3), mode="GUIDED", mode_role="hold")
    story(ev.OperatorCommand(RESUME, 2))
    assert story.state.phase is Phase.FLYING
    return story


def test_one_more_failed_change_does_not_end_a_resumed_flight() -> None:
    story = resumed()
    assert orders(story(ev.MissionFailed(story.swap().plan_id, "hold", "refused"))) == []
    assert story.state.phase is Phase.FLYING


def test_a_resumed_flight_that_an_operator_ends_has_not_failed() -> None:
    story = resumed()
    story.swap()
    story.accept()
    story(ev.OperatorCommand(RETURN, 3))
    story(ev.OrderDone(RETURN))
    story.over((4, 0), armed=False, landed=Landed.ON_GROUND, mode="RTL", mode_role="return")
    assert story.state.phase is Phase.DONE
