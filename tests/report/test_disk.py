"""A slow disk below the evidence holds nobody up, and nothing is armed before it has what was written."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.report.evidence import book
from swarmctl.report.evidence.book import FILE_NAME, EvidenceFile
from swarmctl.report.evidence.chain import check
from swarmctl.report.evidence.hooks import Evidence

ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


class SlowDisk:
    """Takes a sync when it is told to; at once while nobody holds it up."""

    def __init__(self) -> None:
        self.free = threading.Event()
        self.free.set()
        self.error: OSError | None = None
        self.synced: list[int] = []
        """how long the file was at the beginning of each sync [bytes]"""

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


def test_a_disk_that_takes_nothing_holds_up_neither_the_loop_nor_the_order_of_entries(
    disk: SlowDisk, tmp_path: Path
) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        assert await run.evidence.settled() == ""
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
        assert await run.evidence.settled() == ""
        # One was under way, and one more took all the rest.
        assert len(disk.synced) == before + 2
        run.evidence.close()
        checked = check(run.lines)
        assert checked.fault is None
        assert checked.closing == {"entries": 11}

    asyncio.run(story())


def test_it_is_settled_when_all_that_was_written_is_on_the_disk(disk: SlowDisk, tmp_path: Path) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        disk.free.clear()
        run.evidence.remark("before")
        waits = asyncio.create_task(run.evidence.settled())
        await asyncio.sleep(0.01)
        run.evidence.remark("launch")
        also = asyncio.create_task(run.evidence.settled())
        await asyncio.sleep(0.01)
        assert not waits.done()
        assert not also.done()
        disk.free.set()
        assert (await waits, await also) == ("", "")
        assert disk.synced[-1] == run.file.stat().st_size
        run.evidence.close()

    asyncio.run(story())


def test_a_disk_that_fails_later_is_said_once_and_nothing_is_armed_any_more(
    disk: SlowDisk, tmp_path: Path
) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        await run.evidence.settled()
        disk.error = OSError(5, "Input/output error")
        assert run.evidence.to_vehicle(1, ARM)
        assert "the evidence ends here: Input/output error" in await run.evidence.settled()
        assert not run.evidence.to_vehicle(1, ARM)
        assert [text.partition(": ")[2] for text in run.said] == [
            "the evidence ends here: Input/output error; no vehicle is armed any more"
        ]
        run.evidence.close()
        assert "ends here" in run.evidence.trouble

    asyncio.run(story())


def test_a_disk_that_fails_while_the_run_ends_is_said_too(disk: SlowDisk, tmp_path: Path) -> None:
    async def story() -> None:
        run = Run(tmp_path)
        await run.evidence.settled()
        disk.error = OSError(5, "Input/output error")
        run.evidence.to_vehicle(1, ARM)
        run.evidence.close()
        assert "ends here: Input/output error" in run.evidence.trouble
        await asyncio.sleep(0)
        assert len(run.said) == 1

    asyncio.run(story())


def test_a_disk_that_never_answers_is_not_waited_for_for_ever(
    disk: SlowDisk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(book, "SETTLES_S", 0.05)

    async def story() -> None:
        run = Run(tmp_path)
        await run.evidence.settled()
        disk.free.clear()
        assert "the disk has not taken the evidence within 0.05 s" in await run.evidence.settled()
        disk.free.set()
        assert await run.evidence.settled() == ""
        run.evidence.close()

    asyncio.run(story())
