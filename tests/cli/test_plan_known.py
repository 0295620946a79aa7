"""`swarmctl plan --known RUN`: planning with what an earlier run has seen."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_runner import swarmctl

SMALL = """\
name: small
area: {{origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: {rows}, cols: 8, cell_size_m: 50}}
threats: {{count: 5}}
simulate: {{count: 2, ready_s: 3.0}}
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder."""
    folder = tmp_path_factory.mktemp("known")
    (folder / "small.yaml").write_text(SMALL.format(rows=8))
    done = swarmctl("fly", "--clock", "virtual", "--config", folder / "small.yaml", "--out", folder / "runs")
    assert done.exit_code == 0, done.output
    (run,) = (folder / "runs").iterdir()
    return run


def exposures(folder: Path, *words: str | Path) -> list[float]:
    config = folder / "small.yaml"
    config.write_text(SMALL.format(rows=8))
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


@pytest.mark.parametrize("words", [(), ("--front",)])
def test_a_run_over_another_area_is_refused(words: tuple[str, ...], flown: Path, tmp_path: Path) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL.format(rows=3))
    done = swarmctl("plan", "--config", config, "--out", tmp_path / "runs", "--known", flown, *words)
    assert done.exit_code == 2
    assert "rows 8, here 3 [other-area]" in done.output
    assert not (tmp_path / "runs").exists()


def test_an_invalid_run_is_an_error_with_its_path(flown: Path, tmp_path: Path) -> None:
    config = flown.parent.parent / "small.yaml"
    done = swarmctl("plan", "--config", config, "--out", tmp_path / "runs", "--known", tmp_path)
    assert done.exit_code == 2
    assert "[no-record]" in done.output


@pytest.mark.parametrize(
    ("old", "new", "code", "says"),
    [
        ("", "", 0, "prior: "),
        ("14.4", "14.5", 2, "[other-area]"),
        ("cell_size_m: 50", "cell_size_m: 40", 2, "cell_size_m 50, here 40"),
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
    old: str, new: str, code: int, says: str, flown: Path, tmp_path: Path
) -> None:
    config = tmp_path / "small.yaml"
    config.write_text(SMALL.format(rows=8).replace(old, new, 1) if old else SMALL.format(rows=8))
    done = swarmctl("plan", "--config", config, "--out", tmp_path / "runs", "--known", flown)
    assert done.exit_code == code, done.output
    assert says in done.output
