"""Behaviour of every link, over the front end and a memory wire.

`direct` runs on a virtual clock. `mavsdk` needs the machine's clock, so its copters run ten times as fast.
"""

from __future__ import annotations

import asyncio

import pytest
from flying_bench import north_of_home
from link_world import World, connected, flying, play, until, uploaded
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_answers import identify_as, refuse

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.vehicle.mission import Item
from swarmctl.core.events import FlightOrder, LinkLost, LinkRestored
from swarmctl.core.setpoint import SetPoint
from swarmctl.links import LINKS
from swarmctl.links.base import (
    AddressChanged,
    Busy,
    CommandFailed,
    LaunchFailed,
    LinkError,
    NoAnswer,
    NotReady,
    UnsupportedVehicle,
    UploadFailed,
)
from swarmctl.mavlink.events import FirstHeartbeat, ProcedureDone
from swarmctl.mavlink.procedures.rally import RallyPoints, count_rally_points
from swarmctl.mavlink.protocol.outcome import Done, LaunchBlocked

REAL = {"mavsdk"}
ARM, START, SET_CURRENT, SET_MODE, FENCE = (
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_MISSION_START,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_DO_FENCE_ENABLE,
)
AUTOPILOT_VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
EAST = SetPoint((4.0, 0.0, 0.0))


EVERY_LINK = pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=pytest.mark.interop if k in REAL else ()) for k in LINKS]
)
"""Each link, also in the short run."""


@pytest.fixture(
    params=[
        pytest.param(k, marks=(pytest.mark.interop, pytest.mark.full) if k in REAL else ()) for k in LINKS
    ]
)
def kind(request) -> str:
    """Return the name of a link."""
    return request.param


@EVERY_LINK
def test_a_whole_flight_with_a_swap(kind):
    async def story():
        async with World(kind=kind) as world:
            link = world.link()
            identity = await link.connect(10)
            assert (identity.sysid, identity.firmware, identity.simulated) == (1, "ArduPilot 4.6.2", True)
            reasons = []
            await link.prepare(30, reasons.append)
            assert any("STABILIZE" in reason for texts in reasons for reason in texts)
            assert link.state().ready
            await link.upload(north_of_home(8))
            ground_m = link.state().alt_rel_m
            await link.launch()
            assert link.state().alt_rel_m > ground_m + 0.5
            await until(lambda: link.state().mission_seq == 3)
            await link.swap(north_of_home(6, east=0.002))
            assert [i.command for i in link.items()] == [16, 22, *[16] * 8, 21, *[16] * 6, 21]
            assert link.items()[11].y == round(14.508 * 1e7), "the new route is not appended to the old one"
            await until(lambda: not world.vehicles[1].armed, 200)
            assert 0.0 <= link.age_s() <= 1.1
            done = [e.name for e in world.events if isinstance(e, ProcedureDone)]
            assert done == ["identify", "prepare for arming", "upload", "launch", "swap"]
            assert isinstance(world.events[0], FirstHeartbeat)

    play(story(), real=kind != "direct")


def test_a_newly_connected_vehicle_gets_an_identity_request_only(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await connected(world)
            await asyncio.sleep(max(20 / world.pace, 2.0))
            assert {m.param1 for m in world.sent("COMMAND_LONG")} == {AUTOPILOT_VERSION}
            assert {data[7:10] for data, _ in world.to_vehicles} == {b"\0\0\0", b"\x4c\0\0"}, (
                "nothing but heartbeats"
            )
            await link.prepare(30, lambda _: None)
            streams = world.sent("COMMAND_LONG", mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
            assert {m.param1 for m in streams if m.param2 > 0} == {33, 1, 193, 245, 42, 242}

    play(story(), real=kind != "direct")


def test_identify_detects_another_vehicle(kind):
    async def story():
        async with World(kind=kind) as world:
            link = world.link()
            with pytest.raises(NoAnswer, match=r"\[no-heartbeat\]"):
                await link.identify(1)
            assert (await link.connect(10)).simulated
            identify_as(world.vehicles[1], uid2=b"an aircraft")
            again = await link.identify(5)
            assert not again.simulated
            world.silent = True
            with pytest.raises(NoAnswer, match=r"AUTOPILOT_VERSION.* 2 s"):
                await link.identify(2)

    play(story(), real=kind != "direct")


def test_an_order_interrupts_identify(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await connected(world)
            world.wire.connect_vehicles(lambda data, address: None)
            identifying = asyncio.create_task(link.identify(30))
            await asyncio.sleep(1)
            world.wire.connect_vehicles(world.to_fleet)
            await link.order(FlightOrder.HOLD)
            with pytest.raises(LinkError, match=r"by hold \[interrupted\]"):
                await identifying

    play(story(), real=kind != "direct")


def test_no_answer_names_vehicle_endpoint_time_and_other_systems(kind):
    async def story():
        async with World("ardupilot", "ardupilot", first=3, kind=kind) as world:
            with pytest.raises(NoAnswer) as caught:
                await world.link(1).connect(3)
            for part in ("alpha", "system 1", "memory:test", " 3 s", " 3, 4"):
                assert part in str(caught.value)

    play(story(), real=kind != "direct")


def test_an_unsupported_vehicle_is_refused_by_name(kind):
    async def story():
        async with World(kind=kind) as world:
            world.fleet.status.autopilot[0] = 17
            with pytest.raises(UnsupportedVehicle, match="alpha "):
                await world.link().connect(3)

    play(story(), real=kind != "direct")


def test_a_vehicle_that_is_not_ready_is_reported_with_its_last_reasons(kind):
    async def story():
        async with World(ready_s=1e9, kind=kind) as world:
            link = await connected(world)
            reported: list[tuple[str, ...]] = []
            with pytest.raises(NotReady) as caught:
                await link.prepare(20 / world.pace, reported.append)
            assert any(reason.endswith("[no-position]") for reason in caught.value.reasons)
            assert reported.count(reported[-1]) > 1 or kind != "direct"  # others wait one second only
            assert "alpha" in str(caught.value)

    play(story(), real=kind != "direct")


@pytest.mark.parametrize(
    ("spoil", "error", "part"),
    [
        (
            lambda world: world.fleet.inject(
                parse_fault("mission_refused:result=invalid,at_item=2"), world.now_s()
            ),
            UploadFailed,
            "INVALID",
        ),
        (lambda world: refuse(world.vehicles[1], ARM, text="Arm: Battery low"), LaunchFailed, "Battery low"),
    ],
)
def test_failures_name_the_vehicle_the_url_and_its_reason(kind, spoil, error, part):
    async def story():
        async with World(kind=kind) as world:
            link = await connected(world)
            await link.prepare(30, lambda _: None)
            spoil(world)

            async def upload_and_launch() -> None:
                await link.upload(north_of_home(3))
                await link.launch()

            with pytest.raises(error, match=rf"alpha \(system 1 at memory:test\).*{part}"):
                await upload_and_launch()

    play(story(), real=kind != "direct")


def test_a_blocked_launch_does_not_arm(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await uploaded(world, 3)
            assert await link.launch(lambda: "vehicle 7") == LaunchBlocked("vehicle 7")
            assert not {m.command for m in world.sent("COMMAND_LONG")} & {START, ARM}
            await link.launch()
            assert world.vehicles[1].armed

    play(story(), real=kind != "direct")


@EVERY_LINK
def test_a_failed_swap_reports_the_mission_that_is_flown(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await flying(world)
            refuse(world.vehicles[1], SET_CURRENT, mavlink.MAV_RESULT_DENIED)
            done = await link.swap(north_of_home(4, east=0.001))
            assert "DO_SET_MISSION_CURRENT" in done.failure
            assert done.flying == "hold"
            await link.order(FlightOrder.RETURN)
            assert link.state().mode == "RTL"
            done = await link.swap(north_of_home(4, east=0.001))
            assert "RTL" in done.failure
            assert done.flying == "theirs"

    play(story(), real=kind != "direct")


def test_hold_interrupts_a_swap_and_other_calls_are_refused_as_busy(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await flying(world)
            world.silent = True
            swap = asyncio.create_task(link.swap(north_of_home(6, east=0.002)))
            await asyncio.sleep(0.1)
            with pytest.raises(Busy, match=r"upload .*swap"):
                await link.upload(north_of_home(2))
            world.silent = False
            await link.order(FlightOrder.HOLD)
            assert link.state().mode == "GUIDED"
            assert (await swap).failure.endswith("by hold [interrupted]")
            await link.order(FlightOrder.LAND)
            assert link.state().mode == "LAND"

    play(story(), real=kind != "direct")


def test_a_cancelled_upload_is_cancelled_on_the_vehicle(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await connected(world)
            world.loses = lambda frame: frame[7:10] in (b"\x28\0\0", b"\x33\0\0")  # requests for items
            upload = asyncio.create_task(link.upload(north_of_home(3)))
            await until(lambda: world.sent("MISSION_COUNT"))
            upload.cancel()
            with pytest.raises(asyncio.CancelledError):
                await upload
            await asyncio.sleep(0.1)
            assert [m.type for m in world.sent("MISSION_ACK")] == [mavlink.MAV_MISSION_OPERATION_CANCELLED]
            assert ProcedureDone("upload", Done("cancelled")) in world.events
            world.loses = lambda frame: False
            await link.upload(north_of_home(3))

    play(story(), real=kind != "direct")


def test_a_procedure_on_the_ground_returns_its_result(kind):
    async def story():
        async with World(kind=kind) as world:
            points = [Item(mavlink.MAV_CMD_NAV_RALLY_POINT, x=460_490_000 + n, y=145_060_000) for n in (0, 1)]
            world.vehicles[1].home_and_rally.rally.replace(points)
            link = world.link()
            with pytest.raises(LinkError, match=r"\[not-connected\]"):
                await link.ask("rally points", count_rally_points)
            await link.connect(10)
            assert await link.ask("rally points", count_rally_points) == RallyPoints(2)

    play(story(), real=kind != "direct")


def test_a_lost_vehicle_is_reported_with_its_age_and_restored_at_another_address(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await connected(world)
            world.silent = True
            await until(lambda: any(isinstance(e, LinkLost) for e in world.events))
            assert link.age_s() == pytest.approx(5.0, abs=0.2)
            world.address[1], world.silent = "elsewhere", False
            await until(lambda: any(isinstance(e, LinkRestored) for e in world.events))
            assert AddressChanged("elsewhere") in world.events
            await link.order(FlightOrder.HOLD)

    play(story(), real=kind != "direct")


def test_a_refused_operators_command_is_an_error(kind):
    async def story():
        async with World(kind=kind) as world:
            refuse(world.vehicles[1], SET_MODE, text="Mode change to RTL failed")
            link = await connected(world)
            with pytest.raises(CommandFailed, match=r"return .*DO_SET_MODE: FAILED .*RTL failed"):
                await link.order(FlightOrder.RETURN)

    play(story(), real=kind != "direct")


def test_a_closed_link_ends_its_procedures_and_can_be_reopened(kind):
    async def story():
        async with World(ready_s=1e9, kind=kind) as world:
            link = await connected(world)
            waiting = asyncio.create_task(link.prepare(100, lambda _: None))
            await asyncio.sleep(1)
            link.close()
            link.close()
            with pytest.raises(LinkError, match=r"\[interrupted\]"):
                await waiting
            await world.link().connect(10)

    play(story(), real=kind != "direct")


def test_a_lost_command_is_repeated_after_one_second(kind):
    async def story():
        async with World(kind=kind) as world:
            link = await connected(world)
            await asyncio.sleep(10 / world.pace)
            sent, loop = [], asyncio.get_running_loop()

            def lossy(data, address):
                if data[7:10] == b"\x4c\0\0" and data[38:40] == b"\xb0\0":  # COMMAND_LONG: DO_SET_MODE
                    sent.append(loop.time())
                    if len(sent) == 1:
                        return
                world.to_fleet(data, address)

            world.wire.connect_vehicles(lossy)
            await link.order(FlightOrder.HOLD)
            assert sent[1] - sent[0] == pytest.approx(1.0, abs=0.3)

    play(story(), real=kind != "direct")


def test_set_points_are_sent_before_and_during_the_call_that_follows_them(kind):
    async def story():
        async with World(kind=kind) as world:
            link = world.link()
            assert not link.send_setpoint(EAST)
            with pytest.raises(LinkError):
                await link.follow_setpoints()
            await link.connect(10)
            await link.prepare(30, lambda _: None)
            await link.upload(north_of_home(8))
            with pytest.raises(CommandFailed):
                await link.follow_setpoints()
            await link.launch()
            await until(lambda: link.state().mission_seq == 3)
            following = asyncio.create_task(link.follow_setpoints())
            await asyncio.sleep(0)
            assert link.send_setpoint(EAST)
            await following
            assert link.state().mode == "GUIDED"
            assert link.send_setpoint(EAST)
            link.close()
            assert not link.send_setpoint(EAST)

    play(story(), real=kind in REAL)
