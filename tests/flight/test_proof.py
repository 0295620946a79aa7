"""The proof before a takeover: record and vehicle agree, or the vehicle is let go without a command."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from agent_stories import GRID, Story, orders

from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED
from swarmctl.core import events as ev
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.flight import proof
from swarmctl.flight.proof import Finding
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.procedures.recognise import Recognised
from swarmctl.report.unfinished_run import RecordedVehicle

UID2 = bytes(range(18))
SAME = Identity(1, 3, 2, "ArduPilot 4.6.2", UID2)
OTHER_UID, OTHER_FIRMWARE = replace(SAME, uid2=bytes(18)), replace(SAME, firmware="PX4 1.15.3")
LAST_S, OUTAGE_S = 1_767_225_600.0, 20.0
GUIDED, AUTO = (1.0, 4.0), (1.0, 3.0)
Moment = Callable[[], Story]
DOWN: dict[str, Any] = {"armed": False, "landed": Landed.ON_GROUND, "mode": "GUIDED", "mode_role": "hold"}
RTL: dict[str, Any] = {"mode": "RTL", "mode_role": "return"}
HOLD: dict[str, Any] = {"mode": "GUIDED", "mode_role": "hold"}


def flying() -> Story:
    story = Story().flying()
    story.over((4, 1), mission_seq=3)
    return story


def swapping() -> Story:
    """Crash in a change of the mission."""
    story = flying()
    story.hear((4, 3, True))
    assert story.swap().plan_id == 2
    return story


def launching() -> Story:
    return Story().launching()


def on_standby() -> Story:
    return Story().standby()


def ordered(order: ev.FlightOrder) -> Moment:
    """Return a moment right after an order, which the vehicle may not have received."""

    def story() -> Story:
        told = flying()
        told(ev.OperatorCommand(order))
        return told

    return story


def holding() -> Story:
    story = ordered(ev.FlightOrder.HOLD)()
    story(ev.OrderDone(ev.FlightOrder.HOLD))
    story.over((4, 1), **HOLD)
    return story


def arrived() -> Story:
    story = flying()
    story.over((4, 8))
    for _ in range(3):
        story.over((4, 8), **DOWN)
    assert story.state.outcome == ARRIVED
    return story


def finding(story: Story, stored: Recognised, identity: Identity = SAME, **changes: Any) -> Finding:
    """Return a vehicle that flew on for OUTAGE_S, changed by `changes`; `cell` moves it."""
    lat_deg, lon_deg = GRID.centre(changes.pop("cell", (4, 2)))
    before = story.state.vehicle
    state = VehicleState(
        time_boot_s=before.time_boot_s + OUTAGE_S,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        alt_rel_m=30.0,
        alt_amsl_m=330.0,
        mode="AUTO",
        mode_role="mission",
        armed=True,
        landed=Landed.IN_AIR,
        mission_seq=4,
        heartbeat_s=story.now,
        home_lat_deg=GRID.centre((4, 0))[0],
        home_lon_deg=GRID.centre((4, 0))[1],
        home_alt_amsl_m=300.0,
    )
    return Finding(identity, replace(state, **changes), LAST_S + OUTAGE_S, stored)


def taken_over(
    story: Story, found: Finding, *, commanded: tuple[float, ...] = AUTO, speedup: float = 1.0
) -> list[ev.Event]:
    """Fold the events of the takeover into the story's agent, and return them."""
    recorded = RecordedVehicle(
        story.state,
        firmware=SAME.firmware,
        uid2=UID2.hex(),
        last_unix_s=LAST_S,
        mode_params=(*commanded, 0.0),
    )
    events = proof.take_over(recorded, found, speedup)
    effects: list[ev.Effect] = []
    for event in events:
        effects += story(event)
    story.effects = effects
    return events


FIRST, SECOND, NONE = Recognised(plan_id=1), Recognised(plan_id=2), Recognised(difference="item 4 is new")
IN_HOLD = Recognised(difference="", hold_params=GUIDED)


@pytest.mark.parametrize(
    ("moment", "stored", "changes", "commanded", "phase", "plan"),
    [
        (flying, FIRST, {}, AUTO, Phase.FLYING, 1),
        (swapping, SECOND, {}, AUTO, Phase.FLYING, 2),
        (swapping, FIRST, {}, AUTO, Phase.FLYING, 1),
        (swapping, IN_HOLD, HOLD, GUIDED, Phase.FLYING, None),
        (launching, FIRST, {"cell": (4, 0)}, AUTO, Phase.FLYING, 1),
        (holding, IN_HOLD, HOLD, GUIDED, Phase.HOLDING, 1),
        (ordered(ev.FlightOrder.HOLD), IN_HOLD, HOLD, GUIDED, Phase.HOLDING, 1),
        (ordered(ev.FlightOrder.HOLD), FIRST, {}, AUTO, Phase.HOLDING, 1),
        (ordered(ev.FlightOrder.RETURN), NONE, RTL, (1.0, 6.0), Phase.LEAVING, 1),
    ],
)  # fmt: skip
def test_a_vehicle_that_does_as_recorded_is_taken_over(
    moment: Moment,
    stored: Recognised,
    changes: dict[str, Any],
    commanded: tuple[float, ...],
    phase: Phase,
    plan: int | None,
) -> None:
    story = moment()
    taken_over(story, finding(story, stored, **changes), commanded=commanded)
    assert story.state.phase is phase
    assert (story.state.plans.mission and story.state.plans.mission.plan_id) == plan
    assert story.state.plans.pending is None
    assert not story.state.lost


def test_a_launch_that_was_interrupted_on_the_ground_is_aborted() -> None:
    story = launching()
    taken_over(story, finding(story, IN_HOLD, **{**DOWN, "armed": True}), commanded=GUIDED)
    assert orders(story.effects) == [ev.FlightOrder.LAND]
    assert story.state.launch.is_aborted


def test_a_vehicle_in_its_landing_is_past_its_route() -> None:
    story = flying()
    taken_over(story, finding(story, replace(FIRST, lands=True)))
    assert story.state.phase is Phase.LANDING


def test_an_order_that_the_vehicle_has_not_received_is_sent_again() -> None:
    story = ordered(ev.FlightOrder.HOLD)()
    taken_over(story, finding(story, FIRST))
    assert orders(story.effects) == [ev.FlightOrder.HOLD]


@pytest.mark.parametrize(
    ("moment", "stored", "changes", "commanded"),
    [
        pytest.param(flying, NONE, {}, AUTO, id="another mission"),
        pytest.param(flying, FIRST, RTL, AUTO, id="another mode"),
        pytest.param(flying, IN_HOLD, HOLD, AUTO, id="a hold of another station"),
        pytest.param(swapping, IN_HOLD, HOLD, AUTO, id="another station's hold amid a mission change"),
        pytest.param(flying, FIRST, {"cell": (7, 2)}, AUTO, id="off its route"),
        pytest.param(flying, FIRST, {"mission_seq": 2}, AUTO, id="back on its route"),
        pytest.param(flying, FIRST, {"time_boot_s": 12.0}, AUTO, id="rebooted"),
        pytest.param(flying, FIRST, {"time_boot_s": 19.0, "mission_seq": 9}, AUTO, id="rebooted long ago"),
        pytest.param(flying, FIRST, {"identity": OTHER_UID}, AUTO, id="another autopilot"),
        pytest.param(flying, FIRST, {"identity": OTHER_FIRMWARE}, AUTO, id="other firmware"),
        pytest.param(holding, FIRST, {}, GUIDED, id="its hold ended"),
        pytest.param(on_standby, FIRST, {}, AUTO, id="armed from the ground"),
        pytest.param(launching, FIRST, {**DOWN, "armed": True}, GUIDED, id="armed, not taken off"),
    ],
)  # fmt: skip
def test_a_vehicle_that_another_party_touched_is_let_go_without_a_command(
    moment: Moment, stored: Recognised, changes: dict[str, Any], commanded: tuple[float, ...]
) -> None:
    story = moment()
    events = taken_over(story, finding(story, stored, **changes), commanded=commanded)
    assert story.state.phase is Phase.RELEASED
    assert any(isinstance(event, ev.Restarted) and event.reason for event in events)
    assert not any(isinstance(e, ev.Command | ev.SwapMission | ev.SetSpeed) for e in story.effects)


def test_the_clock_of_a_fast_simulator_has_run_on() -> None:
    story = flying()
    found = finding(story, FIRST, time_boot_s=story.state.vehicle.time_boot_s + 10.0 * OUTAGE_S)
    taken_over(story, found, speedup=10.0)
    assert story.state.phase is Phase.FLYING


@pytest.mark.parametrize("moment", [on_standby, launching])
def test_a_vehicle_on_the_ground_is_prepared_again(moment: Moment) -> None:
    story = moment()
    taken_over(story, finding(story, NONE, **DOWN, cell=(4, 0)))
    assert story.state.phase is Phase.WAITING
    assert story.state.plans.mission is None
    story(ev.Ready())
    assert story.swap().plan_id > 1


def test_a_vehicle_that_landed_at_its_goal_meanwhile_has_arrived() -> None:
    story = flying()
    taken_over(story, finding(story, NONE, **DOWN, cell=(4, 8)))
    story.over((4, 8), **DOWN)
    assert story.state.outcome == ARRIVED


def test_a_vehicle_that_landed_elsewhere_meanwhile_has_failed() -> None:
    story = flying()
    taken_over(story, finding(story, NONE, **DOWN, cell=(4, 4)))
    story.over((4, 4), **DOWN)
    assert story.state.phase is Phase.FAILED


def test_an_ended_flight_stays_ended() -> None:
    story = arrived()
    taken_over(story, finding(story, NONE, **DOWN, cell=(4, 8)))
    assert (story.state.phase, story.state.outcome) == (Phase.DONE, ARRIVED)


def test_own_observations_are_numbered_from_one_under_the_new_incarnation() -> None:
    story = flying()
    story(ev.Observed(((4, 2, False),)))
    assert story.state.next_seq == 2
    story(ev.Joined(7))
    (published,) = story(ev.Observed(((5, 2, False),)))
    assert isinstance(published, ev.Publish)
    assert (published.message.incarnation, published.message.seq) == (7, 1)
