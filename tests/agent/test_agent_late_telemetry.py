"""Late telemetry, orders without an acknowledgement, and landings at the goal after other orders."""

from __future__ import annotations

import pytest
from agent_stories import Story, answers, codes, orders

from swarmctl.agent.own_modes import ROLE_OF_ORDER
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.mission_changes import needs_tick
from swarmctl.agent.state import ARRIVED
from swarmctl.core import events as ev
from swarmctl.core.messages import CommandOutcome
from swarmctl.core.vehicle import Landed
from swarmctl.report.final_state import describe_outcome
from swarmctl.report.live_rows import vehicle_row


@pytest.mark.parametrize("order", [None, *ROLE_OF_ORDER])
def test_a_vehicle_that_landed_at_its_goal_has_arrived_whatever_it_was_told_last(
    order: ev.FlightOrder | None,
) -> None:
    """In another party's mode the agent has released the vehicle."""
    story = Story().flying()
    if order is not None:
        story(ev.OperatorCommand(order))
        story(ev.OrderFailed(order, "no answer"))
    for _ in range(4):
        story.over((4, 8), mode="LAND", mode_role="other")
    story.over((4, 8), armed=False, landed=Landed.ON_GROUND, mode="LAND", mode_role="other")
    assert (story.state.phase, story.state.outcome) == (Phase.DONE, ARRIVED)
    assert describe_outcome(story.state) == ARRIVED


@pytest.mark.parametrize("order", ROLE_OF_ORDER)
@pytest.mark.parametrize("answered", [True, False])
def test_an_order_without_an_acknowledgement_is_not_reported_as_given(
    order: ev.FlightOrder, *, answered: bool
) -> None:
    story = Story().flying()
    story(ev.OperatorCommand(order))
    story(ev.OrderDone(order) if answered else ev.OrderFailed(order, "no answer"))
    assert describe_outcome(story.state).endswith("[not-acknowledged]") is not answered
    story.over((4, 3), armed=False, landed=Landed.ON_GROUND)
    assert describe_outcome(story.state).endswith("[not-acknowledged]") is not answered


def test_late_telemetry_suspends_changes_until_it_recovers() -> None:
    story = Story().flying()
    assert codes(story.over((4, 1), delay_s=8.0)) == ["telemetry-old"]
    assert vehicle_row(story.state, 0.1).link == "8 s old"
    story.hear((4, 4, True))
    assert story.state.plans.is_due
    assert not needs_tick(story.state, story.now)
    story.over((4, 2), delay_s=2.0)
    assert not needs_tick(story.state, story.now)  # it has to recover clearly
    assert codes(story.over((4, 2), delay_s=0.0)) == ["telemetry-old"]
    assert needs_tick(story.state, story.now)
    assert vehicle_row(story.state, 0.1).link == "ok"


def test_late_telemetry_shows_no_other_operators_mode_and_no_arrival() -> None:
    """The mode may be from before the agent's last order."""
    story = Story().flying()
    for _ in range(5):
        story.over((4, 8), delay_s=8.0, mode="GUIDED", mode_role="other")
    assert story.state.phase is Phase.FLYING
    story.over((4, 8), mode="GUIDED", mode_role="other")
    assert story.state.phase is Phase.RELEASED


GROUND = {"armed": False, "mode": "GUIDED", "mode_role": "hold"}


def test_a_launch_waits_for_recent_telemetry() -> None:
    """The process orders its own launch once, so this order stays."""
    story = Story().standby()
    story.over((4, 0), **GROUND, delay_s=8.0)
    assert orders(story(ev.OperatorCommand(ev.FlightOrder.LAUNCH))) == []
    assert orders(story.over((4, 0), **GROUND, delay_s=8.0)) == []
    assert orders(story.over((4, 0), **GROUND)) == [ev.FlightOrder.LAUNCH]


@pytest.mark.parametrize(("delay_s", "outcome"), [(8.0, "refused"), (0.0, "taken")])
@pytest.mark.parametrize("order", [ev.FlightOrder.LAUNCH, ev.FlightOrder.RESUME])
def test_an_operators_order_to_fly_on_is_refused_while_telemetry_is_late(
    order: ev.FlightOrder, delay_s: float, outcome: CommandOutcome
) -> None:
    """The operator may have stopped watching the vehicle when telemetry recovers."""
    if order is ev.FlightOrder.LAUNCH:
        story = Story().standby()
        story.over((4, 0), **GROUND, delay_s=delay_s)
    else:
        story = Story().flying()
        story(ev.OperatorCommand(ev.FlightOrder.HOLD, 1))
        story(ev.OrderDone(ev.FlightOrder.HOLD))
        story.over((4, 3), mode="GUIDED", mode_role="hold", delay_s=delay_s)
    phase = story.state.phase
    (answer,) = answers(story(ev.OperatorCommand(order, 2)))
    assert answer.outcome == outcome
    assert (story.state.phase is phase) is (outcome == "refused")


def test_a_flight_that_has_ended_reports_no_late_telemetry() -> None:
    story = Story().flying()
    story.over((4, 8), armed=False)
    assert story.state.ended
    assert codes(story.over((4, 8), armed=False, delay_s=8.0)) == []
