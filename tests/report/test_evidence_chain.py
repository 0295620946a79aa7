"""The chain of entries, and the detection of changes to it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from evidence_files import chained, entries
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.report.evidence.chain import GENESIS, check, sha256

Lines = list[bytes]


def written() -> Lines:
    commands = [("command", {"message": "COMMAND_LONG", "param2": i}) for i in range(5)]
    return chained(entries(*commands, run="test"))


def test_an_unchanged_chain_is_whole() -> None:
    checked = check(written())
    assert checked.fault == ""
    assert checked.closing is not None
    assert checked.opened.run == "test"
    assert [entry.n for entry in checked.entries] == list(range(7))


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


def test_without_its_last_lines_a_chain_is_not_closed() -> None:
    for n in range(7):
        checked = check(written()[:n])
        assert (checked.fault, checked.closing) == ("", None)


def test_evidence_of_format_1_is_readable_and_of_a_later_format_is_not() -> None:
    old = check((Path(__file__).parent / "evidence_format_1.jsonl").read_bytes().splitlines(keepends=True))
    assert (old.fault, old.other_format, old.opened.format) == ("", "", 1)
    assert old.closing is not None
    assert {entry.kind for entry in old.entries} >= {"acknowledgement", "effect"}
    assert check(chained(entries(format=3))).other_format


@settings(derandomize=True, deadline=None, max_examples=examples(300))
@given(data=st.data())
def test_every_changed_removed_or_moved_line_is_found(data: st.DataObject) -> None:
    lines = written()
    i = data.draw(st.integers(0, len(lines) - 1))
    how = data.draw(st.sampled_from(["flip", "drop", "double", "swap"]))
    if how == "flip":
        at = data.draw(st.integers(0, len(lines[i]) - 1))
        bit = 1 << data.draw(st.integers(0, 7))
        lines[i] = lines[i][:at] + bytes([lines[i][at] ^ bit]) + lines[i][at + 1 :]
    elif how == "drop":
        del lines[i]
    elif how == "double":
        lines.insert(i, lines[i])
    else:
        j = (i + 1) % len(lines)
        lines[i], lines[j] = lines[j], lines[i]
    assert check(b"".join(lines).splitlines(keepends=True)).closing is None


@settings(derandomize=True, deadline=None, max_examples=examples(300))
@given(lines=st.lists(st.binary(max_size=80) | st.sampled_from([b"{}\n", b"[]\n", b"1\n", *written()])))
def test_any_bytes_are_checked_without_an_exception(lines: list[bytes]) -> None:
    checked = check(lines)
    assert checked.fault or lines[: len(checked.entries)] == lines
