"""The scenarios that come with the package."""

from dataclasses import dataclass
from pathlib import Path

from sim_vehicle.scenario import load_scenario

FOLDER = Path(__file__).parent.parent / "scenarios"


@dataclass(frozen=True, slots=True)
class Shipped:
    name: str
    about: str
    path: Path


def shipped() -> list[Shipped]:
    """By name."""
    return [Shipped(path.stem, load_scenario(path).about, path) for path in sorted(FOLDER.glob("*.yaml"))]


def find(text: str) -> Path:
    """The file of that path, or the shipped scenario of that name."""
    path = Path(text)
    named = FOLDER / f"{text}.yaml"
    return named if not path.exists() and named.exists() else path
