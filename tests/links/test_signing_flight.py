"""Links to vehicles that sign, played by the simulator and by pymavlink, on a virtual clock."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from evidence_files import HOLD
from link_world import KEY, SignedWorld, connected, flying, play, signing_codec, until, uploaded
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.events import LinkLost
from swarmctl.core.setpoint import SetPoint
from swarmctl.links.base import FramesRefused, NoAnswer
from swarmctl.links.signing import LATE, OTHER_KEY, REPEATED, UNSIGNED
from swarmctl.security.mavlink_key import TimestampFile


def test_pymavlink_verifies_all_frames_of_a_signed_flight_both_ways(tmp_path: Path) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            await world.forward()
            link = await uploaded(world, 2)
            await link.launch()
            await until(lambda: not link.state().armed, 300)
            assert world.front.refusal_summary == ""
            sent = [frame for frame, _ in world.to_vehicles]
            for frames in (sent, world.from_vehicles, world.watching.frames):
                receiver = signing_codec()
                messages = [m for frame in frames for m in receiver.parse_buffer(frame)]
                assert len(messages) == len(frames) > 50
                assert receiver.signing.goodsig_count == len(frames)
                assert receiver.signing.badsig_count == receiver.signing.unsigned_count == 0

    play(story())


@pytest.mark.parametrize("key", [None, bytes(31) + b"x"])
def test_a_vehicle_does_not_answer_without_its_key(tmp_path: Path, key: bytes | None) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path, key=key) as world:
            with pytest.raises(NoAnswer) as caught:
                await world.link().connect(10)
            assert (OTHER_KEY in str(caught.value)) == (key is not None)

    play(story())


def test_an_unsigned_vehicle_is_refused_with_the_reason(tmp_path: Path) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            world.give_key(bytes(32), 0)
            with pytest.raises(NoAnswer) as caught:
                await world.link().connect(10)
            text = str(caught.value)
            assert UNSIGNED in text
            assert "[frames-refused]" in text
            assert "links.signing_key" in text

    play(story())


def test_a_forged_heartbeat_and_a_replayed_frame_change_nothing(tmp_path: Path) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            link = await connected(world)
            world.silent = True
            intruder = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
            armed = mavlink.MAVLink_heartbeat_message(2, 3, 209, 3, 4, 3)
            replayed = world.from_vehicles[0]
            for _ in range(20):
                world.wire.from_vehicle(bytes(armed.pack(intruder)), world.port(0))
                world.wire.from_vehicle(replayed, world.port(0))
                await asyncio.sleep(0.5)
            assert not link.state().armed
            assert any(isinstance(event, LinkLost) for event in world.events)
            assert world.signing is not None
            assert world.signing.refused == {UNSIGNED: 20, REPEATED: 20}

    play(story())


def test_a_vehicle_with_a_late_clock_is_reported_once_and_learns_the_time(tmp_path: Path) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path, behind_s=3600) as world:
            identity = await world.link().connect(10)
            assert identity.simulated
            assert LATE in world.front.refusal_summary
            (event,) = [event for event in world.events if isinstance(event, FramesRefused)]
            assert all(value in event.text for value in (LATE, "(1 ", "vehicle 1"))

    play(story())


def test_the_vehicle_accepts_a_second_run_after_the_clock_went_back(tmp_path: Path) -> None:
    async def story(behind_us: int) -> None:
        async with SignedWorld(tmp_path) as world:
            world.began_us -= behind_us
            if behind_us:
                world.give_key(KEY, kept[-1] - 1)
            await world.link().connect(10)
            kept.append(TimestampFile(tmp_path / "key").load())

    kept: list[int] = []
    play(story(0))
    play(story(3_600_000_000))
    assert kept[1] > kept[0]


@pytest.mark.parametrize(("key", "mode"), [(KEY, 4), (bytes(31) + b"x", 0)])
def test_commands_of_another_station_need_the_key_too(tmp_path: Path, key: bytes, mode: int) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            await world.forward(commands=True)
            link = await connected(world)
            await asyncio.sleep(10)
            world.watching.say(HOLD, signing_codec(key))
            await asyncio.sleep(5)
            assert link.state().mode == {4: "GUIDED", 0: "STABILIZE"}[mode]
            assert (OTHER_KEY in world.front.refusal_summary) == (key != KEY)

    play(story())


def test_signed_set_points_are_followed(tmp_path: Path) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            link = await flying(world)
            await link.follow_setpoints()
            east = SetPoint((4.0, 0.0, 0.0))
            sent = len(world.to_vehicles)
            for _ in range(100):
                assert link.send_setpoint(east)
                await asyncio.sleep(0.1)
            assert link.state().east_m_s == pytest.approx(4.0, abs=0.2)
            number = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT.to_bytes(3, "little")
            frames = [frame for frame, _ in world.to_vehicles[sent:] if frame[7:10] == number]
            receiver = signing_codec()
            messages = [m for frame in frames for m in receiver.parse_buffer(frame)]
            assert len(messages) == receiver.signing.goodsig_count == 100

    play(story())
