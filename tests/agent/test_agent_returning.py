"""Return queue: a return by low battery while other vehicles return, as stories."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from agent_stories import AMSL_M, GRID, Story, answers, codes, operator_texts, orders, publications

from swarmctl.agent.failsafes import low_battery, not_following
from swarmctl.agent.failsafes.base import ActiveRule, Demand, DemandKind
from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.return_schedule import schedule_for
from swarmctl.agent.traffic.returning import may_hold_before_leaving, position_for_return
from swarmctl.agent.traffic.route_hold import hold
from swarmctl.agent.traffic.wait import PASSES_WITHIN_S, RULES, SETTLES_S, WaitFor
from swarmctl.config.flight import FlightSection
from swarmctl.core import events as ev
from swarmctl.core.frames import MAX_MAGNITUDE, StateShared
from swarmctl.core.messages import VehicleAnswer
from swarmctl.core.records import replace
from swarmctl.flight.shutdown import Shutdown
from swarmctl.flight.virtual_clock import run_virtual

MAX_RETURN_WAIT_S = RULES[WaitFor.RETURN_PATH].longest_s
MAX_LANDING_WAIT_S = RULES[WaitFor.GROUND].longest_s

HOLD, RETURN, LAND = ev.FlightOrder.HOLD, ev.FlightOrder.RETURN, ev.FlightOrder.LAND
LAT_DEG, LON_DEG = GRID.centre((4, 0))
HOMES = {"home_lat_deg": LAT_DEG, "home_lon_deg": LON_DEG, "home_alt_amsl_m": AMSL_M - 30.0}
RULES = (ActiveRule(low_battery, low_battery.Params(seconds=0.0)),)


class ReturnStory(Story):
    """A flight of vehicle 2 east along row 4, 200 m from its take-off; `goes_home` adds another return."""

    def __init__(self, **changes: Any) -> None:
        super().__init__(**{"uav": 2, "rules": RULES, **changes})
        self.flying()
        self.at()

    def at(self, percent: int = 60, **changes: Any) -> list[ev.Effect]:
        flown = {"alt_amsl_m": AMSL_M, "battery_percent": percent, **HOMES}
        return self.over((4, 4), **{**flown, **changes})

    def holds(self, percent: int = 23, **changes: Any) -> list[ev.Effect]:
        return self.at(percent, mode="GUIDED", mode_role="hold", **changes)

    def returns(self, percent: int = 23) -> list[ev.Effect]:
        return self.at(percent, mode="RTL", mode_role="return")

    def goes_home(self, uav: int, *, col: int = 6, row: int = 4, **changes: Any) -> None:
        """Receive the state of a vehicle that returns along row 4 to the take-off of vehicle 2."""
        lat_deg, lon_deg = GRID.centre((row, col))
        state: dict[str, Any] = {"time_s": self.now, "lat_deg": lat_deg, "lon_deg": lon_deg, "n_found": 0}
        state |= {"alt_rel_m": 34.0, "alt_amsl_m": AMSL_M + 4.0, "phase": "leaving", "n_observed": 0}
        state |= {"returns_to": (LAT_DEG, LON_DEG), **changes}
        self.tell(neighbours=((uav, StateShared(**state)),))


def shared(effects: list[ev.Effect]) -> StateShared:
    (state,) = publications(effects, StateShared)
    return state


def test_a_vehicle_alone_returns_at_once_and_announces_its_home() -> None:
    story = ReturnStory()
    effects = story.at(23)
    assert orders(effects) == [RETURN]
    assert codes(effects) == ["low-battery"]
    assert "23 %" in operator_texts(effects)[0]
    assert (shared(effects).phase, shared(effects).returns_to) == ("leaving", (LAT_DEG, LON_DEG))


@pytest.mark.parametrize("phase", ["leaving", "released"])
def test_a_vehicle_holds_until_its_return_path_is_clear(
    phase: str,
) -> None:
    story = ReturnStory()
    story.goes_home(3, phase=phase)
    effects = story.at(23)
    assert orders(effects) == [HOLD]
    assert codes(effects) == ["low-battery"]
    assert (shared(effects).phase, shared(effects).returns_to) == ("holding", (LAT_DEG, LON_DEG))
    story(ev.OrderDone(HOLD))
    for col in (5, 4, 3, 2, 1):
        story.goes_home(3, col=col, phase=phase)
        assert orders(story.holds()) == []
    story.goes_home(3, col=0, phase="done", returns_to=None)
    effects = story.holds()
    assert orders(effects) == [RETURN]
    assert codes(effects) == ["return-clear"]
    assert shared(effects).phase == "leaving"
    assert orders(story.returns()) == []
    assert "23 %" in story.state.outcome


def test_a_low_battery_waits_for_a_vehicle_that_flies_through_the_path_home() -> None:
    story = ReturnStory()
    flies = {"phase": "flying", "returns_to": None, "alt_rel_m": 30.0, "alt_amsl_m": AMSL_M}
    story.goes_home(3, col=2, velocity_m_s=(5.0, 0.0, 0.0), **flies)
    assert orders(story.at(23)) == [HOLD]
    story(ev.OrderDone(HOLD))
    story.goes_home(3, row=7, velocity_m_s=(0.0, 10.0, 0.0), **flies)
    assert orders(story.holds()) == [RETURN]


@pytest.mark.parametrize(("other_m", "order"), [(25.0, HOLD), (12.0, RETURN)])
def test_a_return_from_a_low_hold_is_clear_at_each_height_up_to_the_cruise_height(
    other_m: float, order: ev.FlightOrder
) -> None:
    story, low = ReturnStory(), {"alt_rel_m": 20.0, "alt_amsl_m": AMSL_M - 10.0}
    stands = {"phase": "holding", "returns_to": None, "alt_rel_m": other_m}
    story.goes_home(3, col=3, alt_amsl_m=AMSL_M - 30.0 + other_m, **stands)
    assert orders(story.at(23, **low)) == [order]


def end_of_hold(
    story: ReturnStory, percent: int, comes: Callable[[], None] = lambda: None
) -> tuple[ev.FlightOrder, float]:
    """Return the order after a hold, and its time; `comes` is called before each position."""
    began_s = story.state.vehicle.time_boot_s
    story(ev.OrderDone(HOLD))
    for _ in range(int(MAX_RETURN_WAIT_S)):
        comes()
        if given := orders(story.holds(percent)):
            return given[0], story.state.vehicle.time_boot_s - began_s
    raise AssertionError("the hold does not end")


@pytest.mark.parametrize(
    ("passes_s", "order"), [(3, RETURN), (60, LAND)], ids=["passes", "stays in the way home"]
)
def test_an_urgent_return_waits_for_a_passing_vehicle_but_not_for_long(
    passes_s: int, order: ev.FlightOrder
) -> None:
    story = ReturnStory()
    began_s = story.now

    def comes() -> None:
        flies = {"phase": "flying", "returns_to": None, "alt_rel_m": 30.0, "alt_amsl_m": AMSL_M}
        row = 4 if story.now - began_s < passes_s else 7
        story.goes_home(3, row=row, col=2, velocity_m_s=(5.0, 0.0, 0.0), **flies)

    comes()
    assert orders(story.at(19)) == [HOLD]
    given, after_s = end_of_hold(story, 19, comes)
    assert (given, after_s) == (order, pytest.approx(min(passes_s, PASSES_WITHIN_S), abs=1.0))


def test_a_vehicle_in_hold_that_hears_nobody_waits_before_its_return() -> None:
    story = ReturnStory()
    story.goes_home(3, col=5, phase="flying", returns_to=None, alt_amsl_m=AMSL_M)
    story.state, _ = hold(story.state, story.state.plans.mission, frozenset())
    story(ev.OrderDone(HOLD))
    for _ in range(5):
        assert orders(story.holds(60)) == []
    assert orders(story.holds(19)) == [HOLD]
    given, after_s = end_of_hold(story, 19)
    assert (given, after_s) == (RETURN, pytest.approx(PASSES_WITHIN_S, abs=1.0))


def test_a_return_does_not_wait_for_a_return_elsewhere() -> None:
    story = ReturnStory()
    story.goes_home(3, row=8, returns_to=GRID.centre((8, 8)))
    assert orders(story.at(23)) == [RETURN]


@pytest.mark.parametrize(
    "fields",
    [{"alt_rel_m": MAX_MAGNITUDE}, {"alt_rel_m": -MAX_MAGNITUDE}, {"returns_to": (LAT_DEG, LON_DEG - 2.0)}],
    ids=["above the atmosphere", "under the ground", "155 km away"],
)
def test_a_return_does_not_wait_for_a_vehicle_with_an_implausible_state(fields: dict[str, Any]) -> None:
    story = ReturnStory()
    story.goes_home(3, **fields)
    assert orders(story.at(23)) == [RETURN]


@pytest.mark.parametrize(("uav", "first"), [(1, True), (3, False)])
def test_the_lower_system_id_returns_first_when_both_wait(uav: int, *, first: bool) -> None:
    story = ReturnStory()
    story.goes_home(uav, phase="holding")
    assert orders(story.at(23)) == [HOLD if first else RETURN]


def waiting(percent: int = 23) -> ReturnStory:
    story = ReturnStory()
    story.goes_home(3)
    assert orders(story.at(percent)) == [HOLD]
    story(ev.OrderDone(HOLD))
    return story


def test_a_lower_battery_ends_the_wait() -> None:
    story = waiting()
    for percent in (22, 21, 20):
        story.goes_home(3)
        assert orders(story.holds(percent)) == []
    story.goes_home(3)
    assert orders(story.holds(19)) == [RETURN]
    assert orders(story.returns(18)) == []


@pytest.mark.parametrize(("higher", "before_s"), [((), 0.0), ((4,), 10.0), ((4, 5), 20.0)])
def test_waits_that_end_together_are_staggered(higher: tuple[int, ...], before_s: float) -> None:
    story = waiting()

    def returns() -> bool:
        for uav in (1, *higher):
            story.goes_home(uav, phase="holding")
        story.goes_home(3)
        return RETURN in orders(story.holds())

    assert next(s for s in range(int(MAX_RETURN_WAIT_S) + 1) if returns()) == pytest.approx(
        MAX_RETURN_WAIT_S - before_s, abs=2.0
    )


def test_a_vehicle_that_starts_at_its_staggered_end_does_not_hold_again_for_another_start() -> None:
    story = waiting()

    def others() -> None:
        for uav in (4, 5):
            story.goes_home(uav, phase="holding")
        story.goes_home(1)

    others()
    while RETURN not in orders(story.holds()):
        others()
    story(ev.OrderDone(RETURN))
    others()
    assert orders(story.returns()) == []


def test_a_silent_returning_vehicle_counts_until_its_latest_landing() -> None:
    story = waiting()
    # 10 s to react, 19 s to climb to 60 m, 300 m at half the speed and 75 s to descend.
    seconds = next(s for s in range(300) if orders(story.holds()) == [RETURN])
    assert seconds == pytest.approx(MAX_RETURN_WAIT_S, abs=2.0)


@pytest.mark.parametrize(("uav", "then"), [(1, [HOLD]), (3, [])])
def test_the_higher_system_id_holds_again_after_simultaneous_starts(
    uav: int, then: list[ev.FlightOrder]
) -> None:
    story = ReturnStory()
    assert orders(story.at(23)) == [RETURN]
    story(ev.OrderDone(RETURN))
    story.goes_home(uav)
    assert orders(story.returns()) == then


@pytest.mark.parametrize("on_s", [2, 6], ids=["return still settling", "return well under way"])
def test_interruptions_do_not_extend_the_longest_wait(on_s: int) -> None:
    story = ReturnStory()
    (order,), given = orders(story.at(23)), []
    began_s = story.now
    for second in range(4 * int(MAX_RETURN_WAIT_S)):
        story(ev.OrderDone(order))
        story.now -= 1.0
        is_there = second % (2 * on_s) < on_s
        there = {} if is_there else {"phase": "done", "returns_to": None}
        story.goes_home(1, **there)
        for then in orders(story.returns() if order is RETURN else story.holds()):
            given.append((then, story.now - began_s))
            order = then
    assert given[0][0] is HOLD
    assert given[-1][0] is RETURN
    assert given[-1][1] <= MAX_RETURN_WAIT_S + 1.0


def test_a_later_return_has_its_own_wait() -> None:
    story = waiting()
    assert orders(story(ev.OperatorCommand(HOLD, 1))) == [HOLD]
    story.now += MAX_RETURN_WAIT_S
    story.goes_home(3)
    assert orders(story.holds(22)) == []


def test_a_return_under_way_is_not_stopped() -> None:
    story = ReturnStory()
    assert orders(story.at(23)) == [RETURN]
    story(ev.OrderDone(RETURN))
    story.now += SETTLES_S
    story.goes_home(1)
    assert orders(story.returns()) == []


def test_an_urgent_demand_causes_a_return_without_a_wait() -> None:
    story = ReturnStory(rules=(ActiveRule(not_following, not_following.Params(seconds=3.0)),))
    story.goes_home(3)
    given = [order for _ in range(6) for order in orders(story.at(60))]
    assert given == [RETURN]


@pytest.mark.parametrize(("kind", "may_hold"), [(DemandKind.WARN, True), (DemandKind.RETURN, False)])
def test_a_returning_vehicle_gives_way_while_a_rule_only_warns(kind: DemandKind, *, may_hold: bool) -> None:
    story = ReturnStory()
    assert orders(story.at(23)) == [RETURN]
    assert may_hold_before_leaving(replace(story.state, demands=(Demand(kind, "found"),))) is may_hold


def test_an_operators_order_takes_precedence() -> None:
    story = waiting()
    assert orders(story(ev.OperatorCommand(RETURN, 1))) == [RETURN]
    again = waiting()
    (answer,) = answers(again(ev.OperatorCommand(HOLD, 1)))
    assert answer.note.endswith("[return-cancelled]")
    assert "23 %" in answer.note
    again.goes_home(3, phase="done", returns_to=None)
    assert [order for s in range(30) for order in orders(again.holds(22 - s // 10))] == []


def recall(story: ReturnStory, after_s: float = 120.0) -> tuple[list[ev.FlightOrder], VehicleAnswer]:
    effects = story(ev.OperatorCommand(RETURN, 7, after_s))
    (answer,) = answers(effects)
    return orders(effects), answer


@pytest.mark.parametrize("percent", [19, 23], ids=["urgent", "not urgent"])
def test_a_recall_does_not_delay_an_urgent_return(percent: int) -> None:
    story = ReturnStory()
    assert orders(story.at(percent)) == [RETURN]
    given, answer = recall(story)
    assert answer.outcome == "taken"
    assert answer.place is not None
    if percent == 23:
        assert (given, answer.place.is_returning) == ([HOLD], False)
        return
    assert (given, answer.place.is_returning) == ([RETURN], True)
    assert answer.note.endswith("[urgent-return]")
    assert "19 %" in answer.note
    assert orders(story.returns(19)) == []
    assert shared(story.effects).phase == "leaving"


@pytest.mark.parametrize(("command", "after_s"), [(7, 120.0), (None, 0.0), (None, 30.0)])
def test_a_recall_does_not_stop_a_landing_by_low_battery(command: int | None, after_s: float) -> None:
    story = ReturnStory()
    assert orders(story.at(9)) == [LAND]
    effects = story(ev.OperatorCommand(RETURN, command, after_s))
    assert orders(effects) == []
    for answer in answers(effects):
        assert answer.outcome == "refused"
        assert answer.note.endswith("[failsafe-landing]")
        assert "9 %" in answer.note
    assert orders(story.at(8, mode="LAND", mode_role="land")) == []
    assert orders(story(ev.OperatorCommand(HOLD, 8))) == [HOLD], "an explicit order is obeyed"


def test_a_recall_of_an_ordered_landing_with_low_battery_starts_at_once() -> None:
    story = ReturnStory()
    story(ev.OperatorCommand(LAND, 1))
    story.at(19, mode="LAND", mode_role="land")
    assert recall(story)[0] == [RETURN]


def test_a_recall_of_an_ordered_hold_with_low_battery_starts_at_once() -> None:
    story = ReturnStory()
    story.at(19)
    story(ev.OperatorCommand(HOLD, 1))
    story(ev.OrderDone(HOLD))
    assert orders(story.holds(19)) == []
    place = position_for_return(story.state)
    assert place is not None
    assert place.is_returning
    assert recall(story)[0] == [RETURN]


def test_the_schedule_respects_an_urgent_return() -> None:
    story, other = ReturnStory(uav=4), ReturnStory(uav=3)
    story.at(19)
    other.at(60)
    _, urgent = recall(story)
    _, waits = recall(other)
    assert urgent.place is not None
    assert waits.place is not None
    begins_s = schedule_for({4: urgent.place, 3: waits.place}).begins_s
    assert begins_s[4] == 0.0
    assert begins_s[3] > 0.0


def test_a_reboot_ends_the_wait() -> None:
    story = waiting()
    story.now += 60.0
    story.goes_home(3)
    assert orders(story.holds()) == []
    story.now = 1.0
    story.goes_home(3)
    assert orders(story.holds()) == [RETURN]


@pytest.mark.parametrize(("up_m", "given"), [(12.0, RETURN), (28.0, HOLD)])
def test_a_fixed_wing_does_not_hold_during_its_take_off(up_m: float, given: ev.FlightOrder) -> None:
    story = ReturnStory()
    wings = FixedWing(40.0, 30.0, 5.0, 12.0, takeoff_height_m=20.0, home=(LAT_DEG, LON_DEG))
    story.state = replace(story.state, task=replace(story.state.task, wings=wings))
    story.goes_home(3)
    assert orders(story.at(23, alt_rel_m=up_m)) == [given]


class WaitingMember:
    """The attributes of a swarm member that a shutdown uses."""

    def __init__(self, story: ReturnStory) -> None:
        self.story, self.name, self.spec = story, "uav2", SimpleNamespace(sysid=2)
        self.runner = SimpleNamespace(post=story)

    @property
    def state(self) -> AgentState:
        return self.story.state


def test_a_shutdown_keeps_the_return_time_of_a_waiting_vehicle() -> None:
    story = waiting()
    member: Any = WaitingMember(story)
    shutdown = Shutdown([member], FlightSection(), lambda _text: None, flies_all=False)

    async def scene() -> list[ev.FlightOrder]:
        leaving = asyncio.create_task(shutdown.run())
        await asyncio.sleep(20.0)
        story.goes_home(3)
        given = orders(story.holds(19))
        leaving.cancel()
        return given

    assert run_virtual(scene()) == [RETURN]


def ordered(order: ev.FlightOrder, **other: Any) -> ReturnStory:
    """Return the story of vehicle 2 that holds and gets an order, with another vehicle in the way."""
    story = ReturnStory()
    story(ev.OperatorCommand(HOLD))
    story(ev.OrderDone(HOLD))
    story.goes_home(3, **other)
    assert orders(story(ev.OperatorCommand(order))) == []
    return story


def test_a_repeated_return_does_not_wait() -> None:
    story = ordered(RETURN)
    assert orders(story.holds(60)) == []
    assert orders(story(ev.OperatorCommand(RETURN))) == [RETURN]


def test_an_ordered_landing_waits_for_a_vehicle_below() -> None:
    below = {"col": 4, "phase": "holding", "returns_to": None, "alt_amsl_m": AMSL_M - 10.0}
    story = ordered(LAND, **below)
    for _ in range(3):
        story.goes_home(3, **below)
        assert orders(story.holds(60)) == []
    story.goes_home(3, **{**below, "phase": "done", "alt_rel_m": 0.0, "alt_amsl_m": AMSL_M - 30.0})
    assert orders(story.holds(60)) == [LAND]


@pytest.mark.parametrize(
    ("first", "home", "then"),
    [
        ({}, {}, RETURN),
        ({"returns_to": (LAT_DEG, LON_DEG), "phase": "leaving"}, {}, RETURN),
        ({}, {"home_lat_deg": None, "home_lon_deg": None}, LAND),
    ],
    ids=["way home clear", "another vehicle returns first", "home unknown"],
)
def test_an_ordered_landing_with_a_vehicle_below_becomes_a_return_at_its_deadline(
    first: dict[str, Any], home: dict[str, Any], then: ev.FlightOrder
) -> None:
    below = {"col": 4, "phase": "released", "returns_to": None, "alt_amsl_m": AMSL_M - 4.0}
    story = ordered(LAND, **below)
    given: list[tuple[float, ev.FlightOrder]] = []
    for second in range(int(MAX_LANDING_WAIT_S) + 4):
        story.goes_home(3, **below)
        story.goes_home(1, **{"col": 6, "phase": "done", "returns_to": None, "alt_rel_m": 0.0, **first})
        given += [(second, order) for order in orders(story.holds(60, **home))]
    assert given == [(pytest.approx(MAX_LANDING_WAIT_S, abs=4.0), then)]
