"""The command line, run in this process."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner, Result

from swarmctl.cli.main import cli

ROOT = Path(__file__).parents[2]


SHIPPED = ROOT / "configs" / "swarm.yaml"


def swarmctl(*words: str | Path) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words])
