"""A maximum exposure that leaves no way is to blame, by name, with the cure."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import SHIPPED, swarmctl


def checked(limit: float, folder: Path, area: str = "") -> str:
    config = folder / "limited.yaml"
    text = SHIPPED.read_text().replace("  name: dijkstra", f"  name: dijkstra\n  max_exposure: {limit}")
    config.write_text(text.replace("  cell_size_m: 50", f"  cell_size_m: 50\n{area}"))
    return swarmctl("check", "--config", config, "--out", folder / "runs").output


def test_what_closes_every_way_is_named_with_the_least_that_opens_one(tmp_path: Path) -> None:
    # Edges of the prior have P_s 0.102 (the model): less leaves no way from side to side.
    said = checked(0.1, tmp_path)
    assert "planner.max_exposure: uav3 cannot reach its goal: 0.1 closes every way" in said
    assert "the least that opens one is 0.1021" in said
    assert "no_fly" not in said
    assert "good." in checked(0.1021, tmp_path)


@pytest.mark.parametrize("limit", [0.1, 0.5])
def test_where_no_fly_cells_close_it_they_are_to_blame(limit: float, tmp_path: Path) -> None:
    wall = ", ".join(f"[{row}, 10]" for row in range(20))
    said = checked(limit, tmp_path, f"  no_fly: [{wall}]")
    assert "open a way in area.no_fly" in said
    assert "max_exposure:" not in said
