"""The approaches in groups of light vehicles, and the two laws that need no flight."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from flights import AREA
from group_flights import turn_cells
from light_group import LightGroup
from profiles import full_only

from swarmctl.agent.formation.approaches import APPROACHES, behavioural, virtual_structure
from swarmctl.agent.formation.approaches.base import (
    Along,
    Group,
    Nearby,
    OtherMember,
    ThreatField,
)
from swarmctl.agent.formation.approaches.behavioural import gradient
from swarmctl.agent.formation.approaches.place_keeping import keep_separation
from swarmctl.agent.formation.reference import Reference, SpeedProfile
from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.core import events as ev

SHORT = [("behavioural", True), ("leader_following", True), ("virtual_structure", False)]
"""approach, and whether the vehicles are like ArduCopter"""
REST = [case for case in product(APPROACHES, [True, False]) if case not in SHORT]

each_null_space = pytest.mark.parametrize("null_space", [False, True])


@pytest.mark.parametrize(("approach", "like_ardupilot"), [*SHORT, *full_only(*REST)])
def test_members_keep_their_places_on_straight_legs_and_through_a_turn(
    approach: str, *, like_ardupilot: bool
) -> None:
    size, no_fly, goal = turn_cells()
    area = {**AREA, "rows": size, "cols": size, "no_fly": no_fly}
    swarm = LightGroup(
        approach=approach, like_ardupilot=like_ardupilot, area=area, simulate={"goal": goal}
    ).joined()
    leader, followers, began_s = swarm.agents[0].vehicle, swarm.agents[1:], swarm.now
    errors_m, from_place_m, headings = [], [], set()

    def look(now: float) -> None:
        errors_m.extend(math.hypot(*agent.state.membership.error_m[:2]) for agent in followers)
        assert swarm.share_of_limits(*swarm.agents) > 2.5
        headings.add(tuple(round(speed / 9.5) for speed in leader.velocity[:2]))
        if now > began_s + 45.0:
            from_place_m.extend(swarm.from_place_m(agent.uav) for agent in followers)

    swarm.run(began_s + 4.0, lambda _now: None)
    swarm.run(began_s + 50.0, look)
    assert {(0, -1), (1, 0)} <= headings
    assert max(errors_m) < 4.0
    # Cells that are not flown over turn members of the behavioural approach aside.
    assert max(from_place_m) < (4.0 if approach == "behavioural" else 1.5)


@pytest.mark.parametrize("options", [{"null_space": False}, {"null_space": True}])
def test_two_members_of_the_behavioural_approach_pass_each_other(options: dict[str, Any]) -> None:
    """Each one starts on the side of the other one's place."""
    group = {"members": ["uav2", "uav3", "uav1"], "heights": "level", "options": options}
    swarm = LightGroup(approach="behavioural", formation=group)
    shares: list[float] = []
    swarm.run(45.0, lambda now: shares.append(swarm.share_of_limits(*swarm.agents) if now > 20.0 else 9.0))
    assert min(shares) > 1.0
    assert all(swarm.is_in_place(agent) for agent in swarm.agents)


@pytest.mark.parametrize("approach", ["leader_following", "virtual_structure"])
def test_a_group_waits_for_a_slow_member(approach: str) -> None:
    swarm = LightGroup(approach=approach).joined()
    leader, slow = swarm.agents[0].vehicle, swarm.agents[2]
    slow.vehicle.speed_m_s = 5.0
    swarm.run(swarm.now + 25.0, lambda _now: None)
    assert math.hypot(*leader.velocity[:2]) < 7.0
    assert slow.state.phase is Phase.FORMATION


@pytest.mark.parametrize("like_ardupilot", [True, False])
def test_a_member_that_has_to_hold_stops_at_once_also_if_the_order_is_lost(
    monkeypatch: pytest.MonkeyPatch, *, like_ardupilot: bool
) -> None:
    swarm = LightGroup(like_ardupilot=like_ardupilot).joined()
    follower = swarm.agents[1]
    monkeypatch.setattr(follower, "_reaches", lambda: False)
    follower(ev.OperatorCommand(ev.FlightOrder.HOLD))
    swarm.run(swarm.now + 0.4, lambda _now: None)
    begun_m_s = math.hypot(*follower.vehicle.velocity[:2])
    swarm.run(swarm.now + 2.0, lambda _now: None)
    assert math.hypot(*follower.vehicle.velocity[:2]) < 0.5 * begun_m_s


def member(flies: tuple[float, float, float], **facts: object) -> Group:
    """Return a member that flies alone along a route to the east, at its height."""
    route = Reference.over(((0.0, 60.0), (900.0, 60.0)), 15.0)
    return Group(
        **{
            "now_s": 0.0,
            "position_m": (100.0, 60.0, 30.0),
            "velocity_m_s": flies,
            "place": (0.0, 0.0, 0.0),
            "others": (),
            "along": Along(100.0, 8.0),
            "reference": route,
            "profile": SpeedProfile.of(route, 10.0, 8.0, 10.0, 2.0),
            "height_m": 30.0,
            "speed_m_s": 10.0,
            "limits": Limits(10.0, 3.0),
            **facts,
        }
    )


@pytest.mark.parametrize(("ahead_m", "descends"), [(60.0, True), (25.0, False)])
def test_a_member_descends_to_the_height_of_a_standing_vehicle_only_if_it_can_stop_before_it(
    ahead_m: float, *, descends: bool
) -> None:
    flies, standing = (8.0, 0.0, -1.0), Nearby((100.0 + ahead_m, 60.0, 30.0), (0.0, 0.0, 0.0))
    group = member(flies, position_m=(100.0, 60.0, 34.0), obstacles=(standing,))
    safe = keep_separation(group, flies)
    assert (safe is None) is descends
    assert safe is None or safe[2] > -0.5


@pytest.mark.parametrize(
    ("law", "params"),
    [
        (behavioural.fly, behavioural.Params(collision_weight=0.0)),
        (virtual_structure.fly, virtual_structure.Params()),
    ],
)
def test_a_member_passes_an_oncoming_one_on_the_right(law: Any, params: Any) -> None:
    oncoming = OtherMember((130.0, 60.0, 30.0), (-8.0, 0.0, 0.0))
    east_m_s, north_m_s, _ = law(params, member((8.0, 0.0, 0.0), others=(oncoming,))).demand.velocity_m_s
    assert east_m_s < 7.0
    assert north_m_s < -0.5


def test_no_member_is_to_fly_faster_than_its_limit() -> None:
    demand = virtual_structure.fly(virtual_structure.Params(), member((13.0, 0.0, 0.0))).demand
    assert demand is not None
    assert demand.velocity_m_s[0] == pytest.approx(10.0)


@pytest.mark.parametrize("jump_m", [(40.0, 0.0, 0.0), (0.0, 40.0, 0.0), (0.0, 0.0, 10.0)])
def test_a_jump_of_a_place_moves_no_demand_by_a_jump(jump_m: tuple[float, float, float]) -> None:
    """A new shape, a new route and a new leader move a place like this."""
    flies, law = (8.0, 0.0, 0.0), virtual_structure.fly
    params = virtual_structure.Params()
    before = law(params, member(flies))
    forward_m, left_m, up_m = jump_m
    after = law(
        params,
        member(
            flies,
            now_s=0.2,
            position_m=(101.6, 60.0, 30.0),
            along=Along(101.6, 8.0),
            place=(forward_m, -left_m, up_m),
            memory=before.memory,
        ),
    )
    assert after.demand is not None
    assert after.demand.position_m == pytest.approx((101.6, 60.0, 30.0), abs=0.5)


def ridge(along: int, at_m: float) -> ThreatField:
    """Return P_s that falls to both sides of a line across an axis (0: north, 1: east)."""
    away_m = np.abs((np.arange(40) + 0.5) * 10.0 - at_m)
    exposure = np.maximum(1.0 - away_m / 50.0, 0.0)
    return ThreatField(np.tile(exposure, (40, 1)) if along else np.tile(exposure[:, None], (1, 40)), 10.0)


@each_null_space
def test_threats_turn_a_member_aside_but_do_not_stop_it(null_space: bool) -> None:
    params = behavioural.Params(null_space=null_space, threat_weight=5.0)

    def flown(threats: ThreatField | None) -> tuple[float, float]:
        """Return the progress, and the distance to the left of the route, after 12 s."""
        at, velocity, memory = [100.0, 60.0], (8.0, 0.0, 0.0), None
        for k in range(120):
            group = member(velocity, position_m=(*at, 30.0), now_s=0.1 * k, memory=memory, threats=threats)
            result = behavioural.fly(params, group)
            velocity, memory = result.demand.velocity_m_s, result.memory
            at = [here + 0.1 * speed for here, speed in zip(at, velocity, strict=False)]
        return at[0] - 100.0, at[1] - 60.0

    assert flown(None) == pytest.approx((96.0, 0.0), abs=1.0)
    beside, ahead = flown(ridge(0, 70.0)), flown(ridge(1, 140.0))
    assert beside[0] > 75.0
    assert beside[1] < -20.0
    assert ahead[0] > 95.0
    assert ahead[1] == pytest.approx(0.0, abs=0.1)


def test_a_member_of_the_behavioural_approach_moves_away_from_a_near_one() -> None:
    beside = OtherMember((100.0, 48.0, 30.0), (8.0, 0.0, 0.0), place=(0.0, 12.0, 0.0))
    demand = behavioural.fly(behavioural.Params(), member((8.0, 0.0, 0.0), others=(beside,))).demand
    assert demand is not None
    assert demand.velocity_m_s[1] > 0.2


@pytest.mark.parametrize("row", range(3))
@pytest.mark.parametrize("col", range(3))
def test_the_gradient_of_a_plane_of_exposure_is_its_slope(row: int, col: int) -> None:
    exposure = 0.1 * np.arange(5)[None, :] + 0.2 * np.arange(5)[:, None]
    east, north = gradient(ThreatField(exposure, 10.0), 15.0 + 9.0 * col, 16.0 + 9.0 * row)
    assert (east, north) == pytest.approx((0.1, 0.2))
