"""An agent's answers to an operator's orders, by phase."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from agent_stories import Story, orders

from swarmctl.agent.phases import Phase
from swarmctl.core import events as ev
from swarmctl.core.events import FlightOrder

pytestmark = pytest.mark.virtual


def waiting() -> Story:
    return Story()


def uploading() -> Story:
    story = Story()
    story(ev.Ready())
    story.swap()
    return story


def standby() -> Story:
    return Story().standby()


def replanning() -> Story:
    story = standby()
    story.hear((4, 4, True))
    story.swap()
    return story


def lost_on_the_ground() -> Story:
    story = standby()
    story(ev.LinkLost(4.0))
    return story


def launching() -> Story:
    return Story().launching()


def breaking_off() -> Story:
    story = Story().launching()
    story(ev.OperatorCommand(FlightOrder.HOLD))
    return story


def flying() -> Story:
    return Story().flying()


def lost() -> Story:
    story = flying()
    story(ev.LinkLost(4.0))
    return story


def landing() -> Story:
    story = flying()
    story.over((4, 8))
    return story


def holding() -> Story:
    story = flying()
    story(ev.OperatorCommand(FlightOrder.HOLD, 1))
    return story


def held() -> Story:
    story = holding()
    story(ev.OrderDone(FlightOrder.HOLD))
    story.over((4, 1), mode="GUIDED", mode_role="hold")
    return story


def held_over_the_goal() -> Story:
    story = landing()
    story(ev.OperatorCommand(FlightOrder.HOLD, 1))
    story(ev.OrderDone(FlightOrder.HOLD))
    story.over((4, 8), mode="GUIDED", mode_role="hold")
    return story


def held_without_link() -> Story:
    story = held()
    story(ev.LinkLost(4.0))
    return story


def leaving() -> Story:
    story = flying()
    story(ev.OperatorCommand(FlightOrder.RETURN, 1))
    return story


def released() -> Story:
    story = flying()
    story.over((4, 1), mode="LOITER", mode_role="other")
    return story


def done() -> Story:
    story = landing()
    story.over((4, 8), armed=False)
    return story


HOLD, RETURN, LAND, LAUNCH = FlightOrder.HOLD, FlightOrder.RETURN, FlightOrder.LAND, FlightOrder.LAUNCH
RESUME = FlightOrder.RESUME
STAYS, DOWN = "[stays-on-ground]", "[launch-aborted]"
MATRIX: list[tuple[Callable[[], Story], FlightOrder, str, str, list[FlightOrder], Phase]] = [
    # state, order, answer, note of the answer, order to the vehicle, next state
    (waiting, LAUNCH, "refused", "waiting [not-ready]", [], Phase.WAITING),
    (uploading, LAUNCH, "refused", "uploading [not-ready]", [], Phase.UPLOADING),
    (standby, LAUNCH, "taken", "", [LAUNCH], Phase.LAUNCHING),
    (replanning, LAUNCH, "taken", "[after-upload]", [], Phase.STANDBY),
    (lost_on_the_ground, LAUNCH, "refused", "[launch-without-link]", [], Phase.STANDBY),
    (launching, LAUNCH, "taken", "[launching]", [], Phase.LAUNCHING),
    (breaking_off, LAUNCH, "refused", "[launch-aborted]", [], Phase.LEAVING),
    (flying, LAUNCH, "taken", "[launched-already]", [], Phase.FLYING),
    (landing, LAUNCH, "taken", "[launched-already]", [], Phase.LANDING),
    (holding, LAUNCH, "refused", "[not-resumed]", [], Phase.HOLDING),
    (leaving, LAUNCH, "refused", "[not-resumed]", [], Phase.LEAVING),
    (released, LAUNCH, "over", "LOITER", [], Phase.RELEASED),
    (standby, RESUME, "refused", "[not-resumed]", [], Phase.STANDBY),
    (flying, RESUME, "refused", "[not-resumed]", [], Phase.FLYING),
    (holding, RESUME, "refused", "[not-resumed]", [], Phase.HOLDING),
    (held, RESUME, "taken", "", [], Phase.FLYING),
    (held_over_the_goal, RESUME, "taken", "", [LAND], Phase.LANDING),
    (held_without_link, RESUME, "refused", "[not-resumed]", [], Phase.HOLDING),
    (leaving, RESUME, "refused", "[not-resumed]", [], Phase.LEAVING),
    (released, RESUME, "over", "LOITER", [], Phase.RELEASED),
    (done, LAUNCH, "over", "done, arrived", [], Phase.DONE),
    (waiting, HOLD, "taken", STAYS, [], Phase.WAITING),
    (uploading, RETURN, "taken", STAYS, [], Phase.UPLOADING),
    (standby, LAND, "taken", STAYS, [], Phase.STANDBY),
    (launching, HOLD, "taken", DOWN, [LAND], Phase.LEAVING),
    (launching, RETURN, "taken", DOWN, [LAND], Phase.LEAVING),
    (breaking_off, HOLD, "refused", "[launch-aborted]", [], Phase.LEAVING),
    (flying, HOLD, "taken", "", [HOLD], Phase.HOLDING),
    (flying, RETURN, "taken", "", [RETURN], Phase.LEAVING),
    (flying, LAND, "taken", "", [LAND], Phase.LEAVING),
    (lost, HOLD, "taken", "[waits-for-link]", [HOLD], Phase.HOLDING),
    (landing, HOLD, "taken", "", [HOLD], Phase.HOLDING),
    (holding, RETURN, "taken", "", [RETURN], Phase.LEAVING),
    (leaving, HOLD, "taken", "", [HOLD], Phase.HOLDING),
    (released, LAND, "taken", "[sent-once]", [LAND], Phase.RELEASED),
    (done, HOLD, "over", "done, arrived", [], Phase.DONE),
]


@pytest.mark.parametrize(
    ("begun", "order", "outcome", "note", "sent", "phase"),
    MATRIX,
    ids=[f"{begun.__name__}-{order}" for begun, order, *_ in MATRIX],
)
def test_an_agent_answers_an_order_by_its_phase(
    begun: Callable[[], Story],
    order: FlightOrder,
    outcome: str,
    note: str,
    sent: list[FlightOrder],
    phase: Phase,
) -> None:
    story = begun()
    effects = story(ev.OperatorCommand(order, 7))
    (answer,) = (e for e in effects if isinstance(e, ev.Answer))
    assert (answer.request_id, answer.answer.uav, answer.answer.name) == (7, 1, "uav1")
    assert answer.answer.outcome == outcome
    assert note in answer.answer.note
    assert bool(note) == bool(answer.answer.note)
    assert orders(effects) == sent
    assert story.state.phase is phase


def test_a_vehicle_that_resumes_plans_anew_from_its_hold() -> None:
    story = held()
    story.hear((4, 4, True))
    story(ev.OperatorCommand(RESUME, 2))
    swap = story.swap()
    assert (swap.plan.from_hold, swap.plan.leaves_ahead) == (True, False)
    assert swap.cells[0] == (4, 1)
    assert (4, 4) not in swap.cells


def test_orders_from_the_agents_own_process_get_no_answer() -> None:
    for begun in (waiting, standby, flying, done):
        for order in FlightOrder:
            assert not [e for e in begun()(ev.OperatorCommand(order)) if isinstance(e, ev.Answer)]


def test_the_agents_own_process_does_not_launch_a_vehicle_that_an_operator_holds() -> None:
    story = standby()
    story(ev.OperatorCommand(HOLD, 1))
    assert story(ev.OperatorCommand(LAUNCH)) == []
    assert story.state.phase is Phase.STANDBY
    assert orders(story(ev.OperatorCommand(LAUNCH, 2))) == [LAUNCH]


def test_a_hold_cancels_a_launch_that_waits_for_a_plan() -> None:
    story = replanning()
    story(ev.OperatorCommand(LAUNCH, 1))
    story(ev.OperatorCommand(HOLD, 2))
    assert orders(story.accept()) == []
    assert story.state.phase is Phase.STANDBY


def test_a_reboot_cancels_a_launch_that_waits_for_a_plan() -> None:
    """The order came before the reboot, and the situation around the vehicle may have changed since."""
    story = replanning()
    story(ev.OperatorCommand(LAUNCH, 1))
    story(ev.Rebooted())
    story(ev.Ready())
    story.swap()
    assert orders(story.accept()) == []
