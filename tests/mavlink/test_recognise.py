"""A session that is started anew finds out which of its plans the vehicle flies, and changes nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import pytest
from flying_bench import BOTH, FlyingBench, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.mavlink.procedures.recognise import Recognised, recognise
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.mission_transfer import item_message
from swarmctl.mavlink.session import Session

FIRST, SECOND, OTHER = plan(), plan(east=0.001), plan(east=0.002)
PLANS = {1: FIRST, 2: SECOND}
READS = {"COMMAND_LONG", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK"}
Meanwhile = Callable[[FlyingBench], None]


def restarted(bench: FlyingBench) -> FlyingBench:
    """Return the bench after a crash of the ground station."""
    bench.session = Session(MavlinkPeer(1))
    bench.sent.clear()
    bench.run(3.0)
    return bench.connected()


def recognised(bench: FlyingBench, plans: dict[int, FlightPlan], *candidates: int) -> Recognised:
    return bench.do("recognise", partial(recognise, plans=plans, candidates=candidates))


def moves(bench: FlyingBench) -> Iterator[str]:
    """Yield the session's messages that could change something on the vehicle."""
    harmless = {mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL}
    for _, message in bench.sent:
        if message.get_type() not in READS or getattr(message, "command", None) not in {None, *harmless}:
            yield str(message)


def begin_swap(bench: FlyingBench) -> None:
    """Crash in the upload of the second plan."""
    sent = len(bench.of("MISSION_ITEM_INT"))
    bench.block = lambda _message: len(bench.of("MISSION_ITEM_INT")) >= sent + 4
    bench.begin_swap(SECOND)
    assert bench.run(5.0, lambda: len(bench.of("MISSION_ITEM_INT")) >= sent + 4)


def swap(bench: FlyingBench) -> None:
    assert bench.swap(SECOND).failure is None


def append_only(bench: FlyingBench) -> None:
    """Crash when the second plan is stored, but not current."""
    bench.block = lambda message: getattr(message, "command", 0) == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
    bench.begin_swap(SECOND)
    assert bench.run(20.0, lambda: mavlink.MAV_CMD_DO_SET_MISSION_CURRENT in bench.commands)


@pytest.mark.parametrize(
    ("personality", "before", "plan_id"),
    [
        ("ardupilot", begin_swap, 1),
        ("ardupilot", append_only, 1),
        ("ardupilot", swap, 2),
        ("px4", begin_swap, 1),
        ("px4", swap, 2),
    ],
)
def test_the_flown_plan_is_recognised_and_can_be_changed_again(
    personality: str, before: Meanwhile, plan_id: int
) -> None:
    bench = FlyingBench(personality).flying(FIRST)
    before(bench)
    bench.block = lambda _message: False
    found = recognised(restarted(bench), PLANS, 2, 1)
    assert (found.failure, found.plan_id, found.difference) == (None, plan_id, "")
    assert list(moves(bench)) == []
    if personality == "ardupilot":
        assert bench.holds(bench.session.items)
    done = bench.swap(OTHER)
    assert (done.failure, done.flying) == (None, "new")
    assert bench.mode == bench.session.dialect.mission_mode


def another_mission(bench: FlyingBench) -> None:
    other = FlyingBench("ardupilot")
    other.fleet, other.vehicle, other.now = bench.fleet, bench.vehicle, bench.now
    other.connected()
    assert other.swap(OTHER).failure is None
    bench.now = other.now


def strange_item_behind(bench: FlyingBench) -> None:
    """Another station appends one item of its own."""
    count = bench.vehicle.mission.count
    bench.another_sends(mavlink.MAVLink_mission_write_partial_list_message(1, 1, count, count))
    item = MissionItem(mavlink.MAV_CMD_NAV_WAYPOINT, 3, 460_500_000, 145_000_000, 30.0)
    bench.another_sends(item_message(MavlinkPeer(1), count, item))
    assert bench.vehicle.mission.count == count + 1


@pytest.mark.parametrize("meanwhile", [another_mission, strange_item_behind])
def test_a_mission_that_another_station_changed_is_not_recognised(meanwhile: Meanwhile) -> None:
    bench = FlyingBench("ardupilot").flying(FIRST)
    meanwhile(bench)
    found = recognised(restarted(bench), PLANS, 2, 1)
    assert (found.failure, found.plan_id) == (None, None)
    assert found.difference
    assert bench.session.items == ()
    assert list(moves(bench)) == []


@BOTH
def test_a_plan_that_is_no_candidate_is_not_recognised(personality: str) -> None:
    bench = FlyingBench(personality).flying(FIRST)
    assert recognised(restarted(bench), PLANS, 2).plan_id is None


@BOTH
def test_a_silent_vehicle_is_a_failure(personality: str) -> None:
    bench = restarted(FlyingBench(personality).flying(FIRST))
    bench.silent = True
    assert recognised(bench, PLANS, 1).failure
