"""`swarmctl schema`: the JSON schema of configurations."""

from __future__ import annotations

import json

import typer

from swarmctl.cli.console import out
from swarmctl.config.model import Config


def register(cli: typer.Typer) -> None:
    cli.command()(schema)


def schema() -> None:
    """Print the JSON schema of configurations, for editors."""
    out.print_json(
        json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **Config.model_json_schema()})
    )
