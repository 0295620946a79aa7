"""The roster of a configuration: the part that orders need, equal to the same part of the whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.model import load
from swarmctl.config.problems import ConfigError
from swarmctl.config.roster import load_roster
from swarmctl.config.scenario import build

ROOT = Path(__file__).parents[2]
GOOD = """\
name: test
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
simulate: {count: 2}
"""
MESH = "communication: {mesh: {1: tcp/10.0.0.1:7447, uav2: tcp/10.0.0.2:7447}}\n"


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda path: path.stem)
def test_a_shipped_configuration_has_no_problems_and_its_roster_is_a_part_of_it(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = build(load(path, check_config))
    monkeypatch.setattr(model, "load", lambda *_: pytest.fail("the whole was checked"))
    found = load_roster(path)
    assert model.Config.model_validate_json(whole.config.model_dump_json()) == whole.config
    assert found.name == whole.config.name
    assert found.communication == whole.config.communication
    assert found.names == {spec.sysid: spec.name for spec in whole.swarm}
    assert found.grid == whole.grid


def test_a_mesh_may_name_vehicles_by_system_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "swarm.yaml"
    file.write_text(GOOD + MESH)
    monkeypatch.setattr(model, "load", lambda *_: pytest.fail("the whole was checked"))
    assert load_roster(file).communication.mesh == {
        "1": "tcp/10.0.0.1:7447",
        "uav2": "tcp/10.0.0.2:7447",
    }


@pytest.mark.parametrize(
    "content",
    [
        GOOD + "planner: {w: 7}\nflight: {altitude_m: -1}\nnonsense: 1\n",
        GOOD.replace("cell_size_m: 50", "cell_size_m: 50, no_fly: [[99, 0]]").replace(
            "2}", "2, url: nowhere}"
        ),
        GOOD.replace("threats: {count: 5}\n", "").replace(
            "simulate: {count: 2}", "vehicles: [{name: uav1, sysid: 1}, {name: uav2, sysid: 2}]"
        ),
    ],
    ids=["in other sections", "in other keys of the same sections", "keys of the flight are missing"],
)
def test_errors_in_other_keys_do_not_stop_an_order(content: str, tmp_path: Path) -> None:
    file = tmp_path / "swarm.yaml"
    file.write_text(content)
    with pytest.raises(ConfigError):
        load(file, check_config)
    assert load_roster(file).names == {1: "uav1", 2: "uav2"}


WRONG = [
    ("no file", None, "swarm.yaml: "),
    ("malformed YAML", "area: {", "swarm.yaml:1: "),
    ("no mapping", "- 1\n", "swarm.yaml:1: "),
    ("an unknown key", GOOD + "communication: {ruoter: tcp/10.0.0.1:7447}\n", "'router'"),
    (
        "a name that is an option",
        GOOD.replace("simulate: {count: 2}", "vehicles: [{name: -rf, sysid: 1}]"),
        "swarm.yaml:4: vehicles[0].name: ",
    ),
    ("no vehicle", GOOD.replace("simulate: {count: 2}", ""), "`simulate: {count: 5}`"),
    (
        "a mesh with an unknown vehicle",
        GOOD + MESH.replace("uav2", "uav9"),
        "communication.mesh.uav9: ",
    ),
    ("a mesh with one twice", GOOD + MESH.replace("uav2", "uav1"), "communication.mesh.uav1: "),
    (
        "an error of the roster, and another elsewhere",
        GOOD.replace("name: test", "name: ä") + "planner: {w: 7}\n",
        "planner.w: ",
    ),
]


@pytest.mark.parametrize(("content", "reported"), [row[1:] for row in WRONG], ids=[row[0] for row in WRONG])
def test_an_error_in_the_roster_reports_all_errors_of_the_configuration(
    content: str | None, reported: str, tmp_path: Path
) -> None:
    file = tmp_path / "swarm.yaml"
    if content is not None:
        file.write_text(content)
    with pytest.raises(ConfigError) as refused:
        load_roster(file)
    assert any(reported in line for line in refused.value.lines), refused.value.lines
