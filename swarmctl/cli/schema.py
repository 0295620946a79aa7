"""`swarmctl schema`: the JSON schema of configurations."""

from __future__ import annotations

import json

from swarmctl.cli.console import out
from swarmctl.config.model import Config


def schema() -> None:
    """Print the JSON schema of configurations, for editors."""
    out.print_json(
        json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **Config.model_json_schema()})
    )
