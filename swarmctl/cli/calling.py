"""What commands that speak to a swarm and do not fly it have in common: who it is, and where its
configuration names its keys."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from swarmctl.cli.console import USAGE, fail
from swarmctl.config import roster, yaml_lines
from swarmctl.config.roster import Roster


def roll_of(path: Path) -> Roster:
    """The swarm of a configuration; leaves with everything that is wrong with it where it is not clear."""
    try:
        return roster.load_roster(path)
    except roster.RosterError as error:
        fail(error.lines, USAGE)


def of_keys(config: Path, troubles: Iterable[str]) -> list[str]:
    """What is wrong with the folder that a configuration calls `communication.keys`, each with where it
    does."""
    # Only here: it loads the planners, which takes these commands longer than all they do.
    from swarmctl.config.model import ConfigProblem, problem_lines  # noqa: PLC0415

    document = yaml_lines.parse(config.read_text(encoding="utf-8"))
    return problem_lines(config, document, (ConfigProblem(("communication", "keys"), text) for text in troubles))
