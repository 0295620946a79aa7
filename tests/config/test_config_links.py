"""Errors in the section `links` are reported at their keys, before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest
from config_files import ALPHA, SIMULATED, SMALL_AREA, assert_problems, section_problems
from typer.testing import CliRunner

from swarmctl.cli.main import cli


@pytest.mark.parametrize(
    ("links", "vehicles"),
    [
        ('forward: ["udpout:localhost:14550", "tcpin:127.0.0.1:5760"], forward_commands: true', SIMULATED),
        ('forward: ["udpout:10.0.0.5:14550", "tcpout:10.0.0.5:5760"]', SIMULATED),
        ('forward: ["udpout:10.0.0.5:14550"], forward_commands: true, signing_key: some.key', ALPHA),
        ('forward: ["tcpin:0.0.0.0:5760"]', SIMULATED),
        ('forward: ["tcpin:0.0.0.0:5760"], forward_commands: true, signing_key: some.key', ALPHA),
        ("signing_key: some.key, signing_link_id: 255", ALPHA),
        ("position_hz: 2, stop_other_streams: true", SIMULATED),
        ("", SIMULATED),
    ],
)
def test_a_correct_section_has_no_problems(tmp_path: Path, links: str, vehicles: str) -> None:
    assert section_problems("links", links, vehicles, tmp_path) == []


@pytest.mark.parametrize(
    ("links", "vehicles", "expected"),
    [
        ('forward: ["udpout:127.0.0.1"]', SIMULATED, ("forward[0]", "'udpout:127.0.0.1'")),
        ("signing_key: some.key", SIMULATED, ("signing_key", "`simulate`")),
        ("position_hz: 1", ALPHA, ("position_hz", "2", "1")),
        ("signing_link_id: 256", ALPHA, ("signing_link_id", "255", "256")),
        ('forward: ["udpin:127.0.0.1:14999"]', ALPHA, ("forward[0]", "udpin:127.0.0.1:14999")),
        (
            'forward: ["udpout:10.0.0.5:14550"], forward_commands: true',
            SIMULATED,
            ("forward[0]", "udpout://10.0.0.5:14550", "links.forward_commands", "127.0.0.1"),
        ),
        (
            'forward: ["tcpout:ground.local:5760"], forward_commands: true',
            SIMULATED,
            ("forward[0]", "tcpout://ground.local:5760", "links.forward_commands"),
        ),
        (
            'forward: ["udpin:0.0.0.0:14551"], forward_commands: true',
            ALPHA,
            ("forward[0]", "udpin://0.0.0.0:14551", "links.forward_commands", "127.0.0.1"),
        ),
        ("forwards: []", SIMULATED, ("forwards", "'forward'")),
    ],
)
def test_an_error_is_reported_at_its_key(
    tmp_path: Path, links: str, vehicles: str, expected: tuple[str, ...]
) -> None:
    assert_problems(section_problems("links", links, vehicles, tmp_path), [expected])


def written(tmp_path: Path, links: str, vehicles: str) -> Path:
    file = tmp_path / "swarm.yaml"
    file.write_text(f"{SMALL_AREA}{vehicles}links: {{{links}}}\n")
    return file


def test_the_path_of_the_signing_key_is_relative_to_the_folder_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (elsewhere := tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(elsewhere)
    file = written(tmp_path, "signing_key: some.key", ALPHA)
    words = ["check", "--config", str(file), "--out", str(tmp_path / "runs")]
    tried = elsewhere / "some.key"
    assert f"links.signing_key: {tried}: " in CliRunner().invoke(cli, words).output
    tried.write_text("passphrase: correct horse\n")
    tried.chmod(0o600)
    assert CliRunner().invoke(cli, words).exit_code == 0


def test_a_malformed_url_of_forward_exits_with_2(tmp_path: Path) -> None:
    file = written(tmp_path, "", SIMULATED)
    result = CliRunner().invoke(cli, ["fly", "--config", str(file), "--forward", "14550"])
    assert result.exit_code == 2
    assert "--forward: '14550'" in result.output


@pytest.mark.parametrize("command", [["fly"], ["agent", "--uav", "uav1"]])
def test_the_command_line_cannot_forward_commands_of_other_machines(
    tmp_path: Path, command: list[str]
) -> None:
    file = written(tmp_path, "forward_commands: true", SIMULATED)
    result = CliRunner().invoke(cli, [*command, "--config", str(file), "--forward", "tcpin:0.0.0.0:5760"])
    assert result.exit_code == 2
    assert "--forward tcpin://0.0.0.0:5760: " in result.output
