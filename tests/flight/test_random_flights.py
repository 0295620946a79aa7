"""Randomly drawn flights with faults, other stations and orders: rules that no flight may break."""

from __future__ import annotations

from pathlib import Path

import pytest
from flight_monitor import FlightMonitor, findings
from flights import SEPARATION_WAIVED, fly
from random_flights import RandomFlight, draw

pytestmark = pytest.mark.virtual

FILES = ("run.mcap", "evidence.jsonl", "summary.json", "map.png", "uav1.plan", "uav1.tlog", "uav2.tlog")


def flown(drawn: RandomFlight, folder: Path) -> list[str]:
    """Fly and return a line for each broken rule."""
    monitor = FlightMonitor(drawn)
    monitor.attend()
    report = fly(drawn.scenario, folder, trouble=drawn.trouble, options=SEPARATION_WAIVED, bus=drawn.bus)
    return findings(monitor, report, folder)


@pytest.mark.parametrize("seed", range(103, 111))
def test_no_drawn_flight_breaks_a_rule(seed: int, tmp_path: Path) -> None:
    drawn = draw(seed)
    assert flown(drawn, tmp_path) == [], drawn.story


def test_equal_seeds_leave_equal_files(tmp_path: Path) -> None:
    for name in ("one", "other"):
        flown(draw(104), tmp_path / name)
    for file in FILES:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes(), file
