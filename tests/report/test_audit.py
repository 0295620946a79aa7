"""A run's evidence on disk, and `swarmctl audit` over it."""

from __future__ import annotations

import datetime as dt
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from typer.testing import CliRunner, Result

from swarmctl.cli.main import cli
from swarmctl.report.evidence.chain import canonical, check, sha256
from swarmctl.report.evidence.file import FILE_NAME, EvidenceFile
from swarmctl.report.evidence.hooks import Evidence
from swarmctl.security.evidence_keys import load_evidence_signer
from swarmctl.security.files import KeyringError
from swarmctl.security.issue import make_keys

ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
HOLD = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)
ACK = mavlink.MAVLink_command_ack_message(400, 0)


def audit(*words: str | Path) -> Result:
    return CliRunner().invoke(cli, ["audit", *map(str, words)])


class Run:
    """A run folder with evidence."""

    def __init__(self, folder: Path) -> None:
        self.said: list[str] = []
        self.file = folder / FILE_NAME
        self.now_s = 0.0
        self.book = EvidenceFile(
            self.file,
            {"run": "test", "program": "swarmctl 0", "configuration_sha256": "00"},
            unix_s=lambda: 1_700_000_000.0 + self.now_s,
            run_s=lambda: self.now_s,
            say=self.said.append,
        )
        self.evidence = Evidence(self.book, {1: "alpha"})


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    made = Run(tmp_path)
    yield made
    made.evidence.close()


def test_an_entry_is_in_the_file_before_the_message_leaves(run: Run) -> None:
    assert run.evidence.to_vehicle(1, ARM)
    last = json.loads(run.file.read_bytes().splitlines()[-1])
    assert (last["vehicle"], last["kind"], last["what"]["command"]) == (
        "alpha", "command", "COMPONENT_ARM_DISARM",
    )  # fmt: skip


def test_a_whole_chain_is_reported_with_its_final_hash(run: Run, tmp_path: Path) -> None:
    run.evidence.to_vehicle(1, ARM)
    run.evidence.from_vehicle(1, ACK)
    run.evidence.waived("alpha", "gps", "indoors")
    run.evidence.operator("end of the flight", by="signal")
    run.evidence.close()
    run.evidence.close()
    final = json.loads(run.file.read_bytes().splitlines()[-1])["hash"]
    result = audit(tmp_path)
    assert result.exit_code == 0, result.output
    assert "6 entries" in result.output
    assert final in result.output
    assert "[evidence-not-signed]" in result.output
    row = next(line for line in result.output.splitlines() if "COMPONENT_ARM_DISARM" in line)
    assert row.split()[:4] == ["alpha", "COMPONENT_ARM_DISARM", "1", "ACCEPTED"]
    by_people = {" ".join(line.split()[3:]) for line in result.output.splitlines() if " s  " in line}
    assert by_people == {
        "waiver check gps, because indoors",
        "operator asks end of the flight, by signal",
    }


def test_a_changed_line_is_reported_with_the_expected_value(run: Run, tmp_path: Path) -> None:
    run.evidence.to_vehicle(1, HOLD)
    run.evidence.to_vehicle(1, ARM)
    run.evidence.close()
    run.file.write_bytes(run.file.read_bytes().replace(b'"param2":4', b'"param2":5'))
    result = audit(run.file)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"{run.file}:2: ")
    assert "[chain-broken]" in result.stderr
    entry = json.loads(run.file.read_bytes().splitlines()[1])
    found = entry.pop("hash")
    assert re.findall(r"[0-9a-f]{64}", result.stderr) == [found, sha256(canonical(entry))]
    assert " 1 lines " in result.stderr


def test_a_crashed_process_leaves_a_chain_that_is_not_closed(run: Run, tmp_path: Path) -> None:
    run.evidence.to_vehicle(1, ARM)
    result = audit(tmp_path)
    assert result.exit_code == 1
    assert "[not-closed]" in result.stderr


def test_a_crash_during_an_upload_keeps_the_items_until_the_last_heartbeat(
    run: Run,
) -> None:
    def item(seq: int) -> mavlink.MAVLink_message:
        return mavlink.MAVLink_mission_item_int_message(
            1, 1, seq, 6, 16, 0, 1, 0, 0, 0, 0, 460_000_000, seq, 2.0
        )

    run.evidence.to_vehicle(1, mavlink.MAVLink_mission_count_message(1, 1, 9))
    for seq in range(5):
        run.evidence.to_vehicle(1, item(seq))
    run.evidence.to_vehicle(0, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    run.evidence.to_vehicle(1, item(5))
    lines = [json.loads(line) for line in run.file.read_bytes().splitlines()]
    assert [line["what"].get("message") for line in lines] == [None, "MISSION_COUNT", "MISSION_ITEM_INT"]
    assert (lines[-1]["vehicle"], lines[-1]["what"]["items"], lines[-1]["what"]["of"]) == ("alpha", 5, 9)
    shown = audit(run.file, "--all").output
    assert "items 5, of 9" in shown
    row = next(line for line in shown.splitlines() if line.startswith(" alpha    MISSION_ITEM_INT"))
    assert row.split() == ["alpha", "MISSION_ITEM_INT", "1", "1"]  # sent, without an answer


def test_items_of_another_station_are_recorded_as_its_own(run: Run) -> None:
    point = mavlink.MAVLink_mission_item_int_message(
        1, 1, 0, 6, 16, 0, 1, 0, 0, 0, 0, 460_000_000, 145_000_000, 2.0
    )
    run.evidence.to_vehicle(1, point, "station 252")
    run.evidence.to_vehicle(1, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), "station 252")
    assert len(run.file.read_bytes().splitlines()) == 1, "another station's heartbeat writes nothing"
    for _ in range(2):
        run.evidence.to_vehicle(0, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    (_opened, line) = [json.loads(line) for line in run.file.read_bytes().splitlines()]
    assert (line["what"]["items"], line["what"]["by"]) == (1, "station 252")


def test_answers_to_partial_lists_are_recorded_with_a_heartbeat_and_at_the_end(run: Run) -> None:
    def recorded() -> list[tuple[str, int | None]]:
        lines = [json.loads(line) for line in run.file.read_bytes().splitlines()]
        return [(line["what"].get("message", line["kind"]), line["what"].get("times")) for line in lines[1:]]

    announced = mavlink.MAVLink_mission_write_partial_list_message(1, 1, 7, 7)
    point = mavlink.MAVLink_mission_item_int_message(1, 1, 7, 6, 16, 0, 1, 0, 0, 0, 0, 1, 1, 2.0)
    for message in (announced, point):
        run.evidence.to_vehicle(1, message)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    run.evidence.to_vehicle(0, beat)
    run.evidence.from_vehicle(1, mavlink.MAVLink_mission_ack_message(255, 190, 0))
    sent = [("MISSION_WRITE_PARTIAL_LIST", None), ("MISSION_ITEM_INT", None)]
    assert recorded() == sent
    run.evidence.to_vehicle(0, beat)
    assert recorded() == [*sent, ("MISSION_ACK", 1)]
    run.evidence.from_vehicle(1, mavlink.MAVLink_mission_ack_message(255, 190, 1))
    run.evidence.close()
    assert recorded() == [*sent, ("MISSION_ACK", 1), ("MISSION_ACK", 1), ("closed", None)]


def test_a_folder_without_evidence_is_a_usage_error(tmp_path: Path) -> None:
    result = audit(tmp_path)
    assert result.exit_code == 2
    assert "[no-evidence]" in result.stderr


def test_evidence_is_never_written_over(run: Run, tmp_path: Path) -> None:
    with pytest.raises(FileExistsError):
        Run(tmp_path)


def test_a_full_disk_forbids_arming_and_no_other_command(run: Run) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, run.book._file.fileno())
    os.close(full)
    assert run.evidence.to_vehicle(1, HOLD)
    assert not run.evidence.to_vehicle(1, ARM)
    assert len(run.said) == 1
    assert run.said[0].endswith("[evidence-ended]")
    run.evidence.close()


class TestSigned:
    @pytest.fixture
    def keys(self, tmp_path: Path) -> Path:
        make_keys(tmp_path / "keys", ["operator", "uav1"], 30, dt.datetime.now(dt.UTC))
        return tmp_path / "keys"

    def test_a_signature_names_its_owner(self, run: Run, keys: Path) -> None:
        run.evidence.to_vehicle(1, ARM)
        run.evidence.close(load_evidence_signer(keys, "operator"))
        without = audit(run.file)
        assert without.exit_code == 0
        assert " operator " in without.output
        assert "[evidence-not-signed]" not in without.output
        assert "--keys FOLDER" in without.output
        assert audit(run.file, "--keys", keys).exit_code == 0

    def test_unsigned_evidence_is_refused_where_keys_are_given(self, run: Run, keys: Path) -> None:
        run.evidence.close()
        result = audit(run.file, "--keys", keys)
        assert result.exit_code == 1
        assert "[evidence-not-signed]" in result.stderr

    def test_a_signature_with_another_key_is_refused(self, run: Run, keys: Path, tmp_path: Path) -> None:
        make_keys(tmp_path / "other", ["operator"], 30, dt.datetime.now(dt.UTC))
        run.evidence.close(load_evidence_signer(tmp_path / "other", "operator"))
        result = audit(run.file, "--keys", keys)
        assert result.exit_code == 1
        assert "[signed-with-other-key]" in result.stderr

    def test_a_rewritten_chain_does_not_fit_its_signature(self, run: Run, keys: Path) -> None:
        run.evidence.to_vehicle(1, HOLD)
        run.evidence.close(load_evidence_signer(keys, "operator"))
        forged, previous = [], "0" * 64
        for line in run.file.read_bytes().replace(b'"param2":4', b'"param2":5').splitlines():
            entry = json.loads(line)
            del entry["hash"]
            entry["previous"] = previous
            previous = sha256(canonical(entry))
            forged.append(canonical({**entry, "hash": previous}) + b"\n")
        assert check(forged).closing is not None
        run.file.write_bytes(b"".join(forged))
        result = audit(run.file)
        assert result.exit_code == 1
        assert "[signature-invalid]" in result.stderr
        assert " operator " in result.stderr

    def test_a_key_that_others_can_read_is_not_used(self, keys: Path) -> None:
        (keys / "operator" / "sign.pem").chmod(0o644)
        with pytest.raises(KeyringError, match="chmod 600"):
            load_evidence_signer(keys, "operator")
