"""A configuration keeps its comments, and a save writes a valid file whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmctl.config.checks import check_config
from swarmctl.config.examples import example, example_names
from swarmctl.config.model import load
from swarmctl.config.problems import ConfigError
from swarmctl.config.scenario import build
from swarmctl.dashboard.draft import Draft
from swarmctl.dashboard.setup_edits import SIMULATED, edits_of_click, first_routes
from swarmctl.report import first_plans


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "swarm.yaml"
    path.write_text(example("swarm").read_text())
    return path


@pytest.mark.parametrize("name", example_names())
def test_an_edit_changes_only_its_lines(name: str) -> None:
    draft = Draft.open(example(name))
    before = draft.text.splitlines()
    draft.edit({("area", "rows"): 21})
    changed = [(a, b) for a, b in zip(before, draft.text.splitlines(), strict=True) if a != b]
    assert len(changed) == 1
    assert changed[0][0].partition("#")[2] == changed[0][1].partition("#")[2]
    assert draft.undo()
    assert draft.text.splitlines() == before


def test_a_save_is_read_again_by_the_program(file: Path) -> None:
    draft = Draft.open(file)
    draft.edit({("area", "no_fly"): [[3, 4]], ("simulate", "count"): 3})
    draft.save()
    config = load(file, check_config)
    assert config.area.no_fly == ((3, 4),)
    assert config.simulate is not None
    assert config.simulate.count == 3
    assert [path.name for path in file.parent.iterdir()] == ["swarm.yaml"]


def test_bad_values_are_refused_with_their_place(file: Path) -> None:
    before = file.read_bytes()
    draft = Draft.open(file)
    draft.edit({("area", "rows"): 0})
    with pytest.raises(ConfigError) as refused:
        draft.save()
    assert refused.value.lines[0].startswith(f"{file}:9: area.rows: ")
    assert file.read_bytes() == before


def test_a_file_that_another_program_has_changed_is_left_alone(file: Path) -> None:
    draft = Draft.open(file)
    draft.edit({("seed",): 9})
    file.write_text("name: other\n")
    with pytest.raises(ConfigError):
        draft.save()
    assert file.read_text() == "name: other\n"


def test_a_new_file_begins_with_the_starter(tmp_path: Path) -> None:
    draft = Draft.open(tmp_path / "new.yaml")
    assert not draft.path.exists()
    draft.save()
    assert load(draft.path, check_config).area.rows == 20


@pytest.mark.parametrize(
    ("tool", "at", "path", "value"),
    [
        ("no_fly", (220.0, 160.0), ("area", "no_fly"), ((3, 4),)),
        ("hostile", (220.0, 160.0), ("threats", "hostiles"), ((3, 4),)),
        ("goal", (990.0, 10.0), ("simulate", "goal"), (0, 19)),
        ("start", (500.0, -80.0), ("simulate", "start_side"), "south"),
        ("start", (500.0, 1120.0), ("simulate", "start_distance_m"), 120.0),
    ],
)
def test_a_click_sets_a_value(
    file: Path, tool: str, at: tuple[float, float], path: tuple[str, ...], value: object
) -> None:
    draft = Draft.open(file)
    config, _ = draft.checked()
    assert config is not None
    draft.edit(edits_of_click(config, tool, SIMULATED, at))
    assert draft.value(path) == value


def test_the_start_of_a_vehicle_by_url_goes_to_the_click() -> None:
    draft = Draft.open(example("sitl"))
    config, _ = draft.checked()
    assert config is not None
    name = config.vehicles[1].name
    draft.edit(edits_of_click(config, "start", name, (-50.0, 300.0)))
    changed, _ = draft.checked()
    assert changed is not None
    start = changed.vehicles[1].start
    assert config.grid.frame.to_local(start.lat_deg, start.lon_deg) == pytest.approx((-50.0, 300.0), abs=0.2)


def test_the_first_routes_are_those_of_plan(file: Path) -> None:
    scenario = build(load(file, check_config))
    planned = first_plans.first_routes(scenario)[scenario.chosen_by]
    shown = first_routes(scenario)
    assert [each.route.exposure_sum for each in shown] == pytest.approx(
        [first.route.exposure_sum for first in planned]
    )
