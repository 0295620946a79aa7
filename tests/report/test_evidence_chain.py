"""The chain of entries, and the detection of changes to it."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from evidence_files import chained, entries

from swarmctl.report.evidence.chain import GENESIS, check, sha256

Lines = list[bytes]


def written() -> Lines:
    commands = [("command", {"message": "COMMAND_LONG", "param2": i}) for i in range(5)]
    return chained(entries(*commands, run="test"))


def test_each_line_holds_the_hash_of_the_line_before_and_its_own() -> None:
    previous = GENESIS
    for line in written():
        entry = json.loads(line)
        assert entry["previous"] == previous
        assert entry["hash"] == sha256(b"{" + line[75:-1])
        previous = entry["hash"]


def rehashed(line: bytes) -> bytes:
    body = b"{" + line[75:].replace(b'"param2":2', b'"param2":7')
    return b'{"hash":"%s",%s' % (sha256(body[:-1]).encode(), body[1:])


def same_but_for(i: int, change: Callable[[bytes], bytes]) -> Callable[[Lines], Lines]:
    return lambda lines: [*lines[:i], change(lines[i]), *lines[i + 1 :]]


CHANGES: dict[str, tuple[Callable[[Lines], Lines], int]] = {
    "changed": (same_but_for(3, lambda line: line.replace(b'"param2":2', b'"param2":7')), 4),
    "another space": (same_but_for(3, lambda line: line.replace(b'"what":', b'"what": ')), 4),
    "changed with its hash": (same_but_for(3, rehashed), 5),
    "removed": (lambda lines: lines[:3] + lines[4:], 4),
    "doubled": (lambda lines: lines[:3] + lines[2:], 4),
    "swapped": (lambda lines: [*lines[:3], lines[4], lines[3], *lines[5:]], 4),
    "first line removed": (lambda lines: lines[1:], 1),
    "cut within a line": (lambda lines: [*lines[:5], lines[5][:40]], 6),
    "cut at the line end": (lambda lines: [*lines[:6], lines[6][:-1]], 7),
    "no JSON": (same_but_for(3, lambda _: b"{}\n"), 4),
    "added after the last line": (lambda lines: [*lines, lines[3]], 8),
}


@pytest.mark.parametrize(("change", "line"), CHANGES.values(), ids=CHANGES)
def test_a_change_is_found_and_its_line_is_named(change: Callable[[Lines], Lines], line: int) -> None:
    checked = check(change(written()))
    assert checked.fault
    assert len(checked.entries) + 1 == line
    assert checked.closing is None
    assert checked.is_torn is (b"\n" not in change(written())[line - 1])


def test_lines_out_of_their_places_are_found_in_spite_of_valid_hashes() -> None:
    first, command, last = entries(("command", {}))
    for forged in (
        [first, command, last, {**command, "n": 3}],
        [first, {**first, "n": 1}],
        [{**command, "n": 0}, {**last, "n": 1}],
        [first, {**command, "n": 7}, last],
    ):
        assert check(chained(forged)).fault
