"""What commands that speak to a swarm and do not fly it have in common: who it is."""

from __future__ import annotations

from pathlib import Path

from swarmctl import roll
from swarmctl.commands.shared import USAGE, fail
from swarmctl.roll import Roll


def roll_of(path: Path) -> Roll:
    """The swarm of a configuration; leaves with everything that is wrong with it where it is not clear."""
    try:
        return roll.call(path)
    except roll.NoRoll as error:
        fail(error.lines, USAGE)
