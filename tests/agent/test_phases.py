"""The phases of a flight under any sequence of events."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from agent_stories import Story
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmctl.agent.phases import IllegalTransition, Phase, changed
from swarmctl.core import events as ev
from swarmctl.core.vehicle import Landed

Act = Callable[[Story], object]
ROLES = ("mission", "hold", "return", "land", "other", "")
FLYING = ("old", "new", "hold", "theirs", "unknown")


def mission_accepted(story: Story) -> None:
    if story.state.plans.pending is not None:
        story.accept()


def mission_failed(flying: str, *, is_late: bool) -> Act:
    def act(story: Story) -> None:
        if story.state.plans.pending is not None:
            plan_id = story.state.plans.pending.plan_id
            story(ev.MissionFailed(plan_id, flying, "failed", is_late=is_late))  # type: ignore[arg-type]

    return act


def telemetry(column: int, role: str, *, armed: bool, is_down: bool, delay_s: float) -> Act:
    landed = Landed.ON_GROUND if is_down else Landed.IN_AIR
    alt_m = 0.0 if is_down else 30.0
    flies = {"armed": armed, "landed": landed, "alt_rel_m": alt_m}
    return lambda story: story.over((4, column), mode=role, mode_role=role, delay_s=delay_s, **flies)


orders = st.sampled_from(list(ev.FlightOrder))
events = st.one_of(
    st.sampled_from(
        [ev.Ready(), ev.Rebooted(), ev.LinkLost(9.0), ev.LinkRestored(), ev.Restarted(), ev.Joined(2)]
    ),
    st.builds(
        ev.Restarted, on_ground=st.booleans(), lands=st.booleans(), reason=st.sampled_from(["", "why"])
    ),
    st.builds(ev.OrderDone, orders),
    st.builds(ev.OrderFailed, orders, st.just("no answer"), nothing_sent=st.booleans()),
    st.builds(ev.LaunchPostponed, st.just("another vehicle"), was_armed=st.booleans()),
    st.builds(
        ev.OperatorCommand,
        orders,
        request_id=st.sampled_from([None, 7]),
        after_s=st.sampled_from([0.0, 20.0]),
    ),
)
acts = st.one_of(
    events.map(lambda event: lambda story: story(event)),
    st.just(mission_accepted),
    st.builds(mission_failed, st.sampled_from(FLYING), is_late=st.booleans()),
    st.builds(
        telemetry,
        st.integers(0, 8),
        st.sampled_from(ROLES),
        armed=st.booleans(),
        is_down=st.booleans(),
        delay_s=st.sampled_from([0.0, 0.0, 5.0]),
    ),
)
BEGINNINGS: dict[str, Act] = {
    "on the ground": lambda _story: None,
    "launching": Story.launching,
    "flying": Story.flying,
}


@pytest.mark.parametrize("begins", BEGINNINGS)
@settings(deadline=None, derandomize=True, max_examples=60)
@given(drawn=st.lists(acts, min_size=5, max_size=25))
def test_no_sequence_of_events_leads_to_an_illegal_phase(begins: str, drawn: list[Act]) -> None:
    story = Story()
    BEGINNINGS[begins](story)
    for act in drawn:
        before = story.state.phase
        act(story)
        given_orders = [e for e in story.effects if isinstance(e, ev.Command) and not e.by_person]
        assert before is not Phase.RELEASED or not given_orders
        story.tick()


def test_an_illegal_transition_names_both_phases() -> None:
    with pytest.raises(IllegalTransition, match=r"done.*flying"):
        changed(Phase.DONE, Phase.FLYING)
