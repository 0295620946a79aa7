"""The file of a run's evidence. An entry is written before its command is sent."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from swarmctl.report.evidence.chain import Chain, Entry, Kind, sealed
from swarmctl.report.evidence.disk import Disk

FILE_NAME = "evidence.jsonl"
SYNC_TIMEOUT_S = 10.0
"""longest wait for a sync to the disk [s]"""


class Signer(Protocol):
    @property
    def name(self) -> str:
        """The owner of the key."""

    @property
    def public_key(self) -> str:
        """The public key in base64."""

    def sign(self, data: bytes) -> str:
        """Return the Ed25519 signature in base64."""


class EvidenceFile:
    """An append-only file. A full disk ends the file with a message to the operator, without an exception."""

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
        """Create the file; `opened` describes the run. Raises OSError if the file cannot be created.

        `in_thread`: sync in a separate thread, which needs a running loop.
        """
        self.trouble = ""
        """reason for an early end of the evidence"""
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
        """Append an entry and return whether the entry is written; `durable`: sync the file soon."""
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
        """Wait until all entries are on the disk; return the reason of a failure, or an empty text."""
        if self.trouble or self._file.closed:
            return self.trouble or f"{self._path}: the evidence is closed"
        self._disk.sync()
        try:
            async with asyncio.timeout(SYNC_TIMEOUT_S):
                await self._disk.idle()
        except TimeoutError:
            return f"{self._path}: the disk has not taken the evidence within {SYNC_TIMEOUT_S:g} s"
        return self.trouble

    def _write(self, line: bytes) -> None:
        written = self._file.write(line)
        if written != len(line):
            raise OSError(f"{written} of {len(line)} bytes written; is the disk full?")

    def _end(self, error: OSError) -> None:
        if not self.trouble:
            self.trouble = f"{self._path}: the evidence ends early: {error.strerror or error}"
            self._say(f"{self.trouble}; no further vehicle is armed [evidence-ended]")

    def close(self, signer: Signer | None = None) -> None:
        """Write the closing entry, signed if a signer is given. Idempotent."""
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
