"""The chain of entries, and the detection of changes to it."""

from __future__ import annotations

import json
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.report.evidence.chain import GENESIS, Chain, canonical, check, sha256


def written(count: int = 5, *, closed: bool = True) -> list[bytes]:
    chain = Chain()
    lines = [chain.append("opened", None, {"run": "test"}, unix_s=1e9, run_s=0.0)]
    for i in range(count):
        what = {"command": "DO_SET_MODE", "param2": float(i)}
        lines.append(chain.append("command", "uav1", what, unix_s=1e9 + i, run_s=float(i)))
    if closed:
        entries = chain.n
        lines.append(chain.append("closed", None, {"entries": entries}, unix_s=1e9 + 9, run_s=9.0))
    return lines


def test_an_unchanged_chain_is_whole() -> None:
    checked = check(written())
    assert checked.fault is None
    assert checked.closing == {"entries": 6}
    assert checked.opened == {"run": "test"}
    assert [entry["n"] for entry in checked.entries] == list(range(7))


def test_each_line_holds_the_hash_of_the_line_before_and_its_own() -> None:
    previous = GENESIS
    for line in written():
        entry = json.loads(line)
        own = entry.pop("hash")
        assert entry["previous"] == previous
        assert own == sha256(json.dumps(entry, sort_keys=True, separators=(",", ":")).encode())
        previous = own


def test_a_changed_value_is_found_in_its_line() -> None:
    lines = written()
    lines[3] = lines[3].replace(b'"param2":2.0', b'"param2":7.0')
    fault = check(lines).fault
    assert fault is not None
    assert fault.line == 4
    entry = json.loads(lines[3])
    assert entry.pop("hash") in fault.found
    assert sha256(canonical(entry)) in fault.expected


def test_a_line_changed_together_with_its_hash_is_found_in_the_next() -> None:
    lines = written()
    entry = json.loads(lines[3])
    entry["what"]["param2"] = 7.0
    del entry["hash"]
    lines[3] = canonical({**entry, "hash": sha256(canonical(entry))}) + b"\n"
    fault = check(lines).fault
    assert fault is not None
    assert fault.line == 5
    assert json.loads(lines[3])["hash"] in fault.expected
    assert json.loads(lines[4])["previous"] in fault.found


def test_a_cut_off_tail_is_not_closed_and_half_a_line_is_a_fault() -> None:
    whole = written()
    checked = check(whole[:-2])
    assert checked.fault is None
    assert checked.closing is None
    half = check([*whole[:-2], whole[-2][:40]])
    assert half.fault is not None
    assert half.fault.line == 6


def test_an_entry_after_the_closing_one_is_a_fault() -> None:
    chain = Chain()
    lines = [
        chain.append("opened", None, {}, unix_s=1e9, run_s=0.0),
        chain.append("closed", None, {"entries": 1}, unix_s=1e9, run_s=1.0),
    ]
    assert check(lines).fault is None
    # Number and hashes of this entry are correct; only its position is wrong.
    fault = check([*lines, chain.append("note", None, {}, unix_s=1e9, run_s=2.0)]).fault
    assert fault is not None
    assert fault.line == 3


def test_numbers_without_a_json_form_become_strings() -> None:
    assert canonical({"yaw": math.nan, "b": b"\x01\xff"}) == b'{"b":"01ff","yaw":"nan"}'


def test_an_empty_file_is_not_closed() -> None:
    assert check([]).closing is None


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
    checked = check(b"".join(lines).splitlines(keepends=True))
    assert checked.fault is not None or checked.closing is None


@settings(derandomize=True, deadline=None, max_examples=examples(300))
@given(lines=st.lists(st.binary(max_size=80) | st.sampled_from([b"{}\n", b"[]\n", b"1\n", *written()])))
def test_any_bytes_are_checked_without_an_exception(lines: list[bytes]) -> None:
    checked = check(lines)
    assert checked.fault is not None or lines[: len(checked.entries)] == lines
