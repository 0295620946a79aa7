"""What an agent does to arrive with the others, told as stories."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from agent_stories import GRID, Story, orders

from swarmctl.agent.arrival import simultaneous
from swarmctl.agent.arrival.common_time import ArrivalGroup
from swarmctl.agent.arrival.simultaneous import UNKNOWN_M_S
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared

ROW_M = GRID.centre_m((4, 4))[1]


class Meets(Story):
    """Vehicle 1 flies east along row 4, its goal cell begins at 400 m; vehicle 2 is to arrive with it."""

    def __init__(self, uav: int = 1, w: float = 0.5, **simultaneous: float) -> None:
        super().__init__(uav=uav, w=w, arrival_group=ArrivalGroup({1: 0, 2: 1}, **simultaneous))
        self.flying()

    def at(self, east_m: float, **changes: Any) -> list[ev.Effect]:
        lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, ROW_M)
        told = {"lat_deg": lat_deg, "lon_deg": lon_deg, "ground_speed_m_s": 10.0, "east_m_s": 10.0}
        return self.over((4, 0), **{**told, **changes})

    def other(self, earliest_in_s: float | None, uav: int = 2) -> None:
        lat_deg, lon_deg = GRID.frame.to_geodetic(5000.0, ROW_M)
        shared = StateShared(1.0, lat_deg, lon_deg, 30.0, "flying", 0, 0, earliest_in_s=earliest_in_s)
        self(ev.Neighbours(((uav, shared),)))
        self.now -= 1.0


def speeds(effects: list[ev.Effect]) -> list[float]:
    return [effect.speed_m_s for effect in effects if isinstance(effect, ev.SetSpeed)]


def test_alone_it_flies_as_fast_as_it_can_and_tells_when_it_can_be_there() -> None:
    story = Meets()
    (message,) = (e.message for e in story.at(100.0) if isinstance(e, ev.Publish))
    assert isinstance(message, StateShared)
    # 300 m to the rim of its goal cell at 10 m/s, and it brakes for the landing in the cell.
    assert message.earliest_in_s == pytest.approx(30.0, abs=0.5)
    assert speeds(story.effects) == []


def test_for_a_slower_one_it_slows_down() -> None:
    story = Meets()
    story.other(60.0)
    (speed_m_s,) = speeds(story.at(100.0))
    assert speed_m_s == pytest.approx(300.0 / 59.0, abs=0.15)
    assert orders(story.effects) == []


def test_one_that_is_faster_changes_nothing() -> None:
    story = Meets()
    story.other(20.0)
    assert speeds(story.at(100.0)) == []


def test_when_the_other_becomes_slower_it_slows_down_more_but_not_with_every_message() -> None:
    story = Meets()
    story.other(50.0)
    (first_m_s,) = speeds(story.at(100.0))
    story.other(60.0)
    assert speeds(story.at(106.0, ground_speed_m_s=6.0)) == []
    (second_m_s,) = speeds(story.at(112.0, ground_speed_m_s=6.0))
    assert second_m_s < first_m_s


def test_for_one_that_has_given_up_nobody_waits() -> None:
    story = Meets()
    story.other(60.0)
    story.at(100.0)
    story.other(None)
    story.at(106.0, ground_speed_m_s=6.0)
    assert speeds(story.at(112.0, ground_speed_m_s=6.0)) == [10.0]


def test_staggered_the_first_is_early_enough_for_the_next() -> None:
    story = Meets(spacing_s=20.0)
    story.other(70.0)
    (speed_m_s,) = speeds(story.at(100.0))
    assert speed_m_s == pytest.approx(300.0 / 49.0, abs=0.15)


def test_whoever_has_arrived_keeps_its_place_in_the_order() -> None:
    story = Meets(uav=2, spacing_s=20.0)
    story.other(-1.0, uav=1)
    (speed_m_s,) = speeds(story.at(300.0))  # 10 s of way, due 20 s after the other
    assert speed_m_s < 7.0


def test_a_new_plan_takes_back_its_speed_and_it_is_given_again() -> None:
    story = Meets()
    story.other(60.0)
    story.at(100.0)
    story.hear((4, 4, True))
    story.swap()
    story.accept()
    assert story.state.speed_m_s == UNKNOWN_M_S
    assert len(speeds(story.at(103.0, ground_speed_m_s=2.0))) == 1


def test_a_speed_that_was_not_taken_is_given_again() -> None:
    story = Meets()
    story.other(60.0)
    story.at(100.0)
    story(ev.SpeedFailed("no answer"))
    assert len(speeds(story.at(110.0))) == 1


def test_full_speed_that_was_not_taken_is_given_again_too() -> None:
    story = Meets()
    story.other(60.0)
    story.at(100.0)
    story.other(None)
    story.at(101.0)
    assert speeds(story.at(102.0)) == [10.0]
    story(ev.SpeedFailed("no answer"))
    assert speeds(story.at(104.0)) == [10.0]


# a way that takes its time


def swapped(story: Meets) -> ev.SwapMission | None:
    return next((effect for effect in story.tick() if isinstance(effect, ev.SwapMission)), None)


def test_one_that_is_early_takes_a_safer_way() -> None:
    """With w = 0 it goes straight through; with the time that it has it goes round, and is still in time."""
    story = Meets(w=0.0)
    story.hear((4, 5, True))
    assert swapped(story) is None
    story.other(70.0)
    story.at(60.0)
    swap = swapped(story)
    assert swap is not None
    assert (4, 5) not in swap.cells
    story.accept()
    assert story.state.late == ""
    earliest_in_s = simultaneous.earliest_in_s(story.state)
    assert earliest_in_s is not None
    assert earliest_in_s <= 70.0


def test_one_that_may_not_fly_so_slowly_takes_a_longer_way() -> None:
    story = Meets(slowest_m_s=8.0)
    story.other(70.0)
    story.at(60.0)
    swap = swapped(story)
    assert swap is not None
    # 68 s at 8 m/s at least, and at 10 m/s in time.
    assert 0.8 * 640.0 < 60.0 + swap.length_m < 700.0
    story.accept()
    story.state = replace(story.state, swapped_boot_s=-100.0)
    assert swapped(story) is None


def test_one_that_is_a_little_early_only_flies_slower() -> None:
    story = Meets(w=0.0)
    story.hear((4, 5, True))
    story.tick()
    story.other(42.0)
    assert len(speeds(story.at(60.0))) == 1
    assert swapped(story) is None


def test_one_that_has_become_the_last_takes_its_own_best_way_again() -> None:
    story = Meets(w=0.0)
    story.hear((4, 5, True))
    story.tick()
    story.other(70.0)
    story.at(60.0)
    assert swapped(story) is not None
    story.accept()
    story.other(10.0)
    story.at(62.0, time_boot_s=story.now + 10.0)
    story.at(64.0, time_boot_s=story.now + 20.0)
    assert story.state.spare_time_due_s is None
