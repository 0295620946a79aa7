"""Programs of real autopilots in software, given by an option or an environment variable each."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pytest

OPTIONS = ("arducopter", "arduplane", "px4")


@dataclass(frozen=True)
class Builds:
    programs: dict[str, Path]
    """by option"""

    def missing(self, *options: str) -> list[str]:
        return [option for option in options if option not in self.programs]


def variable(option: str) -> str:
    """Return the environment variable that has the same effect as an option."""
    return f"SWARMCTL_{option.upper()}"


def builds_of(config: pytest.Config) -> Builds:
    given = {one: config.getoption(one) or os.environ.get(variable(one)) for one in OPTIONS}
    return Builds({one: Path(path).resolve() for one, path in given.items() if path})
