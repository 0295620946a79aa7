"""The shipped configurations by name, the starter configuration, and the descriptions of the schema."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.examples import MAX_STARTER_VEHICLES, example, example_names, starter
from swarmctl.config.scenario import build

ROOT = Path(__file__).parents[2]
CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))


def test_every_shipped_configuration_is_an_example() -> None:
    assert example_names() == [path.stem for path in CONFIGS]
    assert [example(path.stem).read_text() for path in CONFIGS] == [path.read_text() for path in CONFIGS]


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_shipped_configuration_is_valid(path: Path) -> None:
    build(model.load(path, check_config))


def test_the_wheel_has_the_folder_of_examples() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert "configs" in wheel["only-include"]
    assert wheel["sources"] == {"configs": "swarmctl/configs"}


@pytest.mark.parametrize("real", [False, True], ids=["simulated", "real"])
@pytest.mark.parametrize("n_vehicles", [1, 5, 21])
def test_a_starter_configuration_has_no_problems(real: bool, n_vehicles: int, tmp_path: Path) -> None:
    file = tmp_path / "swarm.yaml"
    file.write_text(starter("swarm.yaml", n_vehicles, real=real))
    specs = build(model.load(file, check_config)).specs
    assert [spec.simulated for spec in specs] == [not real] * n_vehicles
    assert len({spec.goals for spec in specs}) == n_vehicles


@pytest.mark.full
def test_the_largest_starter_configuration_has_no_problems(tmp_path: Path) -> None:
    file = tmp_path / "swarm.yaml"
    file.write_text(starter("swarm.yaml", MAX_STARTER_VEHICLES, real=True))
    assert len(model.load(file, check_config).vehicles) == MAX_STARTER_VEHICLES


def test_places_and_urls_of_a_real_starter_configuration_are_marked() -> None:
    lines = starter("swarm.yaml", 2, real=True).splitlines()
    for key in ("origin_lat_deg", "origin_lon_deg", "endurance_s", "url", "sysid", "start", "goal"):
        marked = ["# EDIT" in line for line in lines if line.strip().startswith(f"{key}:")]
        assert marked
        assert all(marked), key


UNITS = {
    "_m": "[m]", "_s": "[s]", "_deg": "[deg]", "_m_s": "[m/s]", "_hz": "[Hz]", "_percent": "[%]",
    "_bytes_s": "[bytes/s]", "_per_m": "[1/m]",
}  # fmt: skip


def properties() -> Iterator[tuple[str, str]]:
    """Yield each key of the schema with its description, or with that of its section."""
    schema = model.Config.model_json_schema()
    for name, section in {"Config": schema, **schema["$defs"]}.items():
        for key, part in section.get("properties", {}).items():
            inner = schema["$defs"].get(part.get("$ref", "").removeprefix("#/$defs/"), {})
            yield f"{name}.{key}", part.get("description", inner.get("description", ""))


@pytest.mark.parametrize(("key", "description"), [pytest.param(*p, id=p[0]) for p in properties()])
def test_every_key_has_a_description_with_its_unit(key: str, description: str) -> None:
    assert description
    suffix = max((end for end in UNITS if key.endswith(end)), key=len, default="")
    assert UNITS.get(suffix, "") in description


def test_nobody_knows_the_true_hostiles_of_a_real_flight(tmp_path: Path) -> None:
    """A real flight with external sensors has no simulated truth, and must not show one."""
    file = tmp_path / "mine.yaml"
    for is_real in (True, False):
        file.write_text(starter("mine.yaml", 2, real=is_real))
        hostiles = build(model.load(file, check_config)).true_hostiles
        assert (hostiles is None) is is_real
