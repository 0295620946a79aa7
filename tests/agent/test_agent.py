"""The policy of one vehicle as stories: events in, effects out."""

from __future__ import annotations

import re

import numpy as np
import pytest
from agent_stories import GRID, Story, orders, publications
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.agent.commands import RETRY_AFTER_S
from swarmctl.agent.failsafes import ALWAYS_ON, low_battery
from swarmctl.agent.failsafes.base import ActiveRule
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.mission_changes import MAX_FAILED_SWAPS
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.agent.touchdown import DISARMED_FOR_S
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.core.vehicle import STALE_MODE_S, Landed


def without_messages(effects: list[ev.Effect]) -> list[ev.Effect]:
    """Return the effects without messages to other vehicles."""
    return [e for e in effects if not isinstance(e, ev.Publish)]


BOOTED = {"mode": "STABILIZE", "mode_role": "other", "armed": False, "time_boot_s": 900.0}
"""A heartbeat after a boot, before a message with the vehicle's clock."""


def waiting() -> Story:
    story = Story().standby()
    story.over((4, 0), mode="GUIDED", mode_role="hold", armed=False)
    return story


def test_a_vehicle_that_reboots_before_its_launch_is_prepared_again() -> None:
    story = waiting()
    assert orders(story.over((4, 0), **BOOTED)) == []
    assert story.state.phase is Phase.STANDBY
    story(ev.Rebooted())
    assert story.state.phase is Phase.WAITING


def test_a_vehicle_in_a_foreign_mode_is_not_launched() -> None:
    story = waiting()
    story.over((4, 0), **BOOTED)
    assert orders(story(ev.OperatorCommand(ev.FlightOrder.LAUNCH))) == []
    assert story.state.phase is Phase.RELEASED


def test_a_ready_vehicle_gets_its_mission_and_is_launched() -> None:
    story = Story()
    story(ev.Ready())
    swap = story.swap()
    assert swap.cells[0] == (4, 0)
    assert swap.cells[-1] == (4, 8)
    assert swap.plan.takeoff_alt_m == 30.0
    assert story(ev.OperatorCommand(ev.FlightOrder.LAUNCH)) == []
    assert orders(story.accept()) == [ev.FlightOrder.LAUNCH]
    assert story.state.phase is Phase.LAUNCHING


def test_a_first_sighting_is_published_once() -> None:
    story = Story().flying()
    effects = story(ev.Observed(((4, 0, False), (4, 1, True))))
    (message,) = publications(effects, Observation)
    assert (message.observer, message.seq) == (1, 1)
    assert message.cells == ((4, 0, False), (4, 1, True))
    assert story(ev.Observed(((4, 0, False), (4, 1, True)))) == []


@pytest.mark.parametrize("occupied", [True, False])
def test_a_contradicting_sighting_is_published_as_a_contradiction(occupied: bool) -> None:
    story = Story().flying()
    story.hear((4, 1, occupied), (5, 1, False))
    observed = ev.Observed(((4, 1, not occupied), (5, 1, False)))
    (effect,) = (e for e in story(observed) if isinstance(e, ev.Publish))
    assert isinstance(effect.message, Observation)
    assert effect.message.cells == ((4, 1, not occupied),)
    assert effect.against == ((4, 1),)
    assert story(observed) == []  # published once; occupied takes precedence
    assert story.state.belief.occupancy()[4, 1] == 1.0


def test_a_hostile_ahead_changes_the_mission_and_names_the_observation() -> None:
    story = Story().flying()
    assert story.state.plans.mission is not None
    assert (4, 4) in story.state.plans.mission.cells
    story.hear((4, 4, True), observer=3, seq=7)
    swap = story.swap()
    assert (4, 4) not in swap.cells
    assert swap.because == ((3, 0, 7),)
    story.accept()
    assert story.state.plans.replans == 1


def test_observations_without_effect_ahead_change_no_mission() -> None:
    story = Story().flying()
    story.hear((0, 8, False))
    assert story.tick() == []
    assert not story.state.plans.is_due


def test_replanning_starts_from_the_position_of_the_vehicle() -> None:
    story = Story().flying()
    story.over((4, 3))
    story.hear((4, 5, True))
    assert story.swap().cells[0] == (4, 3)


def test_a_leg_through_a_neighbouring_cell_changes_no_mission() -> None:
    story = Story(goals=((8, 8),)).flying()
    assert story.state.plans.mission is not None
    diagonal = next(
        i
        for i in range(8)
        if story.state.plans.mission.cells[i + 1][0] > story.state.plans.mission.cells[i][0]
    )
    (row, col) = story.state.plans.mission.cells[diagonal]
    for cell in story.state.plans.mission.cells[: diagonal + 1]:
        story.over(cell)
    story.over((row, col + 1))
    story.hear((0, 8, False))
    assert story.tick() == []


def test_a_failed_mission_change_is_retried() -> None:
    story = Story().flying()
    story.hear((4, 4, True))
    swap = story.swap()
    story(ev.MissionFailed(swap.plan_id, "old", "no answer"))
    assert story.tick() == []
    story.now += RETRY_AFTER_S
    again = story.swap()
    assert again.because == swap.because


PAST = "mission not changed, it flies its old mission: it has flown past"


def test_trouble_of_a_failed_mission_change_ends_when_the_old_plan_is_confirmed() -> None:
    story = Story().flying()
    story.hear((4, 4, True))
    story(ev.MissionFailed(story.swap().plan_id, "old", PAST, is_late=True))
    assert story.state.trouble == PAST
    for col in range(1, 7):
        story.over((4, col))
    assert story.tick() == []
    assert story.state.trouble == ""


def test_trouble_of_a_failed_mission_change_ends_over_the_goal() -> None:
    story = Story().flying()
    story.hear((4, 4, True))
    story(ev.MissionFailed(story.swap().plan_id, "old", PAST))
    story.over((4, 7))
    assert (story.state.phase, story.state.trouble) == (Phase.FLYING, PAST)
    story.over((4, 8))
    assert (story.state.phase, story.state.trouble) == (Phase.LANDING, "")


def test_a_failed_mission_change_over_the_goal_is_no_trouble() -> None:
    story = Story().flying()
    story.hear((4, 4, True))
    swap = story.swap()
    story.over((4, 8))
    story(ev.MissionFailed(swap.plan_id, "old", PAST, is_late=True))
    assert (story.state.phase, story.state.trouble) == (Phase.LANDING, "")


def test_a_vehicle_that_reboots_in_flight_is_released_for_that_reason() -> None:
    story = Story().flying()
    story.hear((4, 4, True))
    story.swap()
    booted = BOOTED | {"landed": Landed.IN_AIR}
    assert orders(story.over((4, 1), **booted)) == []
    assert story.state.phase is Phase.FLYING
    assert without_messages(story(ev.Rebooted())) == [ev.Release()]
    assert story.state.phase is Phase.RELEASED
    assert "[rebooted]" in story.state.outcome
    assert orders(story.over((4, 1), **booted)) == []


def test_a_vehicle_left_in_hold_gets_a_plan_even_without_observations() -> None:
    story = Story().flying()
    before = story.state.plans.mission
    story.hear((4, 4, True))
    swap = story.swap()
    story(ev.MissionFailed(swap.plan_id, "hold", "no answer"))
    assert story.state.plans.mission is None
    story.now += RETRY_AFTER_S
    assert before is not None
    assert story.swap().cells[-1] == before.cells[-1]


def test_a_vehicle_returns_after_repeated_failures_to_change_its_mission() -> None:
    story = Story().flying()
    for seq in range(1, MAX_FAILED_SWAPS + 1):
        story.hear((4, 1 + seq, True), seq=seq)
        swap = story.swap()
        effects = story(ev.MissionFailed(swap.plan_id, "hold", "refused"))
        story.now += RETRY_AFTER_S
    assert orders(effects) == [ev.FlightOrder.RETURN]
    story.over((4, 0), armed=False, landed=Landed.ON_GROUND)
    assert story.state.phase is Phase.FAILED
    assert "refused" in story.state.outcome


def test_a_lost_vehicle_gets_no_mission_until_its_link_is_back() -> None:
    story = Story().flying()
    story(ev.LinkLost(5.0))
    story.hear((4, 4, True))
    assert story.tick() == []
    story(ev.LinkRestored())
    assert (4, 4) not in story.swap().cells


def test_a_vehicle_is_released_after_a_takeover() -> None:
    story = Story().flying()
    story.hear((4, 4, True))
    swap = story.swap()
    assert without_messages(story.over((4, 1), mode="LOITER", mode_role="other")) == [ev.Release()]
    assert story.state.phase is Phase.RELEASED
    assert "LOITER" in story.state.outcome
    assert story(ev.MissionFailed(swap.plan_id, "theirs", "its mode is LOITER")) == []
    assert story(ev.OperatorCommand(ev.FlightOrder.HOLD)) == []
    story.hear((4, 5, True), seq=2)
    assert story.tick() == []


@pytest.mark.parametrize("role", ["return", "land"])
def test_a_failsafe_return_is_not_overridden(role: str) -> None:
    story = Story().flying()
    assert without_messages(story.over((4, 1), mode_role=role)) == [ev.Release()]


def test_a_foreign_hold_releases_the_vehicle_but_a_late_heartbeat_of_a_swap_does_not() -> None:
    story = Story().flying()
    story.over((4, 1), mode_role="hold")
    story.over((4, 1), mode_role="mission")
    assert story.state.phase is Phase.FLYING
    story.over((4, 1), mode_role="hold")
    story.now += STALE_MODE_S
    assert without_messages(story.over((4, 1), mode_role="hold")) == [ev.Release()]


def test_a_vehicle_tells_the_swarm_that_its_launch_has_failed() -> None:
    story = Story().launching()
    story.over((4, 0), armed=False, landed=Landed.ON_GROUND)
    effects = story(ev.OrderFailed(ev.FlightOrder.LAUNCH, "no acknowledgement"))
    assert story.state.phase is Phase.FAILED
    (told,) = publications(effects, StateShared)
    assert (told.phase, told.outcome) == (Phase.FAILED, story.state.outcome)


@pytest.mark.parametrize("order", [ev.FlightOrder.HOLD, ev.FlightOrder.RETURN])
def test_an_aborted_launch_lands_despite_a_later_order(order: ev.FlightOrder) -> None:
    story = Story().launching()
    assert orders(story(ev.OperatorCommand(order))) == [ev.FlightOrder.LAND]
    assert story(ev.OperatorCommand(ev.FlightOrder.RETURN)) == []
    # The last heartbeat shows a disarmed vehicle; the arm command is on its way.
    story.over((4, 0), armed=False)
    assert not story.state.ended
    story.over((4, 0), armed=True, mode_role="land")
    story.over((4, 0), armed=False, mode_role="land")
    assert (story.state.phase, story.state.launch.is_aborted) == (Phase.DONE, True)
    assert story.state.outcome != ARRIVED


def test_a_launch_aborted_before_arming_ends_with_the_landing_mode() -> None:
    story = Story().launching()
    story.over((4, 0), armed=False, mode_role="hold")
    story(ev.OperatorCommand(ev.FlightOrder.HOLD))
    story.over((4, 0), armed=False, mode_role="land")
    story(ev.OrderDone(ev.FlightOrder.LAND))
    assert (story.state.phase, story.state.launch.is_aborted) == (Phase.DONE, True)


def test_a_vehicle_that_reboots_on_the_ground_is_prepared_again() -> None:
    story = Story().standby()
    story(ev.Rebooted())
    assert story.state.phase is Phase.WAITING
    assert story(ev.OperatorCommand(ev.FlightOrder.LAUNCH)) == []
    story(ev.Ready())
    story.swap()
    assert orders(story.accept()) == [ev.FlightOrder.LAUNCH]


def test_a_vehicle_without_a_route_keeps_its_plan() -> None:
    wall = frozenset((row, col) for row in range(6, 9) for col in range(3) if (row, col) != (7, 1))
    story = Story(no_fly=wall).flying()
    before = story.state.plans.mission
    story.over((7, 1))
    story.hear((0, 8, False))
    assert story.tick() == []
    assert story.state.plans.mission is before
    assert "(7, 1)" in story.state.trouble
    story.over((4, 3))
    story.hear((0, 7, False), seq=2)
    assert story.tick() == []
    assert story.state.trouble == ""


def test_the_trouble_of_a_failed_order_ends_when_the_order_is_followed() -> None:
    story = Story().flying()
    story(ev.OperatorCommand(ev.FlightOrder.HOLD))
    story(ev.OrderFailed(ev.FlightOrder.HOLD, "no answer"))
    assert "no answer" in story.state.trouble
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    assert story.state.trouble == ""


def test_a_holding_vehicle_without_a_route_returns() -> None:
    wall = frozenset((row, col) for row in range(6, 9) for col in range(3) if (row, col) != (7, 1))
    story = Story(no_fly=wall).flying()
    story.hear((4, 4, True))
    story(ev.MissionFailed(story.swap().plan_id, "hold", "no answer"))
    story.over((7, 1), mode_role="hold")
    story.now += RETRY_AFTER_S
    assert orders(story.tick()) == [ev.FlightOrder.RETURN]


def test_the_start_cell_is_not_counted_and_forbidden_cells_are_counted_separately() -> None:
    story = Story(no_fly=frozenset({(0, 0)})).flying()
    assert story.state.flown.exposure == 0.0
    story.over((0, 0))
    assert story.state.flown.no_fly_entered == 1
    assert story.state.flown.exposure == 0.0


@pytest.mark.parametrize(
    ("up_m", "cell", "arrives"), [(1.0, (4, 8), True), (1.0, (5, 8), False), (30.0, (4, 8), True)]
)
def test_a_landing_at_the_goal_after_an_order_to_hold_is_an_arrival(
    up_m: float, cell: Cell, *, arrives: bool
) -> None:
    story = Story().flying()
    story.over((4, 8), alt_rel_m=up_m)
    story(ev.OperatorCommand(ev.FlightOrder.HOLD))
    story.over(cell, armed=False, landed=Landed.ON_GROUND)
    assert story.state.phase is (Phase.DONE if arrives else Phase.FAILED)
    if arrives:
        assert story.state.outcome == ARRIVED
    else:
        assert str(cell) in story.state.outcome
        assert story.state.outcome.endswith("[disarmed-on-the-way]")


@pytest.mark.parametrize(("cell", "away"), [((4, 0), []), ((4, 7), ["350 m"])])
def test_a_recalled_vehicle_reports_a_landing_away_from_home(cell: Cell, away: list[str]) -> None:
    story = Story().flying()
    lat_deg, lon_deg = GRID.centre((4, 0))
    home = {"home_lat_deg": lat_deg, "home_lon_deg": lon_deg}
    story.over((4, 7), **home)  # the landing position
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    story.over(cell, armed=False, landed=Landed.ON_GROUND, **home)
    assert (story.state.phase, story.state.order.given) == (Phase.DONE, ev.FlightOrder.RETURN)
    assert re.findall(r"\d+ m", story.state.outcome) == away


def test_a_vehicle_over_its_goal_gets_no_new_route() -> None:
    story = Story().flying()
    story.over((4, 8))
    story.hear((4, 8, True))
    assert story.tick() == []


def test_a_landing_short_of_the_goal_is_a_failure_with_its_cell() -> None:
    story = Story().flying()
    story.over((4, 3), armed=False, landed=Landed.ON_GROUND)
    assert story.state.phase is Phase.FAILED
    assert "(4, 3)" in story.state.outcome


def test_a_holding_vehicle_over_its_goal_is_ordered_to_land() -> None:
    story = Story().flying()
    story.hear((4, 4, True))
    swap = story.swap()
    story.over((4, 8))
    assert orders(story(ev.MissionFailed(swap.plan_id, "hold", "no answer"))) == [ev.FlightOrder.LAND]
    story.over((4, 8), mode="LAND", mode_role="land")
    assert story.state.phase is Phase.LANDING
    story.over((4, 8), mode="LAND", armed=False)
    assert (story.state.phase, story.state.outcome) == (Phase.DONE, "arrived")


@pytest.mark.parametrize("received", [True, False])
def test_an_order_missed_during_a_lost_link_is_repeated(received: bool) -> None:
    story = Story().flying()
    story(ev.LinkLost(5.0))
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    story(
        ev.OrderDone(ev.FlightOrder.RETURN)
        if received
        else ev.OrderFailed(ev.FlightOrder.RETURN, "no answer")
    )
    story(ev.LinkRestored())
    role = "return" if received else "mission"
    assert orders(story.over((4, 1), mode_role=role)) == ([] if received else [ev.FlightOrder.RETURN])


@pytest.mark.parametrize(
    ("armed", "expected", "phase"), [(False, [], Phase.FAILED), (True, [ev.FlightOrder.LAND], Phase.LEAVING)]
)
def test_a_failed_launch_lands_an_armed_vehicle(
    armed: bool, expected: list[ev.FlightOrder], phase: Phase
) -> None:
    story = Story().launching()
    story.over((4, 0), armed=armed)
    assert orders(story(ev.OrderFailed(ev.FlightOrder.LAUNCH, "it did not climb"))) == expected
    assert story.state.phase is phase


def test_a_return_order_on_the_ground_ends_the_flight_without_a_command() -> None:
    story = Story()
    story(ev.Ready())
    assert story(ev.OperatorCommand(ev.FlightOrder.RETURN)) == []
    assert (story.state.phase, story.state.launch.armed_seen) == (Phase.DONE, False)
    assert story.state.outcome != ARRIVED


def test_an_order_in_flight_ends_the_planning() -> None:
    story = Story().flying()
    story(ev.OperatorCommand(ev.FlightOrder.LAND))
    story.hear((4, 4, True))
    assert story.tick() == []


def test_an_observation_outside_the_area_is_refused_and_counted() -> None:
    story = Story().flying()
    before = story.state.belief
    assert story.hear((99, 99, True)) == []
    assert story.state.belief is before
    assert story.state.refused == 1


def test_the_state_is_shared_about_once_a_second_by_the_vehicles_clock() -> None:
    story = Story().flying()
    shared = 0
    for tenth in range(100, 150):
        effects = story.over((4, 1), time_boot_s=tenth / 10)
        shared += len(publications(effects, StateShared))
    assert shared == 5


def test_flown_exposure_uses_the_belief_at_the_choice_of_each_cell() -> None:
    story = Story().flying()
    assert story.state.plans.exposure is not None
    before = story.state.flown.exposure
    believed = float(story.state.plans.exposure[4, 1])
    story.over((4, 1))
    assert story.state.flown.exposure - before == pytest.approx(believed)
    assert story.state.flown.safety < 1.0


OBSERVED = st.lists(
    st.tuples(st.integers(2, 4), st.integers(1, 5), st.integers(0, 8), st.integers(0, 8), st.booleans()),
    max_size=12,
)


@given(OBSERVED, st.randoms(use_true_random=False))
@settings(max_examples=examples(40), deadline=None, derandomize=True)
def test_the_sequence_of_observations_does_not_change_the_route(
    rows: list[tuple[int, int, int, int, bool]], random: object
) -> None:
    unique = {(observer, seq): (r, c, o) for observer, seq, r, c, o in rows}
    news = list(unique.items())
    shuffled = [*news, *news[:3]]
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    ends: list[AgentState] = []
    for sequence in (news, shuffled):
        story = Story().flying()
        for (observer, seq), cell in sequence:
            story.hear(cell, observer=observer, seq=seq)
        if story.tick():
            story.accept()
        ends.append(story.state)
    assert np.array_equal(ends[0].belief.known, ends[1].belief.known)
    assert ends[0].plans.mission is not None
    assert ends[1].plans.mission is not None
    assert ends[0].plans.mission.cells == ends[1].plans.mission.cells


def test_disarmed_heartbeats_in_the_air_end_the_flight_only_after_some_seconds() -> None:
    story = Story().flying()
    up = {"armed": False, "landed": Landed.IN_AIR}
    story.over((4, 1), **up)
    story.over((4, 1), **up, heartbeat_s=story.state.vehicle.heartbeat_s)  # a position, no other heartbeat
    assert story.state.phase is Phase.FLYING
    story.over((4, 1))
    story.over((4, 2), **up)
    assert story.state.phase is Phase.FLYING
    story.over((4, 2), **up, heartbeat_s=story.now + DISARMED_FOR_S)
    assert story.state.phase is Phase.FAILED
    assert "(4, 2)" in story.state.outcome
    assert story.state.outcome.endswith("[disarmed-on-the-way]")


def test_failsafes_and_orders_work_without_a_position() -> None:
    story = Story(rules=(*ALWAYS_ON, ActiveRule(low_battery, low_battery.Params()))).flying()
    flown_m, cell = story.state.flown.length_m, story.state.cell
    nowhere = {"lat_deg": None, "lon_deg": None, "alt_rel_m": None, "position_s": 0.0}
    given = [orders(story.over((7, 7), battery_percent=20, **nowhere)) for _ in range(6)]
    assert [ev.FlightOrder.RETURN] in given
    story(ev.OrderFailed(ev.FlightOrder.RETURN, "no answer"))
    again = [orders(story.over((7, 7), mode_role="mission", **nowhere)) for _ in range(6)]
    assert [ev.FlightOrder.RETURN] in again
    assert (story.state.flown.length_m, story.state.cell) == (flown_m, cell)


def test_a_repeated_position_adds_no_distance_and_is_not_shared() -> None:
    story = Story().flying()
    story.over((4, 1))
    flown_m, cells, boot_s = (
        story.state.flown.length_m,
        story.state.flown.cells,
        story.state.vehicle.time_boot_s,
    )
    effects = [e for _ in range(3) for e in story.over((4, 1), time_boot_s=boot_s, position_s=boot_s)]
    assert (story.state.flown.length_m, story.state.flown.cells) == (flown_m, cells)
    assert publications(effects, StateShared) == []
