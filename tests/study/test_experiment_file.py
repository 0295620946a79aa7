"""Experiment files: their levels, and the errors before the first mission."""

from __future__ import annotations

from pathlib import Path

import pytest
from study_experiments import experiment_file, small_experiment
from swarmctl_process import ROOT, SHIPPED

from swarmctl.config.problems import ConfigError
from swarmctl.study.experiment import load_experiment


def test_every_combination_of_values_is_a_level(tmp_path: Path) -> None:
    experiment = small_experiment(tmp_path)
    found = [(s.config.planner.w, s.config.simulate.count) for s in experiment.setups]  # type: ignore[union-attr]
    assert found == [(0, 1), (0, 2), (0.5, 1), (0.5, 2), (1, 1), (1, 2)]
    assert experiment.levels[3].values == {"planner.w": 0.5, "simulate.count": 2}
    assert experiment.most_rows == 20 * (1 + 2) * 3


def test_a_range_is_evenly_spaced_with_both_ends(tmp_path: Path) -> None:
    line = "factors: {planner.w: {from: 0, to: 1, steps: 21}, simulate.count: {from: 2, to: 6, steps: 3}}"
    values = load_experiment(experiment_file(tmp_path, line)).values
    assert values["planner.w"][:4] == [0.0, 0.05, 0.1, 0.15]
    assert len(values["planner.w"]) == 21
    assert values["simulate.count"] == [2, 4, 6]


def test_the_keys_of_a_paired_list_change_together(tmp_path: Path) -> None:
    near = "{name: near, communication.range: 1, communication.delay_s: 3}"
    path = experiment_file(tmp_path, f"factors: {{radio: [{near}, {{name: base}}]}}")
    experiment = load_experiment(path)
    assert [level.values for level in experiment.levels] == [{"radio": "near"}, {"radio": "base"}]
    radios = [setup.config.communication for setup in experiment.setups]
    assert [(radio.range, radio.delay_s) for radio in radios] == [(1, 3.0), ("all", 0.0)]


def test_set_changes_all_levels_and_a_whole_section_can_be_a_value(tmp_path: Path) -> None:
    planners = "planner: [{name: dijkstra, w: 1}, {name: survival}]"
    path = experiment_file(tmp_path, "set: {threats.count: 30}", f"factors: {{{planners}}}")
    experiment = load_experiment(path)
    assert [setup.config.planner.name for setup in experiment.setups] == ["dijkstra", "survival"]
    assert {setup.config.threats.count for setup in experiment.setups} == {30}


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("communication.range < simulate.count", [(0, 1), (0, 3), (2, 3)]),
        ("communication.range == 2", [(2, 1), (2, 3)]),
        ("simulate.count >= 3", [(0, 3), (2, 3)]),
    ],
)
def test_where_leaves_out_combinations(
    condition: str, expected: list[tuple[int, int]], tmp_path: Path
) -> None:
    factors = "factors: {communication.range: [0, 2], simulate.count: [1, 3]}"
    experiment = load_experiment(experiment_file(tmp_path, factors, f"where: [{condition}]"))
    assert [tuple(level.values.values()) for level in experiment.levels] == expected


@pytest.mark.parametrize(
    ("lines", "place", "hint"),
    [
        (["factors: {planer.w: [0, 1]}"], "3: factors.planer.w", "'planner'"),
        (["factors: {planner.wide: [0, 1]}"], "3: factors.planner.wide", "planner.wide: unknown key"),
        (["factors: {planner.w..x: [0, 1]}"], "3: factors.planner.w..x", "malformed"),
        (["factors:", "  count: [5]"], "4: factors.count", "LABEL"),
        (["set: {flight.altitude: 5}"], "3: set.flight.altitude", "'altitude_m'"),
        (["factors: {radio: [{name: x, communication.rnge: 1}]}"], "3: factors.radio", "'range'"),
        (["factors: {seed: [1, 2]}"], "3: factors.seed", "first_seed"),
        (["factors: {strikes: [{name: x}]}"], "3: factors.strikes", ""),
        (["factors: {planner.w: []}"], "3: factors.planner.w", ""),
        (["factors: {planner.w: [0, 0]}"], "3: factors.planner.w", ""),
        (["set: {planner.w: 1}", "factors: {planner.w: [0]}"], "4: factors.planner.w", "set"),
        (["factors:", "  planner.w: [0.5, high]"], "4: factors.planner.w", "planner.w = high"),
        (["factors: {planner.w: [0.5, 1.5]}"], "3: factors.planner.w", "planner.w = 1.5"),
        (["factors: {simulate.count: [5, 251]}"], "3: factors.simulate.count", "simulate.count = 251"),
        (
            ["factors: {area.rows: [3, 20]}", "set: {threats.count: 100}"],
            "4: set.threats.count",
            "area.rows = 3",
        ),
        (["set: {threats.count: 401}"], "3: set.threats.count", "401"),
        (["set: {arrival: {mode: simultaneous}}"], "1: factors", "arrival"),
        (["set: {area.no_fly.x: 1}"], "3: set.area.no_fly.x", "area.no_fly"),
        (["set: {'vehicles[0].goal': [1, 2]}"], "3: set.vehicles[0].goal", "item [0]"),
        (["where: [planner.w < 1]"], "3: where", "planner.w"),
        (["factors: {planner.w: [0]}", "where: [planner.w ~ 1]"], "4: where", "FACTOR OPERATOR VALUE"),
        (["factors: {planner.w: [0]}", "where: [planner.w > 1]"], "4: where", ""),
        (["factors: {communication.range: [0, all]}", "where: [communication.range < 3]"], "4: where", "all"),
        (["until: {measure: strike, half_width: 0.1}"], "3: until.measure", "'strikes'"),
        (["until: {measure: strikes, half_width: 0}"], "3: until.half_width", ""),
        (["worlds: 5", "tracks: [0, 5]"], "4: tracks[1]", "0 to 4"),
        (["kind: mission"], "3: kind", "missions"),
        (["search: {method: annealing}"], "3: search", "missions"),
        (["figures: [{kind: lnes, x: planner.w, y: strikes}]"], "3: figures[0]", "lines"),
        (["world: 5"], "3: world", "'worlds'"),
    ],
)
def test_an_error_names_its_line_and_key(lines: list[str], place: str, hint: str, tmp_path: Path) -> None:
    path = experiment_file(tmp_path, *lines)
    with pytest.raises(ConfigError) as refused:
        load_experiment(path)
    (text,) = refused.value.lines
    assert text.startswith(f"{path}:{place}")
    assert hint in text


def test_all_errors_of_a_file_are_reported_at_once(tmp_path: Path) -> None:
    lines = ["factors: {planer.w: [0, 1]}", "set: {seed: 5}", "tracks: [2000]"]
    with pytest.raises(ConfigError) as refused:
        load_experiment(experiment_file(tmp_path, *lines))
    assert [line.split(":")[1] for line in refused.value.lines] == ["3", "4", "5"]


def test_an_error_of_several_levels_is_reported_once_with_their_number(tmp_path: Path) -> None:
    lines = ["factors: {simulate.count: [2, 300], planner.w: [0, 0.5, 1]}"]
    with pytest.raises(ConfigError) as refused:
        load_experiment(experiment_file(tmp_path, *lines))
    (text,) = refused.value.lines
    assert "simulate.count = 300, planner.w = 0" in text
    assert "2 more levels" in text


def test_a_wrong_base_is_reported_in_its_own_file(tmp_path: Path) -> None:
    path = experiment_file(tmp_path, base=SHIPPED.read_text().replace("w: 0.5", "w: 5"))
    with pytest.raises(ConfigError) as refused:
        load_experiment(path)
    assert refused.value.lines[0].startswith(f"{tmp_path / 'swarm.yaml'}:20: planner.w")
    (tmp_path / "swarm.yaml").unlink()
    with pytest.raises(ConfigError) as refused:
        load_experiment(path)
    assert refused.value.lines[0].startswith(f"{path}:2: base")


@pytest.mark.parametrize("lines", [[], ["worlds: 7  # few"]])
def test_the_copy_in_the_folder_is_the_same_experiment(lines: list[str], tmp_path: Path) -> None:
    experiment = small_experiment(tmp_path / "one", *lines, worlds=3)
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "experiment.yaml").write_text(experiment.portable_text, encoding="utf-8")
    (tmp_path / "two" / "base.yaml").write_text(experiment.base_text, encoding="utf-8")
    again = load_experiment(tmp_path / "two" / "experiment.yaml")
    assert again.identity == experiment.identity
    assert again.worlds == 3


@pytest.mark.parametrize("path", sorted((ROOT / "configs" / "studies").glob("*.yaml")), ids=lambda p: p.stem)
def test_a_shipped_experiment_has_no_problems(path: Path) -> None:
    experiment = load_experiment(path)
    assert experiment.worlds >= (30 if experiment.section.kind == "flights" else 1000)
