"""A `DirectLink` over the front end and a memory wire, on a virtual clock."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import Copter, Script

from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.links import LINKS
from swarmctl.links.base import (
    AddressChanged,
    Busy,
    CommandFailed,
    Conflict,
    Heard,
    LaunchFailed,
    LinkError,
    Lost,
    NobodyAnswers,
    NotReady,
    ProcedureDone,
    Restored,
    SwapFailed,
    TransportError,
    UnsupportedVehicle,
    UploadFailed,
)
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.memory import MemoryWire
from swarmctl.links.url import Endpoint

WIRE = Endpoint("memory", "test")


class VirtualLoop(asyncio.SelectorEventLoop):
    """Time jumps to the next timer as soon as nothing else is to be done."""

    virtual_s = 0.0

    def time(self) -> float:
        return self.virtual_s

    def _run_once(self) -> None:
        if not self._ready and self._scheduled:
            self.virtual_s = max(self.virtual_s, self._scheduled[0].when())
        super()._run_once()


def play(story) -> None:
    """Run an async story on a virtual clock, at most an hour of it."""

    async def bounded():
        async with asyncio.timeout(3600):
            await story

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(bounded())


def north(count: int, east: float = 0.0) -> FlightPlan:
    points = tuple(Waypoint(46.049 + 0.001 * i, 14.506 + east, 20.0) for i in range(1, count + 1))
    return FlightPlan(20.0, points, points[-1])


class World:
    """Copters on a memory wire, and a link to each."""

    def __init__(self, *copters: Copter, tlog=None) -> None:
        self.copters = {c.sysid: c for c in copters}
        self.address = {c.sysid: "fleet" for c in copters}
        self.wire = MemoryWire()
        self.wire.to_vehicles = self._to_vehicles
        self.silent = False
        self.to_vehicles: list[tuple[bytes, object]] = []
        self.events: list = []
        self._wall_us = 1_700_000_000_000_000
        self.front = FrontEnd(wall_time_us=self._wall, memory={"test": self.wire})
        self.tlog = tlog

    def _wall(self) -> int:
        self._wall_us += 1000
        return self._wall_us

    def link(self, sysid: int = 1, name: str = "alpha"):
        kind = LINKS["direct"]
        return kind(self.front, WIRE, sysid, name=name, on_event=self.events.append, tlog=self.tlog)

    def _to_vehicles(self, data: bytes, address) -> None:
        self.to_vehicles.append((data, address))
        now = asyncio.get_running_loop().time()
        for copter in self.copters.values():
            if not self.silent and self.address[copter.sysid] == address:
                self._from(copter, copter.receive(data, now))

    def _from(self, copter: Copter, frames: list[bytes]) -> None:
        for frame in frames:
            if not self.silent:
                self.wire.from_vehicle(frame, self.address[copter.sysid])

    async def _fly(self) -> None:
        while True:
            await asyncio.sleep(0.1)
            for copter in self.copters.values():
                self._from(copter, copter.step(asyncio.get_running_loop().time()))

    async def __aenter__(self):
        self._task = asyncio.create_task(self._fly())
        return self

    async def __aexit__(self, *error) -> None:
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        await self.front.close()


async def until(condition, limit_s: float = 60.0) -> None:
    async with asyncio.timeout(limit_s):
        while not condition():  # noqa: ASYNC110 - the clock is virtual
            await asyncio.sleep(0.1)


async def flying(world: World):
    link = world.link()
    await link.connect(10)
    await link.prepare(30, lambda _: None)
    await link.upload(north(8))
    await link.launch()
    await until(lambda: link.state().mission_seq == 3)
    return link


def test_a_whole_flight_with_a_swap():
    async def story():
        copter = Copter(1)
        async with World(copter) as world:
            link = world.link()
            identity = await link.connect(10)
            assert (identity.sysid, identity.firmware, identity.simulated) == (1, "ArduPilot 4.6.2", True)
            said = []
            await link.prepare(30, said.append)
            assert any("STABILIZE" in reason for reasons in said for reason in reasons)
            assert link.state().ready
            await link.upload(north(8))
            await link.launch()
            assert link.state().alt_rel_m > 0.5
            await until(lambda: link.state().mission_seq == 3)
            await link.swap(north(6, east=0.002))
            assert [i.command for i in link.items()] == [16, 22, *[16] * 6, 21]
            assert link.items()[2].y == round(14.508 * 1e7)
            await until(lambda: not copter.armed, 200)
            assert 0.0 <= link.age_s() <= 1.1
            done = [e.name for e in world.events if isinstance(e, ProcedureDone)]
            assert done == ["identify", "prepare", "upload", "launch", "swap"]
            assert isinstance(world.events[0], Heard)

    play(story())


def asked_of(world: World) -> set[tuple[str, float]]:
    """(message, its first parameter) of all that went out to the vehicles, heartbeats aside."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    messages = [m for data, _ in world.to_vehicles for m in parser.parse_buffer(data) or []]
    return {(m.get_type(), getattr(m, "param1", 0.0)) for m in messages if m.get_type() != "HEARTBEAT"}


def test_a_vehicle_that_is_only_connected_is_asked_who_it_is_and_nothing_else():
    async def story():
        async with World(Copter(1)) as world:
            link = world.link()
            await link.connect(10)
            await asyncio.sleep(20)
            assert asked_of(world) == {("COMMAND_LONG", 148.0)}
            assert world.copters[1].streams == {}
            await link.prepare(30, lambda _: None)
            assert set(world.copters[1].streams) == {33, 1, 193, 245, 42, 242}

    play(story())


def test_identify_asks_again_and_hears_that_another_vehicle_is_there_now():
    async def story():
        async with World(Copter(1)) as world:
            link = world.link()
            with pytest.raises(LinkError, match="connect first"):
                await link.identify(5)
            assert (await link.connect(10)).simulated
            world.copters[1].uid2 = b"an aircraft"
            again = await link.identify(5)
            assert not again.simulated
            world.silent = True
            with pytest.raises(NobodyAnswers, match=r"AUTOPILOT_VERSION.*tried for 5 s"):
                await link.identify(5)

    play(story())


def test_an_order_interrupts_identify():
    async def story():
        async with World(Copter(1)) as world:
            link = world.link()
            await link.connect(10)
            world.wire.to_vehicles = lambda data, address: None
            asking = asyncio.create_task(link.identify(30))
            await asyncio.sleep(1)
            world.wire.to_vehicles = world._to_vehicles
            await link.hold()
            with pytest.raises(LinkError, match="interrupted by hold"):
                await asking

    play(story())


def test_nobody_answers_says_who_where_how_long_and_what_is_there_instead():
    async def story():
        async with World(Copter(3), Copter(4)) as world:
            with pytest.raises(NobodyAnswers) as caught:
                await world.link(1).connect(7)
            for part in ("alpha", "system 1", "memory:test", "7 s", "heard there: system 3, 4"):
                assert part in str(caught.value)

    play(story())


def test_a_vehicle_that_cannot_be_flown_is_refused_by_name():
    async def story():
        async with World(Copter(1, autopilot=12)) as world:
            with pytest.raises(UnsupportedVehicle, match=r"alpha .* PX4 vehicles cannot be flown yet"):
                await world.link().connect(7)

    play(story())


def test_not_ready_tells_the_last_reasons():
    async def story():
        async with World(Copter(1, Script(ready_at_s=1e9))) as world:
            link = world.link()
            await link.connect(10)
            with pytest.raises(NotReady) as caught:
                await link.prepare(20, lambda _: None)
            assert "no position estimate yet" in caught.value.reasons
            assert "alpha" in str(caught.value)

    play(story())


@pytest.mark.parametrize(
    ("script", "error", "says"),
    [
        (Script(refuse_item=2, refusals_left=9), UploadFailed, "INVALID"),
        (Script(refuse_arming="Battery low"), LaunchFailed, "Battery low"),
        (Script(refuse_mode="AUTO"), None, ""),
    ],
)
def test_failures_name_the_vehicle_the_url_and_its_reason(script, error, says):
    async def story():
        async with World(Copter(1)) as world:
            link = world.link()
            await link.connect(10)
            await link.prepare(30, lambda _: None)
            world.copters[1].script = script
            context = pytest.raises(error, match=says) if error else contextlib.nullcontext()
            with context as caught:
                await link.upload(north(3))
                await link.launch()
            if error:
                assert "alpha (system 1 at memory:test)" in str(caught.value)

    play(story())


def test_a_failed_swap_says_what_the_vehicle_flies():
    async def story():
        async with World(Copter(1)) as world:
            link = await flying(world)
            world.copters[1].script = Script(refuse_set_current=True)
            with pytest.raises(SwapFailed, match="stands in hold") as caught:
                await link.swap(north(4, east=0.001))
            assert caught.value.flying == "hold"
            await link.return_home()
            assert link.state().mode == "RTL"
            with pytest.raises(SwapFailed, match="RTL") as caught:
                await link.swap(north(4, east=0.001))
            assert caught.value.flying == "unknown"

    play(story())


def test_hold_interrupts_a_swap_and_other_calls_are_told_to_wait():
    async def story():
        async with World(Copter(1)) as world:
            link = await flying(world)
            swap = asyncio.create_task(link.swap(north(6, east=0.002)))
            await asyncio.sleep(0.2)
            with pytest.raises(Busy, match="upload while swap runs"):
                await link.upload(north(2))
            await link.hold()
            assert link.state().mode == "GUIDED"
            with pytest.raises(SwapFailed, match="interrupted by hold"):
                await swap
            await link.land()
            assert link.state().mode == "LAND"

    play(story())


def test_cancelling_a_call_cancels_it_on_the_wire():
    async def story():
        copter = Copter(1)
        async with World(copter) as world:
            link = world.link()
            await link.connect(10)
            copter.on_mission_item_int = lambda m: None
            upload = asyncio.create_task(link.upload(north(3)))
            await until(lambda: copter.transfer is not None)
            upload.cancel()
            with pytest.raises(asyncio.CancelledError):
                await upload
            await asyncio.sleep(0.1)
            assert copter.acks_received == [15]
            assert ProcedureDone("upload", "cancelled") in world.events
            del copter.on_mission_item_int
            await link.upload(north(3))

    play(story())


def test_a_lost_vehicle_is_reported_with_its_age_and_taken_up_again_from_another_address():
    async def story():
        async with World(Copter(1)) as world:
            link = world.link()
            await link.connect(10)
            world.silent = True
            await until(lambda: any(isinstance(e, Lost) for e in world.events))
            assert link.age_s() == pytest.approx(5.0, abs=0.2)
            world.address[1], world.silent = "elsewhere", False
            await until(lambda: any(isinstance(e, Restored) for e in world.events))
            assert AddressChanged("elsewhere") in world.events
            await link.hold()

    play(story())


def test_two_vehicles_with_one_system_id_are_a_conflict_and_the_second_is_not_heard():
    async def story():
        world = World(Copter(1))
        async with world:
            link = world.link()
            await link.connect(10)
            double = Copter(1)
            double.mode = 9
            for _ in range(30):
                await asyncio.sleep(0.1)
                for frame in double.step(asyncio.get_running_loop().time()):
                    world.wire.from_vehicle(frame, "impostor")
            assert world.events.count(Conflict("impostor")) == 1
            assert link.state().mode == "STABILIZE"

    play(story())


def test_a_companion_with_the_vehicles_system_id_moves_nothing():
    async def story():
        async with World(Copter(1)) as world:
            link = world.link()
            await link.connect(10)
            companion = Copter(1)
            companion.mav.srcComponent = 191
            companion.mode = 9
            world.silent = True
            await asyncio.sleep(3)
            for _ in range(30):
                await asyncio.sleep(0.1)
                for frame in companion.step(asyncio.get_running_loop().time()):
                    world.wire.from_vehicle(frame, "companion")
            assert link.state().mode == "STABILIZE"
            assert link.age_s() > 5.0
            assert not any(isinstance(e, AddressChanged | Conflict) for e in world.events)

    play(story())


def test_frames_go_to_the_vehicles_address_only_and_one_heartbeat_to_each():
    async def story():
        world = World(Copter(1), Copter(2), Copter(3))
        world.address[3] = "third"
        async with world:
            links = [world.link(i, f"v{i}") for i in (1, 2, 3)]
            await asyncio.gather(*(link.connect(10) for link in links))
            world.to_vehicles.clear()
            await asyncio.sleep(10)
            beats = [a for data, a in world.to_vehicles if data[7:10] == b"\0\0\0"]
            assert beats.count("fleet") == beats.count("third") == 10
            world.to_vehicles.clear()
            await links[2].hold()
            assert {a for data, a in world.to_vehicles if data[7:10] != b"\0\0\0"} == {"third"}

    play(story())


def test_one_system_id_cannot_be_two_vehicles_on_one_endpoint():
    async def story():
        async with World(Copter(1)) as world:
            await world.link().connect(10)
            with pytest.raises(LinkError, match="beta: system id 1 is used by two vehicles"):
                await world.link(1, "beta").connect(10)
            with pytest.raises(LinkError, match=r"255 .* ground station's own"):
                await world.link(255, "gamma").connect(10)
            with pytest.raises(TransportError, match="no memory wire of that name; known: test"):
                await world.front.open(Endpoint("memory", "other"))
            with pytest.raises(LinkError, match="connect first"):
                await world.link(2).hold()

    play(story())


def test_a_command_that_was_lost_is_sent_again_after_a_second_and_not_later():
    async def story():
        async with World(Copter(1)) as world:
            link = world.link()
            await link.connect(10)
            await asyncio.sleep(10)
            sent, loop = [], asyncio.get_running_loop()

            def lossy(data, address):
                if data[7:10] == b"\x4c\0\0" and data[38:40] == b"\xb0\0":  # COMMAND_LONG: DO_SET_MODE
                    sent.append(loop.time())
                    if len(sent) == 1:
                        return
                world._to_vehicles(data, address)

            world.wire.to_vehicles = lossy
            await link.hold()
            assert sent[1] - sent[0] == pytest.approx(1.0)

    play(story())


def test_a_refused_operators_command_is_an_error():
    async def story():
        async with World(Copter(1, Script(refuse_mode="RTL"))) as world:
            link = world.link()
            await link.connect(10)
            with pytest.raises(CommandFailed, match=r"return_home: DO_SET_MODE: FAILED .*RTL failed"):
                await link.return_home()

    play(story())


def test_a_closed_link_ends_what_runs_and_can_be_opened_again():
    async def story():
        async with World(Copter(1, Script(ready_at_s=1e9))) as world:
            link = world.link()
            await link.connect(10)
            waiting = asyncio.create_task(link.prepare(100, lambda _: None))
            await asyncio.sleep(1)
            link.close()
            link.close()
            with pytest.raises(LinkError, match="closing the link"):
                await waiting
            await world.link().connect(10)

    play(story())


def test_equal_runs_send_equal_bytes():
    def run() -> list[tuple[bytes, object]]:
        sent = []

        async def story():
            async with World(Copter(1)) as world:
                link = await flying(world)
                await link.swap(north(5, east=0.001))
                sent.extend(world.to_vehicles)

        play(story())
        return sent

    assert run() == run()


def test_the_tlog_is_read_by_pymavlink_with_both_directions(tmp_path):
    path = tmp_path / "alpha.tlog"

    async def story():
        async with World(Copter(1), tlog=path) as world:
            link = world.link()
            await link.connect(10)
            await link.upload(north(2))
            await asyncio.sleep(2)

    play(story())
    log = mavutil.mavlink_connection(str(path))
    messages = []
    while (message := log.recv_match()) is not None:
        messages.append((message.get_srcSystem(), message.get_type(), message._timestamp))
    log.close()
    assert {(1, "HEARTBEAT"), (255, "HEARTBEAT"), (1, "MISSION_ACK"), (255, "MISSION_COUNT")} <= {
        m[:2] for m in messages
    }
    assert "BAD_DATA" not in {m[1] for m in messages}
    stamps = [m[2] for m in messages]
    assert stamps == sorted(stamps)
    assert 1_700_000_000 <= stamps[0] < 1_700_000_001


def test_what_was_received_is_on_disk_within_a_second_or_so(tmp_path):
    path = tmp_path / "alpha.tlog"

    async def story():
        async with World(Copter(1), tlog=path) as world:
            link = world.link()
            await link.connect(10)
            await asyncio.sleep(10)
            world.silent = True
            await asyncio.sleep(1.1)
            logged = path.read_bytes()
            world.copters[1].text(4, "the last words")
            world.silent = False
            await asyncio.sleep(1.1)
            assert b"the last words" not in logged
            assert b"the last words" in path.read_bytes()

    play(story())
