"""Intents of agents, and the deconfliction of plans, as stories."""

from __future__ import annotations

from typing import Any

import pytest
from agent_stories import (
    AMSL_M,
    GRID,
    MID_M,
    Story,
    codes,
    intent_path,
    operator_texts,
    orders,
    publications,
    swaps,
)

from swarmctl.agent.failsafes.base import Fence
from swarmctl.agent.traffic.check import clashes_of_route
from swarmctl.agent.traffic.intents import MAX_UNCERTAINTY_M, REPEAT_EVERY_S
from swarmctl.agent.traffic.known_flights import known_flights
from swarmctl.agent.traffic.own_flight import HOLD_DURATION_S, LAST_POSITION_S
from swarmctl.agent.traffic.route_deconfliction import RETRY_S
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.agent.traffic.separation.watch import AvoidanceAction, SeparationRules
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentShared, StateShared
from swarmctl.core.records import replace


def intents(effects: list[ev.Effect]) -> list[IntentShared]:
    return publications(effects, IntentShared)


class IntentStory(Story):
    """A flight of vehicle 2 east along row 4 at 10 m/s."""

    def __init__(self, action: AvoidanceAction = "hold", **changes: Any) -> None:
        super().__init__(**{"uav": 2, "separation": replace(SeparationRules(), action=action), **changes})
        self.flying()
        self.at(75.0)

    def other(
        self, uav: int, *points: tuple[float, float, float], age_s: float = 0.0, **changes: Any
    ) -> list[ev.Effect]:
        """Receive an intent of vehicle `uav`: points (seconds from then, east, north), at the same height."""
        up_m, changes["age_s"] = changes.pop("up_m", 0.0), changes.pop("message_age_s", 0.0)
        path = intent_path(*((t, e, n, AMSL_M + up_m) for t, e, n in points))
        return self.told(intents=((uav, age_s, IntentShared(1, path, **changes)),))

    def crossing(self, uav: int, **changes: Any) -> list[ev.Effect]:
        """Receive an intent that crosses the middle of the area from the south when vehicle 2 is there."""
        in_s = (MID_M[0] - 75.0) / 10.0 + 1.0
        south, north = MID_M[1] - 10.0 * in_s, MID_M[1] + 100.0
        return self.other(uav, (0.0, MID_M[0], south), (in_s + 10.0, MID_M[0], north), **changes)


# --- sending


def test_an_intent_in_flight_reaches_to_the_landing() -> None:
    (intent,) = intents(IntentStory().effects)
    first, *_, last = intent.points
    assert first.in_s == 0.0
    assert GRID.frame.to_local(first.lat_deg, first.lon_deg)[0] == pytest.approx(75.0, abs=0.01)
    assert first.alt_amsl_m == pytest.approx(AMSL_M)
    over_m = GRID.frame.to_local(last.lat_deg, last.lon_deg)[0] - 75.0
    assert over_m == pytest.approx(GRID.centre_m((4, 8))[0] - 75.0, abs=0.01)
    assert last.in_s > over_m / 10.0
    assert last.alt_amsl_m == pytest.approx(AMSL_M - 30.0)
    assert (intent.plan_id, intent.may_change) == (1, True)


def test_an_intent_is_repeated_at_its_interval() -> None:
    story, since_s, east_m = IntentStory(), 0.0, 75.0
    while since_s < REPEAT_EVERY_S - 1.5:
        since_s, east_m = since_s + 1.0, east_m + 10.0
        assert intents(story.at(east_m)) == []
    story.at(east_m + 10.0)
    assert intents(story.effects) or intents(story.at(east_m + 20.0))


def test_a_newly_heard_vehicle_gets_the_intent_at_once() -> None:
    story = IntentStory()
    place = GRID.frame.to_geodetic(75.0, MID_M[1] + 60.0)
    heard = StateShared(0.0, *place, 30.0, AMSL_M, "flying", 0, 0)
    story.told(neighbours=((3, heard),))
    assert len(intents(story.at(85.0))) == 1


def test_a_vehicle_behind_its_intent_sends_a_new_intent() -> None:
    story = IntentStory()
    assert intents(story.at(81.0)) == []
    (intent,) = intents(story.at(81.0))  # 95 m by the intent
    assert GRID.frame.to_local(intent.points[0].lat_deg, intent.points[0].lon_deg)[0] == pytest.approx(81.0)


def test_the_intent_of_a_hold_is_fixed() -> None:
    story = IntentStory()
    story(ev.OperatorCommand(ev.FlightOrder.HOLD))
    (intent,) = intents(story.at(100.0, ground_speed_m_s=0.0, east_m_s=0.0, mode_role="hold"))
    assert [p.in_s for p in intent.points] == [0.0, HOLD_DURATION_S]
    assert len({(p.lat_deg, p.lon_deg, p.alt_amsl_m) for p in intent.points}) == 1
    assert not intent.may_change


def test_a_return_withdraws_the_intent() -> None:
    story = IntentStory()
    story(ev.OperatorCommand(ev.FlightOrder.RETURN))
    (intent,) = intents(story.at(130.0, mode="RTL", mode_role="return"))
    assert intent.points == ()
    other = IntentStory()
    other.crossing(1)
    assert 1 in other.state.intents
    other.told(intents=((1, 0.0, intent),))
    assert 1 not in other.state.intents


# --- a new plan


def report_hostile_ahead(story: IntentStory) -> list[ev.Effect]:
    """Report a hostile ahead on the row and let the agent decide."""
    story.hear((4, 6, True), observer=9)
    return story.tick()


def heights(effects: list[ev.Effect]) -> list[float]:
    return [swap.plan.landing.alt_rel_m for swap in swaps(effects)]


def test_a_new_plan_without_conflict_is_uploaded_and_announced() -> None:
    story = IntentStory()
    story.other(1, (0.0, 0.0, 0.0), (60.0, 400.0, 0.0))
    effects = report_hostile_ahead(story)
    assert heights(effects) == [30.0]
    (intent,) = intents(effects)
    assert intent.plan_id == story.state.plans.pending.plan_id  # type: ignore[union-attr]
    assert story.state.conflicts.counts.predicted == 0


def test_a_vehicle_that_keeps_its_old_mission_announces_it_again_at_once() -> None:
    """Its link may be lost, and then nothing else tells the others which plan it flies."""
    story = IntentStory()
    assert story.state.plans.mission is not None
    old_id = story.state.plans.mission.plan_id
    story.hear((4, 5, True))
    swap = story.swap()
    (again,) = intents(story(ev.MissionFailed(swap.plan_id, "old", "no answer")))
    assert again.plan_id == old_id != swap.plan_id


@pytest.mark.parametrize("uav", [1, 3])
def test_a_new_plan_gives_way_to_earlier_plans(uav: int) -> None:
    """The rule also holds for the earlier plan of a higher system id."""
    story = IntentStory()
    story.crossing(uav)
    effects = report_hostile_ahead(story)
    assert heights(effects) == [pytest.approx(33.6)]
    assert codes(effects) == ["height-change"]
    assert f"vehicle {uav} " in operator_texts(effects)[0]
    assert (story.state.conflicts.counts.predicted, story.state.conflicts.counts.by_height) == (1, 1)
    now, accepted, *new, _, _ = (round(p.alt_amsl_m, 1) for p in intents(effects)[0].points)
    assert now == accepted == AMSL_M  # until the vehicle has the new mission it flies by the old one
    assert set(new) == {AMSL_M + 3.6}


def below_ceiling(**changes: Any) -> IntentStory:
    """Return a vehicle that may not climb above 33 m."""
    return IntentStory(fence=Fence((), 36.0), **changes)


def test_without_a_free_height_a_new_plan_is_deferred() -> None:
    story = below_ceiling()
    # The row of vehicle 2 is free; each route around the hostile has a conflict.
    for uav, north_m in ((1, MID_M[1] + 100.0), (3, MID_M[1] - 100.0)):
        story.other(uav, (0.0, MID_M[0] + 50.0, north_m), (90.0, MID_M[0] + 55.0, north_m))
    before = story.state.plans.mission
    effects = report_hostile_ahead(story)
    assert heights(effects) == []
    assert codes(effects) == ["plan-deferred"]
    assert story.state.plans.mission is before
    assert story.state.plans.pending is None
    assert story.state.conflicts.counts.by_waiting == story.state.conflicts.counts.predicted >= 1
    assert story.tick() == []
    story.now += RETRY_S
    for uav in (1, 3):
        story.other(uav, (0.0, 0.0, 0.0), (60.0, 400.0, 0.0))
    assert heights(story.tick()) == [30.0]


@pytest.mark.parametrize("action", ["hold", "none"])
def test_a_vehicle_holds_if_the_present_plan_conflicts_soon_as_well(action: AvoidanceAction) -> None:
    story = below_ceiling(action=action)
    story.crossing(3, may_change=False)
    effects = report_hostile_ahead(story)
    assert heights(effects) == []
    if action == "none":
        assert orders(effects) == []
        return
    assert orders(effects) == [ev.FlightOrder.HOLD]
    assert codes(effects)[-1] == "plan-deferred-hold"
    *_, stops, ends = intents(effects)[0].points
    assert ends.in_s - stops.in_s == pytest.approx(HOLD_DURATION_S)
    assert (stops.lat_deg, stops.lon_deg) == (ends.lat_deg, ends.lon_deg)
    # The vehicle holds, and plans again when vehicle 1 has passed.
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    story.other(3, (0.0, 0.0, 0.0), (60.0, 400.0, 0.0))
    still = {"ground_speed_m_s": 0.0, "east_m_s": 0.0, "mode_role": "hold"}
    for _ in range(9):
        story.at(100.0, **still)
    swap = story.swap()
    assert swap.plan.landing.alt_rel_m == 30.0
    assert codes(story.effects) == ["resumes"]


@pytest.mark.parametrize(("present_m", "clashes"), [(0.0, 0), (6.0, 1), (None, 1)])
def test_a_plan_that_comes_too_close_has_to_be_clearly_better_than_the_present_plan(
    present_m: float | None, clashes: int
) -> None:
    """Vehicle 1 stands 15 m ahead; the limit is 10 m. The new plan passes it at 6.3 m."""
    story = IntentStory()
    east_m, north_m = 75.0, MID_M[1]
    story.other(1, (0.0, east_m + 15.0, north_m), (60.0, east_m + 15.0, north_m))
    begin_s = story.state.vehicle.time_boot_s

    def passing(beside_m: float) -> Trajectory:
        path = [(0.0, 0.0), (15.0, beside_m), (100.0, beside_m)]
        points = tuple((east_m + e, north_m + n, AMSL_M) for e, n in path)
        return Trajectory((begin_s, begin_s + 1.5, begin_s + 10.0), points)

    present = None if present_m is None else passing(present_m)
    assert len(clashes_of_route(story.state, passing(7.0), known_flights(story.state), present)) == clashes


def test_a_vehicle_that_passes_during_the_upload_is_in_the_way() -> None:
    """Vehicle 1 passes through the hold of vehicle 2 when its climb has hardly begun."""
    story = IntentStory()
    east_m, north_m = 75.0, MID_M[1]
    story.other(1, (0.0, east_m, north_m - 105.0), (20.0, east_m, north_m + 95.0))
    begin_s, here = story.state.vehicle.time_boot_s, (east_m, north_m, AMSL_M)
    climb = Trajectory(
        (begin_s, begin_s + 8.0, begin_s + 35.0), (here, here, (east_m, north_m, AMSL_M + 40.0))
    )
    hold = Trajectory((begin_s, begin_s + 30.0), (here, here))
    assert len(clashes_of_route(story.state, climb, known_flights(story.state), hold)) == 1


# --- plans made before the other vehicle's intent arrives


@pytest.mark.parametrize(
    ("uav", "may_change", "gives_way"), [(1, True, True), (3, True, False), (3, False, True)]
)
def test_the_higher_system_id_gives_way_and_a_fixed_plan_has_priority(
    uav: int, may_change: bool, gives_way: bool
) -> None:
    story = IntentStory()
    effects = story.crossing(uav, may_change=may_change)
    assert bool(operator_texts(effects)) is gives_way
    assert heights(story.tick()) == ([pytest.approx(33.6)] if gives_way else [])
    assert (story.state.conflicts.counts.predicted, story.state.conflicts.counts.by_height) == (
        gives_way,
        gives_way,
    )


@pytest.mark.parametrize(("may_change", "gives_way"), [(False, True), (True, False)])
def test_a_landing_already_begun_has_priority(may_change: bool, gives_way: bool) -> None:
    """The height of a vehicle en route is known, but not the time of its descent."""
    story, (east_m, north_m) = IntentStory(), (MID_M[0], MID_M[1] + 5.0)
    in_s = (east_m - 75.0) / 10.0
    down = [(0.0, 8.0), (in_s - 4.0, 8.0), (in_s + 1.0, 0.0), (in_s + 30.0, -30.0)]
    points = intent_path(*((t, east_m, north_m, AMSL_M + up_m) for t, up_m in down))
    effects = story.told(intents=((1, 0.0, IntentShared(1, points, may_change=may_change)),))
    assert ("route-conflict" in codes(effects)) is gives_way


def test_a_conflict_is_reported_and_counted_once() -> None:
    story = below_ceiling()
    south = MID_M[1] - 300.0
    for _ in range(3):
        effects = story.other(1, (0.0, 425.0, south), (35.0, 425.0, MID_M[1]), (60.0, 425.0, MID_M[1]))
        story.tick()
    assert operator_texts(effects) == []
    assert story.state.conflicts.counts.predicted == 1
    story.other(1, (0.0, 0.0, 0.0), (60.0, 400.0, 0.0))
    assert story.state.conflicts.predicted == frozenset()


# --- vehicles without a position


NOWHERE: dict[str, Any] = {"lat_deg": None, "lon_deg": None, "alt_rel_m": None, "alt_amsl_m": None}


def states(effects: list[ev.Effect]) -> list[StateShared]:
    return publications(effects, StateShared)


def without_position(seconds: int) -> tuple[IntentStory, list[ev.Effect]]:
    """Return vehicle 2, last seen at 75 m on its row, and its effects since."""
    story = IntentStory()
    return story, [effect for _ in range(seconds) for effect in story.at(75.0, **NOWHERE)]


def test_a_vehicle_without_a_position_shares_its_last_one_and_its_age() -> None:
    _, effects = without_position(5)
    assert [state.age_s for state in states(effects)] == [1.0, 2.0, 3.0, 4.0, 5.0]
    at = states(effects)[-1]
    assert GRID.frame.to_local(at.lat_deg, at.lon_deg)[0] == pytest.approx(75.0, abs=0.01)
    assert (at.alt_rel_m, at.velocity_m_s) == (30.0, (10.0, 0.0, 0.0))


def test_the_intent_without_a_position_has_an_uncertainty() -> None:
    story, effects = without_position(8)
    intent = intents(effects)[-1]
    assert [GRID.frame.to_local(p.lat_deg, p.lon_deg)[0] for p in intent.points] == pytest.approx(
        [75.0] * 2, abs=0.01
    )
    assert {p.alt_amsl_m for p in intent.points} == {AMSL_M - 15.0}
    age_s = story.state.sent.intent_boot_s - story.state.last_position.time_boot_s
    assert intent.around_m == (pytest.approx(min(10.0 * age_s, MAX_UNCERTAINTY_M)), 15.0)
    assert not intent.may_change


def test_the_last_position_expires() -> None:
    _, effects = without_position(int(LAST_POSITION_S) + 10)
    assert intents(effects)[-1].points == ()
    assert intents(effects)[-3].points != ()


def test_a_vehicle_without_a_link_announces_its_flight_since_the_last_telemetry_again_and_again() -> None:
    """The messages are the same but for their age, and the others expect the same flight from each."""
    story, told = IntentStory(), []
    for age_s in (4.0, 5.0):
        effects = story(ev.LinkLost(age_s))
        told += states(effects)
        (intent,) = intents(effects)
        first = intent.points[0]
        assert GRID.frame.to_local(first.lat_deg, first.lon_deg)[0] == pytest.approx(75.0, abs=0.01)
        assert (intent.age_s, first.in_s, intent.may_change) == (age_s, 0.0, False)
    (state,) = told
    assert GRID.frame.to_local(state.lat_deg, state.lon_deg)[0] == pytest.approx(75.0, abs=0.01)
    assert state.age_s == 4.0


def test_new_telemetry_ends_the_age_of_an_intent_before_the_first_heartbeat() -> None:
    story = IntentStory()
    story(ev.LinkLost(20.0))
    effects = story.at(275.0)
    assert [state.age_s for state in states(effects)] == [0.0]
    assert {intent.age_s for intent in intents(effects)} <= {0.0}


def test_an_intent_begins_at_its_senders_last_telemetry() -> None:
    story = IntentStory()
    story.other(1, (0.0, 0.0, 0.0), (60.0, 500.0, 0.0), message_age_s=4.0)
    known = known_flights(story.state)[1].flight
    assert known.times_s[0] == pytest.approx(story.state.vehicle.time_boot_s - 4.0)


@pytest.mark.parametrize(("away_m", "around_m", "height_m"), [(50.0, 60.0, 33.6), (50.0, 20.0, 30.0)])
def test_a_new_plan_respects_the_uncertainty_of_a_lost_position(
    away_m: float, around_m: float, height_m: float
) -> None:
    """Its intent has half the last height, and an uncertainty down to the ground."""
    story = IntentStory(action="none")
    there = (200.0, MID_M[1] - away_m)
    vague = {"up_m": -15.0, "around_m": (around_m, 15.0), "may_change": False}
    story.other(7, (0.0, *there), (60.0, *there), **vague)
    (height,) = heights(report_hostile_ahead(story))
    assert height == pytest.approx(height_m)


def test_an_exaggerated_uncertainty_is_limited() -> None:
    story = IntentStory()
    story.other(1, (0.0, 75.0, MID_M[1] + 300.0), (60.0, 500.0, MID_M[1] + 300.0), around_m=(1e6, 0.0))
    story.at(85.0)
    assert story.state.conflicts.predicted == frozenset()
