"""Failsafe: fence ahead."""

from __future__ import annotations

from typing import Any

import pytest
from failsafe_facts import RuleRunner, at, facts

from swarmctl.agent.failsafes import fence_ahead
from swarmctl.agent.failsafes.base import DemandKind, FailsafeFacts, Fence

FENCE = Fence(((-200.0, -200.0), (1200.0, -200.0), (1200.0, 200.0), (-200.0, 200.0)), 60.0)
"""The fence around the route to the east."""


def there(east_m: float, north_m: float, speed_m_s: float = 10.0, **changes: Any) -> FailsafeFacts:
    vehicle = at(east_m, north_m, ground_speed_m_s=speed_m_s)
    return facts(vehicle, **{"fence": FENCE, **changes})


def blown_north(speed_m_s: float, **changes: Any) -> dict[int, DemandKind]:
    """Return the distance to the fence [m] at the first demand of each kind during a drift to the north."""
    rule, found = RuleRunner(fence_ahead, off_route_m=15.0, seconds=2.0), {}
    for north_m in range(0, 230, 2):
        demand = rule(float(north_m), there(500.0, float(north_m), speed_m_s, **changes))
        if demand is not None and demand.kind not in found.values():
            found[200 - north_m] = demand.kind
    return found


@pytest.mark.parametrize(("speed_m_s", "stops_m"), [(5.0, 15.0), (10.0, 40.0), (15.0, 75.0)])
def test_a_vehicle_holds_inside_the_fence_and_returns_from_outside(speed_m_s: float, stops_m: float) -> None:
    found = blown_north(speed_m_s)
    (holds_at, hold), (returns_at, back) = found.items()
    assert (hold, back) == (DemandKind.HOLD, DemandKind.RETURN)
    # Two consecutive positions, 2 m apart.
    assert stops_m - 4.0 <= holds_at <= stops_m
    assert -4.0 <= returns_at <= 0.0


@pytest.mark.parametrize(("radius_m", "turns_m"), [(40.0, 70.0), (80.0, 110.0)])
def test_a_fixed_wing_returns_with_enough_room_to_turn(radius_m: float, turns_m: float) -> None:
    ((returns_at, back),) = blown_north(15.0, turn_radius_m=radius_m).items()
    assert back is DemandKind.RETURN
    assert turns_m - 4.0 <= returns_at <= turns_m


def test_a_route_may_lead_near_the_fence() -> None:
    rule = RuleRunner(fence_ahead)
    near = Fence(((-10.0, -20.0), (1005.0, -20.0), (1005.0, 20.0), (-10.0, 20.0)), 60.0)
    for east_m in range(0, 1000, 5):
        assert rule(float(east_m), there(float(east_m), 5.0, 20.0, fence=near)) is None


def test_flight_along_the_fence_is_allowed() -> None:
    rule = RuleRunner(fence_ahead)
    for east_m in range(0, 1000, 5):
        assert rule(float(east_m), there(float(east_m), 195.0)) is None


def test_a_position_above_the_ceiling_is_outside() -> None:
    rule, high = RuleRunner(fence_ahead), facts(at(0.0, 0.0, alt_rel_m=61.0), fence=FENCE)
    rule(0.0, high)
    demand = rule(0.25, high)
    assert demand is not None
    assert demand.kind is DemandKind.RETURN
    assert "61 m" in demand.reason
    assert "60 m" in demand.reason


@pytest.mark.parametrize("changes", [{"fence": None}, {"lost": True}, {"activity": "ground"}])
def test_the_rule_is_silent_without_a_fence_on_the_ground_or_with_a_lost_link(
    changes: dict[str, Any],
) -> None:
    assert blown_north(10.0, **changes) == {}


def test_a_single_position_outside_raises_no_demand() -> None:
    rule = RuleRunner(fence_ahead)
    assert rule(0.0, there(0.0, 0.0)) is None
    assert rule(0.25, there(9000.0, 0.0)) is None
    # Other messages arrive, but no new position.
    assert rule(1.0, there(9000.0, 0.0), position_s=0.25) is None
    assert rule(1.25, there(2.0, 0.0)) is None
    assert rule(1.5, there(9000.0, 0.0)) is None
    demand = rule(1.75, there(9000.0, 0.0))
    assert demand is not None
    assert demand.kind is DemandKind.RETURN
    again = rule(3.0, there(9000.0, 0.0), position_s=1.75)
    assert again == demand


def test_the_weaker_demand_of_two_positions_is_followed() -> None:
    rule = RuleRunner(fence_ahead)
    rule(0.0, there(500.0, 170.0))
    assert rule(0.25, there(500.0, 175.0)) is None
    demand = rule(0.5, there(500.0, 9000.0))
    assert demand is not None
    assert demand.kind is DemandKind.HOLD
