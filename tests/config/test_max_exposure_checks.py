"""A maximum exposure that excludes every route is reported with the least value that does not."""

from __future__ import annotations

from pathlib import Path

import pytest
from swarmctl_process import SHIPPED, swarmctl

from swarmctl.cli.console import OK, USAGE


def checked(limit: float, folder: Path, area: str = "") -> tuple[int, str]:
    config = folder / "limited.yaml"
    text = SHIPPED.read_text().replace("  name: dijkstra", f"  name: dijkstra\n  max_exposure: {limit}")
    config.write_text(text.replace("  cell_size_m: 50", f"  cell_size_m: 50\n{area}"))
    result = swarmctl("check", "--config", config, "--out", folder / "runs")
    return result.exit_code, result.output


def test_the_least_value_with_a_route_is_reported_and_has_one(tmp_path: Path) -> None:
    # Border cells of the prior have P_s 0.102 (the model): less excludes every route across the area.
    code, output = checked(0.1, tmp_path)
    assert code == USAGE
    assert "planner.max_exposure: uav3 " in output
    assert " 0.1021" in output
    assert "area.no_fly" not in output
    assert checked(0.1021, tmp_path)[0] == OK


@pytest.mark.parametrize("limit", [0.1, 0.5])
def test_cells_of_no_fly_that_exclude_every_route_are_reported(limit: float, tmp_path: Path) -> None:
    wall = ", ".join(f"[{row}, 10]" for row in range(20))
    code, output = checked(limit, tmp_path, f"  no_fly: [{wall}]")
    assert code == USAGE
    assert "area.no_fly" in output
    assert "max_exposure:" not in output
