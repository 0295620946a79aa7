"""The report of a results folder: summary.csv, the figures' files, and one page without links."""

from __future__ import annotations

import json
import re
from pathlib import Path

import made_up_study
import pandas as pd
import pytest

from swarmctl.study.report import ReportError, write

FACTORS = {"planner.w": [0.0, 1.0], "communication.range": [0, "all"]}
LINES = {"kind": "lines", "x": "planner.w", "y": "strikes", "by": "communication.range", "name": "danger"}


def test_a_report_is_one_page_that_needs_no_other_file(tmp_path: Path) -> None:
    folder = made_up_study.folder(tmp_path / "results", FACTORS, [LINES], n_worlds=10)
    text = write(folder).read_text(encoding="utf-8")
    links = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert links
    assert all(link.startswith("data:") for link in links)
    assert "Does communication save strikes?" in text
    assert "abc1234" in text
    assert sorted(path.name for path in (folder / "figures").glob("*.p*")) == ["danger.pdf", "danger.png"]


def test_the_summary_has_the_means_of_the_table(tmp_path: Path) -> None:
    folder = made_up_study.folder(tmp_path / "results", FACTORS, [], n_worlds=10)
    write(folder)
    summary = pd.read_csv(folder / "summary.csv")
    table = pd.read_parquet(folder / "results.parquet")
    by_level = table.groupby("level")
    assert summary["strikes"].tolist() == pytest.approx(by_level["strikes"].mean().tolist(), rel=1e-5)
    assert summary["survived"].tolist() == pytest.approx(by_level["survived"].mean().tolist(), rel=1e-5)
    per_mission = table.groupby(["level", "seed"])["strikes"].sum().groupby("level").mean()
    assert summary["mission_strikes"].tolist() == pytest.approx(per_mission.tolist(), rel=1e-5)
    assert (summary["strikes_low"] < summary["strikes"]).all()
    assert summary["communication.range"].tolist() == ["0", "all", "0", "all"]
    assert summary["worlds"].tolist() == [10] * 4


def test_one_wrong_figure_does_not_cost_the_others(tmp_path: Path) -> None:
    wrong = {"kind": "lines", "x": "planner.w", "y": "strikes"}
    folder = made_up_study.folder(tmp_path / "results", FACTORS, [wrong, LINES], n_worlds=10)
    with pytest.raises(ReportError, match=r"communication\.range"):
        write(folder)
    assert (folder / "figures" / "danger.png").exists()
    assert "data:image" in (folder / "report.html").read_text(encoding="utf-8")


def test_a_renamed_figure_leaves_no_old_file_and_other_files_stay(tmp_path: Path) -> None:
    folder = made_up_study.folder(tmp_path / "results", FACTORS, [LINES], n_worlds=10)
    write(folder)
    (folder / "figures" / "mine.png").touch()
    experiment = folder / "experiment.yaml"
    experiment.write_text(experiment.read_text(encoding="utf-8").replace("danger", "harm"), encoding="utf-8")
    write(folder)
    found = sorted(path.name for path in (folder / "figures").glob("*.p*"))
    assert found == ["harm.pdf", "harm.png", "mine.png"]


def test_a_level_that_was_left_out_is_a_gap(tmp_path: Path) -> None:
    folder = made_up_study.folder(tmp_path / "results", FACTORS, [LINES], n_worlds=10)
    table = pd.read_parquet(folder / "results.parquet")
    table[table["level"] != 1].to_parquet(folder / "results.parquet")
    write(folder)
    assert pd.read_csv(folder / "summary.csv")["level"].tolist() == [0, 2, 3]


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ReportError, match="manifest"):
        write(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps({"rows": 1}), encoding="utf-8")
    with pytest.raises(ReportError, match=r"results\.parquet"):
        write(tmp_path)
