"""`swarmctl audit`: changed evidence, files and signatures are found and named, never an exception."""

from __future__ import annotations

import contextlib
import copy
import datetime as dt
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from evidence_files import ARM, HOLD, Json, Written, chained, entries, tlog
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner, Result

from swarmctl.cli.main import cli
from swarmctl.report.evidence.log import FILE_NAME
from swarmctl.security.evidence_keys import EvidenceSigner, load_evidence_signer
from swarmctl.security.files import KeyringError
from swarmctl.security.issue import make_keys

ACK = mavlink.MAVLink_command_ack_message(176, 0)


def audit(*words: str | Path) -> Result:
    result = CliRunner().invoke(cli, ["audit", *map(str, words)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def code_of(result: Result) -> str:
    """Return the code of the only error; empty without an error."""
    assert len(result.stderr.splitlines()) == (result.exit_code != 0), result.stderr
    return result.stderr.strip().rpartition("[")[2].rstrip("]")


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keyrings") / "keys"
    make_keys(folder, ["operator", "router", "uav4", "uav5"], 30, dt.datetime.now(dt.UTC))
    return folder


def flown(folder: Path, signer: EvidenceSigner | None = None) -> Path:
    """Write a run folder with a record, the tlog of alpha, and evidence; return the folder."""
    folder.mkdir()
    run = Written(folder)
    run.evidence.to_vehicle(1, HOLD)
    run.evidence.to_vehicle(1, ARM)
    run.evidence.waived("alpha", "gps", "indoors")
    run.evidence.operator("end of the flight", by="signal")
    (folder / "run.mcap").write_bytes(b"record")
    (folder / "alpha.tlog").write_bytes(tlog((255, HOLD), (1, ACK), (255, ARM)))
    run.evidence.close(signer)
    run.evidence.close(signer)
    return folder


def test_a_whole_run_is_reported_with_its_table_its_people_and_its_final_hash(tmp_path: Path) -> None:
    run = flown(tmp_path / "run")
    result = audit(run)
    assert result.exit_code == 0, result.output
    closed = json.loads((run / FILE_NAME).read_bytes().splitlines()[-1])
    assert closed["hash"] in result.output
    assert " 6 entries" in result.output
    assert set(closed["what"]["files"]) == {"alpha.tlog", "run.mcap"}
    assert "[evidence-not-signed]" in result.output
    rows = {line.split()[1]: line.split()[2:] for line in result.output.splitlines() if " alpha  " in line}
    assert rows["DO_SET_MODE"] == ["1", "ACCEPTED"]
    assert rows["COMPONENT_ARM_DISARM"] == ["1", "1"], "sent, without an answer"
    people = {" ".join(line.split()[3:]) for line in result.output.splitlines() if " s  " in line}
    assert people == {"waiver check gps, because indoors", "operator asks end of the flight, by signal"}
    assert "param2 4" in audit(run, "--all").output


def changed(name: str, old: bytes, new: bytes) -> Callable[[Path], object]:
    return lambda run: (run / name).write_bytes((run / name).read_bytes().replace(old, new, 1))


def lines(change: Callable[[list[bytes]], list[bytes]]) -> Callable[[Path], object]:
    def write(run: Path) -> None:
        file = run / FILE_NAME
        file.write_bytes(b"".join(change(file.read_bytes().splitlines(keepends=True))))

    return write


CHANGES: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "a changed line": (changed(FILE_NAME, b'"param2":4', b'"param2":5'), "chain-broken", f"{FILE_NAME}:2: "),
    "a cut within a line": (lines(lambda all_: [*all_[:4], all_[4][:9]]), "chain-broken", f"{FILE_NAME}:5: "),
    "cut lines": (lines(lambda all_: all_[:-1]), "not-closed", f"{FILE_NAME}:5: "),
    "no lines": (lines(lambda _: []), "not-closed", f"{FILE_NAME}: "),
    "another record": (changed("run.mcap", b"r", b"R"), "file-changed", "run.mcap: "),
    "another tlog": (changed("alpha.tlog", bytes(8), b"1" * 8), "file-changed", "alpha.tlog: "),
    "no record": (lambda run: (run / "run.mcap").unlink(), "file-changed", "run.mcap: "),
    "no evidence": (lambda run: (run / FILE_NAME).unlink(), "no-run", f"{FILE_NAME}: "),
    "an earlier format": (
        lines(lambda _: chained(entries(("answer", {}), format=1))), "other-format", f"{FILE_NAME}: ",
    ),
    "a later format": (
        lines(lambda _: chained(entries(format=3))), "other-format", f"{FILE_NAME}: ",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "code", "where"), CHANGES.values(), ids=CHANGES)
def test_a_change_is_found_and_its_place_is_named(
    change: Callable[[Path], object], code: str, where: str, tmp_path: Path
) -> None:
    run = flown(tmp_path / "run")
    change(run)
    result = audit(run)
    assert code_of(result) == code
    assert result.exit_code == (2 if code in ("no-run", "other-format") else 1)
    assert result.stderr.startswith(f"{run}/{where}")


def test_the_table_leaves_out_a_changed_tlog(tmp_path: Path) -> None:
    run = flown(tmp_path / "run")
    changed("alpha.tlog", bytes(8), b"1" * 8)(run)
    row = next(line for line in audit(run).output.splitlines() if "DO_SET_MODE" in line)
    assert row.split()[2:] == ["1", "?"]


def test_evidence_alone_is_checked_without_the_other_files(tmp_path: Path) -> None:
    run = flown(tmp_path / "run")
    alone = (run / FILE_NAME).rename(tmp_path / "copy.jsonl")
    assert audit(alone).exit_code == 0
    (tmp_path / "run.mcap").write_bytes(b"another")
    assert code_of(audit(alone)) == "file-changed"


def test_a_crashed_process_leaves_a_chain_that_is_not_closed(tmp_path: Path) -> None:
    run = Written(tmp_path)
    run.evidence.to_vehicle(1, ARM)
    assert code_of(audit(tmp_path)) == "not-closed"
    run.evidence.close()


class TestSigned:
    def test_a_signature_names_its_owner(self, keys: Path, tmp_path: Path) -> None:
        run = flown(tmp_path / "run", load_evidence_signer(keys, "operator"))
        for words in ((run,), (run, "--keys", keys)):
            result = audit(*words)
            assert result.exit_code == 0
            assert " operator " in result.output
            assert "[evidence-not-signed]" not in result.output

    def test_unsigned_evidence_is_refused_where_keys_are_given(self, keys: Path, tmp_path: Path) -> None:
        run = flown(tmp_path / "run")
        assert code_of(audit(run, "--keys", keys)) == "evidence-not-signed"

    def test_a_signature_with_another_key_is_refused(self, keys: Path, tmp_path: Path) -> None:
        make_keys(tmp_path / "other", ["operator"], 30, dt.datetime.now(dt.UTC))
        run = flown(tmp_path / "run", load_evidence_signer(tmp_path / "other", "operator"))
        assert code_of(audit(run, "--keys", keys)) == "signed-with-other-key"

    def test_a_signature_with_a_revoked_key_is_refused(self, tmp_path: Path) -> None:
        keys = tmp_path / "keys"
        make_keys(keys, ["operator"], 30, dt.datetime.now(dt.UTC))
        run = flown(tmp_path / "run", load_evidence_signer(keys, "operator"))
        make_keys(keys, ["operator"], 30, dt.datetime.now(dt.UTC), revoke=["operator"])
        assert code_of(audit(run, "--keys", keys)) == "signed-with-revoked-key"

    def test_a_signature_under_another_name_is_refused(self, keys: Path, tmp_path: Path) -> None:
        forged = EvidenceSigner("uav4", load_evidence_signer(keys, "uav5").signing_key)
        assert code_of(audited(tmp_path, keys, RUN, forged)) == "signed-with-other-key"

    @pytest.mark.parametrize(
        ("old", "new"), [(b'"param2":4', b'"param2":5'), (b'"run.mcap":"', b'"run.mcap":"0')]
    )
    def test_a_rewritten_chain_does_not_fit_its_signature(
        self, old: bytes, new: bytes, keys: Path, tmp_path: Path
    ) -> None:
        run = flown(tmp_path / "run", load_evidence_signer(keys, "operator"))
        content = (run / FILE_NAME).read_bytes()
        whole, forged = (
            [*map(json.loads, data.splitlines())] for data in (content, content.replace(old, new))
        )
        for entry in (*whole, *forged):
            del entry["hash"], entry["previous"]
        assert b"".join(chained(whole)) == content
        alone = tmp_path / "alone.jsonl"
        alone.write_bytes(b"".join(chained(forged)))
        assert code_of(audit(alone)) == "signature-invalid"
        del forged[-1]["what"]["signature"]
        alone.write_bytes(b"".join(chained(forged)))
        assert "[evidence-not-signed]" in audit(alone).output

    def test_a_key_that_others_can_read_is_not_used(self, tmp_path: Path) -> None:
        make_keys(tmp_path / "keys", ["operator"], 30, dt.datetime.now(dt.UTC))
        (tmp_path / "keys" / "operator" / "sign.pem").chmod(0o644)
        with pytest.raises(KeyringError, match="chmod 600"):
            load_evidence_signer(tmp_path / "keys", "operator")


RUN = entries(
    ("command", {"message": "COMMAND_LONG", "command": "COMPONENT_ARM_DISARM", "by": "udpin://:14550"}),
    ("command", {"message": "MISSION_ITEM_INT", "seq": 3}),
    ("operator", {"asks": "hold", "outcome": "taken"}),
    vehicle="uav4",
    vehicles={"uav4": 4},
)


def audited(folder: Path, keys: Path, run: list[Json], signer: EvidenceSigner | None = None) -> Result:
    (folder / FILE_NAME).write_bytes(b"".join(chained(copy.deepcopy(run), signer)))
    return audit(folder, "--all", "--keys", keys)


SIGNERS: dict[str, tuple[str, Any, str, str]] = {
    "its own agent": ("uav4", {"uav4": 4}, "uav4", ""),
    "its own agent, another name": ("uav4", {"alpha": 4}, "alpha", ""),
    "the operator": ("operator", {"uav4": 4, "uav5": 5}, "uav4", ""),
    "another agent": ("uav5", {"uav4": 4}, "uav4", "signed-by-another"),
    "another agent that changes the system id": ("uav5", {"uav4": 5}, "uav4", "signed-by-another"),
    "another agent that changes the vehicles": ("uav5", {"uav5": 5}, "uav4", "signed-by-another"),
    "one of two agents": ("uav5", {"uav4": 4, "uav5": 5}, "uav4", "signed-by-another"),
    "an agent, without vehicles": ("uav5", {}, "uav4", "signed-by-another"),
    "the router": ("router", {"uav4": 4}, "uav4", "signed-by-another"),
}


@pytest.mark.parametrize(("by", "vehicles", "vehicle", "code"), SIGNERS.values(), ids=SIGNERS)
def test_only_the_writer_of_evidence_signs_it(
    by: str, vehicles: Any, vehicle: str, code: str, keys: Path, tmp_path: Path
) -> None:
    run = entries(("command", {"message": "MISSION_COUNT"}), vehicle=vehicle, vehicles=vehicles)
    assert code_of(audited(tmp_path, keys, run, load_evidence_signer(keys, by))) == code


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


SHAPE = copy.deepcopy(RUN)
SHAPE[-1]["what"] = {
    "signature": {"by": "operator", "key": "", "signature": ""},
    "files": {"run.mcap": "00"},
}
PLACES = [path for path in paths(SHAPE) if len(path) > 1]


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_odd_values_in_a_chain_of_valid_hashes_are_never_a_bug(
    data: st.DataObject, keys: Path, tmp_path: Path
) -> None:
    """A forger computes all hashes anew; the signature cannot fit, or is odd itself."""
    run = copy.deepcopy(SHAPE)
    for *before, last in data.draw(st.lists(st.sampled_from(PLACES), min_size=1, max_size=2)):
        target: Any = run
        with contextlib.suppress(KeyError, IndexError, TypeError):  # the first change removed this place
            for part in before:
                target = target[part]
            target[last] = data.draw(ODD_VALUES)
    result = audited(tmp_path, keys, run)
    assert result.exit_code in (1, 2)
    assert FILE_NAME in result.stderr


@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_changed_bytes_of_signed_evidence_are_found(
    data: st.DataObject, keys: Path, tmp_path: Path
) -> None:
    content = b"".join(chained(copy.deepcopy(RUN), load_evidence_signer(keys, "uav4")))
    at = data.draw(st.integers(0, len(content) - 1))
    length = data.draw(st.integers(0, 40))
    new = data.draw(
        st.binary(max_size=40)
        | st.sampled_from([b"\n", b"NaN", b"1e999", b'"a":1,', b"\xff\xfe", b"9" * 5000])
    )
    found = content[:at] + new + content[at + length :]
    assume(found != content)
    (tmp_path / FILE_NAME).write_bytes(found)
    assert audit(tmp_path, "--all", "--keys", keys).exit_code == 1
