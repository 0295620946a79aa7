"""`swarmctl audit` over evidence that was changed: found or reported as unreadable, never an exception."""

from __future__ import annotations

import contextlib
import copy
import datetime as dt
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from profiles import examples
from typer.testing import CliRunner, Result

from swarmctl.cli.main import cli
from swarmctl.report.evidence.chain import GENESIS, canonical, sha256, signed_content
from swarmctl.security.evidence_keys import EvidenceSigner, load_evidence_signer
from swarmctl.security.issue import make_keys

Json = dict[str, Any]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("audit")
    make_keys(folder / "keys", ["operator", "router", "uav4", "uav5"], 30, dt.datetime.now(dt.UTC))
    return folder


def entries(vehicles: Any, vehicle: str | None = "uav4") -> list[Json]:
    """Return a run's entries, without hashes."""
    opened = {"run": "test", "program": "swarmctl 0", "configuration_sha256": "00", "vehicles": vehicles}
    contents: list[tuple[str, Json]] = [
        ("opened", opened),
        ("command", {"command": "COMPONENT_ARM_DISARM", "param1": 1.0, "by": "udpin://:14550"}),
        ("acknowledgement", {"command": "COMPONENT_ARM_DISARM", "result": "ACCEPTED"}),
        ("effect", {"changed": "armed", "from": False, "to": True}),
        ("effect", {"changed": "landed", "from": "IN_AIR", "to": "ON_GROUND"}),
        ("command", {"message": "MISSION_ITEM_INT", "items": 3}),
        ("acknowledgement", {"message": "MISSION_ACK", "result": "MISSION_ACCEPTED"}),
        ("operator", {"asks": "hold", "outcome": "taken"}),
        ("closed", {}),
    ]
    return [
        {
            "n": n,
            "unix_s": 1.7e9 + n,
            "run_s": n + 0.5,
            "vehicle": vehicle if n else None,
            "kind": k,
            "what": w,
        }
        for n, (k, w) in enumerate(contents)
    ]


def chained(run: list[Json], signer: EvidenceSigner | None = None) -> bytes:
    """Return the lines of the entries with valid hashes, closed and signed, as a forger writes them."""
    lines, previous = [], GENESIS
    for entry in run:
        if entry is run[-1] and isinstance(entry.get("what"), dict):
            entry["what"].setdefault("entries", len(run) - 1)
            if signer is not None:
                signature = signer.sign(signed_content(len(run) - 1, previous))
                entry["what"].setdefault(
                    "signature", {"by": signer.name, "key": signer.public_key, "signature": signature}
                )
        entry.setdefault("previous", previous)
        previous = sha256(canonical(entry))
        lines.append(canonical({"hash": previous, **entry}) + b"\n")
    return b"".join(lines)


def audited(folder: Path, content: bytes) -> Result:
    (folder / "evidence.jsonl").write_bytes(content)
    words = ["audit", str(folder), "--all", "--keys", str(folder / "keys")]
    return CliRunner().invoke(cli, words)


RUNS: dict[str, tuple[str, Any, str, int]] = {
    "its own agent": ("uav4", {"uav4": 4}, "uav4", 0),
    "its own agent, another name": ("uav4", {"alpha": 4}, "alpha", 0),
    "the operator": ("operator", {"uav4": 4, "uav5": 5}, "uav4", 0),
    "another agent": ("uav5", {"uav4": 4}, "uav4", 1),
    "another agent that changes the system id": ("uav5", {"uav4": 5}, "uav4", 1),
    "another agent that changes the vehicles": ("uav5", {"uav5": 5}, "uav4", 1),
    "one of two agents": ("uav5", {"uav4": 4, "uav5": 5}, "uav4", 1),
    "an agent, without vehicles": ("uav5", {}, "uav4", 1),
    "the router": ("router", {"uav4": 4}, "uav4", 1),
}


@pytest.mark.parametrize(("by", "vehicles", "vehicle", "expected"), RUNS.values(), ids=RUNS)
def test_only_the_writer_of_evidence_signs_it(
    by: str, vehicles: Any, vehicle: str, expected: int, folder: Path
) -> None:
    signer = load_evidence_signer(folder / "keys", by)
    result = audited(folder, chained(entries(vehicles, vehicle), signer))
    assert (result.exit_code, "[signed-by-another]" in result.stderr) == (expected, bool(expected)), (
        result.output
    )


def test_a_signature_under_another_name_is_refused(folder: Path) -> None:
    signer = load_evidence_signer(folder / "keys", "uav5")
    forged = EvidenceSigner("uav4", signer.signing_key)
    result = audited(folder, chained(entries({"uav4": 4}), forged))
    assert "[signed-with-other-key]" in result.stderr


DEEP = json.loads("[" * 300 + "]" * 300)
ODD_VALUES = st.recursive(
    st.sampled_from(
        [None, True, -1, 0.5, 10**30, 1e300, "", "closed", "\ud800", "uav5", [], {}, [[]], {"a": {}}, DEEP]
    )
    | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


def paths(value: Any, before: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [before, *(path for key, part in inner for path in paths(part, (*before, key)))]


SHAPE = entries({"uav4": 4})
SHAPE[-1]["what"] = {"signature": {"by": "operator", "key": "", "signature": ""}, "entries": 8}
PLACES = [path for path in paths(SHAPE) if len(path) > 1]


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_odd_values_in_a_chain_of_valid_hashes_are_never_a_bug(data: st.DataObject, folder: Path) -> None:
    """A forger computes all hashes anew; the signature cannot fit, or is odd itself."""
    run = copy.deepcopy(SHAPE)
    for *before, last in data.draw(st.lists(st.sampled_from(PLACES), min_size=1, max_size=2)):
        target: Any = run
        with contextlib.suppress(KeyError, IndexError, TypeError):  # the first change removed this place
            for part in before:
                target = target[part]
            target[last] = data.draw(ODD_VALUES)
    result = audited(folder, chained(run))
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code == 1
    assert "evidence.jsonl" in result.stderr


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_changed_bytes_of_signed_evidence_are_found(data: st.DataObject, folder: Path) -> None:
    signer = load_evidence_signer(folder / "keys", "uav4")
    content = chained(entries({"uav4": 4}), signer)
    at = data.draw(st.integers(0, len(content) - 1))
    length = data.draw(st.integers(0, 40))
    new = data.draw(
        st.binary(max_size=40)
        | st.sampled_from([b"\n", b"NaN", b"1e999", b'"a":1,', b"\xff\xfe", b"9" * 5000])
    )
    changed = content[:at] + new + content[at + length :]
    assume(changed != content)
    result = audited(folder, changed)
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code == 1


def test_fault_lines_name_file_and_line(folder: Path) -> None:
    run = entries({"uav4": 4})
    run[2]["kind"] = ["effect"]
    result = audited(folder, chained(run))
    assert result.exit_code == 1
    assert f"{folder / 'evidence.jsonl'}:3: " in result.stderr
