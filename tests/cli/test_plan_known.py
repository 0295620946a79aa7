"""`swarmctl plan --known RUN`: planning with the observations of an earlier run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from swarmctl_process import SMALL, CliFlight, swarmctl


@pytest.fixture
def flown(small_flight: CliFlight) -> Path:
    """A run folder."""
    return small_flight.run


def exposures(folder: Path, *words: str | Path) -> list[float]:
    config = folder / "small.yaml"
    config.write_text(SMALL)
    done = swarmctl("plan", "--front", "--config", config, "--out", folder / "runs", *words)
    assert done.exit_code == 0, done.output
    (run,) = (folder / "runs").iterdir()
    content = json.loads((run / "front.json").read_text())
    return [route["exposure_sum"] for vehicle in content["vehicles"] for route in vehicle["routes"]]


def test_earlier_observations_change_the_front(flown: Path, tmp_path: Path) -> None:
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    known = exposures(tmp_path / "with", "--known", flown)
    assert min(known) < min(exposures(tmp_path / "without"))
    summary = json.loads((flown / "summary.json").read_text())
    assert summary["hostiles"]["found"] > 0


def test_an_invalid_run_is_an_error_with_its_path(flown: Path, tmp_path: Path) -> None:
    config = flown.parent.parent / "small.yaml"
    done = swarmctl("plan", "--config", config, "--out", tmp_path / "runs", "--known", tmp_path)
    assert done.exit_code == 2
    assert "[no-run]" in done.output


@pytest.mark.parametrize(
    ("old", "new", "code", "part"),
    [
        ("", "", 0, "prior: "),
        ("14.4", "14.5", 2, "[other-area]"),
        ("cell_size_m: 50", "cell_size_m: 40", 2, "cell_size_m 50"),
        ("name: small", "name: small\nseed: 9", 0, "[other-hostiles]"),
        ("name: small", "name: small\nsensor: {p_miss: 0.1}", 0, "[other-sensor]"),
        ("count: 5", "count: 1", 0, "[count-too-low]"),
        (
            "name: small",
            "name: small\nplanner: {max_exposure: 0.25}",
            1,
            "uav1: ",
        ),
    ],
)
def test_differences_of_the_earlier_run_are_printed(
    old: str, new: str, code: int, part: str, flown: Path, tmp_path: Path
) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL.replace(old, new, 1))
    done = swarmctl("plan", "--config", config, "--out", tmp_path / "runs", "--known", flown)
    assert done.exit_code == code, done.output
    assert part in done.output
