"""Messages that would arm a vehicle: not sent if the evidence cannot be written."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from evidence_files import ARM, HOLD, Written
from link_world import World, play, until, uploaded
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.events import FlightOrder
from swarmctl.links.base import LaunchFailed

LAUNCH_COMMANDS = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_MISSION_START)


class EvidenceWorld(World):
    """A copter and an evidence file on a disk that can fill up."""

    def __init__(self, folder: Path) -> None:
        self.written = Written(folder, asyncio.get_running_loop().time)
        super().__init__(evidence=self.written.evidence)

    async def __aexit__(self, *error: object) -> None:
        await super().__aexit__(*error)
        self.written.evidence.close()

    def disk_is_full(self) -> str:
        """Fill the disk from now on; as a launch check, report no vehicle in the way."""
        self.written.fill_disk()
        return ""

    def launch_commands(self) -> list[int]:
        return [m.command for m in self.sent("COMMAND_LONG") if m.command in LAUNCH_COMMANDS]


def test_a_launch_whose_earlier_evidence_is_not_on_disk_sends_nothing(tmp_path: Path) -> None:
    async def story() -> None:
        async with EvidenceWorld(tmp_path) as world:
            link = await uploaded(world, 2)
            world.disk_is_full()
            before = len(world.sent("COMMAND_LONG"))
            with pytest.raises(LaunchFailed, match=world.written.file.name):
                await link.launch()
            assert world.sent("COMMAND_LONG")[before:] == []

    play(story())


def test_an_arming_command_that_cannot_be_recorded_is_not_sent(tmp_path: Path) -> None:
    """The disk stores all earlier messages and fills up right before the command."""

    async def story() -> None:
        async with EvidenceWorld(tmp_path) as world:
            link = await uploaded(world)
            with pytest.raises(LaunchFailed, match=r"\[no-arming\]"):
                await link.launch(world.disk_is_full)
            assert world.launch_commands() == []
            assert not world.vehicles[1].armed
            assert "[evidence-ended]" in world.written.said[0]
            # A command that cannot arm a vehicle is still sent.
            await link.order(FlightOrder.RETURN)
            assert world.vehicles[1].mode.name == "RTL"

    play(story())


def test_an_arming_command_of_another_station_that_cannot_be_recorded_is_not_sent(tmp_path: Path) -> None:
    async def story() -> None:
        async with EvidenceWorld(tmp_path) as world:
            await world.forward(commands=True)
            await world.link().connect(10)
            await asyncio.sleep(5)
            world.disk_is_full()
            world.watching.say(ARM)
            world.watching.say(HOLD)
            await until(lambda: world.vehicles[1].mode.name == "GUIDED", 5)
            assert world.launch_commands() == []

    play(story())
