"""The chain of entries: the form of a line, and the check of a file. Pure."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import msgspec

FORMAT = 1
GENESIS = "0" * 64
"""`previous` of the first entry"""

EntryKind = Literal["opened", "command", "acknowledgement", "effect", "waiver", "operator", "note", "closed"]
MAX_UNIX_S = 253_402_300_799
"""end of the year 9999"""
MAX_SHOWN_CHARS = 200


class _Line(msgspec.Struct, forbid_unknown_fields=True):
    """The keys and types of an entry."""

    n: int
    unix_s: Annotated[float, msgspec.Meta(ge=0, le=MAX_UNIX_S)]
    run_s: float
    vehicle: str | None
    kind: EntryKind
    what: dict[str, Any]
    previous: str
    hash: str


class Signature(msgspec.Struct, frozen=True):
    """The signature in the closing entry."""

    by: str
    key: str
    """public key, in base64"""
    signature: str
    """in base64"""


class _Opened(msgspec.Struct):
    vehicles: dict[str, int] = {}


Entry = Mapping[str, Any]
Content = Mapping[str, Any]
"""`what` of an entry"""


def canonical(value: Any) -> bytes:
    """Return canonical JSON: keys sorted, no spaces, ASCII; NaN and infinity as text, bytes as hex digits."""
    return json.dumps(_plain(value), sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, (bytes, bytearray)):
        return bytes(value).hex()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


class Chain:
    """The state of a chain after its last line."""

    def __init__(self) -> None:
        self.n = 0
        """number of entries so far"""
        self.last_hash = GENESIS
        """the hash of the last entry"""

    def append(
        self, kind: EntryKind, vehicle: str | None, what: Content, *, unix_s: float, run_s: float
    ) -> bytes:
        """Add an entry; return its line with the line end."""
        entry = {
            "n": self.n,
            "unix_s": round(unix_s, 6),
            "run_s": round(run_s, 6),
            "vehicle": vehicle,
            "kind": kind,
            "what": what,
            "previous": self.last_hash,
        }
        body = canonical(entry)
        self.last_hash = sha256(body)
        self.n += 1
        # "hash" is the first key in canonical order.
        return b'{"hash":"%s",%s\n' % (self.last_hash.encode(), body[1:])


@dataclass(frozen=True, slots=True)
class ChainFault:
    """The first line where a chain is broken."""

    line: int
    """from 1"""
    found: str
    expected: str


@dataclass(frozen=True, slots=True)
class CheckedChain:
    """The result of the check of a file of entries."""

    entries: tuple[Entry, ...]
    """all entries; if there is a fault, the entries before the fault"""
    fault: ChainFault | None
    last_hash: str
    """the hash of the last of `entries`; GENESIS if there are none"""

    @property
    def opened(self) -> Content:
        """The description of the run in the first entry; empty if there are no entries."""
        return self.entries[0]["what"] if self.entries else {}

    @property
    def vehicles(self) -> dict[str, int]:
        """The system ids of the run's vehicles, by name; empty if the first entry has none."""
        return msgspec.convert(self.opened, _Opened).vehicles

    @property
    def signature(self) -> Signature | None:
        """The signature of the closing entry; None for unsigned evidence."""
        signature = (self.closing or {}).get("signature")
        return None if signature is None else msgspec.convert(signature, Signature)

    @property
    def closing(self) -> Content | None:
        """The content of the closing entry; None if there is a fault or no closing entry."""
        is_closed = self.fault is None and self.entries and self.entries[-1]["kind"] == "closed"
        return self.entries[-1]["what"] if is_closed else None


def check(lines: Iterable[bytes]) -> CheckedChain:
    """Return the entries of a chain up to its end or its first fault. Lines that are not JSON are faults."""
    entries: list[Entry] = []
    last = GENESIS
    for line in lines:
        entry, fault = _read(line)
        if entry is not None:
            fault = _mismatch(entry, entries, last)
        if entry is None or fault is not None:
            found, expected = (text[:MAX_SHOWN_CHARS] for text in fault or ("", ""))
            return CheckedChain(tuple(entries), ChainFault(len(entries) + 1, found, expected), last)
        entries.append(entry)
        last = entry["hash"]
    return CheckedChain(tuple(entries), None, last)


_Mismatch = tuple[str, str]
"""found, expected"""


def _read(line: bytes) -> tuple[Entry | None, _Mismatch | None]:
    if not line.endswith(b"\n"):
        return None, (
            "a line without its end",
            "a whole line: the process died while writing this line, or the line was cut",
        )
    try:
        entry = json.loads(line)
        is_canonical = canonical(entry) + b"\n" == line
    except (ValueError, RecursionError):
        return None, ("a line that is not JSON", "an entry as this program writes it")
    if not is_canonical:
        return None, ("another form of JSON than the canonical one", "the line as it was written")
    try:
        _check_types(entry)
    except msgspec.ValidationError as error:
        return None, ("a line that is not an entry", str(error)[:MAX_SHOWN_CHARS])
    return entry, None


def _check_types(entry: Any) -> None:
    """Raise msgspec.ValidationError unless an entry has all keys, with the right types."""
    line = msgspec.convert(entry, _Line)
    if line.kind == "opened":
        msgspec.convert(line.what, _Opened)
    elif line.kind == "closed" and line.what.get("signature") is not None:
        msgspec.convert(line.what["signature"], Signature)


def _mismatch(entry: Entry, before: list[Entry], last: str) -> _Mismatch | None:
    n = len(before)
    if before and before[-1]["kind"] == "closed":
        return f"entry {entry['n']} after the closing one", "the end of the file"
    if entry["n"] != n:
        return f"entry {entry['n']}", f"entry {n}: lines were removed or inserted here"
    if (entry["kind"] == "opened") != (n == 0):
        return f"an entry of the kind {entry['kind']}", "the opening entry first, and only there"
    if entry["previous"] != last:
        return f"the previous hash {entry['previous']}", f"{last}, the hash of the line before"
    actual_hash = sha256(canonical({key: value for key, value in entry.items() if key != "hash"}))
    if entry["hash"] != actual_hash:
        return f"the hash {entry['hash']}", f"{actual_hash}, the hash of the other keys: the line was changed"
    if entry["kind"] == "closed" and entry["what"].get("entries") != n:
        return f"a count of {entry['what'].get('entries')} entries", f"a count of {n}"
    return None


def signed_content(n_entries: int, last_hash: str) -> bytes:
    """Return the bytes that a signature covers: number and last hash of the entries before `closed`."""
    return b"swarmctl evidence\0" + canonical({"entries": n_entries, "previous": last_hash})
