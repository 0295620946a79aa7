"""Another ground station puts another mission on a vehicle that flies ours, or is to."""

from __future__ import annotations

import pytest
from flying_bench import FlyingBench, on_the_ground, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.codec import Decoder, FrameSplitter
from swarmctl.mavlink.conversation import Peer
from swarmctl.mavlink.events import StateChanged
from swarmctl.mavlink.mission_upload import Upload, UploadOutcome
from swarmctl.mavlink.mission_watch import LASTS_S, SETTLES_S, MissionWatch

AUTOPILOTS = pytest.mark.parametrize("personality", ["ardupilot", "px4"])


def another_uploads(bench: FlyingBench, north: int) -> None:
    """By the protocol, as QGroundControl does, from another address."""
    items = bench.session.mission_items(plan(north=north, east=-0.002))
    upload = Upload(Peer(1, own_sysid=200, own_compid=190), items)
    station = mavlink.MAVLink(None, srcSystem=200, srcComponent=190)
    decoder, queue = Decoder(), upload.start(bench.now)
    for _ in range(400):
        frames = [
            frame
            for message in queue
            for _, frame in bench.fleet.receive(message.pack(station), bench.now, peer="other")
        ]
        queue = []
        for frame in frames:
            for part in FrameSplitter().feed(frame):
                message = decoder.decode(part)
                if message is not None and upload.result is None:
                    queue += upload.receive(message, bench.now)
        if upload.result is not None:
            break
        if not queue:
            bench.run(FlyingBench.STEP_S)
            queue = upload.tick(bench.now)
    assert upload.result is not None
    assert upload.result.outcome is UploadOutcome.ACCEPTED


def states(bench: FlyingBench) -> list[VehicleState]:
    return [event.state for event in bench.events if isinstance(event, StateChanged)]


@AUTOPILOTS
def test_another_mission_on_a_flying_vehicle_is_noticed_and_ours_forgotten(personality: str) -> None:
    bench = FlyingBench(personality).flying(plan(north=8))
    bench.run(5.0)
    assert bench.session.items
    assert not any(state.other_mission for state in states(bench))
    another_uploads(bench, north=20)
    bench.run(5.0)
    assert bench.session.items == ()
    assert states(bench)[-1].other_mission


@AUTOPILOTS
def test_our_own_swaps_are_nobody_elses(personality: str) -> None:
    bench = FlyingBench(personality).flying(plan(north=8))
    for north in (12, 5, 9):
        assert bench.swap(plan(north=north, east=0.001)).failure is None
        bench.run(6.0)
        assert bench.holds(bench.session.items)
    assert not any(state.other_mission for state in states(bench))


@AUTOPILOTS
def test_a_mission_that_is_cleared_is_another_too_until_ours_is_put_there_again(personality: str) -> None:
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


@pytest.mark.parametrize("total", [0, 7])
def test_as_many_as_expected_or_an_old_firmware_tell_of_no_other_mission(total: int) -> None:
    watch = MissionWatch()
    told = mavlink.MAVLink_mission_current_message(1, total)
    assert not any(watch.is_another(told, 7, float(second)) for second in range(60))


def test_one_message_or_an_old_one_after_our_own_transfer_is_not_believed() -> None:
    watch = MissionWatch()
    other = mavlink.MAVLink_mission_current_message(1, 9)
    ours = mavlink.MAVLink_mission_current_message(1, 7)
    assert not watch.is_another(other, 7, 10.0)
    assert not watch.is_another(ours, 7, 10.5)
    assert not watch.is_another(other, 7, 11.0)
    watch.own_procedure_ended(11.2)
    assert not watch.is_another(other, 7, 11.2 + SETTLES_S - 0.1)
    assert not watch.is_another(other, 7, 14.0)
    assert watch.is_another(other, 7, 14.0 + LASTS_S)
