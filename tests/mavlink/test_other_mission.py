"""Missions from another ground station on a vehicle with our mission."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from flying_bench import BOTH, Faults, FlyingBench, on_the_ground, plan
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.station.exchanges import UploadPlan
from sim_vehicle.station.frames import Receiver
from sim_vehicle.station.messages import PlanItem
from swarmctl.core.events import TelemetryReceived
from swarmctl.core.mission import MissionItem
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.protocol.codec import GCS_COMPID, GCS_SYSID
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.mission_transfer import item_message
from swarmctl.mavlink.telemetry.mission_watch import OTHER_MISSION_LASTS_S, SETTLING_S, MissionWatch


def another_uploads(bench: FlyingBench, north: int) -> None:
    """Upload by the protocol from another address, as QGroundControl does."""
    items = [
        PlanItem(i.command, i.x, i.y, i.z, i.frame, (i.param1, i.param2, i.param3, i.param4))
        for i in bench.session.mission_items(plan(north=north, east=-0.002))
    ]
    station, receiver, queue = mavlink.MAVLink(None, 200, 190), Receiver(), list[Any]()
    upload = UploadPlan(queue.append, (1, 1), items, sysid=200)
    upload.begin(bench.now)
    for _ in range(400):
        while queue:
            for _, frame in bench.fleet.receive(queue.pop(0).pack(station), bench.now, peer="other"):
                for message in receiver.messages(frame):
                    upload.receive(message, bench.now)
        if upload.outcome is not None:
            break
        bench.run(FlyingBench.STEP_S)
        upload.tick(bench.now)
    assert upload.outcome is not None
    assert upload.outcome.accepted


def states(bench: FlyingBench) -> list[VehicleState]:
    return [event.state for event in bench.events if isinstance(event, TelemetryReceived)]


@BOTH
def test_another_mission_on_a_flying_vehicle_is_noticed_and_the_own_mission_is_dropped(
    personality: str,
) -> None:
    bench = FlyingBench(personality).flying(plan(north=8))
    bench.run(5.0)
    assert bench.session.items
    assert not any(state.other_mission for state in states(bench))
    another_uploads(bench, north=20)
    bench.run(5.0)
    assert bench.session.items == ()
    assert states(bench)[-1].other_mission


@BOTH
def test_own_swaps_do_not_count_as_another_mission(personality: str) -> None:
    bench = FlyingBench(personality).flying(plan(north=8))
    for north in (12, 5, 9):
        assert bench.swap(plan(north=north, east=0.001)).failure is None
        bench.run(6.0)
        assert bench.holds(bench.session.items)
    assert not any(state.other_mission for state in states(bench))


@BOTH
def test_a_cleared_mission_counts_as_another_until_the_own_mission_is_uploaded_again(
    personality: str,
) -> None:
    bench = on_the_ground(personality)
    assert bench.upload(plan(north=4)).failure is None
    bench.run(5.0)
    assert bench.session.items
    another_uploads(bench, north=2)
    bench.run(5.0)
    assert bench.session.state.other_mission
    assert bench.session.items == ()
    assert bench.upload(plan(north=4)).failure is None
    bench.run(5.0)
    assert not bench.session.state.other_mission
    assert bench.holds(bench.session.items)


def over_the_wire(message: Any, payload: bytes) -> Any:
    """Return the message with a whole payload; pymavlink leaves out the mission's id."""
    station = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return mavlink.MAVLink(None).decode(bytearray(message._pack(station, message.crc_extra, payload)))


def current(total: int, mission_id: int = 0) -> mavlink.MAVLink_mission_current_message:
    message = mavlink.MAVLink_mission_current_message(1, total)
    return over_the_wire(message, struct.pack("<HHBBI", 1, total, 0, 0, mission_id))


SEVEN = tuple(MissionItem(16, 3, 460_000_000 + i, 145_000_000, 20.0) for i in range(7))


def watching(autopilot: int = mavlink.MAV_AUTOPILOT_PX4) -> MissionWatch:
    watch = MissionWatch(MavlinkPeer(1), dialect_for(autopilot, mavlink.MAV_TYPE_QUADROTOR))
    watch.own_procedure_ended(SEVEN, 0.0)
    return watch


@pytest.mark.parametrize("total", [0, 7])
def test_an_equal_count_or_an_old_firmware_shows_no_other_mission(total: int) -> None:
    watch = watching()
    assert not any(watch.shows_other_mission(current(total), float(second)) for second in range(60))


def test_a_single_or_old_message_after_an_own_transfer_shows_no_other_mission() -> None:
    watch = watching()
    assert not watch.shows_other_mission(current(9), 10.0)
    assert not watch.shows_other_mission(current(7), 10.5)
    assert not watch.shows_other_mission(current(9), 11.0)
    watch.own_procedure_ended(SEVEN, 11.2)
    assert not watch.shows_other_mission(current(9), 11.2 + SETTLING_S - 0.1)
    assert not watch.shows_other_mission(current(9), 14.0)
    assert watch.shows_other_mission(current(9), 14.0 + OTHER_MISSION_LASTS_S)


def test_another_id_is_another_mission_only_with_a_second_message() -> None:
    watch = watching()
    for at_s, mission_id, shows_other_mission in ((3.0, 5, False), (60.0, 5, False), (61.0, 6, False)):
        assert watch.shows_other_mission(current(7, mission_id), at_s) is shows_other_mission
    assert not watch.shows_other_mission(current(7, 5), 61.5)
    assert not watch.shows_other_mission(current(7, 6), 62.0)
    assert watch.shows_other_mission(current(7, 6), 62.0 + OTHER_MISSION_LASTS_S)


def test_an_own_command_that_keeps_the_mission_keeps_its_id() -> None:
    """Another station may change the mission meanwhile."""
    watch = watching()
    assert not watch.shows_other_mission(current(7, 5), 3.0)
    watch.own_procedure_ended(SEVEN, 10.0)
    assert not watch.shows_other_mission(current(7, 6), 13.0)
    assert watch.shows_other_mission(current(7, 6), 13.0 + OTHER_MISSION_LASTS_S)
    watch.own_procedure_ended(SEVEN[:6], 20.0)
    assert not watch.shows_other_mission(current(6, 9), 23.0)
    assert not watch.shows_other_mission(current(6, 9), 23.0 + OTHER_MISSION_LASTS_S)


def accepted(mission_id: int) -> mavlink.MAVLink_mission_ack_message:
    message = mavlink.MAVLink_mission_ack_message(GCS_SYSID, GCS_COMPID, 0, 0)
    return over_the_wire(message, struct.pack("<BBBBI", GCS_SYSID, GCS_COMPID, 0, 0, mission_id))


@pytest.mark.parametrize("mission_ids", [(6, 8), (6,)])
def test_the_own_mission_uploaded_again_may_have_another_id(mission_ids: tuple[int, ...]) -> None:
    """A failed swap restores the mission. Its read-back differs slightly, and an answer may be lost."""
    watch = watching()
    assert not watch.shows_other_mission(current(7, 5), 3.0)
    for mission_id in mission_ids:
        watch.receive_own_transfer(accepted(mission_id))
    watch.own_procedure_ended(SEVEN, 10.0)
    assert not any(watch.shows_other_mission(current(7, 8), 13.0 + second) for second in range(9))
    assert not watch.shows_other_mission(current(7, 9), 23.0)
    assert watch.shows_other_mission(current(7, 9), 23.0 + OTHER_MISSION_LASTS_S)


def test_home_alone_is_not_requested() -> None:
    watch = watching(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    watch.own_procedure_ended(SEVEN[:1], 10.0)
    assert watch.next_deadline is None
    assert watch.tick(0, 60.0) == []


@BOTH
@pytest.mark.parametrize("within_s", [0.0, 3.0])
def test_another_mission_with_an_equal_count_is_noticed(personality: str, within_s: float) -> None:
    """The other upload may follow directly after the own one."""
    bench = FlyingBench(personality).flying(plan(north=12))
    assert bench.swap(plan(north=12, east=0.001)).failure is None
    bench.run(within_s)
    ours = bench.session.items
    another_uploads(bench, north=len(ours) - (3 if personality == "ardupilot" else 2))
    assert len(bench.stored) == len(ours)
    assert bench.run(15.0, lambda: bench.session.state.other_mission)
    assert bench.session.items == ()


@pytest.mark.parametrize("loss", [0.3, *full_only(0.0)])
def test_without_an_id_one_item_is_requested_every_few_seconds(loss: float) -> None:
    bench = FlyingBench("ardupilot").flying(plan(north=20))
    bench.spoil(Faults(loss=loss, max_delay_s=0.8, seed=3))
    before = len(bench.of("MISSION_REQUEST_INT"))
    bench.run(60.0)
    asked = [m.seq for m in bench.of("MISSION_REQUEST_INT")[before:]]
    assert 10 <= len(asked) <= 13
    assert 0 not in asked
    flown = {state.mission_seq for state in states(bench)}
    assert sum(seq in flown for seq in asked) >= 5
    assert max(asked) > 8
    assert not any(state.other_mission for state in states(bench))


def test_a_vehicle_with_mission_ids_gets_no_requests() -> None:
    bench = FlyingBench("px4").flying(plan(north=8))
    before = len(bench.of("MISSION_REQUEST_INT")), len(bench.of("MISSION_REQUEST_LIST"))
    bench.run(60.0)
    assert (len(bench.of("MISSION_REQUEST_INT")), len(bench.of("MISSION_REQUEST_LIST"))) == before


def test_a_changed_item_is_found_by_the_periodic_requests() -> None:
    """The change comes by a partial list, keeps the count and lies far ahead of the vehicle."""
    bench = FlyingBench("ardupilot").flying(plan(north=8))
    bench.run(3.0)
    seq = len(bench.session.items) - 2
    item = replace(bench.session.items[seq], x=bench.session.items[seq].x + 9000)
    bench.another_sends(mavlink.MAVLink_mission_write_partial_list_message(1, 1, seq, seq))
    bench.another_sends(item_message(MavlinkPeer(1), seq, item))
    assert bench.stored[seq].x == item.x
    assert bench.run(10.0 * len(bench.stored) + 5.0, lambda: bench.session.state.other_mission)
