"""The file of a run's evidence. An entry is written before its command is sent."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from swarmctl.report.evidence.chain import Chain, Content, EntryKind, signed_content
from swarmctl.report.evidence.disk import FileSync

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
    """An append-only file. A failed write, as on a full disk, ends the evidence; the operator is told."""

    def __init__(
        self,
        path: Path,
        opened: Content,
        *,
        unix_s: Callable[[], float],
        run_s: Callable[[], float],
        say: Callable[[str], None],
        in_thread: bool = False,
    ) -> None:
        """Create the file; `opened` describes the run. Raises OSError if the file cannot be created.

        `in_thread`: sync in a separate thread; a durable entry then needs a running event loop.
        """
        self.trouble = ""
        """reason for an early end of the evidence; empty if there is none"""
        self._path = path
        self._unix_s, self._run_s, self._say = unix_s, run_s, say
        self._chain = Chain()
        self._file = path.open("xb", buffering=0)
        self._file_sync = FileSync(self._file.fileno(), self._end, in_thread=in_thread)
        self.add("opened", opened, durable=True)

    @property
    def is_closed(self) -> bool:
        return self._file.closed

    def add(
        self, kind: EntryKind, what: Content, vehicle: str | None = None, *, durable: bool = False
    ) -> bool:
        """Append an entry; return False if the evidence has ended. `durable`: begin a sync of the file."""
        if self.trouble or self._file.closed:
            return False
        line = self._chain.append(kind, vehicle, what, unix_s=self._unix_s(), run_s=self._run_s())
        try:
            self._write(line)
        except OSError as error:
            self._end(error)
        else:
            if durable:
                self._file_sync.sync()
        return not self.trouble

    async def wait_until_stored(self) -> str:
        """Wait at most SYNC_TIMEOUT_S for all entries to reach the disk; return the failure, or ""."""
        if self.trouble or self._file.closed:
            return self.trouble or f"{self._path}: the evidence is closed"
        self._file_sync.sync()
        try:
            async with asyncio.timeout(SYNC_TIMEOUT_S):
                await self._file_sync.wait_idle()
        except TimeoutError:
            return f"{self._path}: the disk has not stored the evidence within {SYNC_TIMEOUT_S:g} s"
        return self.trouble

    def _write(self, line: bytes) -> None:
        written = self._file.write(line)
        if written != len(line):
            raise OSError(f"{written} of {len(line)} bytes written; is the disk full?")

    def _end(self, error: OSError) -> None:
        if not self.trouble:
            self.trouble = f"{self._path}: the evidence ends early: {error.strerror or error}"
            self._say(f"{self.trouble}; flights continue, but no further vehicle is armed [evidence-ended]")

    def close(self, signer: Signer | None = None) -> None:
        """Write the closing entry, signed if a signer is given, and close the file. Idempotent."""
        if self._file.closed:
            return
        n_entries, last_hash = self._chain.n, self._chain.last_hash
        what: dict[str, object] = {"entries": n_entries}
        if signer is not None:
            signature = signer.sign(signed_content(n_entries, last_hash))
            what["signature"] = {"by": signer.name, "key": signer.public_key, "signature": signature}
        self.add("closed", what)
        self._file_sync.close()
        self._file.close()
