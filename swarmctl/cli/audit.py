"""`swarmctl audit`: check and summarise the evidence of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from swarmctl.cli.console import FAILED, USAGE, fail, out, say
from swarmctl.core.operator_text import printable
from swarmctl.report.evidence.chain import CheckedChain, Entry, check, signed_content
from swarmctl.report.evidence.digest import Digest, digest
from swarmctl.report.evidence.file import FILE_NAME
from swarmctl.report.tables import Column, FittedTable
from swarmctl.security.evidence_keys import is_valid_signature, key_trouble, signer_trouble
from swarmctl.security.files import KeyringError

UNSIGNED = (
    "the evidence is not signed. A program that can write the file can make a new chain with another final "
    "hash. So note the final hash elsewhere and compare it later, or fly with `communication.keys` "
    "[evidence-not-signed]"
)

_LEADING = (
    *("message", "command", "items", "of", "first", "result", "times"),
    *("changed", "from", "to", "check", "asks", "decided", "ended", "failed"),
)
"""keys of an entry, in the order of the output; other keys follow in the order of the file"""


def register(cli: typer.Typer) -> None:
    cli.command()(audit)


def audit(
    run: Annotated[Path, typer.Argument(help=f"A run folder, or its {FILE_NAME}.", show_default=False)],
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

    The evidence is a chain: each line has the hash of the line before, and the last line has the number of
    the lines before it.
    """
    if keys is not None and not keys.is_dir():
        fail(
            [f"--keys {keys}: not a folder; give the folder of the swarm's keys (communication.keys)"], USAGE
        )
    path = run / FILE_NAME if run.is_dir() else run
    checked = _read_chain(path)
    if checked.entries:
        _show(checked, shows_all=shows_all)
    troubles = [printable(text) for text in _troubles(path, checked, keys)]
    if troubles:
        fail(troubles, FAILED)
    n_entries, last_hash = len(checked.entries), checked.last_hash
    say(f"{path}: complete and unchanged: {n_entries} entries; the final hash is {last_hash}")
    say(_signed_by(checked, keys))


def _read_chain(path: Path) -> CheckedChain:
    try:
        with path.open("rb") as file:
            return check(file)
    except FileNotFoundError:
        fail([f"{path}: no such file; give the folder of a run with its {FILE_NAME} [no-evidence]"], USAGE)
    except OSError as error:
        fail([f"{path}: cannot be read: {error.strerror or error}"], USAGE)


def _troubles(path: Path, checked: CheckedChain, keys: Path | None) -> Iterator[str]:
    if checked.fault is not None:
        fault = checked.fault
        yield (
            f"{path}:{fault.line}: the chain breaks at this line: found {fault.found}, expected "
            f"{fault.expected}; only the {len(checked.entries)} lines before it are unchanged [chain-broken]"
        )
    elif not checked.entries:
        yield f"{path}: the file is empty: the process died at once, or all lines were cut [not-closed]"
    elif checked.closing is None:
        yield (
            f"{path}:{len(checked.entries)}: the evidence is not closed: the process died, or lines were "
            f"cut; the last valid hash is {checked.last_hash} [not-closed]"
        )
    else:
        yield from _signature_troubles(path, checked, keys)


def _signature_troubles(path: Path, checked: CheckedChain, keys: Path | None) -> Iterator[str]:
    signature = checked.signature
    if signature is None:
        if keys is not None:
            yield (
                f"{path}: the evidence is not signed; expected a signature by a key of {keys} "
                "[evidence-not-signed]"
            )
        return
    by, key = signature.by, signature.key
    signed = signed_content(len(checked.entries) - 1, checked.entries[-1]["previous"])
    if not is_valid_signature(signed, key, signature.signature):
        yield (
            f"{path}: the signature by {by} is invalid: the chain was rewritten after it was signed "
            "[signature-invalid]"
        )
        return
    try:
        if keys is not None and (why := key_trouble(keys, by, key)):
            yield f"{path}: signed by {by} with the key {key}; {why}"
        elif keys is not None:
            mentioned = (entry["vehicle"] for entry in checked.entries if entry["vehicle"] is not None)
            if why := signer_trouble(by, checked.vehicles, mentioned):
                yield f"{path}: signed by {by}, but {why} [signed-by-another]"
    except KeyringError as error:
        fail([str(error)], USAGE)


def _signed_by(checked: CheckedChain, keys: Path | None) -> str:
    signature = checked.signature
    if signature is None:
        return UNSIGNED
    signer = printable(f"signed by {signature.by} with the key {signature.key}")
    if keys is None:
        return f"{signer}; give --keys FOLDER to check this key"
    return f"{signer}, as {keys} lists it; only the owner of that key could have rewritten the chain"


def _show(checked: CheckedChain, *, shows_all: bool) -> None:
    opened = checked.opened
    began = _time(checked.entries[0])
    say(printable(f"{opened.get('run')}, flown by {opened.get('program')}, began {began}"))
    say(printable(f"configuration SHA-256 {opened.get('configuration_sha256')}"))
    if isinstance(earlier := opened.get("continues"), dict):
        text = f"goes on with {earlier.get('run')} after its {earlier.get('entries')} entries"
        say(printable(f"{text}, final hash {earlier.get('last_hash')}; its vehicles may be armed since then"))
    vehicles = (f"{name} (system {sysid})" for name, sysid in checked.vehicles.items())
    say(printable(f"vehicles: {', '.join(vehicles) or 'not recorded'}"))
    if shows_all:
        for entry in checked.entries:
            say(_line(entry))
    summary = digest(checked.entries)
    out.print(_table(summary))
    for entry in summary.people:
        say(_line(entry))
    for vehicle, changes in summary.unasked.items():
        say(printable(f"{vehicle}: changes without a recorded command: {_counted(changes)}"))
    for vehicle, n in summary.n_disarmed_on_ground.items():
        times = f" × {n}" if n > 1 else ""
        say(printable(f"{vehicle}: disarmed automatically after landing{times}"))


COLUMNS = (
    Column("vehicle", "left"),
    Column("command", "left"),
    Column("sent"),
    Column("answered", "left", wraps_at=13),
    Column("re-\nfused"),
    Column("no\nanswer"),
    Column("seen", "left", rank=1, wraps_at=11),
)


def _table(summary: Digest) -> FittedTable:
    caption = ["seen: the first change of mode, arming or current item after the command"]
    table = FittedTable(COLUMNS, caption=caption, elsewhere="`swarmctl audit --all`")
    for row in summary.rows:
        others = f" ({row.by_others} by others)" if row.by_others else ""
        table.add_row(
            printable(row.vehicle),
            printable(row.command),
            f"{row.sent}{others}",
            printable(_counted(row.answers)),
            str(row.refused or ""),
            str(row.unanswered or ""),
            printable(_grouped(row.effects)),
        )
    return table


def _counted(counter: Counter[str]) -> str:
    return ", ".join(f"{text} × {n}" if n > 1 else text for text, n in counter.items())


def _grouped(seen: Counter[str]) -> str:
    """Return changes as text, grouped by the part of the state: "mission_seq 5, 10; mode AUTO"."""
    values: dict[str, Counter[str]] = {}
    for change, n in seen.items():
        name, _, value = change.partition(" ")
        values.setdefault(name, Counter())[value] += n
    return "; ".join(f"{name} {_counted(found)}" for name, found in values.items())


def _line(entry: Entry) -> str:
    what = entry["what"]
    names = [*(name for name in _LEADING if name in what), *(name for name in what if name not in _LEADING)]
    text = ", ".join(f"{name} {what[name]}" for name in names if what[name] not in (None, ""))
    return printable(f"{entry['run_s']:9.3f} s  {entry['vehicle'] or 'all':<8} {entry['kind']:<15} {text}")


def _time(entry: Entry) -> str:
    return f"{datetime.fromtimestamp(entry['unix_s'], UTC):%Y-%m-%d %H:%M:%S} UTC"
