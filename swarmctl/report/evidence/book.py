"""The file of a run's evidence: each entry is the operating system's before what it tells of happens."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from swarmctl.report.evidence.chain import Chain, Entry, Kind, sealed
from swarmctl.report.evidence.disk import Disk

FILE = "evidence.jsonl"
SETTLES_S = 10.0
"""A disk that takes longer than this is not waited for any more."""


class Signer(Protocol):
    @property
    def name(self) -> str:
        """Whose key it is."""

    @property
    def public_key(self) -> str:
        """In base64."""

    def sign(self, data: bytes) -> str:
        """Ed25519, in base64."""


class Book:
    """Appends to one file until `close`. A disk that is full ends it, is said, and does not raise."""

    def __init__(
        self,
        path: Path,
        opened: Entry,
        *,
        unix_s: Callable[[], float],
        run_s: Callable[[], float],
        say: Callable[[str], None],
        in_thread: bool = False,
    ) -> None:
        """`opened` says what run this is. Raises OSError where the file cannot be begun.

        `in_thread`: the disk is waited for in a thread, which needs a running loop.
        """
        self.trouble = ""
        """why it ends early"""
        self._path = path
        self._unix_s, self._run_s, self._say = unix_s, run_s, say
        self._chain = Chain()
        self._file = path.open("xb", buffering=0)
        self._disk = Disk(self._file.fileno(), self._end, in_thread=in_thread)
        self.add("opened", opened, durable=True)

    @property
    def is_closed(self) -> bool:
        return self._file.closed

    def add(self, kind: Kind, what: Entry, vehicle: str | None = None, *, durable: bool = False) -> bool:
        """Whether it is written; `durable`: it will soon outlive a loss of power, too."""
        if self.trouble or self._file.closed:
            return False
        line = self._chain.link(kind, vehicle, what, unix_s=self._unix_s(), run_s=self._run_s())
        try:
            self._write(line)
        except OSError as error:
            self._end(error)
        else:
            if durable:
                self._disk.sync()
        return not self.trouble

    async def settled(self) -> str:
        """Wait until what was written would outlive a loss of power; why it does not, empty if it does."""
        if self.trouble or self._file.closed:
            return self.trouble or f"{self._path}: the evidence is closed"
        self._disk.sync()
        try:
            async with asyncio.timeout(SETTLES_S):
                await self._disk.idle()
        except TimeoutError:
            return f"{self._path}: the disk has not taken the evidence within {SETTLES_S:g} s"
        return self.trouble

    def _write(self, line: bytes) -> None:
        written = self._file.write(line)
        if written != len(line):
            raise OSError(f"{written} of {len(line)} bytes were taken; is the disk full?")

    def _end(self, error: OSError) -> None:
        if not self.trouble:
            self.trouble = f"{self._path}: the evidence ends here: {error.strerror or error}"
            self._say(f"{self.trouble}; no vehicle is armed any more")

    def close(self, signer: Signer | None = None) -> None:
        """Write the closing entry, signed where there is a key. Idempotent."""
        if self._file.closed:
            return
        entries, last = self._chain.n, self._chain.last
        what: dict[str, object] = {"entries": entries}
        if signer is not None:
            signature = signer.sign(sealed(entries, last))
            what["signature"] = {"by": signer.name, "key": signer.public_key, "signature": signature}
        self.add("closed", what)
        self._disk.close()
        self._file.close()
