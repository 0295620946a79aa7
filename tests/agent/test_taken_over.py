"""Failsafe: another operator flies the vehicle."""

from __future__ import annotations

import pytest
from failsafe_facts import RuleRunner, at, facts

from swarmctl.agent.failsafes import taken_over
from swarmctl.agent.failsafes.base import DemandKind, FlightActivity
from swarmctl.agent.failsafes.taken_over import FOREIGN_ON_GROUND_S
from swarmctl.core.records import replace
from swarmctl.core.vehicle import STALE_MODE_S, VehicleState

LOITER = at(0.0, 0.0, mode="LOITER", mode_role="other")
GUIDED = at(0.0, 0.0, mode="GUIDED", mode_role="hold")


def test_a_mode_that_no_agent_sets_releases_at_once() -> None:
    rule = RuleRunner(taken_over)
    assert rule(0.0, facts()) is None
    demand = rule(0.1, facts(LOITER))
    assert demand is not None
    assert demand.kind is DemandKind.RELEASE
    assert "LOITER" in demand.reason


@pytest.mark.parametrize("state", [GUIDED, at(0.0, 0.0, mode="OFFBOARD", mode_role="setpoints")])
def test_an_own_mode_is_tolerated_for_a_moment_as_an_old_heartbeat(state: VehicleState) -> None:
    rule = RuleRunner(taken_over)
    assert rule(0.0, facts(state)) is None
    assert rule(STALE_MODE_S - 0.1, facts(state)) is None
    assert rule(STALE_MODE_S, facts(state)) is not None


def test_each_order_restarts_the_tolerance_for_old_heartbeats() -> None:
    rule = RuleRunner(taken_over)
    for second in range(10):
        assert rule(float(second), facts(GUIDED, orders_given=second)) is None


def test_only_a_recent_status_text_is_quoted() -> None:
    for silence_s, is_quoted in ((1.0, True), (3.0, False)):
        rule = RuleRunner(taken_over)
        rule(0.0, facts(at(0.0, 0.0, status_text="Mode change failed")))
        rule(5.0, facts(at(0.0, 0.0, status_text="EKF Failsafe")))
        demand = rule(5.0 + silence_s, facts(replace(LOITER, status_text="EKF Failsafe")))
        assert demand is not None
        assert ("EKF Failsafe" in demand.reason) is is_quoted


@pytest.mark.parametrize("armed", [True, False])
def test_arming_of_a_waiting_vehicle_is_a_takeover(armed: bool) -> None:
    demand = RuleRunner(taken_over)(0.0, facts(at(0.0, 0.0, armed=armed), activity="ground"))
    assert (demand is not None) is armed


def test_a_boot_mode_releases_only_after_some_time() -> None:
    on_ground = facts(
        at(0.0, 0.0, mode="STABILIZE", mode_role="other", armed=False),
        activity="ground",
        own_roles=frozenset({"hold", "mission"}),
    )
    rule = RuleRunner(taken_over)
    assert [rule(second, on_ground) for second in (0.0, 1.0, FOREIGN_ON_GROUND_S - 0.1)] == [None] * 3
    demand = rule(FOREIGN_ON_GROUND_S, on_ground)
    assert demand is not None
    assert "STABILIZE" in demand.reason


OTHER = {"other_mission": True, "mission_total": 21}


@pytest.mark.parametrize("activity", ["launch", "mission", "goal"])
def test_a_foreign_mission_in_use_releases_the_vehicle(activity: FlightActivity) -> None:
    demand = RuleRunner(taken_over)(0.0, facts(at(0.0, 0.0, **OTHER), activity=activity))
    assert demand is not None
    assert demand.kind is DemandKind.RELEASE
    assert "21 items" in demand.reason


def test_a_foreign_mission_warns_on_the_ground_and_is_ignored_during_a_return() -> None:
    ground = at(0.0, 0.0, mode="GUIDED", mode_role="hold", armed=False, **OTHER)
    demand = RuleRunner(taken_over)(0.0, facts(ground, activity="ground", own_roles=frozenset({"hold"})))
    assert demand is not None
    assert demand.kind is DemandKind.WARN
    home = facts(
        at(0.0, 0.0, mode="RTL", mode_role="return", **OTHER),
        activity="return",
        own_roles=frozenset({"return"}),
    )
    assert RuleRunner(taken_over)(0.0, home) is None
    switched = facts(at(0.0, 0.0, mode="LOITER", mode_role="other", **OTHER), activity="return")
    demand = RuleRunner(taken_over)(0.0, switched)
    assert demand is not None
    assert "LOITER" in demand.reason
