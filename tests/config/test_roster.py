"""As much of a configuration as an order needs: the same as the whole of it says, and not a line more."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmctl.config import roster
from swarmctl.config.checks import check_config
from swarmctl.config.model import load
from swarmctl.config.roster import RosterError
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
def test_the_shipped_configurations_are_read_as_the_whole_reads_them(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = build(load(path, check_config))
    monkeypatch.setattr(roster, "_judged", lambda _: pytest.fail("the whole was judged"))
    found = roster.load_roster(path)
    assert found.name == whole.config.name
    assert found.communication == whole.config.communication
    assert found.names == {spec.sysid: spec.name for spec in whole.swarm}
    assert found.grid == whole.grid


def test_a_mesh_may_name_vehicles_by_system_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "swarm.yaml"
    file.write_text(GOOD + MESH)
    monkeypatch.setattr(roster, "_judged", lambda _: pytest.fail("the whole was judged"))
    assert roster.load_roster(file).communication.mesh == {
        "1": "tcp/10.0.0.1:7447",
        "uav2": "tcp/10.0.0.2:7447",
    }


def test_what_is_wrong_where_an_order_does_not_look_stops_none(tmp_path: Path) -> None:
    file = tmp_path / "swarm.yaml"
    file.write_text(GOOD + "planner: {w: 7}\nflight: {altitude_m: -1}\n")
    assert roster.load_roster(file).names == {1: "uav1", 2: "uav2"}


WRONG = [
    ("no file", None, "there is no such file"),
    ("no YAML", "area: {", "this is not YAML"),
    ("no mapping", "- 1\n", "swarm.yaml:1: "),
    ("an unknown key", GOOD + "communication: {ruoter: tcp/10.0.0.1:7447}\n", "did you mean 'router'?"),
    ("no vehicle", GOOD.replace("simulate: {count: 2}", ""), "no vehicle: give `simulate: {count: 5}`"),
    (
        "a mesh with a stranger",
        GOOD + MESH.replace("uav2", "uav9"),
        "no vehicle has the system id or name uav9",
    ),
    ("a mesh with one twice", GOOD + MESH.replace("uav2", "uav1"), "uav1 is given twice"),
    (
        "more that is wrong elsewhere",
        GOOD.replace("name: test", "name: ä") + "planner: {w: 7}\n",
        "planner.w: ",
    ),
]


@pytest.mark.parametrize(("content", "said"), [row[1:] for row in WRONG], ids=[row[0] for row in WRONG])
def test_where_it_is_not_clear_who_is_meant_all_that_is_wrong_is_said(
    content: str | None, said: str, tmp_path: Path
) -> None:
    file = tmp_path / "swarm.yaml"
    if content is not None:
        file.write_text(content)
    with pytest.raises(RosterError) as refused:
        roster.load_roster(file)
    assert any(said in line for line in refused.value.lines), refused.value.lines
