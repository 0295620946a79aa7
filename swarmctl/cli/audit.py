"""`swarmctl audit`: check and summarise the evidence of a run."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.console import FAILED, USAGE, fail, out, say
from swarmctl.core.operator_text import printable
from swarmctl.report import record_file
from swarmctl.report.evidence.chain import CheckedChain, Closed, Entry, check, signed_content
from swarmctl.report.evidence.commands import CHANGED_PART
from swarmctl.report.evidence.digest import VehicleDigest, digest
from swarmctl.report.evidence.log import FILE_NAME, sha256_of
from swarmctl.report.tables import Column, FittedTable
from swarmctl.security.evidence_keys import is_valid_signature, key_trouble, signer_trouble
from swarmctl.security.files import KeyringError

UNSIGNED = (
    "the evidence is not signed. A program that can write the file can make a new chain with another final "
    "hash. So note the final hash elsewhere and compare it later, or fly with `communication.keys` "
    "[evidence-not-signed]"
)


def audit(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", help=f"A run folder, or its {FILE_NAME}.", show_default=False)
    ],
    keys: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="The swarm's keys; the operator or the vehicle's own agent must have signed the evidence.",
        ),
    ] = None,
    shows_all: Annotated[bool, typer.Option("--all", help="Show every entry besides the summary.")] = False,
) -> None:
    """Check the evidence of a run line by line, and summarise it.

    The evidence is a chain: each line has the hash of the line before. The last line has the hashes of the
    record and the tlogs. The answers and effects in the table are those in the tlogs.
    """
    if keys is not None and not keys.is_dir():
        fail(
            [f"--keys {keys}: not a folder; give the folder of the swarm's keys (communication.keys)"], USAGE
        )
    path = run / FILE_NAME if run.is_dir() else run
    try:
        with path.open("rb") as file:
            checked = check(file)
    except FileNotFoundError:
        fail([str(record_file.not_found(path))], USAGE)
    except OSError as error:
        fail([f"{path}: cannot be read: {error.strerror or error}"], USAGE)
    if checked.other_format:
        fail([f"{path}: {checked.other_format}"], USAGE)
    closing = checked.closing or Closed()
    missing, changed = _file_troubles(path.parent, closing)
    if checked.entries:
        _show(checked, _tlogs(path.parent, checked, except_for=changed), shows_all=shows_all)
    may_miss = not run.is_dir()
    troubles = [*_troubles(path, checked, keys), *changed.values(), *([] if may_miss else missing)]
    if troubles:
        fail([printable(text) for text in troubles], FAILED)
    not_checked = f" ({len(missing)} not here, so not checked)" if missing else ""
    _say(
        f"{path}: complete and unchanged: {len(checked.entries)} entries, with the hashes of "
        f"{len(closing.files)} files{not_checked}; the final hash is {checked.last_hash}"
    )
    _say(_signed_by(closing, keys))


def _say(text: str) -> None:
    say(printable(text))


def _file_troubles(folder: Path, closing: Closed) -> tuple[list[str], dict[str, str]]:
    """Return messages about missing files, and about files that differ from the closing entry, by name."""
    missing, changed = [], {}
    for name, expected in closing.files.items():
        path = folder / Path(name).name
        try:
            found = sha256_of(path)
        except FileNotFoundError:
            missing.append(f"{path}: missing; expected the SHA-256 {expected} [file-changed]")
            continue
        except (OSError, ValueError) as error:
            found = str(error)
        if found != expected:
            changed[name] = (
                f"{path}: changed after the flight, and left out of the table: found {found}, expected the "
                f"SHA-256 {expected} [file-changed]"
            )
    return missing, changed


def _tlogs(folder: Path, checked: CheckedChain, except_for: Container[str]) -> dict[str, bytes]:
    """Return the contents of the tlogs by vehicle."""
    found = {}
    for vehicle in checked.opened.vehicles:
        name = f"{Path(vehicle).name}.tlog"
        with contextlib.suppress(OSError, ValueError):
            if name not in except_for:
                found[vehicle] = (folder / name).read_bytes()
    return found


def _troubles(path: Path, checked: CheckedChain, keys: Path | None) -> Iterator[str]:
    """Return the faults of chain and signature."""
    n, closing = len(checked.entries), checked.closing
    if checked.fault:
        yield (
            f"{path}:{n + 1}: the chain breaks at this line: {checked.fault}; only the {n} lines before it "
            "are unchanged [chain-broken]"
        )
    elif closing is None:
        place = f"{path}:{n}" if n else f"{path}"
        yield (
            f"{place}: the evidence is not closed: the process died, or lines were cut; the last valid "
            f"hash is {checked.last_hash} [not-closed]"
        )
    elif closing.signature is None:
        if keys is not None:
            text = f"expected a signature by a key of {keys}"
            yield f"{path}: the evidence is not signed; {text} [evidence-not-signed]"
    else:
        by, key, signature = closing.signature.by, closing.signature.key, closing.signature.signature
        signed = signed_content(n - 1, checked.entries[-1].previous, closing.files)
        if not is_valid_signature(signed, key, signature):
            text = "the chain was rewritten after it was signed"
            yield f"{path}: the signature by {by} is invalid: {text} [signature-invalid]"
        elif keys is not None:
            mentioned = (entry.vehicle for entry in checked.entries if entry.vehicle is not None)
            try:
                if why := key_trouble(keys, by, key):
                    yield f"{path}: signed by {by} with the key {key}; {why}"
                elif why := signer_trouble(by, checked.opened.vehicles, mentioned):
                    yield f"{path}: signed by {by}, but {why} [signed-by-another]"
            except KeyringError as error:
                fail([str(error)], USAGE)


def _signed_by(closing: Closed, keys: Path | None) -> str:
    if closing.signature is None:
        return UNSIGNED
    signer = f"signed by {closing.signature.by} with the key {closing.signature.key}"
    if keys is None:
        return f"{signer}; give --keys FOLDER to check this key"
    return f"{signer}, as {keys} lists it; only the owner of that key could have rewritten the chain"


def _show(checked: CheckedChain, tlogs: Mapping[str, bytes], *, shows_all: bool) -> None:
    opened, began = checked.opened, datetime.fromtimestamp(checked.entries[0].unix_s, UTC)
    _say(f"{opened.run}, flown by {opened.program}, began {began:%Y-%m-%d %H:%M:%S} UTC")
    _say(f"configuration SHA-256 {opened.configuration_sha256}")
    if (earlier := opened.continues) is not None:
        text = f"goes on with {earlier.run} after its {earlier.entries} entries"
        _say(f"{text}, final hash {earlier.last_hash}; its vehicles may be armed since then")
    vehicles = ", ".join(f"{name} (system {sysid})" for name, sysid in opened.vehicles.items())
    _say(f"vehicles: {vehicles or 'not recorded'}")
    for entry in checked.entries if shows_all else ():
        _say(_line(entry))
    digests = digest(checked, tlogs)
    out.print(_table(digests, tlogs.keys(), are_proved=checked.closing is not None))
    for entry in checked.entries:
        if entry.kind in ("waiver", "operator"):
            _say(_line(entry))
    for vehicle, found in digests.items():
        if found.unasked:
            _say(f"{vehicle}: changes without a recorded command: {_counted(found.unasked)}")
        if n := found.n_disarmed_on_ground:
            _say(f"{vehicle}: disarmed automatically after landing{f' × {n}' if n > 1 else ''}")


COLUMNS = (
    Column("vehicle", "left"),
    Column("command", "left"),
    Column("sent"),
    Column("answered", "left", wraps_at=13),
    Column("re-\nfused"),
    Column("no\nanswer"),
    Column("seen", "left", rank=1, wraps_at=11),
)


def _table(
    digests: Mapping[str, VehicleDigest], with_tlog: Container[str], *, are_proved: bool
) -> FittedTable:
    caption = ["seen: the first change of mode, arming or current item after the command"]
    if not are_proved:
        caption.append("answers and effects are from tlogs that the evidence does not cover")
    if not all(vehicle in with_tlog for vehicle in digests):
        caption.append("?: no unchanged tlog, so the answers are unknown")
    table = FittedTable(COLUMNS, caption=caption, elsewhere="`swarmctl audit --all`")
    for vehicle, found in digests.items():
        for command, row in found.rows.items():
            cells = (
                vehicle,
                command,
                f"{row.sent} ({row.by_others} by others)" if row.by_others else f"{row.sent}",
                _counted(row.answers),
                str(row.refused or ""),
                str(row.unanswered or "") if vehicle in with_tlog else "?",
                f"{CHANGED_PART[command]} {_counted(row.effects)}" if row.effects else "",
            )
            table.add_row(*map(printable, cells))
    return table


def _counted(counter: Counter[str]) -> str:
    return ", ".join(f"{text} × {n}" if n > 1 else text for text, n in counter.items())


def _line(entry: Entry) -> str:
    text = ", ".join(f"{name} {value}" for name, value in entry.what.items() if value not in (None, "", []))
    return f"{entry.run_s:9.3f} s  {entry.vehicle or 'all':<8} {entry.kind:<9} {text}"
