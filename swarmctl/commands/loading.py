"""What commands that fly or plan have in common: the configuration, judged whole."""

from __future__ import annotations

from pathlib import Path

from swarmctl.commands.shared import USAGE, fail
from swarmctl.config import ConfigError, load
from swarmctl.judge import judge
from swarmctl.scenario import Scenario, build


def scenario_of(path: Path) -> Scenario:
    """What a configuration describes; leaves with everything that is wrong with it."""
    try:
        return build(load(path, judge))
    except ConfigError as error:
        fail(error.lines, USAGE)
