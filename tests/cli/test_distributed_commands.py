"""Refusals of the commands for a swarm on many machines: the error and the exit code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from swarmctl.bus.transports import zenoh_config
from swarmctl.cli.main import cli

PLAIN = """\
name: apart
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
simulate: {count: 2}
"""
REAL = """\
name: apart
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.0, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
vehicles:
  - {name: alpha, url: "udpin://:14999", sysid: 1, start: {lat_deg: 46.0, lon_deg: 13.99}, goal: [3, 7]}
  - {name: beta, url: "udpin://:14999", sysid: 2, start: {lat_deg: 46.001, lon_deg: 13.99}, goal: [4, 7]}
"""
ROUTER = "communication: {router: tcp/127.0.0.1:1}\n"
CERTIFIED = "communication: {router: tls/127.0.0.1:1, keys: nowhere}\n"

Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(text: str) -> Path:
        path = tmp_path / "apart.yaml"
        path.write_text(text)
        return path

    return written


def swarmctl(*words: str | Path) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words], env={"COLUMNS": "200"})


REFUSED: list[tuple[str, list[str], str, int, str]] = [
    # name, arguments, configuration, exit code, part of the error
    ("an agent of an unknown vehicle", ["agent", "--uav", "uav9"], PLAIN + ROUTER, 2, "1 (uav1), 2 (uav2)"),
    ("an agent without a network", ["agent", "--uav", "1"], PLAIN, 2, "--launch when-ready"),
    ("an agent with an invalid URL", ["agent", "--uav", "1", "--url", "ftp://x"],
     PLAIN + ROUTER, 2, "--url: "),
    ("an agent with an invalid router", ["agent", "--uav", "1", "--connect", "x"],
     PLAIN, 2, "--connect: 'x' "),
    ("a simulated vehicle with --real", ["agent", "--uav", "1", "--real"], PLAIN + ROUTER, 2, "--real: "),
    (
        "a real vehicle without its name",
        ["agent", "--uav", "beta", "--real", "--confirm", "alpha"],
        REAL + ROUTER,
        2,
        "[not-confirmed]",
    ),
    ("a simulated vehicle at another URL", ["agent", "--uav", "1", "--url", "udpin://:14998", "--real"],
     PLAIN + ROUTER, 2, "--confirm uav1"),
    ("an agent without its keys", ["agent", "--uav", "1"], PLAIN + CERTIFIED, 1, "nowhere/uav1: "),
    ("watching without a network", ["watch"], PLAIN, 2, "[no-network]"),
    ("watching without keys", ["watch"], PLAIN + CERTIFIED, 1, "nowhere/operator: "),
    ("watching without certificates", ["watch", "--connect", "tls/127.0.0.1:1"],
     PLAIN, 2, "[no-certificates]"),
    ("an order without a vehicle", ["order", "hold"], PLAIN + ROUTER, 2, "[which-vehicles]"),
    ("a return that ignores a vehicle", ["order", "return", "--all", "--ignore", "uav2"],
     PLAIN + ROUTER, 2, "ignore with order return"),
    ("an unknown order", ["order", "fly", "--all"], PLAIN + ROUTER, 2, "Invalid value for"),
    ("routing without keys", ["router"], PLAIN + CERTIFIED, 1, "nowhere/router: "),
    ("reporting without keys", ["observe", "--uav", "1", "--cell", "1,1", "--clear"],
     PLAIN + CERTIFIED, 1, "nowhere/operator: "),
    ("checking without keys", ["check"], PLAIN + CERTIFIED, 1, "nowhere/uav1: "),
    ("an order without a router", ["order", "hold", "--all"], PLAIN + ROUTER, 1, "tcp/127.0.0.1:1"),
    ("an order without keys", ["order", "hold", "--all"], PLAIN + CERTIFIED, 1, "nowhere/operator: "),
    ("weights without a router", ["set", "--all", "--w", "1"], PLAIN + ROUTER, 1, "tcp/127.0.0.1:1"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "configuration", "code", "error"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED]
)
def test_an_impossible_command_ends_before_a_run_folder_is_made(
    words: list[str],
    configuration: str,
    code: int,
    error: str,
    write: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(zenoh_config, "JOIN_MS", 200)
    folder = ["--out", str(tmp_path / "runs")] if words[0] == "agent" else []
    file = write(configuration)
    result = swarmctl(*words, "--config", file, *folder)
    assert error in result.stderr
    if CERTIFIED in configuration:
        line = configuration.splitlines().index(CERTIFIED.strip()) + 1
        assert f"{file}:{line}: communication.keys: {error}" in result.stderr
    assert result.exit_code == code, result.output
    assert not (tmp_path / "runs").exists()
