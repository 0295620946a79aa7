"""The chain of entries: the form of a line, and the check of a file. Pure."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import msgspec

from swarmctl import __version__

FORMAT = 2
GENESIS = "0" * 64
"""`previous` of the first entry"""
EntryKind = Literal["opened", "command", "waiver", "operator", "note", "closed"]
MAX_UNIX_S = 253_402_300_799
"""end of the year 9999"""
MAX_SHOWN_CHARS = 200
_HASH_PART = len(f'{{"hash":"{GENESIS}",')
"""length of the first key with its value"""


class Entry(msgspec.Struct, forbid_unknown_fields=True):
    """One line; the hash covers all bytes but its own key and the line end."""

    n: int
    unix_s: Annotated[float, msgspec.Meta(ge=0, le=MAX_UNIX_S)]
    run_s: float
    vehicle: str | None
    kind: EntryKind
    what: dict[str, Any]
    previous: str
    hash: str


class Continued(msgspec.Struct):
    """The evidence of an earlier run, which this run continues."""

    run: str
    entries: int
    last_hash: str


class Opened(msgspec.Struct):
    """`what` of the first entry."""

    format: int = FORMAT
    run: str = ""
    program: str = f"swarmctl {__version__}"
    configuration_sha256: str = ""
    clock: str = ""
    vehicles: dict[str, int] = {}
    """system ids, by name"""
    continues: Continued | None = None


class Signature(msgspec.Struct, frozen=True):
    by: str
    key: str
    """public key, in base64"""
    signature: str
    """in base64"""


class Closed(msgspec.Struct):
    """`what` of the last entry."""

    files: dict[str, str] = {}
    """SHA-256 of the run's other files, by name"""
    signature: Signature | None = None


_CONTENTS: dict[str, type[Opened | Closed]] = {"opened": Opened, "closed": Closed}


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def line_of(
    n: int, previous: str, kind: EntryKind, vehicle: str | None, what: Any, *, unix_s: float, run_s: float
) -> tuple[bytes, str]:
    """Return the line of an entry with the line end, and its hash."""
    content = {"n": n, "unix_s": round(unix_s, 6), "run_s": round(run_s, 6), "vehicle": vehicle, "kind": kind}
    body = msgspec.json.encode({**content, "what": what, "previous": previous})
    own_hash = sha256(body)
    return b'{"hash":"%s",%s\n' % (own_hash.encode(), body[1:]), own_hash


def signed_content(n_entries: int, last_hash: str, files: dict[str, str]) -> bytes:
    """Return the bytes that a signature covers: number and last hash of the entries before it, and files."""
    content = {"entries": n_entries, "previous": last_hash} | ({"files": files} if files else {})
    return b"swarmctl evidence\0" + json.dumps(content, sort_keys=True, separators=(",", ":")).encode()


class CheckedChain(msgspec.Struct, frozen=True):
    """The result of the check of a file of entries."""

    entries: tuple[Entry, ...]
    """all entries; if there is a fault, the entries before the fault"""
    fault: str
    """the fault of the line after `entries`; empty without a fault"""
    is_torn: bool = False
    """True if the fault is a last line without its end, as after the death of the process"""

    @property
    def last_hash(self) -> str:
        return self.entries[-1].hash if self.entries else GENESIS

    @property
    def opened(self) -> Opened:
        """The description of the run in the first entry."""
        return msgspec.convert(self.entries[0].what if self.entries else {}, Opened)

    @property
    def closing(self) -> Closed | None:
        """The content of the closing entry; None if there is a fault or no closing entry."""
        is_closed = not self.fault and self.entries and self.entries[-1].kind == "closed"
        return msgspec.convert(self.entries[-1].what, Closed) if is_closed else None

    @property
    def other_format(self) -> str:
        """The reason why this version cannot read the evidence; empty if it can."""
        if self.opened.format == FORMAT:
            return ""
        text = f"the evidence has format {self.opened.format}, and swarmctl {__version__} reads {FORMAT}"
        return f"{text}; use the version that wrote it [other-format]"


def check(lines: Iterable[bytes]) -> CheckedChain:
    """Return the entries of a chain up to its end or its first fault. Lines that are not JSON are faults."""
    entries: list[Entry] = []
    for line in lines:
        if not line.endswith(b"\n"):
            fault = "found a line without its end: the process died while writing it, or the line was cut"
            return CheckedChain(tuple(entries), fault, is_torn=True)
        try:
            entry = msgspec.json.decode(line, type=Entry)
            msgspec.convert(entry.what, _CONTENTS.get(entry.kind, dict))
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            fault = f"found a line that is not an entry: {error}"
        else:
            fault = _fault(entry, sha256(b"{" + line[_HASH_PART:-1]), entries)
        if fault:
            return CheckedChain(tuple(entries), fault)
        entries.append(entry)
    return CheckedChain(tuple(entries), "")


def _fault(entry: Entry, actual_hash: str, before: list[Entry]) -> str:
    last = before[-1] if before else None
    rules = (
        ("lines were removed, added or moved: found the number", entry.n, len(before)),
        ("the line was changed: found the hash", entry.hash, actual_hash),
        (
            "a line before was changed: found the previous hash",
            entry.previous,
            last.hash if last else GENESIS,
        ),
        ("lines were moved: found an opening entry", entry.kind == "opened", last is None),
        (
            "lines were added: found an entry after the last",
            last is not None and last.kind == "closed",
            False,
        ),
    )
    wrong = (rule for rule in rules if rule[1] != rule[2])
    return next((f"{text} {str(found)[:MAX_SHOWN_CHARS]}, expected {due}" for text, found, due in wrong), "")
