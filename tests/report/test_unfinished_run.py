"""The choice of the run that a new program continues."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from swarmctl.report.unfinished_run import MAX_AGE_S, is_unfinished, last_run

NAMES = (
    "20260101-100000-swarm",
    "20260101-110000-swarm-2",
    "20260101-120000-swarm-uav1",
    "20260101-130000-other",
)


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    for hour, name in enumerate(NAMES):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "run.mcap").touch()
        os.utime(folder / "run.mcap", (3600.0 * hour, 3600.0 * hour))
    (tmp_path / "20260101-140000-swarm").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("name", "expected"), [("", NAMES[3]), ("swarm", NAMES[1]), ("swarm-uav1", NAMES[2]), ("nobody", None)]
)
def test_the_last_run_is_the_newest_record_of_its_name(runs: Path, name: str, expected: str | None) -> None:
    found = last_run(runs, name)
    assert (found and found.name) == expected


def test_an_old_record_is_of_no_vehicle_in_the_air(runs: Path) -> None:
    run = runs / NAMES[3]
    written_s = 3.0 * 3600.0
    assert is_unfinished(run, written_s + MAX_AGE_S - 1.0)
    assert not is_unfinished(run, written_s + MAX_AGE_S + 1.0)
