"""The scenarios that come with the package."""

import difflib
from dataclasses import dataclass
from pathlib import Path

from sim_vehicle.scenarios import ScenarioError, load_scenario

FOLDER = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Shipped:
    name: str
    about: str
    path: Path


def shipped() -> list[Shipped]:
    """By name."""
    return [Shipped(path.stem, load_scenario(path).about, path) for path in sorted(FOLDER.glob("*.yaml"))]


def find(text: str) -> Path:
    """The file of that path, or the shipped scenario of that name; ScenarioError if there is neither."""
    path = Path(text)
    if path.exists():
        return path
    names = {file.stem: file for file in FOLDER.glob("*.yaml")}
    if text in names:
        return names[text]
    near = difflib.get_close_matches(path.stem, names, n=1)
    meant = f"; did you mean {near[0]}?" if near else ""
    raise ScenarioError(f"{text}: neither a file nor a shipped scenario{meant} (`run --list` shows these)")
