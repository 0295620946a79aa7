"""Evidence on a slow or failing disk: only arming waits for the disk."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.report.evidence import file
from swarmctl.report.evidence.chain import check
from swarmctl.report.evidence.file import FILE_NAME, EvidenceFile
from swarmctl.report.evidence.hooks import Evidence

ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


class SlowDisk:
    """A disk whose syncs end at once, or wait while `free` is cleared."""

    def __init__(self) -> None:
        self.free = threading.Event()
        self.free.set()
        self.error: OSError | None = None
        self.synced: list[int] = []
        """size of the file at the beginning of each sync [bytes]"""

    def fsync(self, fileno: int) -> None:
        size = os.fstat(fileno).st_size
        # A loop that waits here would hang; the limit lets it fail instead.
        self.free.wait(2.0)
        if self.error is not None:
            raise self.error
        self.synced.append(size)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[SlowDisk]:
    made = SlowDisk()
    monkeypatch.setattr(os, "fsync", made.fsync)
    yield made
    made.free.set()


class Run:
    """Evidence in a running loop."""

    def __init__(self, folder: Path) -> None:
        self.said: list[str] = []
        self.file = folder / FILE_NAME
        loop = asyncio.get_running_loop()
        self.evidence = Evidence(
            EvidenceFile(
                self.file, {}, unix_s=loop.time, run_s=loop.time, say=self.said.append, in_thread=True
            ),
            {1: "alpha"},
        )

    @property
    def lines(self) -> list[bytes]:
        return self.file.read_bytes().splitlines(keepends=True)


def test_a_blocked_disk_delays_neither_the_loop_nor_the_order_of_entries(
    disk: SlowDisk, tmp_path: Path
) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        assert await run.evidence.wait_until_stored() == ""
        before = len(disk.synced)
        disk.free.clear()
        began_s = asyncio.get_running_loop().time()
        for _ in range(10):
            assert run.evidence.to_vehicle(1, ARM)
            await asyncio.sleep(0)
        assert asyncio.get_running_loop().time() - began_s < 1.0
        assert [json.loads(line)["kind"] for line in run.lines] == ["opened", *["command"] * 10]
        assert len(disk.synced) == before
        disk.free.set()
        assert await run.evidence.wait_until_stored() == ""
        # One sync was running, and one more stored all other entries.
        assert len(disk.synced) == before + 2
        run.evidence.close()
        checked = check(run.lines)
        assert checked.fault is None
        assert checked.closing == {"entries": 11}

    asyncio.run(story())


def test_evidence_is_stored_when_all_entries_are_on_the_disk(disk: SlowDisk, tmp_path: Path) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        disk.free.clear()
        run.evidence.remark("before")
        waits = asyncio.create_task(run.evidence.wait_until_stored())
        await asyncio.sleep(0.01)
        run.evidence.remark("launch")
        also = asyncio.create_task(run.evidence.wait_until_stored())
        await asyncio.sleep(0.01)
        assert not waits.done()
        assert not also.done()
        disk.free.set()
        assert (await waits, await also) == ("", "")
        assert disk.synced[-1] == run.file.stat().st_size
        run.evidence.close()

    asyncio.run(story())


def test_a_disk_that_fails_later_is_reported_once_and_forbids_arming(disk: SlowDisk, tmp_path: Path) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        await run.evidence.wait_until_stored()
        disk.error = OSError(5, "Input/output error")
        assert run.evidence.to_vehicle(1, ARM)
        assert "Input/output error" in await run.evidence.wait_until_stored()
        assert not run.evidence.to_vehicle(1, ARM)
        (line,) = run.said
        assert "Input/output error" in line
        assert line.endswith("[evidence-ended]")
        run.evidence.close()
        assert "Input/output error" in run.evidence.trouble

    asyncio.run(story())


def test_a_disk_that_fails_at_the_end_of_the_run_is_reported(disk: SlowDisk, tmp_path: Path) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        await run.evidence.wait_until_stored()
        disk.error = OSError(5, "Input/output error")
        run.evidence.to_vehicle(1, ARM)
        run.evidence.close()
        assert "Input/output error" in run.evidence.trouble
        await asyncio.sleep(0)
        assert len(run.said) == 1

    asyncio.run(story())


def test_the_wait_for_a_blocked_disk_has_a_limit(
    disk: SlowDisk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file, "SYNC_TIMEOUT_S", 0.05)

    async def story() -> None:
        run = Run(tmp_path)
        await run.evidence.wait_until_stored()
        disk.free.clear()
        assert "0.05 s" in await run.evidence.wait_until_stored()
        disk.free.set()
        assert await run.evidence.wait_until_stored() == ""
        run.evidence.close()

    asyncio.run(story())
