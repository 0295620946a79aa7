"""Messages about refused frames in flight: at once for each vehicle, and once a minute."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path

import pytest
from evidence_files import HOLD
from flights import Ui, fly, small
from link_world import SignedWorld, play, signing_codec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet
from swarmctl.config.scenario import Scenario
from swarmctl.flight.run import VIRTUAL_EPOCH_NS, FlightOptions
from swarmctl.flight.virtual_simulator import Frames, fleet_of, serve
from swarmctl.links.signing import (
    AHEAD,
    LATE,
    MEANINGS,
    OTHER_KEY,
    REPEATED,
    REPORT_PERIOD_S,
    TICKS_PER_S,
    UNSIGNED,
    Refusals,
    ticks,
)
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.report.evidence.log import FILE_NAME
from swarmctl.security.mavlink_key import TimestampFile

KEY, OTHER = bytes(range(32)), bytes(31) + b"x"
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 3, 209, 3, 4, 3)


def forged(sysid: int, key: bytes | None = None, now_s: float = 0.0) -> bytes:
    codec = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
    if key is not None:
        codec.signing.secret_key, codec.signing.sign_outgoing = key, True
        codec.signing.timestamp = ticks(VIRTUAL_EPOCH_NS // 1000) + round(now_s * TICKS_PER_S)
    return bytes(HEARTBEAT.pack(codec))


class SigningVehicles:
    """Vehicles with the key, set over USB; from 20 s on other senders use the same link."""

    def __init__(self, fleet: Fleet) -> None:
        self.sysids, self.receive, self._fleet = fleet.sysids, fleet.receive, fleet
        for sysid in self.sysids:
            codec = signing_codec(KEY)
            setup = mavlink.MAVLink_setup_signing_message(sysid, 1, list(KEY), codec.signing.timestamp)
            self.receive(bytes(setup.pack(codec)), 0.0)
        self._second = 20

    def step(self, now: float) -> Frames:
        frames = [*self._fleet.step(now)]
        if now >= self._second:
            self._second += 1
            frames += [(0, forged(1)), (0, forged(99)), (1, forged(2, OTHER, now))]
        return frames


async def simulate(wire: MemoryWire, scenario: Scenario) -> None:
    await serve(wire, SigningVehicles(fleet_of(scenario)))


def test_a_flight_reports_refused_frames_at_once_every_minute_and_at_the_end(tmp_path: Path) -> None:
    key = tmp_path / "swarm.key"
    key.write_text(KEY.hex())
    key.chmod(0o600)
    scenario = small(
        links={"signing_key": str(key)},
        simulate={"count": 2, "ready_s": 3.0},
    )
    ui = Ui()
    report = fly(scenario, tmp_path / "run", ui=ui, options=FlightOptions(simulate=simulate))
    assert report.all_arrived
    *reports, end = (line for line in ui.said if "[frames-refused]" in line)
    first = reports[:3]
    for text, values in zip(
        first,
        [
            ("uav1: ", UNSIGNED, "(1 ", "simulated:1", MEANINGS[UNSIGNED]),
            ("memory:fleet: ", UNSIGNED, "(1 ", "system 99", "simulated:1"),
            ("uav2: ", OTHER_KEY, "(1 ", "simulated:2", MEANINGS[OTHER_KEY]),
        ],
        strict=True,
    ):
        assert text.startswith(values[0])
        assert all(value in text for value in values[1:])
    # A minute later each report is repeated while the frames continue.
    assert [re.sub(r"\(6[12] ", "(1 ", text) for text in reports[3:]] == first
    assert "links.signing_key" in end
    assert all(int(re.findall(rf"(\d+) {why}", end)[0]) > 61 for why in (OTHER_KEY, UNSIGNED))
    lines = [json.loads(line) for line in (tmp_path / "run" / FILE_NAME).read_text().splitlines()]
    # The record has the reports about a vehicle; those about the whole flight are only here.
    noted = [line["what"]["said"] for line in lines if line["kind"] == "note"]
    assert noted == [text for text in (*reports, end) if not text.startswith("uav")]


def test_refusals_are_reported_once_a_minute_by_vehicle_and_reason() -> None:
    refusals = Refusals()

    def of(sysid: int, why: str, now_s: float, component: int = 1) -> str:
        return refusals.of_vehicle(sysid, component, why, "here:1", now_s)

    for why in (UNSIGNED, OTHER_KEY, LATE, AHEAD, REPEATED):
        first = of(1, why, 0.0)
        assert all(text in first for text in (why, "(1 ", "here:1", MEANINGS[why]))
        assert of(2, why, 0.0)
        assert of(1, why, REPORT_PERIOD_S - 0.1) == of(2, why, 1.0) == ""
        assert "(3 " in of(1, why, REPORT_PERIOD_S)
        assert of(1, why, REPORT_PERIOD_S + 1.0) == ""
    assert "component 100" in of(3, UNSIGNED, 0.0, component=100)


def test_forged_system_ids_do_not_fill_the_memory() -> None:
    refusals = Refusals()
    texts = [refusals.of_stranger(sysid, UNSIGNED, f"far:{sysid}", 0.0) for sysid in range(1, 250)]
    assert [bool(text) for text in texts] == [True] + [False] * 248
    text = refusals.of_stranger(7, UNSIGNED, "far:7", REPORT_PERIOD_S)
    assert all(value in text for value in (UNSIGNED, "(250 ", "system 7", "far:7"))


def test_a_refused_station_is_reported(tmp_path: Path) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            await world.forward(commands=True)
            await world.link().connect(10)
            for key in (OTHER, OTHER, OTHER, KEY):
                world.watching.say(HOLD, signing_codec(key))
            await asyncio.sleep(1.0)
            (report,) = [line for line in world.said if "[frames-refused]" in line]
            assert all(value in report for value in (OTHER_KEY, "(1 ", "system 252", "memory:watcher"))

    play(story())


def test_a_disk_that_stores_no_timestamps_is_reported_in_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story() -> None:
        async with SignedWorld(tmp_path) as world:
            await world.link().connect(10)

            def full(_file: TimestampFile, _timestamp: int) -> None:
                raise OSError(28, "No space left on device")

            monkeypatch.setattr(TimestampFile, "save", full)
            await asyncio.sleep(300.0)
            (trouble,) = world.said
            assert "No space left on device" in trouble
            assert trouble.endswith("[timestamps-not-stored]")
            assert world.front.refusal_summary == trouble

    play(story())
