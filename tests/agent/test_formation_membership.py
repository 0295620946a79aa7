"""Members that cannot follow, or whose link is late: agents with light vehicles."""

from __future__ import annotations

import math

import pytest
from light_group import LateVehicle, LightGroup
from light_swarm import LightAgent

from swarmctl.agent.formation.approaches import APPROACHES
from swarmctl.agent.formation.membership import Formation, GroupRoute
from swarmctl.agent.formation.shape import Shape
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED
from swarmctl.agent.step import step
from swarmctl.agent.traffic.own_flight import planned_flight, position_amsl
from swarmctl.core import events as ev
from swarmctl.core.frames import MAX_POINTS
from swarmctl.core.records import replace
from swarmctl.core.setpoint import SetPoint
from swarmctl.core.vehicle import VehicleState

ENDS_WITHIN_S = 400.0

GROUP = Formation(
    "alpha", (1, 2), APPROACHES["virtual_structure"], None, (Shape(kind="column", spacing_m=20.0),), 10.0
)

each_kind = pytest.mark.parametrize("like_ardupilot", [True, False])


def left(swarm: LightGroup, uav: int) -> list[tuple[float, str]]:
    said = swarm.agents[uav - 1].said
    return [(at_s, text) for at_s, text in said if text.endswith("[leaves-group]")]


@each_kind
def test_a_member_that_does_not_follow_leaves_and_arrives_alone(
    like_ardupilot: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    swarm = LightGroup(like_ardupilot=like_ardupilot).joined()
    agent, began_s = swarm.agents[2], swarm.now
    # The vehicle takes the set-points, but creeps.
    take = agent.vehicle.take_setpoint
    creeping = SetPoint((0.5, 0.0, 0.0))
    monkeypatch.setattr(agent.vehicle, "take_setpoint", lambda _set_point: take(creeping))
    formation = agent.task.formation
    assert formation is not None
    swarm.run_while(lambda: agent.state.phase is Phase.FORMATION, 60.0)
    ((at_s, _),) = left(swarm, 3)
    assert formation.max_error_s < at_s - began_s < formation.max_error_s + 10.0
    monkeypatch.undo()
    assert swarm.run(swarm.now + ENDS_WITHIN_S, lambda _now: None)
    assert [a.state.outcome for a in swarm.agents] == [ARRIVED] * 3


def test_a_member_announces_the_way_that_it_flies_now_not_the_one_to_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    swarm = LightGroup().joined()
    agent = swarm.agents[2]
    take = agent.vehicle.take_setpoint
    monkeypatch.setattr(agent.vehicle, "take_setpoint", lambda _set_point: take(SetPoint((0.5, 0.0, 0.0))))
    swarm.run(swarm.now + 8.0, lambda _now: None)
    here, flight = position_amsl(agent.state), planned_flight(agent.state)
    assert here is not None
    assert flight is not None
    soon = flight.at(flight.times_s[0] + 2.0)
    assert soon is not None
    assert soon == pytest.approx((here[0] + 1.0, here[1], here[2]), abs=0.2)


@each_kind
def test_a_member_joins_around_no_fly_cells(like_ardupilot: bool) -> None:
    wall = [(4, 0), (4, 1), (4, 2), (4, 3)]
    area, starts = {"no_fly": [list(cell) for cell in wall]}, {"start_spacing_m": 100.0}
    swarm = LightGroup(like_ardupilot=like_ardupilot, area=area, simulate=starts)
    agent, entered = swarm.agents[2], set()

    def joins() -> bool:
        entered.add(agent.state.cell)
        return not swarm.is_in_place(agent)

    swarm.run_while(joins, 140.0)
    assert (5, 3) in entered
    assert entered.isdisjoint(wall)


@each_kind
def test_a_member_whose_set_points_are_refused_leaves_at_once(like_ardupilot: bool) -> None:
    swarm = LightGroup(like_ardupilot=like_ardupilot).joined()
    agent = swarm.agents[1]
    agent(ev.OrderFailed(ev.FlightOrder.FORMATION, "no set-points"))
    assert (agent.state.phase, agent.state.order.given) == (Phase.FLYING, ev.FlightOrder.HOLD)
    ((_, text),) = left(swarm, 2)
    assert "no set-points" in text
    assert swarm.run(swarm.now + ENDS_WITHIN_S, lambda _now: None)
    assert agent.state.outcome == ARRIVED


def test_a_member_without_a_position_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    swarm = LightGroup().joined()
    agent, telemetry = swarm.agents[1], swarm.agents[1].vehicle.telemetry

    def blind(boot_s: float) -> VehicleState:
        return replace(telemetry(boot_s), lat_deg=None, lon_deg=None)

    monkeypatch.setattr(agent.vehicle, "telemetry", blind)
    swarm.run_while(lambda: agent.state.phase is Phase.FORMATION, 5.0)
    ((_, text),) = left(swarm, 2)
    assert "position" in text
    assert "leader" not in text


def test_telemetry_half_a_second_old_moves_nobody_off_its_place() -> None:
    swarm = LightGroup().joined()
    agent = swarm.agents[2]
    assert isinstance(agent.vehicle, LateVehicle)
    away_m: list[float] = []
    agent.vehicle.delay_s = 0.5
    swarm.run(swarm.now + 10.0, lambda _now: away_m.append(swarm.from_place_m(3)))
    assert agent.state.phase is Phase.FORMATION
    assert max(away_m) < 2.5, "the vehicle itself, not what its telemetry says"


@each_kind
def test_set_points_are_sent_until_telemetry_is_too_old_for_any_decision(like_ardupilot: bool) -> None:
    swarm = LightGroup(like_ardupilot=like_ardupilot).joined()
    agent = swarm.agents[2]
    assert isinstance(agent.vehicle, LateVehicle)
    for delay_s, is_sent in ((2.5, True), (3.5, False)):
        agent.vehicle.delay_s = delay_s
        swarm.run(swarm.now + 2.0, lambda _now: None)
        assert (agent.vehicle.setpoint_age_s < 1.0) is is_sent


@pytest.mark.parametrize("is_silent", [False, True])
@each_kind
def test_a_column_keeps_apart_from_a_leader_that_stops(like_ardupilot: bool, is_silent: bool) -> None:
    # The silence of the leader is noticed a second later, so a column needs more room for it.
    spacing_m = 30.0 if is_silent else 18.0
    column = {"shape": {"kind": "column", "spacing_m": spacing_m}, "heights": "level"}
    swarm = LightGroup(like_ardupilot=like_ardupilot, approach="virtual_structure", formation=column).joined()
    leader, follower = swarm.agents[:2]
    if is_silent:
        leader.silent.append((swarm.now, swarm.now + 30.0))
        swarm.air.mute[1] = [(swarm.now, swarm.now + 30.0)]
    else:
        leader(ev.OperatorCommand(ev.FlightOrder.HOLD))
    assert least_share(swarm, leader, follower) > 1.0
    assert [text[-12:] for _, text in follower.said].count("[new-leader]") == 1


def test_at_the_end_of_the_route_each_member_plans_anew_and_flies_to_its_goal() -> None:
    swarm = LightGroup(count=3).joined()
    assert swarm.run(swarm.now + ENDS_WITHIN_S, lambda _now: None)
    ends = [text for agent in swarm.agents for _, text in agent.said if text.endswith("[resumes-stored]")]
    assert ends == []
    assert [agent.state.outcome for agent in swarm.agents] == [ARRIVED] * 3


def least_share(swarm: LightGroup, one: LightAgent, other: LightAgent) -> float:
    """Fly for 30 s, and return the least distance of two vehicles as a share of the limits."""
    shares: list[float] = []
    swarm.run(swarm.now + 30.0, lambda _now: shares.append(swarm.share_of_limits(one, other)))
    return min(shares)


@each_kind
def test_the_last_member_gives_way_to_a_leader_that_returns_through_its_hold(like_ardupilot: bool) -> None:
    column = {"shape": {"kind": "column", "spacing_m": 60.0}, "heights": "level"}
    swarm = LightGroup(
        like_ardupilot=like_ardupilot, approach="behavioural", formation=column, count=2
    ).joined()
    leader, follower = swarm.agents
    leader.vehicle.battery_percent = 18.0
    assert least_share(swarm, leader, follower) > 1.0
    assert (leader.state.phase, follower.state.phase) == (Phase.LEAVING, Phase.FLYING)


@each_kind
def test_a_member_that_leaves_gives_way_by_set_points_until_another_member_has_passed(
    like_ardupilot: bool,
) -> None:
    column = {"shape": {"kind": "column", "spacing_m": 20.0}, "heights": "level"}
    swarm = LightGroup(like_ardupilot=like_ardupilot, formation=column).joined()
    passing, slow = swarm.agents[1:]
    slow.vehicle.speed_m_s = 0.5
    swarm.run_while(lambda: slow.state.membership.far is None, 10.0)
    swarm.run(swarm.now + 14.0, lambda _now: None)
    # The other member has been as slow, and comes up from behind.
    passing.vehicle.at[:] = slow.vehicle.at[0] - 8.0, slow.vehicle.at[1] + 8.0, slow.vehicle.at[2]
    swarm.run_while(lambda: slow.state.phase is Phase.FORMATION, 30.0)
    assert math.dist(passing.vehicle.at, slow.vehicle.at) > 11.5
    assert passing.vehicle.at[0] > slow.vehicle.at[0]
    assert passing.state.phase is Phase.FORMATION
    assert not passing.state.membership.told[3].message.joins, "the group does not wait for it"
    told = []
    swarm.run(swarm.now + 2.0, lambda _now: told.append(passing.state.membership.told[3].message.joins))
    assert not any(told), "neither when it has left"


def test_a_leader_that_hears_nobody_any_more_flies_no_faster_than_announced() -> None:
    swarm = LightGroup().joined()
    swarm.run(swarm.now + 2.0, lambda _now: None)
    leader = swarm.agents[0].vehicle
    as_announced_m_s = leader.commanded_m_s
    assert as_announced_m_s is not None
    assert as_announced_m_s < leader.speed_m_s
    swarm.air.mute[1] = [(swarm.now, swarm.now + 20.0)]
    swarm.run(swarm.now + 19.0, lambda _now: None)
    assert leader.commanded_m_s == as_announced_m_s


@pytest.mark.parametrize("approach", ["leader_following", "virtual_structure", "behavioural"])
def test_a_group_that_is_silent_for_some_seconds_stays_together(approach: str) -> None:
    swarm = LightGroup(approach=approach).joined()
    before = [agent.state.phase for agent in swarm.agents]
    swarm.air.mute.update({uav: [(swarm.now, swarm.now + 8.0)] for uav in (1, 2, 3)})
    swarm.run(swarm.now + 12.0, lambda _now: None)
    assert [agent.state.phase for agent in swarm.agents] == before


def test_a_member_that_stood_still_announces_its_flight_at_once() -> None:
    swarm = LightGroup().joined()
    agent = swarm.agents[2]
    sent_s = agent.state.sent.intent_boot_s
    swarm.run_while(lambda: agent.state.sent.intent_boot_s == sent_s, 6.0)
    swarm.run(swarm.now + 2.0, lambda _now: None)
    standing = replace(agent.state.membership, stands_since_boot_s=agent.state.now_boot_s - 10.0)
    agent.state = replace(agent.state, membership=standing)
    swarm.run_while(lambda: agent.state.membership.stands_still, 2.0)
    assert agent.state.sent.intent_boot_s == pytest.approx(agent.state.now_boot_s, abs=0.1)


def test_a_structure_whose_leader_hears_nobody_any_more_moves_no_faster() -> None:
    swarm = LightGroup(approach="virtual_structure").joined()
    leader, slow = swarm.agents[0].vehicle, swarm.agents[2].vehicle
    slow.speed_m_s = 1.0
    swarm.run_while(lambda: math.hypot(*leader.velocity[:2]) > 3.0, 30.0)
    swarm.air.mute[1] = [(swarm.now, swarm.now + 20.0)]
    speeds_m_s = []
    swarm.run(swarm.now + 12.0, lambda _now: speeds_m_s.append(math.hypot(*leader.velocity[:2])))
    assert max(speeds_m_s) < 3.5


def test_a_leader_whose_group_has_ended_flies_at_its_own_speed() -> None:
    swarm = LightGroup().joined()
    leader = swarm.agents[0].vehicle
    for follower in swarm.agents[1:]:
        follower(ev.OperatorCommand(ev.FlightOrder.RETURN))
    swarm.run(swarm.now + 10.0, lambda _now: None)
    assert leader.commanded_m_s == leader.speed_m_s


def test_a_long_route_is_told_by_its_corners() -> None:
    north = [(0.0, 10.0 * k) for k in range(400)]
    east = [(10.0 * k, 3990.0) for k in range(1, 400)]
    route = GroupRoute.of(1, 1, (*north, *east), (), GROUP, 12.0)
    assert route.reference.points_m == ((0.0, 0.0), (0.0, 3990.0), (3990.0, 3990.0))


def test_a_route_with_too_many_corners_ends_earlier() -> None:
    zigzag = tuple((10.0 * k, 10.0 * (k % 2)) for k in range(2 * MAX_POINTS))
    assert GroupRoute.of(1, 1, zigzag, (), GROUP, 12.0).reference.points_m == zigzag[:MAX_POINTS]


def behaviours(swarm: LightGroup) -> list[tuple[float, ...]]:
    return [agent.state.membership.weights for agent in swarm.agents]


def test_new_weights_of_the_leader_count_for_all_members() -> None:
    swarm = LightGroup(approach="behavioural").joined()
    leader, follower = swarm.agents[:2]
    follower(ev.WeightsChanged(1, behaviours={"goal": 0.7}))
    leader(ev.WeightsChanged(2, behaviours={"threat": 2.0, "goal": 0.8}))
    swarm.run(swarm.now + 1.0, lambda _now: None)
    assert behaviours(swarm) == [(0.8, 1.0, 2.0, 1.0)] * 3


@pytest.mark.parametrize(
    ("approach", "weights"), [("leader_following", {"goal": 1.0}), ("behavioural", {"gaol": 1.0})]
)
def test_weights_of_unknown_behaviours_are_refused(approach: str, weights: dict[str, float]) -> None:
    agent = LightGroup(approach=approach).agents[0]
    state, (effect,) = step(agent.state, ev.WeightsChanged(1, w=0.9, behaviours=weights), 0.0)
    assert isinstance(effect, ev.Answer)
    assert effect.answer.outcome == "refused"
    assert state is agent.state
