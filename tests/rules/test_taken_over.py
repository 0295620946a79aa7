"""Somebody else flies the vehicle."""

from __future__ import annotations

from dataclasses import replace

import pytest
from facts import Judged, at, facts

from swarmctl.rules import Kind, taken_over
from swarmctl.rules.taken_over import RECENT_S, STALE_MODE_S

LOITER = at(0.0, 0.0, mode="LOITER", mode_role="other")
GUIDED = at(0.0, 0.0, mode="GUIDED", mode_role="hold")


def test_a_mode_that_no_agent_ever_chooses_is_let_at_once() -> None:
    rule = Judged(taken_over)
    assert rule(0.0, facts()) is None
    demand = rule(0.1, facts(LOITER))
    assert demand is not None
    assert (demand.kind, demand.why) == (Kind.LET_GO, "in mode LOITER, which nobody here has ordered")


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
    for silence_s, told in ((1.0, True), (RECENT_S + 1.0, False)):
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
