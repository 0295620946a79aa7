"""Set-points over every link: sent at once, also during another call, and signed."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from link_world import World, north, play, until
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import Copter
from signed_world import SignedWorld, station

from swarmctl.core.setpoint import SetPoint
from swarmctl.links import LINKS
from swarmctl.links.base import CommandFailed, LinkError

REAL = {"mavsdk"}
EAST = SetPoint((4.0, 0.0, 0.0))
SET_POINT_ID = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT


@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=(pytest.mark.interop, pytest.mark.full) if k in REAL else ()) for k in LINKS],
)
def test_set_points_are_sent_before_and_during_the_call_that_follows_them(kind: str) -> None:
    async def story() -> None:
        copter = Copter(1)
        async with World(copter, kind=kind) as world:
            link = world.link()
            assert not link.send_setpoint(EAST)
            with pytest.raises(LinkError):
                await link.follow_setpoints()
            await link.connect(10)
            await link.prepare(30, lambda _: None)
            await link.upload(north(8))
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


def test_signed_set_points_are_followed(tmp_path: Path) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            link = world.link()
            await link.connect(10)
            await link.prepare(60, lambda _: None)
            await link.upload(north(8))
            await link.launch()
            await until(lambda: link.state().mission_seq == 3)
            await link.follow_setpoints()
            sent = len(world.to_vehicles)
            for _ in range(100):
                assert link.send_setpoint(EAST)
                await asyncio.sleep(0.1)
            assert link.state().east_m_s == pytest.approx(4.0, abs=0.2)
            assert world.vehicle.signing.refused == 0
            frames = [
                f for f in world.to_vehicles[sent:] if int.from_bytes(f[7:10], "little") == SET_POINT_ID
            ]
            receiver = station()
            messages = [m for frame in frames for m in receiver.parse_buffer(frame)]
            assert len(messages) == receiver.signing.goodsig_count == 100

    play(story())
