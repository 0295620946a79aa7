"""The kind `flights`: rows that agree with `summary.json`, and equal bytes whatever the workers."""

from __future__ import annotations

from pathlib import Path

import flights
import numpy as np
import pandas as pd
import pytest
from study_experiments import experiment_file

from swarmctl.config.problems import ConfigError
from swarmctl.config.scenario import build
from swarmctl.core.exposure import exposure
from swarmctl.study.cluster import local_workers
from swarmctl.study.experiment import load_experiment
from swarmctl.study.results import open_results
from swarmctl.study.run import run
from swarmctl.study.world import World

# Dask warns of a slow disk and of a busy machine.
pytestmark = [
    pytest.mark.filterwarnings("ignore::UserWarning:distributed"),
    pytest.mark.filterwarnings("ignore:Creating scratch"),
]

BASE = """
name: pair
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 4, cols: 6, cell_size_m: 50}
threats: {count: 3}
communication: {bus: memory}
formations:
  - {name: alpha, members: [uav1, uav2], approach: virtual_structure, shape: {kind: column, spacing_m: 20}}
flight: {altitude_m: 15}
simulate: {count: 2, ready_s: 3, speed_m_s: 12, start_spacing_m: 20, start_distance_m: 30, goal: [2, 5]}
"""


@pytest.mark.full
def test_rows_agree_with_the_summary_of_the_same_flight_and_do_not_depend_on_workers(tmp_path: Path) -> None:
    lines = ("kind: flights", "factors: {planner.w: [0.5]}", "tracks: [4]", "first_seed: 3", "worlds: 2")
    experiment = load_experiment(experiment_file(tmp_path, *lines, base=BASE))
    for n in (1, 2):
        folder = tmp_path / f"workers-{n}"
        with open_results(folder, experiment) as results, local_workers(n, processes=False) as workers:
            outcome = run(experiment, results, workers, lambda _done, _total: None, "swarmctl study")
        assert (outcome.n_worlds, outcome.n_rows) == (2, 4)
    for name in ("results", "tracks", "hostiles"):
        one, two = ((tmp_path / f"workers-{n}" / f"{name}.parquet").read_bytes() for n in (1, 2))
        assert one == two

    table = pd.read_parquet(folder / "results.parquet")
    scenario = build(experiment.setups[0].config.model_copy(update={"seed": 4}))
    report = flights.fly(scenario, tmp_path / "run")
    (group,) = report.summary["formations"]
    p_s = exposure(World.drawn(scenario, 4).occupancy(), scenario.strength)
    tracks = pd.read_parquet(folder / "tracks.parquet")
    for vehicle, (_, row) in zip(report.summary["vehicles"], table[table.seed == 4].iterrows(), strict=True):
        member = group["members"][vehicle["name"]]
        assert row.arrived == (vehicle["outcome"] == "arrived")
        assert row.survived == (vehicle["strikes"] == 0)
        assert row.length_m == vehicle["flown_m"]
        assert row.flight_time_s == vehicle["arrived_s"]
        assert row.messages_sent == vehicle["network"]["sent"]["inform/observation"]
        assert row.all_messages_sent == vehicle["messages_sent"]
        assert row.cells_known == vehicle["cells_own"] + vehicle["cells_received"] == row.cells_sensed
        for name in ("strikes", "searches", "replans", "hostiles_known", "cells_own"):
            assert row[name] == vehicle[name]
        assert row.rms_along_m == member["rms_error_m"]["along"]
        assert row.largest_across_m == member["largest_error_m"]["across"]
        assert row.in_place_s == member["time_in_place_s"]
        assert (row.shape_changes, row.splits) == (member["shape_changes"], member["splits"])
        cells = tracks[tracks.uav == row.uav][["row", "col"]].to_numpy()
        assert cells.tolist() == [[*cell] for cell in report.states[row.uav].flown.cells]
        assert row.exposure_sum == pytest.approx(p_s[tuple(cells[1:].T)].sum())
    swaths_m = table.cells_sensed * 50**2 / table.groupby("seed").length_m.transform("mean")
    assert np.allclose(table.swath_m, swaths_m)


def test_a_level_that_needs_the_clock_of_the_machine_is_refused(tmp_path: Path) -> None:
    path = experiment_file(tmp_path, "kind: flights", "set: {simulate.link: mavsdk}")
    with pytest.raises(ConfigError, match=r"\[real-clock\]"):
        load_experiment(path)
