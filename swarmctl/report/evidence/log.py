"""The writer of a run's evidence. An entry is written before its command is sent."""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, Protocol

from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.parameters import BYTE_WISE
from swarmctl.report.evidence.chain import (
    GENESIS,
    Closed,
    EntryKind,
    Opened,
    Signature,
    line_of,
    signed_content,
)
from swarmctl.report.evidence.commands import UNRECORDED, arms, content
from swarmctl.report.ui import Observer

FILE_NAME = "evidence.jsonl"
SYNC_TIMEOUT_S = 10.0
"""longest wait for a sync to the disk [s]"""


class Signer(Protocol):
    """The owner of an Ed25519 key; public key and signature are in base64."""

    @property
    def name(self) -> str: ...
    @property
    def public_key(self) -> str: ...
    def sign(self, data: bytes) -> str: ...


class Evidence(Observer):
    """The evidence of one run, also an `EvidenceRecorder` for the front end.

    A failed write or sync, as on a full disk, ends the evidence. The operator is told, and no further vehicle
    is armed.
    """

    def __init__(
        self,
        path: Path,
        opened: Opened,
        *,
        now: Callable[[], float],
        unix_s_at_zero: float,
        say: Callable[[str], None],
        waits_in_thread: bool = False,
    ) -> None:
        """Create the file; `opened` describes the run. Raises OSError if the file cannot be created.

        now: the clock of the run [s]
        waits_in_thread: leave the loop running during a wait for the disk; False: the loop stops
        """
        self.trouble = ""
        """reason for an early end of the evidence; empty if there is none"""
        self._path = path
        self._names = {sysid: name for name, sysid in opened.vehicles.items()}
        self._now, self._unix_s_at_zero, self._say = now, unix_s_at_zero, say
        self._began_s, self._waits_in_thread = now(), waits_in_thread
        self._autopilots: dict[int, int] = {}
        self._n, self._last_hash = 0, GENESIS
        self._file = path.open("xb", buffering=0)
        self._syncs = ThreadPoolExecutor(1, "evidence")
        self._sync_error: OSError | None = None
        self._add("opened", opened)

    def to_vehicle(self, sysid: int, message: Message, by: str = "") -> bool:
        """Record a message to the vehicle `sysid` (0: all) and return whether the message may be sent.

        A message that arms a vehicle may be sent only if it was recorded. `by` names another station.
        """
        if message.get_type() in UNRECORDED:
            return True
        what = content(message, byte_wise=self._autopilots.get(sysid) in BYTE_WISE)
        vehicle = self._names.get(sysid, f"system {sysid}") if sysid else None
        self._add("command", {**what, "by": by} if by else what, vehicle)
        if not arms(what):
            return True
        if self.trouble or self._file.closed:
            return False
        self._begin_sync()
        return True

    def from_vehicle(self, sysid: int, message: Message) -> None:
        """Note the autopilot, because integer parameters of PX4 have another form."""
        if message.get_type() == "HEARTBEAT":
            self._autopilots[sysid] = int(message.autopilot)

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        """Record an operator's request with its answer."""
        match event:
            case ev.OperatorCommand(order=order, request_id=int(), ignore=ignored, by=by):
                asks: dict[str, Any] = {"action": str(order), "ignore": ignored}
            case ev.WeightsChanged(w=w, strength=strength, range=reach, by=by, behaviours=behaviours):
                asks = {"action": "weights", "w": w, "firing_strength": strength}
                asks |= {} if reach is None else {"range": reach}
                asks |= {"behaviours": behaviours} if behaviours else {}
            case _:
                return
        asks |= {"by": by} if by else {}
        for effect in effects:
            if isinstance(effect, ev.Answer):
                asks |= {"outcome": effect.answer.outcome, "note": effect.answer.note}
        self.operator(vehicle=after.task.name, **asks)

    def waived(self, vehicle: str | None, check: str, because: str = "") -> None:
        """Record that an operator lets a preflight check fail."""
        self._add("waiver", {"check": check, "because": because}, vehicle)

    def operator(self, action: str, vehicle: str | None = None, **more: Any) -> None:
        """Record an action of a person."""
        self._add("operator", {"asks": action, **more}, vehicle)

    def remark(self, text: str) -> None:
        """Record a note about the whole run."""
        self._add("note", {"said": text})

    async def wait_until_stored(self) -> str:
        """Wait for all entries to reach the disk; return the failure, or "".

        In a thread the wait ends after SYNC_TIMEOUT_S. While the loop stops, on a virtual clock, it has no
        end: a flight must not depend on the speed of the disk.
        """
        if self._file.closed:
            return f"{self._path}: the evidence is closed"
        sync = self._begin_sync()
        if self._waits_in_thread:
            await asyncio.wait({asyncio.wrap_future(sync)}, timeout=SYNC_TIMEOUT_S)
        else:
            wait({sync})
        if not sync.done():
            return f"{self._path}: the disk has not stored the evidence within {SYNC_TIMEOUT_S:g} s"
        self._end(self._sync_error)
        return self.trouble

    def close(self, signer: Signer | None = None) -> None:
        """Write the closing entry and close the file. Idempotent.

        The entry has the hashes of the record and the tlogs, which must be complete, and a signature if a
        signer is given.
        """
        if self._file.closed:
            return
        try:
            folder = self._path.parent
            files = {p.name: sha256_of(p) for p in sorted((*folder.glob("*.mcap"), *folder.glob("*.tlog")))}
        except OSError as error:
            self._end(error)
        else:
            closed = Closed(files)
            if signer is not None:
                signature = signer.sign(signed_content(self._n, self._last_hash, files))
                closed.signature = Signature(signer.name, signer.public_key, signature)
            self._add("closed", closed)
        self._begin_sync()
        self._syncs.shutdown()
        self._end(self._sync_error)
        self._file.close()

    def _add(self, kind: EntryKind, what: Any, vehicle: str | None = None) -> None:
        """Append an entry unless the evidence has ended."""
        self._end(self._sync_error)
        if self.trouble or self._file.closed:
            return
        now = self._now()
        unix_s, run_s = self._unix_s_at_zero + now, now - self._began_s
        line, self._last_hash = line_of(
            self._n, self._last_hash, kind, vehicle, what, unix_s=unix_s, run_s=run_s
        )
        self._n += 1
        try:
            written = self._file.write(line)
        except OSError as error:
            self._end(error)
        else:
            if written != len(line):
                self._end(OSError(f"{written} of {len(line)} bytes written; is the disk full?"))

    def _begin_sync(self) -> Future[None]:
        """Begin a sync in the thread, after the earlier ones."""
        return self._syncs.submit(self._sync)

    def _sync(self) -> None:
        try:
            os.fsync(self._file.fileno())
        except OSError as error:  # The system reports each failure only once.
            self._sync_error = self._sync_error or error

    def _end(self, error: OSError | None) -> None:
        if error is not None and not self.trouble:
            self.trouble = f"{self._path}: the evidence ends early: {error.strerror or error}"
            self._say(f"{self.trouble}; flights continue, but no further vehicle is armed [evidence-ended]")


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
