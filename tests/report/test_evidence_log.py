"""The writer of evidence: contents of entries, and a full, slow or failing disk; only arming waits."""

from __future__ import annotations

import asyncio
import math
import os
import struct
import threading
from collections.abc import Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest
from agent_stories import Story
from evidence_files import ARM, DISARM, HOLD, Written
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core import events as ev
from swarmctl.core.messages import VehicleAnswer
from swarmctl.core.threat import FiringStrength
from swarmctl.report.evidence import log
from swarmctl.report.evidence.chain import check
from swarmctl.report.evidence.commands import arms, content


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Written]:
    made = Written(tmp_path)
    yield made
    made.evidence.close()


class TestContents:
    def test_a_message_is_in_the_file_before_it_leaves(self, run: Written) -> None:
        assert run.evidence.to_vehicle(1, ARM)
        last = run.lines[-1]
        assert (last["vehicle"], last["kind"], last["what"]["command"]) == (
            "alpha", "command", "COMPONENT_ARM_DISARM",
        )  # fmt: skip
        assert (last["what"]["message"], last["what"]["param1"]) == ("COMMAND_LONG", 1)
        assert "target_system" not in last["what"]

    def test_each_item_of_a_mission_is_recorded_before_it_leaves(self, run: Written) -> None:
        item = mavlink.MAVLink_mission_item_int_message(1, 1, 7, 6, 16, 0, 1, 0, 0, 0, math.nan, 46, 14, 2)
        run.evidence.to_vehicle(1, mavlink.MAVLink_mission_count_message(1, 1, 9))
        run.evidence.to_vehicle(1, item, "station 252")
        run.evidence.to_vehicle(1, mavlink.MAVLink_mission_request_int_message(1, 1, 7))
        announced, sent = run.commands
        assert (announced["message"], announced["count"]) == ("MISSION_COUNT", 9)
        assert (sent["seq"], sent["command"], sent["x"], sent["y"]) == (7, "NAV_WAYPOINT", 46, 14)
        assert (sent["param4"], sent["by"]) == (None, "station 252")

    def test_heartbeats_are_no_commands_and_a_signing_key_is_never_written(self, run: Written) -> None:
        run.evidence.to_vehicle(0, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        run.evidence.to_vehicle(1, mavlink.MAVLink_setup_signing_message(1, 1, [7] * 32, 5))
        assert run.commands == [{"message": "SETUP_SIGNING", "initial_timestamp": 5}]

    @pytest.mark.parametrize("value", [3, -1])
    def test_an_integer_parameter_is_recorded_as_its_value(self, value: int, run: Written) -> None:
        field = struct.unpack("<f", struct.pack("<i", value))[0]
        for autopilot, sent in (
            (mavlink.MAV_AUTOPILOT_PX4, field),
            (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, value),
        ):
            run.evidence.from_vehicle(1, mavlink.MAVLink_heartbeat_message(2, autopilot, 0, 0, 3, 3))
            asks = mavlink.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", sent, mavlink.MAV_PARAM_TYPE_INT32)
            run.evidence.to_vehicle(1, asks)
            assert (run.commands[-1]["param_id"], run.commands[-1]["param_value"]) == ("NAV_DLL_ACT", value)

    @pytest.mark.parametrize(
        ("message", "expected"),
        [
            (ARM, True),
            (DISARM, False),
            (HOLD, False),
            (mavlink.MAVLink_command_long_message(1, 1, 300, 0, 0, 0, 0, 0, 0, 0, 0), True),
            (mavlink.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0), True),
            (mavlink.MAVLink_mission_item_int_message(1, 1, 0, 6, 300, 0, 1, 0, 0, 0, 0, 1, 1, 2), False),
        ],
    )
    def test_only_arming_messages_count_as_arming(self, message: Any, expected: bool) -> None:
        assert arms(content(message, byte_wise=False)) is expected

    def test_an_operators_request_and_its_answer_are_one_entry(self, run: Written) -> None:
        state = Story().state
        refused = ev.Answer(3, VehicleAnswer(1, "alpha", "refused", note="[launch-without-link]"))
        launch = ev.OperatorCommand(ev.FlightOrder.LAUNCH, 3, ignore=(2,))
        weights = ev.WeightsChanged(4, 0.2, FiringStrength(0.7, 0.3, 0.1))
        by_program = ev.OperatorCommand(ev.FlightOrder.HOLD)
        for event, effects in ((launch, [refused]), (weights, []), (by_program, [])):
            run.evidence.folded(state, event, state, effects, 0.0)
        launched, weighted = [line["what"] for line in run.lines if line["kind"] == "operator"]
        assert launched == {
            "asks": "launch", "ignore": [2], "outcome": "refused", "note": "[launch-without-link]",
        }  # fmt: skip
        assert (weighted["w"], list(weighted["firing_strength"].values())) == (0.2, [0.7, 0.3, 0.1])

    def test_evidence_is_never_written_over(self, run: Written, tmp_path: Path) -> None:
        with pytest.raises(FileExistsError):
            Written(tmp_path)


def test_a_full_disk_forbids_arming_and_no_other_command(run: Written) -> None:
    run.fill_disk()
    assert run.evidence.to_vehicle(1, HOLD)
    assert not run.evidence.to_vehicle(1, ARM)
    run.evidence.close()
    assert len(run.said) == 1
    assert run.said[0].endswith("[evidence-ended]")


class SlowDisk:
    """A disk whose syncs end at once, or wait while `free` is cleared."""

    def __init__(self) -> None:
        self.free = threading.Event()
        self.free.set()
        self.error: OSError | None = None
        self.failed = threading.Event()
        self.synced: list[int] = []
        """size of the file at the beginning of each sync [bytes]"""

    def fsync(self, fileno: int) -> None:
        size = os.fstat(fileno).st_size
        # A loop that waits here would hang; the limit lets it fail instead.
        self.free.wait(2.0)
        if self.error is not None:
            error, self.error = self.error, None  # Linux reports a failure only once
            self.failed.set()
            raise error
        self.synced.append(size)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[SlowDisk]:
    made = SlowDisk()
    monkeypatch.setattr(os, "fsync", made.fsync)
    yield made
    made.free.set()


def play(story: Coroutine[Any, Any, None]) -> None:
    asyncio.run(story)


def test_a_blocked_disk_delays_neither_the_loop_nor_the_order_of_entries(
    disk: SlowDisk, tmp_path: Path
) -> None:
    async def story() -> None:
        run = Written.in_loop(tmp_path)
        disk.free.clear()
        began_s = asyncio.get_running_loop().time()
        for _ in range(10):
            assert run.evidence.to_vehicle(1, ARM)
            await asyncio.sleep(0)
        assert asyncio.get_running_loop().time() - began_s < 1.0
        assert [line["kind"] for line in run.lines] == ["opened", *["command"] * 10]
        assert disk.synced == []
        disk.free.set()
        assert await run.evidence.wait_until_stored() == ""
        assert disk.synced[-1] == run.file.stat().st_size
        run.evidence.close()
        checked = check(run.file.read_bytes().splitlines(keepends=True))
        assert checked.closing is not None
        assert len(checked.entries) == 12

    play(story())


def test_evidence_is_stored_when_all_entries_are_on_the_disk(disk: SlowDisk, tmp_path: Path) -> None:
    async def story() -> None:
        run = Written.in_loop(tmp_path)
        disk.free.clear()
        waits = []
        for text in ("before", "launch"):
            run.evidence.remark(text)
            waits.append(asyncio.create_task(run.evidence.wait_until_stored()))
            await asyncio.sleep(0.01)
            assert not any(wait.done() for wait in waits)
        disk.free.set()
        assert await asyncio.gather(*waits) == ["", ""]
        assert disk.synced[-1] == run.file.stat().st_size
        run.evidence.close()
        assert await run.evidence.wait_until_stored() != ""
        assert not run.evidence.to_vehicle(1, ARM)

    play(story())


@pytest.mark.parametrize("then", ["waits", "records", "ends", "only the last sync"])
def test_a_sync_that_fails_once_is_reported_once_and_forbids_arming(
    then: str, disk: SlowDisk, tmp_path: Path
) -> None:
    async def story() -> None:
        run = Written.in_loop(tmp_path)
        disk.error = OSError(5, "Input/output error")
        if then != "only the last sync":
            assert run.evidence.to_vehicle(1, ARM)
            assert await asyncio.to_thread(disk.failed.wait, 2.0)
        if then == "waits":
            assert "Input/output error" in await run.evidence.wait_until_stored()
        if then in ("waits", "records"):
            assert not run.evidence.to_vehicle(1, ARM)
        run.evidence.close()
        assert "Input/output error" in run.evidence.trouble
        (line,) = run.said
        assert line.endswith("[evidence-ended]")

    play(story())


def test_the_wait_for_a_blocked_disk_has_a_limit(
    disk: SlowDisk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log, "SYNC_TIMEOUT_S", 0.05)

    async def story() -> None:
        run = Written.in_loop(tmp_path)
        disk.free.clear()
        disk.error = OSError(5, "Input/output error")
        assert "0.05 s" in await run.evidence.wait_until_stored()
        disk.free.set()
        # The sync went on; its failure is not lost.
        assert "Input/output error" in await run.evidence.wait_until_stored()
        run.evidence.close()

    play(story())


def test_on_a_virtual_clock_the_wait_for_the_disk_has_no_limit(
    disk: SlowDisk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log, "SYNC_TIMEOUT_S", 0.0)
    run = Written(tmp_path, lambda: 0.0)
    disk.free.clear()
    threading.Timer(0.05, disk.free.set).start()
    assert asyncio.run(run.evidence.wait_until_stored()) == ""
    run.evidence.close()
