"""A study: its folder is the same bytes whatever the workers and interruptions, and nothing is lost."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from study_experiments import FACTORS, experiment_file, quick_kind, small_experiment

from swarmctl.study import provenance
from swarmctl.study.cluster import ClusterError, Workers, local_workers
from swarmctl.study.experiment import Experiment, load_experiment
from swarmctl.study.kinds import KINDS
from swarmctl.study.results import ResultsError, open_results
from swarmctl.study.run import Outcome, run

# Dask warns of a slow disk and of a busy machine.
pytestmark = [
    pytest.mark.filterwarnings("ignore::UserWarning:distributed"),
    pytest.mark.filterwarnings("ignore:Creating scratch"),
]


class Interrupted(Exception):
    """An interruption."""


@pytest.fixture(autouse=True)
def quick_missions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KINDS, "missions", quick_kind())


@pytest.fixture(scope="module")
def threads() -> Iterator[Workers[Any, Any]]:
    with local_workers(2, processes=False) as workers:
        yield workers


def study(
    experiment: Experiment, folder: Path, workers: Workers[Any, Any], stop_after: int = 10**9
) -> Outcome:
    """Run a study, and interrupt it after a number of finished missions."""

    def progress(done: int, _total: int) -> None:
        if done >= stop_after:
            raise Interrupted

    with open_results(folder, experiment) as results:
        return run(experiment, results, workers, progress, "swarmctl study")


def test_rows_are_sorted_and_have_every_factor_seed_and_measure(
    tmp_path: Path, threads: Workers[Any, Any]
) -> None:
    outcome = study(small_experiment(tmp_path), tmp_path / "out", threads)
    table = pd.read_parquet(tmp_path / "out" / "results.parquet")
    assert outcome.n_rows == len(table) == 20 * 9
    names = ["level", "planner.w", "simulate.count", "seed", "uav", "strikes", "survived"]
    assert list(table) == names
    assert [str(table[name].dtype) for name in names[:5]] == ["int32", "float64", "int64", "int64", "int16"]
    assert table.equals(table.sort_values(["level", "seed", "uav"], ignore_index=True))
    assert table.groupby(["level", "seed"]).size().to_list() == ([1] * 20 + [2] * 20) * 3
    row = table[(table.level == 3) & (table.seed == 7) & (table.uav == 2)].iloc[0]
    assert (row["planner.w"], row["simulate.count"]) == (0.5, 2)
    assert row.strikes == np.random.default_rng((7, 2)).binomial(9, 0.35)


def test_the_tables_are_the_same_bytes_after_interruptions_and_extensions(
    tmp_path: Path, threads: Workers[Any, Any]
) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    experiment = small_experiment(tmp_path, "tracks: [2, 11]")
    study(experiment, whole, threads)
    for stop_after in (30, 31):
        with pytest.raises(Interrupted):
            study(experiment, parts, threads, stop_after)
    study(small_experiment(tmp_path, "tracks: [2, 11]", worlds=15), parts, threads)
    assert len(pd.read_parquet(parts / "results.parquet")) == 15 * 9
    study(experiment, parts, threads)
    for name in ("results.parquet", "tracks.parquet", "hostiles.parquet"):
        assert (parts / name).read_bytes() == (whole / name).read_bytes()
    tracks = pd.read_parquet(whole / "tracks.parquet")
    assert tracks.groupby("level").seed.unique().map(list).to_list() == [[2, 11]] * 6


def test_nothing_is_computed_twice(
    tmp_path: Path, threads: Workers[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = small_experiment(tmp_path)
    study(experiment, tmp_path / "out", threads)
    seeds: list[int] = []
    monkeypatch.setitem(KINDS, "missions", quick_kind(seeds.append))
    study(experiment, tmp_path / "out", threads)
    assert seeds == []


def test_a_study_can_be_done_again_from_its_folder(tmp_path: Path, threads: Workers[Any, Any]) -> None:
    folder = tmp_path / "out"
    study(small_experiment(tmp_path), folder, threads)
    study(load_experiment(folder / "experiment.yaml"), tmp_path / "again", threads)
    assert (tmp_path / "again" / "results.parquet").read_bytes() == (folder / "results.parquet").read_bytes()
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["versions"] == provenance.versions()
    assert (manifest["first_seed"], manifest["worlds"], manifest["missions"]) == (0, 20, 120)
    assert manifest["factors"] == {"planner.w": [0.0, 0.5, 1.0], "simulate.count": [1, 2]}


@pytest.mark.parametrize(
    ("change", "named"),
    [("set: {threats.count: 30}", "set.threats.count"), ("tracks: [1]", "tracks"), ("first_seed: 5", "")],
)
def test_the_folder_of_another_experiment_is_refused(
    change: str, named: str, tmp_path: Path, threads: Workers[Any, Any]
) -> None:
    folder = tmp_path / "out"
    study(small_experiment(tmp_path), folder, threads)
    changed = small_experiment(tmp_path, change)
    if not named:  # other seeds of the same experiment
        assert study(changed, folder, threads).n_rows == 20 * 9
        return
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(ResultsError, match=rf"{named}.*\[other-experiment\]"):
        study(changed, folder, threads)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_other_factors_are_named_instead_of_their_levels(tmp_path: Path, threads: Workers[Any, Any]) -> None:
    study(small_experiment(tmp_path), tmp_path / "out", threads)
    other = load_experiment(experiment_file(tmp_path, "factors: {planner.w: [0, 1]}"), 20)
    with pytest.raises(ResultsError, match=r"factors\.planner\.w") as refused:
        study(other, tmp_path / "out", threads)
    assert "factors.simulate.count" in str(refused.value)
    assert "levels" not in str(refused.value)


def test_more_missions_than_fit_the_disk_are_refused(tmp_path: Path) -> None:
    experiment = small_experiment(tmp_path, worlds=10**12)
    with pytest.raises(ResultsError, match=r"\[disk-too-small\]"), open_results(tmp_path / "out", experiment):
        pass
    assert not (tmp_path / "out").exists()


def test_two_studies_do_not_write_one_folder(tmp_path: Path) -> None:
    experiment = small_experiment(tmp_path)
    with (
        open_results(tmp_path / "out", experiment),
        pytest.raises(ResultsError, match=r"\[folder-taken\]"),
        open_results(tmp_path / "out", experiment),
    ):
        pass


def test_a_damaged_part_is_named(tmp_path: Path, threads: Workers[Any, Any]) -> None:
    experiment = small_experiment(tmp_path)
    study(experiment, tmp_path / "out", threads)
    part = next((tmp_path / "out" / "parts").glob("*-rows.parquet"))
    part.write_bytes(part.read_bytes()[:100])
    with pytest.raises(ResultsError, match=rf"{part.name}.*\[part-damaged\]"):
        study(experiment, tmp_path / "out", threads)


def test_an_experiment_ends_at_the_first_block_that_is_precise_enough(
    tmp_path: Path, threads: Workers[Any, Any]
) -> None:
    until = "until: {measure: strikes, half_width: 0.5, block: 10}"
    path = experiment_file(tmp_path, FACTORS, until)
    outcome = study(load_experiment(path), tmp_path / "out", threads)
    assert outcome.widest is not None
    assert outcome.widest <= 0.5
    assert outcome.n_worlds % 10 == 0
    assert 10 < outcome.n_worlds < 1000
    table = pd.read_parquet(tmp_path / "out" / "results.parquet")
    assert table.seed.max() == outcome.n_worlds - 1
    with pytest.raises(Interrupted):
        study(load_experiment(path), tmp_path / "two", threads, 70)
    assert study(load_experiment(path), tmp_path / "two", threads) == outcome


def test_the_precision_is_told_before_each_further_block_until_there_are_no_more_worlds(
    tmp_path: Path, threads: Workers[Any, Any]
) -> None:
    until = "until: {measure: strikes, half_width: 0.001, block: 8}"
    experiment = small_experiment(tmp_path, until, worlds=20)
    told: list[tuple[int, float]] = []
    with open_results(tmp_path / "out", experiment) as results:
        outcome = run(
            experiment, results, threads, lambda *_: None, "", lambda n, widest: told.append((n, widest))
        )
    assert [n for n, _ in told] == [8, 16]
    assert all(widest > 0.001 for _, widest in [*told, (outcome.n_worlds, outcome.widest)])
    assert (outcome.n_worlds, outcome.n_rows) == (20, 180)


def test_a_bug_in_a_mission_names_level_and_seeds(
    tmp_path: Path, threads: Workers[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(seed: int) -> None:
        if seed == 13:
            raise ZeroDivisionError

    monkeypatch.setitem(KINDS, "missions", quick_kind(fail))
    with pytest.raises(ZeroDivisionError) as bug:
        study(small_experiment(tmp_path), tmp_path / "out", threads)
    assert "Batch(level=" in bug.value.__notes__[0]


def test_workers_with_another_program_are_refused(
    tmp_path: Path, threads: Workers[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmctl.study.kinds.versions", lambda: provenance.versions() | {"numpy": "1.0"})
    with pytest.raises(ClusterError, match=r"numpy 1.0.*\[worker-other\]"):
        study(small_experiment(tmp_path), tmp_path / "out", threads)
