"""Simultaneous and staggered arrival in whole flights on the virtual clock."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from flights import fly, small

from swarmctl.report.flight_table import swarm_lines

pytestmark = pytest.mark.virtual


def test_vehicles_arrive_simultaneously_although_routes_change(tmp_path: Path) -> None:
    report = fly(small(arrival={"mode": "simultaneous"}), tmp_path)
    assert [state.outcome for state in report.states.values()] == ["arrived"] * 3
    assert sum(state.plans.replans for state in report.states.values()) > 0
    lengths_m = [state.flown.length_m for state in report.states.values()]
    assert max(lengths_m) - min(lengths_m) > 50.0  # five seconds at full speed
    arrival = json.loads((tmp_path / "summary.json").read_text())["arrival"]
    assert arrival["spread_s"] <= 2.0
    assert arrival["kept"] is True
    spread_s = report.summary["arrival"]["spread_s"]
    assert spread_s == pytest.approx(arrival["spread_s"], abs=0.001)
    assert any(f" {spread_s:.1f} s (" in line for line in swarm_lines(report.summary))


@pytest.mark.full
def test_staggered_vehicles_arrive_one_after_the_other(tmp_path: Path) -> None:
    report = fly(small(arrival={"mode": "staggered", "spacing_s": 8.0}), tmp_path)
    arrival = report.summary["arrival"]
    after_s = [vehicle["after_the_first_s"] for vehicle in arrival["vehicles"]]
    assert after_s == pytest.approx([0.0, 8.0, 16.0], abs=3.0)
    assert arrival["kept"] is (arrival["spread_s"] <= 3.0)


@pytest.mark.full
def test_vehicles_choose_longer_routes_where_speed_alone_is_not_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last vehicle is due 40 s after the first and flies at 8 m/s or faster.

    On its shortest route it would arrive half a minute too early.
    """
    staggered = {"mode": "staggered", "spacing_s": 20.0, "slowest_m_s": 8.0, "tolerance_s": 5.0}
    chosen = fly(small(seed=11, arrival=staggered), tmp_path / "chosen")
    assert [state.outcome for state in chosen.states.values()] == ["arrived"] * 3
    assert chosen.summary["arrival"]["kept"] is True
    assert chosen.summary["arrival"]["spread_s"] <= 5.0
    monkeypatch.setattr(
        "swarmctl.agent.arrival.simultaneous.update_spare_time", lambda state, _due_s, _soonest_s: state
    )
    by_speed = fly(small(seed=11, arrival=staggered), tmp_path / "by_speed")
    assert by_speed.summary["arrival"]["spread_s"] > 25.0
    flown_m = [run.states[3].flown.length_m for run in (chosen, by_speed)]
    assert flown_m[0] > flown_m[1] + 150.0
