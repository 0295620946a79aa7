"""Messages of `swarmctl check` and `fly` about files and places that a configuration names."""

from __future__ import annotations

from pathlib import Path

import pytest
from swarmctl_process import swarmctl

TWO = """\
name: two
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 6, cols: 6, cell_size_m: 50}
threats: {count: 3}
preflight: {endurance_s: 900}
links: {signing_key: KEY}
vehicles:
  - {name: alpha, url: "udpin:127.0.0.1:0", sysid: 1, start: {lat_deg: 46.001, lon_deg: 14.399}, goal: [4, 5]}
  - {name: beta, url: "BETA", sysid: 2, start: {lat_deg: 46.002, lon_deg: 14.399}, goal: [3, 5]}
"""


def config(folder: Path, key: str, url: str = "udpin:127.0.0.1:0") -> Path:
    file = folder / "two.yaml"
    file.write_text(TWO.replace("KEY", key).replace("BETA", url))
    return file


@pytest.mark.parametrize(
    "command", [("check",), ("fly", "--real", "--confirm", "alpha,beta"), ("preflight",)]
)
def test_a_bad_signing_key_is_an_error_of_the_file_before_a_run_folder_is_made(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    key = tmp_path / "key"
    key.write_text("0" * 64)
    key.chmod(0o600)
    file = config(tmp_path, str(key))
    result = swarmctl(*command, "--config", file)
    assert result.exit_code == 1, result.output
    assert f"{file}:5: links.signing_key: " in result.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["key", "two.yaml"]


def test_a_missing_serial_device_is_an_error_with_its_line(tmp_path: Path) -> None:
    file = config(tmp_path, "null", "serial:///dev/ttyNOPE:57600")
    result = swarmctl("check", "--config", file, "--out", tmp_path)
    assert result.exit_code == 1
    assert f"{file}:8: beta: " in result.stderr
    assert "/dev/ttyNOPE" in result.stderr
    assert "[no-device]" in result.stderr


def test_audit_needs_a_folder_of_keys(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("x")
    (tmp_path / "evidence.jsonl").write_bytes(b"")
    result = swarmctl("audit", tmp_path, "--keys", key)
    assert result.exit_code == 2
    assert f"--keys {key}: " in result.stderr


@pytest.mark.parametrize("given", [True, False])
def test_a_missing_endurance_is_a_hint_for_real_vehicles(given: bool, tmp_path: Path) -> None:
    file = config(tmp_path, "null")
    if not given:
        file.write_text(file.read_text().replace("preflight: {endurance_s: 900}\n", ""))
    result = swarmctl("check", "--config", file, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    hints = [line for line in result.output.splitlines() if "preflight.endurance_s" in line]
    assert len(hints) == (0 if given else 1)
    assert all("alpha, beta" in line for line in hints)


def test_a_flight_beyond_a_full_battery_is_a_problem_with_its_line(tmp_path: Path) -> None:
    file = config(tmp_path, "null")
    file.write_text(file.read_text().replace("endurance_s: 900", "endurance_s: 60"))
    result = swarmctl("check", "--config", file, "--out", tmp_path)
    assert result.exit_code == 1
    assert f"{file}:7: alpha: battery: " in result.stderr
    assert f"{file}:8: beta: battery: " in result.stderr
    assert "preflight.endurance_s" in result.stderr


def test_brackets_in_the_name_of_a_file_are_printed(tmp_path: Path) -> None:
    file = config(tmp_path, "null").rename(tmp_path / "[red]two.yaml")
    checked = swarmctl("check", "--config", file, "--out", tmp_path)
    planned = swarmctl("plan", "--config", file, "--out", tmp_path / "[b]")
    assert str(file) in checked.output
    assert str(tmp_path / "[b]") in planned.output
