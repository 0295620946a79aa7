"""Stories of agents that arrive simultaneously."""

from __future__ import annotations

import pytest
from agent_stories import GRID, MID_M, Story, orders, publications, swaps

from swarmctl.agent.arrival import simultaneous
from swarmctl.agent.arrival.common_time import UNKNOWN_M_S, ArrivalGroup
from swarmctl.agent.replan.swap_times import SwapHistory
from swarmctl.agent.traffic.route_hold import hold
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace


class ArrivalStory(Story):
    """A flight of vehicle 1 east along row 4 to its goal cell at 400 m; vehicle 2 has to arrive with it."""

    def __init__(self, uav: int = 1, w: float = 0.5, **simultaneous: float) -> None:
        super().__init__(uav=uav, w=w, arrival_group=ArrivalGroup({1: 0, 2: 1}, **simultaneous))
        self.flying()

    def other(self, earliest_in_s: float | None, uav: int = 2) -> None:
        lat_deg, lon_deg = GRID.frame.to_geodetic(5000.0, MID_M[1])
        shared = StateShared(1.0, lat_deg, lon_deg, 30.0, 330.0, "flying", 0, 0, earliest_in_s=earliest_in_s)
        self.tell(neighbours=((uav, shared),))


def speeds(effects: list[ev.Effect]) -> list[float]:
    return [effect.speed_m_s for effect in effects if isinstance(effect, ev.SetSpeed)]


def test_a_single_vehicle_flies_at_full_speed_and_reports_its_earliest_arrival() -> None:
    story = ArrivalStory()
    (message,) = publications(story.at(100.0), StateShared)
    # 300 m to the edge of the goal cell at 10 m/s; the braking for the landing is inside the cell.
    assert message.earliest_in_s == pytest.approx(30.0, abs=0.5)
    assert speeds(story.effects) == []


def test_a_vehicle_that_holds_to_give_way_still_reports_its_earliest_arrival() -> None:
    story = ArrivalStory()
    story.at(100.0)
    story.state, _ = hold(story.state, story.state.plans.mission, frozenset())
    (message,) = publications(story.at(100.0), StateShared)
    assert message.earliest_in_s == pytest.approx(30.0, abs=3.0)


def test_a_vehicle_slows_down_for_a_slower_vehicle() -> None:
    story = ArrivalStory()
    story.other(60.0)
    (speed_m_s,) = speeds(story.at(100.0))
    assert speed_m_s == pytest.approx(300.0 / 59.0, abs=0.15)
    assert orders(story.effects) == []


def test_a_faster_vehicle_does_not_change_the_speed() -> None:
    story = ArrivalStory()
    story.other(20.0)
    assert speeds(story.at(100.0)) == []


def test_no_speed_is_set_while_an_order_is_under_way() -> None:
    story = ArrivalStory()
    story.other(60.0)
    order = story.state.order.sent(ev.FlightOrder.HOLD, frozenset())
    story.state = replace(story.state, order=order)
    assert speeds(story.at(100.0)) == []


def test_a_vehicle_follows_a_later_arrival_but_not_with_every_message() -> None:
    story = ArrivalStory()
    story.other(50.0)
    (first_m_s,) = speeds(story.at(100.0))
    story.other(60.0)
    assert speeds(story.at(106.0, ground_speed_m_s=6.0)) == []
    (second_m_s,) = speeds(story.at(112.0, ground_speed_m_s=6.0))
    assert second_m_s < first_m_s


def test_a_vehicle_does_not_wait_for_a_vehicle_without_an_arrival_time() -> None:
    story = ArrivalStory()
    story.other(60.0)
    story.at(100.0)
    story.other(None)
    story.at(106.0, ground_speed_m_s=6.0)
    assert speeds(story.at(112.0, ground_speed_m_s=6.0)) == [10.0]


def test_with_spacing_the_first_vehicle_is_due_before_the_next() -> None:
    story = ArrivalStory(spacing_s=20.0)
    story.other(70.0)
    (speed_m_s,) = speeds(story.at(100.0))
    assert speed_m_s == pytest.approx(300.0 / 49.0, abs=0.15)


def test_an_arrived_vehicle_keeps_its_position_in_the_order() -> None:
    story = ArrivalStory(uav=2, spacing_s=20.0)
    story.other(-1.0, uav=1)
    (speed_m_s,) = speeds(story.at(300.0))  # 10 s from the goal, due 20 s after vehicle 1
    assert speed_m_s < 7.0


def test_the_speed_is_set_again_after_a_new_plan() -> None:
    story = ArrivalStory()
    story.other(60.0)
    story.at(100.0)
    story.hear((4, 4, True))
    story.swap()
    story.accept()
    assert story.state.speed.m_s == UNKNOWN_M_S
    assert len(speeds(story.at(103.0, ground_speed_m_s=2.0))) == 1


def test_a_failed_mission_change_leaves_a_speed_alone_that_was_never_set() -> None:
    story = ArrivalStory()
    story.hear((4, 4, True))
    story(ev.MissionFailed(story.swap().plan_id, "old", "no answer"))
    story.at(103.0)
    assert speeds(story.at(105.0)) == []


def test_a_refused_full_speed_is_set_again() -> None:
    story = ArrivalStory()
    story.other(60.0)
    story.at(100.0)
    story.other(None)
    story.at(101.0)
    assert speeds(story.at(102.0)) == [10.0]
    story(ev.SpeedFailed("no answer"))
    assert speeds(story.at(104.0)) == [10.0]


# --- routes that use spare time


def next_swap(story: ArrivalStory) -> PlannedMission | None:
    return next(iter(swaps(story.tick())), None)


def test_an_early_vehicle_takes_a_safer_route() -> None:
    """With w = 0 the vehicle flies straight; with spare time it avoids the hostile and arrives in time."""
    story = ArrivalStory(w=0.0)
    story.hear((4, 5, True))
    assert next_swap(story) is None
    story.other(70.0)
    story.at(60.0)
    swap = next_swap(story)
    assert swap is not None
    assert (4, 5) not in swap.cells
    story.accept()
    assert story.state.late == ""
    earliest_in_s = simultaneous.earliest_in_s(story.state)
    assert earliest_in_s is not None
    assert earliest_in_s <= 70.0


def test_an_early_vehicle_with_a_minimum_speed_takes_a_longer_route() -> None:
    story = ArrivalStory(slowest_m_s=8.0)
    story.other(70.0)
    story.at(60.0)
    swap = next_swap(story)
    assert swap is not None
    # The route takes at least 68 s at 8 m/s and is in time at 10 m/s.
    assert 0.8 * 640.0 < 60.0 + swap.length_m < 700.0
    story.accept()
    story.state = replace(
        story.state, plans=replace(story.state.plans, swaps=SwapHistory(done_boot_s=-100.0))
    )
    assert next_swap(story) is None


def test_a_slightly_early_vehicle_only_flies_slower() -> None:
    story = ArrivalStory(w=0.0)
    story.hear((4, 5, True))
    story.tick()
    story.other(42.0)
    assert len(speeds(story.at(60.0))) == 1
    assert next_swap(story) is None


def test_the_new_last_vehicle_takes_its_best_route_again() -> None:
    story = ArrivalStory(w=0.0)
    story.hear((4, 5, True))
    story.tick()
    story.other(70.0)
    story.at(60.0)
    assert next_swap(story) is not None
    story.accept()
    story.other(10.0)
    story.at(62.0, time_boot_s=story.now + 10.0)
    story.at(64.0, time_boot_s=story.now + 20.0)
    assert story.state.common_arrival.spare_time_due_s is None
