"""Whole flights on a network with loss, delay and partitions, on the virtual clock."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from flights import fly, small

from swarmctl.report import record

pytestmark = [pytest.mark.virtual, pytest.mark.full]

POOR: dict[str, Any] = {
    "bus": "memory",
    "range": 2,
    "relay": True,
    "delay_s": 0.2,
    "jitter_s": 0.3,
    "loss": 0.2,
    "loss_burst": 3.0,
    "bandwidth_bytes_s": 5000.0,
    "partitions": [{"from_s": 20.0, "until_s": 45.0, "groups": [["uav1", "uav2"], [3, 4]]}],
    "quiet": [{"uavs": ["uav2"], "from_s": 10.0, "until_s": 30.0}],
    "penalty_per_m": 0.01,
}
FOUR = {"count": 4, "ready_s": 3.0, "delay_step_s": 4.0}


def test_a_swarm_on_a_poor_network_arrives_and_agrees(tmp_path: Path) -> None:
    report = fly(small(communication=POOR, simulate=FOUR), tmp_path)
    assert report.all_arrived
    assert len({state.belief.looks.tobytes() for state in report.states.values()}) == 1
    rows = json.loads((tmp_path / "summary.json").read_text())["vehicles"]
    lost = {why for row in rows for why in row["network"]["lost"]}
    assert {"loss", "partition"} <= lost
    assert rows[1]["network"]["lost"]["quiet"] > 5
    assert all(row["network"]["refused"] == {} for row in rows)
    assert record.replay(tmp_path / "run.mcap").difference == ""


def test_equal_seeds_leave_equal_files_and_another_seed_does_not(tmp_path: Path) -> None:
    """Hostiles, their number, sensors, the network and the vehicles draw from the seed."""
    drawn = {
        "threats": {"count": {"distribution": "uniform", "min": 3, "max": 8}},
        "sensor": {"p_miss": 0.2, "p_false_alarm": 0.05},
        "communication": POOR,
        "simulate": FOUR,
    }
    runs = [tmp_path / name for name in ("one", "same", "other")]
    for run, seed in zip(runs, (3, 3, 4), strict=True):
        fly(small(**drawn, seed=seed), run)
    for file in ("run.mcap", "summary.json", "map.png", "uav1.plan", "uav1.tlog"):
        one, same, other = ((run / file).read_bytes() for run in runs)
        assert one == same, file
        assert one != other, file


def test_network_delay_separates_observation_and_belief(tmp_path: Path) -> None:
    at_once = fly(small(), tmp_path / "at once").summary["latency"]["observation_to_last_peers_belief_s"]
    late = {"bus": "memory", "delay_s": 1.5}
    delayed = fly(small(communication=late), tmp_path / "late").summary["latency"]
    assert at_once["max"] < 0.1
    assert delayed["observation_to_last_peers_belief_s"]["p50"] == pytest.approx(1.5, abs=0.1)


def test_vehicles_below_the_minimum_distance_exchange_nothing(tmp_path: Path) -> None:
    near = {"bus": "memory", "min_distance_m": 5000.0}
    report = fly(small(communication=near), tmp_path)
    assert report.all_arrived
    for row in report.summary["vehicles"]:
        # Before the first position no vehicle is too near.
        assert row["network"]["lost"]["too_near"] > 50
        assert row["cells_received"] == 0
