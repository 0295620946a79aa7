"""Somebody else flies the vehicle."""

from __future__ import annotations

from dataclasses import replace

import pytest
from facts import Judged, at, facts

from swarmctl.agent.failsafes import taken_over
from swarmctl.agent.failsafes.base import Activity, DemandKind
from swarmctl.agent.failsafes.taken_over import BOOTS_S
from swarmctl.core.vehicle import STALE_MODE_S

LOITER = at(0.0, 0.0, mode="LOITER", mode_role="other")
GUIDED = at(0.0, 0.0, mode="GUIDED", mode_role="hold")


def test_a_mode_that_no_agent_ever_chooses_is_let_at_once() -> None:
    rule = Judged(taken_over)
    assert rule(0.0, facts()) is None
    demand = rule(0.1, facts(LOITER))
    assert demand is not None
    assert (demand.kind, demand.why) == (DemandKind.LET_GO, "in mode LOITER, which nobody here has ordered")


def test_a_mode_of_ours_may_be_an_old_heartbeat_for_a_moment() -> None:
    rule = Judged(taken_over)
    assert rule(0.0, facts(GUIDED)) is None
    assert rule(STALE_MODE_S - 0.1, facts(GUIDED)) is None
    assert rule(STALE_MODE_S, facts(GUIDED)) is not None


def test_after_each_order_it_has_that_moment_again() -> None:
    rule = Judged(taken_over)
    for second in range(10):
        assert rule(float(second), facts(GUIDED, orders=second)) is None


def test_what_the_vehicle_has_just_said_is_said_with_it_and_what_it_said_long_ago_is_not() -> None:
    for silence_s, told in ((1.0, True), (3.0, False)):
        rule = Judged(taken_over)
        rule(0.0, facts(at(0.0, 0.0, status_text="Mode change failed")))
        rule(5.0, facts(at(0.0, 0.0, status_text="EKF Failsafe")))
        demand = rule(5.0 + silence_s, facts(replace(LOITER, status_text="EKF Failsafe")))
        assert demand is not None
        assert ("(it says: EKF Failsafe)" in demand.why) is told


@pytest.mark.parametrize("armed", [True, False])
def test_who_arms_a_vehicle_that_waits_on_the_ground_has_it(armed: bool) -> None:
    demand = Judged(taken_over)(0.0, facts(at(0.0, 0.0, armed=armed), doing="ground"))
    assert (demand is not None) is armed


def test_a_mode_it_boots_in_is_nobodys_will_before_that_lasts() -> None:
    on_ground = facts(
        at(0.0, 0.0, mode="STABILIZE", mode_role="other", armed=False),
        doing="ground",
        ours=frozenset({"hold", "mission"}),
    )
    rule = Judged(taken_over)
    assert [rule(second, on_ground) for second in (0.0, 1.0, BOOTS_S - 0.1)] == [None] * 3
    demand = rule(BOOTS_S, on_ground)
    assert demand is not None
    assert "in mode STABILIZE" in demand.why


OTHER = {"other_mission": True, "mission_total": 21}


@pytest.mark.parametrize("doing", ["launch", "mission", "goal"])
def test_who_puts_another_mission_on_it_has_taken_it(doing: Activity) -> None:
    demand = Judged(taken_over)(0.0, facts(at(0.0, 0.0, **OTHER), doing=doing))
    assert demand is not None
    assert demand.kind is DemandKind.LET_GO
    assert demand.why == "another mission is on it, of 21 items, which nobody here has put there"


def test_on_the_ground_that_is_said_and_on_its_way_home_it_is_no_matter() -> None:
    ground = at(0.0, 0.0, mode="GUIDED", mode_role="hold", armed=False, **OTHER)
    demand = Judged(taken_over)(0.0, facts(ground, doing="ground", ours=frozenset({"hold"})))
    assert demand is not None
    assert demand.kind is DemandKind.WARN
    home = facts(
        at(0.0, 0.0, mode="RTL", mode_role="return", **OTHER), doing="return", ours=frozenset({"return"})
    )
    assert Judged(taken_over)(0.0, home) is None
    switched = facts(at(0.0, 0.0, mode="LOITER", mode_role="other", **OTHER), doing="return")
    demand = Judged(taken_over)(0.0, switched)
    assert demand is not None
    assert "in mode LOITER" in demand.why
